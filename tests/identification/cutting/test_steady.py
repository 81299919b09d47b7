"""The steady part: full engagement only, and the zero from the air around it."""

import numpy as np
import pytest

from pipeline.identification.cutting.steady import steady_part

TURN = 150.0


def record(air=3000, ramp=4500, full=9000, zero=0.0):
    """Force that grows over the way in and ends at once, samples 150 a revolution."""
    size = np.concatenate([np.zeros(air), np.linspace(0, 1, ramp), np.ones(full)])
    angle = 2 * np.pi * np.arange(len(size)) / TURN
    shape = np.stack([100 + 80 * np.sin(3 * angle), 60 * np.cos(3 * angle), 20 + 0 * angle], 1)
    noise = np.random.default_rng(0).normal(0, 0.5, shape.shape)
    return size[:, None] * shape + noise + zero


def test_the_way_in_is_left_out():
    steady = steady_part(record(), TURN, 4500.0)
    assert steady.first >= 3000 + 4500 - 2 * TURN  # contact shows within two revolutions
    assert steady.first <= 3000 + 4500 + 5 * TURN
    assert steady.last == 16500


def test_the_zero_is_that_of_the_air():
    steady = steady_part(record(zero=np.array([7.0, -3.0, 2.0])), TURN, 4500.0)
    assert steady.zero_known
    # 20 revolutions of noise of 0.5 N: 0.01 N
    assert steady.zero[steady.first] == pytest.approx([7.0, -3.0, 2.0], abs=0.05)


def test_a_zero_that_drifts_is_a_line_between_air_and_air():
    force = np.concatenate([record(ramp=0), record(full=0, ramp=0)])
    drift = np.linspace(0, 12, len(force))[:, None]
    steady = steady_part(force + drift, TURN, 0.0)
    assert np.abs(steady.zero - drift).max() < 0.1


def test_without_air_the_zero_is_not_known():
    steady = steady_part(record(air=0, ramp=0), TURN, 4500.0)
    assert not steady.zero_known
    assert (steady.first, steady.last) == (0, 9000)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (np.zeros((9000, 3)), "there is no cut"),
        (np.zeros((100, 3)), "shorter than one revolution"),
        (record(full=100), "nowhere fully in the material"),
    ],
)
def test_no_steady_part_is_said(force, message):
    with pytest.raises(ValueError, match=message):
        steady_part(force, TURN, 4500.0)
