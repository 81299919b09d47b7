"""Windows, what could not be known yet, and training on them: recordings stay whole, bits hold."""

import json
from dataclasses import replace
from functools import cache
from math import inf

import numpy as np
import pytest
import torch

from pipeline.nets.settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    SequenceSettings,
    TcnSettings,
    WindowTraining,
)
from pipeline.nets.window_training import (
    TrainedSequence,
    autocast,
    restore_sequence,
    train_windows,
    usable_precision,
)
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of

NETWORKS: tuple[SequenceSettings, ...] = (
    CnnLstmAttentionSettings(units=12),
    CnnLstmSettings(units=12, pool=2),
    LstmSettings(units=12),
    TcnSettings(filters=8, blocks=3),
)
KINDS = (*NETWORKS, ArxSettings())
SHORT = WindowTraining(epochs=5, patience=5)


def delayed(many: int = 5, samples: int = 90) -> Windows:
    """A product of two inputs, each with a delay of its own: nothing for a linear model."""
    rng = np.random.default_rng(0)
    recordings = []
    for k in range(many):
        u, v = rng.uniform(-1.0, 1.0, (2, samples))
        y = np.zeros(samples)
        y[4:] = 3.0 + 20.0 * u[1:-3] * v[2:-2]
        recordings.append(Recording(name=f"r{k}", step_s=0.01, signals={"u": u, "v": v, "y": y}))
    inputs = [WindowInput(name="u"), WindowInput(name="v")]
    return windows_of(recordings, inputs, "y", 10, np.inf)


DATA = delayed()


def trained(
    kind: SequenceSettings, data: Windows = DATA, settings: WindowTraining = SHORT, **more: object
) -> TrainedSequence:
    return train_windows(kind, data, settings=settings, **more)  # type: ignore[arg-type]


once = cache(trained)
"""The training of a kind on the usual windows, for all tests that only read it."""


def rmse(found: TrainedSequence, data: Windows) -> float:
    return float(np.sqrt(np.mean((found.predict(data.x) - data.y) ** 2)))


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_each_overfits_twenty_windows(kind: SequenceSettings) -> None:
    data = Windows(x=DATA.x[:20], y=DATA.y[:20], group=DATA.group[:20])
    settings = WindowTraining(
        epochs=150, patience=150, validation=0.0, batch=10, learning_rate=0.02
    )
    assert rmse(trained(kind, data, settings), data) < 0.05 * data.y.std()


@pytest.mark.proof
@pytest.mark.parametrize("kind", [NETWORKS[0], NETWORKS[3]], ids=repr)
def test_a_delayed_product_is_learnt_where_a_linear_model_learns_nothing(
    kind: SequenceSettings,
) -> None:
    """On recordings that no training saw."""
    data = delayed(many=12, samples=160)
    learnt, unseen = data.of(*(f"r{k}" for k in range(9))), data.of("r9", "r10", "r11")
    settings = WindowTraining(epochs=60, learning_rate=0.01)
    linear = rmse(trained(ArxSettings(), learnt, settings), unseen)
    assert linear > 0.9 * unseen.y.std()
    assert rmse(trained(kind, learnt, settings), unseen) < 0.4 * linear


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_two_trainings_and_a_restored_one_are_the_same_bits(kind: SequenceSettings) -> None:
    one = once(kind)
    text = json.dumps(one.document(), allow_nan=False)
    assert text == json.dumps(trained(kind).document())
    other = trained(kind, settings=replace(SHORT, seed=1))
    assert other.history.tobytes() != one.history.tobytes()
    again = restore_sequence(json.loads(text))
    assert again.predict(DATA.x).tobytes() == one.predict(DATA.x).tobytes()
    assert again.document() == one.document()
    assert (again.kind, again.settings, again.inputs) == (kind, SHORT, DATA.inputs)


def test_validation_recordings_are_whole_and_never_learnt_from() -> None:
    one = once(NETWORKS[0])
    assert len(one.validation_groups) == 1
    held = np.isin(DATA.group, one.validation_groups)
    x, y = np.where(held[:, None, None], 99.0, DATA.x), np.where(held, -DATA.y, DATA.y)
    for kind in KINDS:
        one = once(kind)
        two = trained(kind, Windows(x=x, y=y, group=DATA.group))
        assert two.validation_groups == one.validation_groups
        np.testing.assert_array_equal(two.history[:, 1], one.history[: len(two.history), 1])
        np.testing.assert_array_equal(two.x_scaling.scale, one.x_scaling.scale)


@pytest.mark.parametrize("kind", NETWORKS, ids=repr)
def test_the_best_state_is_kept_and_patience_ends_a_training(kind: SequenceSettings) -> None:
    settings = WindowTraining(epochs=200, patience=3, learning_rate=0.05)
    found = trained(kind, settings=settings)
    best = found.history[:, 2].argmin()
    assert found.epochs == best + 1 + 3 < 200
    assert rmse(found, DATA.of(*found.validation_groups)) == pytest.approx(
        found.history[best, 2], rel=1e-5
    )


def test_whoever_watches_is_told_and_can_end_a_training() -> None:
    seen: list[tuple[int, float]] = []

    def watch(epoch: int, error: float) -> bool:
        seen.append((epoch, error))
        return epoch == 3

    found = trained(NETWORKS[2], watch=watch)
    np.testing.assert_allclose(found.history[:, [0, 2]], seen)
    assert len(seen) == 3


def test_the_penalty_makes_weights_small_and_leaves_biases() -> None:
    free, held = (
        trained(NETWORKS[2], settings=replace(SHORT, epochs=40, patience=40, l2=l2, validation=0.0))
        for l2 in (0.0, 0.1)
    )
    sizes = [
        sum(
            float((v.detach() ** 2).sum())
            for k, v in one.network.named_parameters()
            if "weight" in k
        )
        for one in (free, held)
    ]
    assert sizes[1] < 0.2 * sizes[0]
    bias = held.network.state_dict()["lstm.bias_ih_l0"]
    assert bias[12:24].mean() > 0.5  # forget gates began at 1


BF16 = pytest.mark.skipif(
    usable_precision("bfloat16") == "float32", reason="this processor has no bfloat16"
)


@BF16
@pytest.mark.parametrize("kind", NETWORKS, ids=repr)
def test_bfloat16_trains_to_what_float32_does(kind: SequenceSettings) -> None:
    one = trained(kind, settings=replace(SHORT, epochs=15, patience=15))
    settings = replace(SHORT, epochs=15, patience=15, precision="bfloat16")
    two, again = trained(kind, settings=settings), trained(kind, settings=settings)
    assert (one.precision, two.precision) == ("float32", "bfloat16")
    assert json.dumps(two.document()) == json.dumps(again.document())
    assert two.history[:, 1].tobytes() != one.history[:, 1].tobytes()
    np.testing.assert_allclose(two.history[:, 1:], one.history[:, 1:], rtol=0.05)
    x = one.x_scaling.scaled(DATA.x, torch.float32)
    with torch.no_grad():
        exact = one.network(x)
        with autocast("bfloat16"):
            short = one.network(x).float()
    # eight bits of a mantissa
    assert (short - exact).abs().max() < 0.05 * exact.abs().max()
    assert not torch.equal(short, exact)


def test_float32_stands_in_where_there_is_no_bfloat16(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = once(NETWORKS[2])
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    found = trained(NETWORKS[2], settings=replace(SHORT, precision="bfloat16"))
    assert found.precision == "float32"
    assert found.history.tobytes() == wanted.history.tobytes()


def test_attention_of_windows_adds_up_to_one() -> None:
    found = once(NETWORKS[0])
    weights = found.attention(DATA.x)
    assert weights.shape == DATA.x.shape[:2]
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-5)
    with pytest.raises(ValueError, match="a lstm network has no attention"):
        once(NETWORKS[2]).attention(DATA.x)


def test_units_do_not_matter() -> None:
    one = once(ArxSettings())
    scaled = Windows(x=1e3 * DATA.x + 5.0, y=1e-6 * DATA.y, group=DATA.group)
    two = trained(ArxSettings(), scaled)
    np.testing.assert_allclose(two.predict(scaled.x), 1e-6 * one.predict(DATA.x), rtol=1e-6)


def test_what_cannot_be_learnt_from_is_refused() -> None:
    one = DATA.of("r0")
    with pytest.raises(ValueError, match="there is one recording, 'r0'"):
        trained(NETWORKS[2], one)
    with pytest.raises(ValueError, match="nothing to learn from"):
        trained(NETWORKS[2], DATA.of())
    with pytest.raises(ValueError, match="as many windows of each"):
        trained(NETWORKS[2], Windows(x=DATA.x, y=DATA.y[1:], group=DATA.group))
    with pytest.raises(ValueError, match="lower window_training"):
        trained(NETWORKS[2], settings=replace(SHORT, learning_rate=1e30))
    found = once(NETWORKS[2])
    with pytest.raises(ValueError, match="takes 10 rows of 2 channels"):
        found.predict(DATA.x[:, 1:])
    assert found.predict(np.empty((0, 10, 2))).shape == (0,)
    document = found.document()
    with pytest.raises(ValueError, match="'scaling'"):
        restore_sequence({k: v for k, v in document.items() if k != "scaling"})
    with pytest.raises(ValueError, match="does not fit together"):
        restore_sequence({**document, "network": {"units": 13}})


STEP = 0.01
COMMAND, OLD = WindowInput(name="command"), WindowInput(name="error", older_than_s=0.05)


def recording(name: str = "a", many: int = 40, start: float = 0.0) -> Recording:
    """Numbers that say which sample they are of."""
    k = start + np.arange(many, dtype=np.float64)
    signals = {"command": k, "position": k + 0.25, "error": k + 0.5}
    return Recording(name=name, step_s=STEP, signals=signals, measured=frozenset({"position"}))


def test_commands_reach_the_target_s_time_and_measurements_end_at_their_age() -> None:
    found = windows_of([recording()], [COMMAND, OLD], "error", 8, 0.05)
    assert found.x.shape == (40 - 7 - 5, 8, 2) and found.leaks == ()
    t = found.y - 0.5
    np.testing.assert_array_equal(found.at, t)
    np.testing.assert_array_equal(found.x[:, -1, 0], t)
    np.testing.assert_array_equal(found.x[:, 0, 0], t - 7)
    np.testing.assert_array_equal(found.x[:, -1, 1] - 0.5, t - 5)


def test_an_age_between_two_samples_is_rounded_up() -> None:
    older = WindowInput(name="error", older_than_s=0.051)
    found = windows_of([recording()], [older], "error", 3, 0.05)
    np.testing.assert_array_equal(found.y - found.x[:, -1, 0], 6.0)


def test_no_window_crosses_from_one_recording_into_the_next() -> None:
    parts = [recording("a", 20), recording("short", 4, 500.0), recording("b", 25, 1000.0)]
    found = windows_of(parts, [COMMAND, OLD], "error", 6, 0.02)
    assert set(found.group) == {"a", "b"}
    assert (np.ptp(found.x[..., 0], axis=1) == 5).all()
    assert ((found.y > 900) == (found.group == "b")).all()
    assert ((found.x > 900).all(axis=(1, 2)) == (found.group == "b")).all()
    only = found.of("b")
    assert set(only.group) == {"b"} and len(only.at) == (found.group == "b").sum()


@pytest.mark.parametrize(
    ("given", "horizon", "said"),
    [
        (WindowInput(name="error", older_than_s=0.04), 0.05, "'error' is a measurement .* younger"),
        (WindowInput(name="position", older_than_s=0.0), 0.01, "'position' is a measurement"),
        (OLD, inf, "'error' .* that no measurement may enter"),
        (WindowInput(name="position"), 0.0, "'position' is measured, but declared as known"),
        (WindowInput(name="error"), 0.0, "'error' is measured, but declared as known"),
    ],
    ids=["younger", "no age", "before the motion", "measured", "target"],
)
def test_an_input_that_could_not_be_known_is_refused_by_name(
    given: WindowInput, horizon: float, said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        windows_of([recording()], [COMMAND, given], "error", 4, horizon)
    leaky = windows_of([recording()], [COMMAND, given], "error", 4, horizon, allow_leaks=True)
    assert leaky.leaks == (given.name,) == leaky.of("a").leaks


def test_a_copy_of_the_target_under_another_name_is_refused() -> None:
    first = recording()
    copied = {**first.signals, "model": first.signals["error"].copy()}
    with pytest.raises(ValueError, match="'model' holds the very values of the target 'error'"):
        windows_of(
            [Recording(name="a", step_s=STEP, signals=copied)],
            [WindowInput(name="model")], "error", 4, 0.05,
        )  # fmt: skip


def test_what_cannot_be_made_windows_of_is_refused() -> None:
    with pytest.raises(ValueError, match="recording a is given 2 times"):
        windows_of([recording(), recording()], [COMMAND], "error", 4, 0.0)
    with pytest.raises(ValueError, match="has no signal 'force'"):
        windows_of([recording()], [WindowInput(name="force")], "error", 4, 0.0)
    with pytest.raises(ValueError, match="long enough"):
        windows_of([recording(many=7)], [COMMAND, OLD], "error", 4, 0.05)
    broken = recording()
    broken.signals["error"][17] = np.nan
    with pytest.raises(ValueError, match="the first at sample 17"):
        windows_of([broken], [COMMAND], "error", 4, 0.0)
    with pytest.raises(ValueError, match="as many samples"):
        Recording(name="a", step_s=STEP, signals={"u": np.ones(3), "v": np.ones(4)})
    with pytest.raises(ValueError, match=r"older_than_s = -0\.1 s"):
        WindowInput(name="error", older_than_s=-0.1)
