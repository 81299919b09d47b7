"""Readings of a condition from windows, and the blocks of the generator."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipeline.nets.dcgan import Block, ChannelScaling, encoded
from pipeline.nets.dcgan_settings import ConditionSpace, GanTraining
from pipeline.nets.dcgan_training import Readers, train_gan, window_features
from pipeline.nets.diversity import features
from tests.nets.wear_signals import CHANNELS, SMALL, TRAINING, windows

X, CONDITIONS = windows()
SPACE = ConditionSpace.of(CONDITIONS, {"wear": "um"})
NUMBERS, WORDS = encoded(SPACE, CONDITIONS)
SCALED = ChannelScaling.of(X).scaled(X)
LEARNT, LEFT = slice(0, None, 2), slice(1, None, 2)


@pytest.fixture(scope="module")
def readers() -> Readers:
    torch.manual_seed(0)
    return Readers(SCALED[LEARNT], NUMBERS[LEARNT], WORDS[LEARNT], read=0, unknown=0.25)


def test_windows_that_were_not_learnt_are_read(readers: Readers) -> None:
    found = readers(SCALED[LEFT], NUMBERS[LEFT], WORDS[LEFT]).mean(dim=1)
    assert (found - NUMBERS[LEFT, 0]).abs().mean() < 0.5 * NUMBERS[LEFT, 0].abs().mean()


def test_the_reading_does_not_rest_on_the_condition_that_is_read(readers: Readers) -> None:
    other = NUMBERS.clone()
    other[:, 0] = -other[:, 0]
    assert torch.equal(readers(SCALED, NUMBERS, WORDS), readers(SCALED, other, WORDS))


def test_windows_of_another_wear_are_further_away(readers: Readers) -> None:
    order = np.argsort(NUMBERS[:, 0].numpy(), kind="stable")
    x, numbers, words = SCALED[order], NUMBERS[order], WORDS[order]
    near = readers.distance((x, x.roll(1, 0), x.roll(2, 0)), numbers, words)
    far = readers.distance((x, x.flip(0), x.flip(0).roll(1, 0)), numbers, words)
    assert far > 2.0 * near


def test_it_moves_windows_and_not_the_readers(readers: Readers) -> None:
    x = SCALED[:8].clone().requires_grad_(True)
    readers.distance((SCALED[8:16], x, SCALED[16:24]), NUMBERS[:8], WORDS[:8]).backward()
    assert x.grad is not None and x.grad.abs().sum() > 0
    assert not any(one.requires_grad for one in readers.parameters())


def test_level_and_spread_are_those_of_the_windows() -> None:
    found = window_features(SCALED).numpy()
    judged = features(SCALED.numpy().astype(float)).reshape(len(X), len(CHANNELS), -1)
    many = len(CHANNELS)
    assert np.allclose(found[:, :many], judged[:, :, 0], atol=1e-5)
    assert np.allclose(found[:, many : 2 * many], 2.0 * judged[:, :, 1], atol=0.2)


@pytest.mark.parametrize("read", ["", "cut"])
def test_what_is_to_be_read_has_to_be_a_number(read: str) -> None:
    with pytest.raises(ValueError, match=r"gan_training\.reading = 1 needs a condition"):
        train_gan(
            SMALL, X, CONDITIONS, training=replace(TRAINING, reading=1.0), channels=CHANNELS,
            read=read,
        )  # fmt: skip


def test_first_steps_need_something_to_learn_from() -> None:
    with pytest.raises(ValueError, match="nothing to learn from"):
        GanTraining(warm=5)
    assert GanTraining(warm=5, reading=1.0).warm == 5


@pytest.mark.parametrize("kernel", [1, 3, 5, 7, 31])
def test_a_block_is_a_convolution_over_each_sample_twice(kernel: int) -> None:
    block = Block(3, 4, replace(SMALL, kernel=kernel))
    x = torch.randn(2, 3, 20)
    twice = x.repeat_interleave(2, dim=2)
    wanted = torch.nn.functional.conv1d(twice, block.conv.weight, padding=kernel // 2)
    normed = torch.nn.functional.leaky_relu(block.norm(wanted), 0.2)
    assert torch.allclose(block(x, None), normed, atol=1e-5)
