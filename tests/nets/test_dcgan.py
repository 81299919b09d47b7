"""Conditional DCGAN: shapes, bits, conditions and their readings, the R1 gradient, collapse."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import spearmanr

from pipeline.nets import dcgan
from pipeline.nets.dcgan_settings import ConditionSpace, GanSettings, GanTraining
from pipeline.nets.dcgan_training import (
    Readers,
    energy_distance,
    gradient_penalty,
    train_gan,
    window_features,
)
from pipeline.nets.diversity import band_edges, band_power, collapse, features
from pipeline.nets.latent_search import LatentSearch, explain
from tests.nets.wear_signals import CHANNELS, LENGTH, SMALL, TRAINING, windows

X, CONDITIONS = windows()
SPACE = ConditionSpace.of(CONDITIONS, {"wear": "um"})
LEARNING = replace(
    TRAINING, steps=310, batch=32, learning_rate=1e-2, beta1=0.8, spectrum=1.0, warm=300, every=10
)


def trained(kind=SMALL, training=TRAINING, x=X, conditions=CONDITIONS, **more):
    return train_gan(
        kind, x, conditions, training=training, channels=CHANNELS, units=("N", "m/s^2"),
        condition_units={"wear": "um"}, read="wear", **more,
    )  # fmt: skip


@pytest.fixture(scope="module")
def learnt():
    return trained(training=LEARNING)


def middle(many: int, **changes):
    return {"wear": np.full(many, 100.0), "cut": np.full(many, "slot"), **changes}


@pytest.mark.parametrize("length", [8, 50, 64, 500])
@pytest.mark.parametrize("condition", ["film", "multiply"])
def test_any_number_of_channels_and_samples(length: int, condition: str) -> None:
    kind = replace(SMALL, condition=condition)
    made = dcgan.Generator(5, length, SPACE, kind)
    score = dcgan.Discriminator(5, SPACE, kind)
    numbers, words = torch.zeros(3, 1), torch.zeros(3, 1, dtype=torch.int64)
    window = made(torch.randn(3, kind.latent), numbers, words)
    assert window.shape == (3, 5, length)
    assert window.abs().max() <= 1.0
    assert score(window, numbers, words).shape == (3,)


def test_every_block_of_the_generator_upsamples() -> None:
    seen = []
    made = dcgan.Generator(2, LENGTH, SPACE, SMALL)
    for block in made.blocks:
        block.register_forward_hook(lambda _, given, out: seen.append((given[0], out)))
    made(torch.randn(1, SMALL.latent), torch.zeros(1, 1), torch.zeros(1, 1, dtype=torch.int64))
    assert [out.shape[2] / given.shape[2] for given, out in seen] == [2.0, 2.0, 2.0]


def test_the_published_sizes_are_the_defaults() -> None:
    kind, training = GanSettings(), GanTraining()
    assert (kind.latent, kind.discriminator, kind.dropout) == (3500, (128, 128, 64, 64), 0.5)
    assert (training.steps, training.learning_rate, training.beta1) == (148_000, 1e-4, 0.5)
    assert training.spectrum == 0.0


SINGLE = (
    {"r1": 1.0, "r1_every": 2}, {"loss": "cross_entropy"}, {"mismatched": 0.5},
    {"spectrum": 1.0, "warm": 3}, {"average": 0.0}, {"reading": 1.0, "warm": 3},
)  # fmt: skip
ALL_AT_ONCE = {name: value for change in SINGLE for name, value in change.items()}


@pytest.mark.parametrize("change", [
    {}, ALL_AT_ONCE, *(pytest.param(change, marks=pytest.mark.proof) for change in SINGLE),
])  # fmt: skip
def test_two_trainings_are_the_same_bits_and_another_seed_is_another(change) -> None:
    training = replace(TRAINING, **change)
    one, two = trained(training=training), trained(training=training)
    assert json.dumps(one.document()) == json.dumps(two.document())
    other = trained(training=replace(training, seed=1))
    assert other.history.tobytes() != one.history.tobytes()


def test_a_training_leaves_the_random_numbers_of_others_alone() -> None:
    torch.manual_seed(3)
    before = torch.get_rng_state()
    trained()
    assert torch.equal(torch.get_rng_state(), before)


def test_a_watch_sees_samples_as_they_stand_and_can_end_it() -> None:
    made = []

    def watch(step: int, so_far) -> bool:
        made.append(so_far().sample(middle(2), seed=1))
        return step == 4

    found = trained(watch=watch)
    assert found.history[:, 0].tolist() == [2.0, 4.0]
    assert len(made) == 2
    assert not np.array_equal(made[0], made[1])


def test_a_restored_generator_samples_the_same_bits(learnt) -> None:
    again = dcgan.restore_gan(json.loads(json.dumps(learnt.document(), allow_nan=False)))
    one, two = learnt.sample(middle(4), seed=5), again.sample(middle(4), seed=5)
    assert one.tobytes() == two.tobytes()
    assert again.document() == learnt.document()
    assert not np.array_equal(one, learnt.sample(middle(4), seed=6))


def test_more_wear_gives_a_larger_force(learnt) -> None:
    """What was learnt: the amplitude at 0 and 200 um is 20 and 220 N."""
    wear = np.repeat(np.linspace(10.0, 190.0, 10), 12)
    made = learnt.sample({"wear": wear, "cut": np.full(120, "slot")}, seed=1)
    assert spearmanr(wear, made[:, 0].std(axis=1))[0] > 0.7


def test_the_cut_decides_on_the_frequency(learnt) -> None:
    def share_of_low(cut: str) -> float:
        made = learnt.sample(middle(40, cut=np.full(40, cut)), seed=2)[:, 0]
        power = np.abs(np.fft.rfft(made - made.mean(axis=1, keepdims=True))) ** 2
        return float(power[:, :7].sum() / power.sum())

    assert share_of_low("slot") > share_of_low("side") + 0.3


def test_a_word_that_is_not_given_is_the_mean_of_those_that_are_known(learnt) -> None:
    one = learnt.sample({"wear": np.full(3, 50.0)}, seed=1)
    two = learnt.sample({"wear": np.full(3, 50.0), "cut": np.full(3, "")}, seed=1)
    assert np.array_equal(one, two)


@pytest.mark.parametrize(("change", "words"), [
    ({"wear": np.full(2, 1000.0)}, r"wear = 1000 um lies outside .* to \d+"),
    ({"cut": np.full(2, "turning")}, "cut = 'turning' was not learnt.*side, slot"),
    ({"speed": np.full(2, 1.0)}, "speed is no condition"),
])  # fmt: skip
def test_conditions_that_were_not_learnt_or_are_missing_are_refused(learnt, change, words) -> None:
    with pytest.raises(ValueError, match=words):
        learnt.sample(middle(2, **change))
    with pytest.raises(ValueError, match="condition wear is missing"):
        learnt.sample({"cut": np.full(2, "slot")})


def test_the_gradient_penalty_is_that_of_finite_differences() -> None:
    torch.manual_seed(0)
    kind = replace(SMALL, dropout=0.0)
    score = dcgan.Discriminator(2, SPACE, kind).double().eval()
    x = torch.randn(3, 2, 12, dtype=torch.float64)
    numbers, words = torch.zeros(3, 1).double(), torch.zeros(3, 1, dtype=torch.int64)
    found = gradient_penalty(score, x, numbers, words)
    step, total = 1e-5, 0.0
    with torch.no_grad():
        for c in range(2):
            for k in range(12):
                away = torch.zeros_like(x)
                away[:, c, k] = step
                slope = score(x + away, numbers, words) - score(x - away, numbers, words)
                total += float(((slope / (2 * step)) ** 2).sum())
    assert float(found.detach()) == pytest.approx(total / 3, rel=1e-6)


def test_the_penalty_reaches_the_weights() -> None:
    score = dcgan.Discriminator(2, SPACE, replace(SMALL, dropout=0.0))
    x = torch.randn(4, 2, LENGTH)
    numbers, words = torch.zeros(4, 1), torch.zeros(4, 1, dtype=torch.int64)
    gradient_penalty(score, x, numbers, words).backward()
    slopes = [p.grad for name, p in score.named_parameters() if "convs" in name and "bias" not in
              name]  # fmt: skip
    assert all(one is not None and one.abs().max() > 0 for one in slopes)


def test_dropout_drops_its_share_and_keeps_the_mean() -> None:
    torch.manual_seed(0)
    x = torch.ones(20, 6, 1, 50).contiguous(memory_format=torch.channels_last)
    found = dcgan.dropped(x.clone(), 0.25)
    assert float((found == 0).float().mean()) == pytest.approx(0.25, abs=0.02)
    assert float(found.mean()) == pytest.approx(1.0, abs=0.03)


def test_a_small_set_is_learnt_by_heart() -> None:
    """Four windows, each with a name of its own: what is generated by name is like it in size."""
    slots = np.flatnonzero(CONDITIONS["cut"] == "slot")
    x = X[slots[np.argsort(CONDITIONS["wear"][slots])[[5, 25, 45, 65]]]]
    names = {"name": np.array(["a", "b", "c", "d"])}
    training = replace(LEARNING, steps=350, warm=350, batch=8)
    gan = trained(replace(SMALL, unknown=0.0), training, x, names)
    made = gan.sample({"name": np.repeat(names["name"], 10)}, seed=1)
    sizes = made[:, 0].std(axis=1).reshape(4, 10).mean(axis=1)
    assert sizes == pytest.approx(x[:, 0].std(axis=1), rel=0.35)


def test_the_energy_distance_is_least_at_the_recorded_spread() -> None:
    """A proper score: neither the mean of the amplitudes nor twice their spread does better."""
    rng = np.random.default_rng(0)
    tone = np.sin(2 * np.pi * 5 * np.arange(LENGTH) / LENGTH)

    def drawn(spread: float) -> torch.Tensor:
        size = 0.5 + spread * rng.uniform(-0.4, 0.4, (4000, 1, 1))
        return torch.tensor(size * tone[None, None], dtype=torch.float32)

    found = {s: float(energy_distance(drawn(1.0), drawn(s), drawn(s))) for s in (0.0, 1.0, 2.2)}
    assert found[1.0] < found[0.0]
    assert found[1.0] < found[2.2]


def test_scaling_is_of_the_channels_and_says_what_it_cuts() -> None:
    scaling = dcgan.ChannelScaling.of(X)
    scaled = scaling.scaled(X)
    assert float(scaled.abs().max()) <= 1.0
    assert scaling.clipped < 0.001
    inside = np.abs((X - scaling.shift[:, None]) / scaling.scale[:, None]) < 1.0
    assert np.abs(scaling.restored(scaled) - X)[inside].max() < 1e-3
    still = dcgan.ChannelScaling.of(np.full((3, 1, 9), 4.0))
    assert still.restored(still.scaled(np.full((3, 1, 9), 4.0))).tolist() == [[[4.0] * 9]] * 3


def test_windows_are_explained_by_the_wear_they_show(learnt) -> None:
    """Three sharp and three worn ones: the means of what is found lie apart as they do, by half."""
    x, conditions = windows(400, seed=7)
    settings = LatentSearch(values=9, starts=2, steps=40)
    best = []
    for asked in (40.0, 160.0):
        near = (conditions["cut"] == "slot") & (abs(conditions["wear"] - asked) < 9)
        found = [
            explain(learnt, x[k], "wear", {"cut": "slot"}, settings)
            for k in np.flatnonzero(near)[:3]
        ]
        assert all(one.distance.min() < one.typical for one in found)
        assert all(one.window.shape == (2, LENGTH) for one in found)
        best.append(np.mean([one.best for one in found]))
    assert best[1] - best[0] > 60.0


def test_what_cannot_be_explained_is_refused(learnt) -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 9\)"):
        explain(learnt, np.zeros((2, 9)), "wear", {})
    with pytest.raises(ValueError, match="cut is no continuous condition"):
        explain(learnt, np.zeros((2, LENGTH)), "cut", {})


@pytest.mark.parametrize(("change", "words"), [
    ({"kernel": 4}, "kernel = 4 is even"), ({"condition": "add"}, "gan.condition = 'add'"),
    ({"generator": ()}, "need a layer"), ({"dropout": 1.0}, "gan.dropout = 1.0"),
])  # fmt: skip
def test_settings_out_of_range_are_refused(change, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        GanSettings(**change)


@pytest.mark.parametrize(("x", "conditions", "words"), [
    (X[:1], {"wear": [1.0]}, "two windows or more"),
    (X[:4], {"wear": [1.0, 2.0]}, "one value for each of the 4 windows"),
    (X[:2], {"wear": [1.0, np.nan]}, "not finite"),
    (X[:2] * np.nan, {"wear": [1.0, 2.0]}, "not finite"),
])  # fmt: skip
def test_windows_that_do_not_fit_are_refused(x, conditions, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        trained(x=x, conditions=conditions)


NUMBERS, WORDS = dcgan.encoded(SPACE, CONDITIONS)
SCALED = dcgan.ChannelScaling.of(X).scaled(X)
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
    block = dcgan.Block(3, 4, replace(SMALL, kernel=kernel))
    x = torch.randn(2, 3, 20)
    twice = x.repeat_interleave(2, dim=2)
    wanted = torch.nn.functional.conv1d(twice, block.conv.weight, padding=kernel // 2)
    normed = torch.nn.functional.leaky_relu(block.norm(wanted), 0.2)
    assert torch.allclose(block(x, None), normed, atol=1e-5)


PLACE = CONDITIONS["wear"][:, None] / 100.0


def sound() -> np.ndarray:
    """Other windows of the same wears and cuts."""
    rng = np.random.default_rng(3)
    return X * rng.uniform(0.95, 1.05, (len(X), 1, 1)) + rng.normal(0, 1.0, X.shape)


def test_a_sound_generator_has_no_fault() -> None:
    assert collapse(X, sound(), PLACE, [1.0, 0.8]).reasons == ()


def test_one_window_for_all_conditions_is_a_collapse() -> None:
    found = collapse(X, np.broadcast_to(X[:1], X.shape), PLACE)
    assert found.within == found.between == 0.0
    assert "the generator has collapsed" in found.reasons[0]


def test_one_window_for_each_condition_is_a_collapse() -> None:
    """Samples follow the wear, and are the same wherever it is."""
    t = np.arange(X.shape[2])
    tone = np.sin(2 * np.pi * 4 * t / X.shape[2])
    made = (20.0 + CONDITIONS["wear"])[:, None, None] * tone
    made = np.concatenate([made, 0.05 * made], axis=1)
    found = collapse(X, made, PLACE)
    assert any("at the same conditions" in one for one in found.reasons)


def test_a_loss_that_vanished_is_said() -> None:
    found = collapse(X, sound(), PLACE, [1.0, 0.5, 0.001])
    assert found.saturated
    assert "learns nothing more" in found.reasons[0]


def test_too_few_windows_show_nothing() -> None:
    with pytest.raises(ValueError, match="2 windows show no spread"):
        collapse(X[:2], X[:2], PLACE[:2])


@pytest.mark.parametrize("length", [16, 50, 64, 501])
def test_bands_add_up_to_the_mean_square(length: int) -> None:
    x = np.random.default_rng(0).normal(size=(3, 2, length))
    x -= x.mean(axis=2, keepdims=True)
    assert np.allclose(band_power(x).sum(axis=2), (x**2).mean(axis=2))
    assert band_edges(length)[-1] == length // 2 + 1


def test_features_do_not_depend_on_the_phase() -> None:
    assert np.allclose(features(np.roll(X, 9, axis=2)), features(X))
