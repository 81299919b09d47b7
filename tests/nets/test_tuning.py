"""Tuning on windows: the same in every place, poor candidates stopped, the best trained in full."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.nets.settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    LstmSettings,
    SequenceSettings,
    TcnSettings,
    TuningSettings,
    WindowTraining,
)
from pipeline.nets.tuning import Tuned, thinned, tune
from pipeline.nets.window_training import train_windows
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of
from pipeline.search.methods import METHODS

KIND = CnnLstmAttentionSettings(filters=4)
TRAINING = WindowTraining(epochs=9, patience=9, batch=32, seed=3)
SMALL = TuningSettings(
    population=4, generations=3, epochs=6, patience=6, windows=120, milestones=(2, 4), units=(3, 6),
    learning_rate=(1e-3, 3e-2),
)  # fmt: skip


def lagged(many: int = 5, samples: int = 60) -> Windows:
    """A bent function of one input three samples ago."""
    rng = np.random.default_rng(0)
    recordings = []
    for k in range(many):
        u = rng.uniform(-1.0, 1.0, samples)
        y = 5.0 * np.tanh(2.0 * np.roll(u, 3))
        recordings.append(Recording(name=f"r{k}", step_s=0.01, signals={"u": u, "y": y}))
    return windows_of(recordings, [WindowInput(name="u")], "y", 12, np.inf)


DATA = lagged()


def tuned(
    settings: TuningSettings = SMALL, training: WindowTraining = TRAINING,
    kind: SequenceSettings = KIND, data: Windows = DATA, **more: object,
) -> Tuned:  # fmt: skip
    return tune(kind, data, training, settings, **{"compute": "serial", **more})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def small() -> Tuned:
    return tuned()


def bytes_of(found: Tuned) -> str:
    every = [
        *(f"{one.generation} {one.values} {one.errors.tolist()} {one.pruned}"
          for one in found.candidates),
        *(json.dumps(one.document(), allow_nan=False) for one in found.retrained),
        f"{found.names} {found.history.tolist()} {found.evaluations} {found.bounds_hit}",
    ]  # fmt: skip
    return "\n".join(every)


def test_processes_give_the_bytes_of_serial_and_another_seed_is_another(small: Tuned) -> None:
    assert bytes_of(tuned(compute="processes")) == bytes_of(small)
    short = replace(SMALL, generations=1, epochs=2, milestones=())
    assert bytes_of(tuned(replace(short, seed=1))) != bytes_of(tuned(short))


def test_candidates_stay_in_their_ranges_and_the_history_falls(small: Tuned) -> None:
    assert small.evaluations == 12 == len(small.candidates)
    assert [one.generation for one in small.candidates] == [1] * 4 + [2] * 4 + [3] * 4
    for one in small.candidates:
        for name, value in one.values.items():
            low, high = getattr(SMALL, name)
            assert low <= value <= high
        assert type(one.values["units"]) is int
    errors = np.array([one.validation for one in small.candidates]).reshape(3, 4)
    np.testing.assert_array_equal(small.history, np.minimum.accumulate(errors.min(axis=1)))


def test_a_candidate_above_the_median_at_a_milestone_is_stopped_there(small: Tuned) -> None:
    """Of the best four before its own generation; without milestones all are trained to the end."""
    pruned = [one for one in small.candidates if one.pruned]
    assert pruned and all(one.generation > 1 for one in pruned)
    for one in small.candidates:
        earlier = [other for other in small.candidates if other.generation < one.generation]
        stop = SMALL.epochs
        for epoch in SMALL.milestones if earlier else ():
            there = [other.by(epoch) for other in earlier if other.by(epoch) is not None]
            if one.by(epoch) is not None and one.by(epoch) > np.median(sorted(there)[:4]):
                stop = epoch
                break
        assert one.epochs == stop and one.pruned == (stop < SMALL.epochs)
    whole = tuned(replace(SMALL, milestones=()))
    assert not any(one.pruned for one in whole.candidates)
    assert sum(one.epochs for one in whole.candidates) == 12 * SMALL.epochs
    assert sum(one.epochs for one in small.candidates) < 12 * SMALL.epochs
    # a candidate's error does not depend on who else is pruned
    for one, other in zip(small.candidates[:4], whole.candidates[:4], strict=True):
        assert one.errors.tobytes() == other.errors.tobytes()


def test_nothing_is_pruned_by_the_median_of_too_few() -> None:
    assert not any(one.pruned for one in tuned(replace(SMALL, fewest=9)).candidates[:8])


def test_a_candidate_is_the_training_that_it_says(small: Tuned) -> None:
    one = next(one for one in small.candidates if not one.pruned)
    settings = replace(
        TRAINING, epochs=SMALL.epochs, patience=SMALL.patience,
        learning_rate=one.values["learning_rate"], l2=one.values["l2"],
    )  # fmt: skip
    kind = replace(KIND, units=one.values["units"])
    again = train_windows(kind, thinned(DATA, SMALL.windows), settings=settings)
    assert again.history[:, 2].tobytes() == one.errors.tobytes()


def test_the_best_three_are_trained_in_full_by_the_same_recordings(small: Tuned) -> None:
    best = sorted(small.candidates, key=lambda one: one.validation)[:3]
    values = [
        (one.settings.seed, one.settings.learning_rate, one.kind.units, one.settings.l2)
        for one in small.retrained
    ]
    assert sorted(values) == [(3 + k, *one.values.values()) for k, one in enumerate(best)]
    assert {one.epochs for one in small.retrained} == {TRAINING.epochs}
    plain = train_windows(LstmSettings(units=2), DATA, settings=replace(TRAINING, epochs=1))
    assert {one.validation_groups for one in small.retrained} == {plain.validation_groups}
    errors = [one.history[:, 2].min() for one in small.retrained]
    assert errors == sorted(errors) and small.network is small.retrained[0]


def test_windows_of_a_candidate_are_even_and_of_every_recording() -> None:
    few = thinned(DATA, 20)
    assert len(few.y) == len(few.at) == 20
    assert {name: int((few.group == name).sum()) for name in np.unique(few.group)} == {
        f"r{k}": 4 for k in range(5)
    }
    assert np.ptp(np.diff(few.of("r1").at)) <= 1
    assert np.unique(thinned(DATA, 2).group).tolist() == [f"r{k}" for k in range(5)]
    assert thinned(DATA, len(DATA.y)) is DATA


def test_bounds_that_are_hit_are_named(small: Tuned) -> None:
    """The more a penalty far too large is let go, the better; a held setting hits nothing."""
    assert small.bounds_hit == {}
    found = tuned(
        replace(SMALL, method="whale", generations=5, learning_rate=(1e-8, 1e-5), units=(4, 4))
    )
    assert found.bounds_hit["learning_rate"] == "high" and "units" not in found.bounds_hit


def test_a_setting_that_is_asked_for_again_is_not_trained_again() -> None:
    found = tuned(replace(SMALL, learning_rate=(0.01, 0.01), units=(3, 4), l2=(0.0, 0.0)))
    assert found.evaluations == 12 and len(found.candidates) == 2 == len(found.retrained)


def test_a_diverging_candidate_has_an_infinite_cost_and_is_no_error() -> None:
    found = tuned(replace(SMALL, learning_rate=(1e-3, 1e30)))
    lost = [one for one in found.candidates if not one.epochs]
    assert lost and all(one.validation == np.inf for one in lost)
    assert np.isfinite(found.network.predict(DATA.x)).all()
    with pytest.raises(ValueError, match=r"^none of 12 candidates .* from 1e\+30 to 1e\+35$"):
        tuned(replace(SMALL, learning_rate=(1e30, 1e35)))


@pytest.mark.parametrize(
    "method",
    ["genetic", "whale"]
    + [
        pytest.param(name, marks=pytest.mark.proof)
        for name in METHODS
        if name not in ("genetic", "whale")
    ],
)
def test_every_search_of_the_table_tunes(method: str) -> None:
    found = tuned(replace(SMALL, method=method, generations=2, epochs=2))
    assert found.evaluations == 8 and len(found.retrained) == 3


def test_a_network_without_units_is_tuned_in_what_it_has() -> None:
    found = tuned(replace(SMALL, generations=1, epochs=1), kind=TcnSettings(filters=3, blocks=2))
    assert found.names == ("learning_rate", "l2")
    assert found.network.kind == TcnSettings(filters=3, blocks=2)


def test_what_cannot_be_tuned_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^tuning.units = 6 to 3 is an empty range"):
        replace(SMALL, units=(6, 3))
    with pytest.raises(
        ValueError, match=r"^tuning.learning_rate = 0.0 must be finite and positive"
    ):
        replace(SMALL, learning_rate=(0.0, 1e-2))
    with pytest.raises(ValueError, match=r"^tuning.method = 'tabu' is not one of genetic, whale"):
        replace(SMALL, method="tabu")
    with pytest.raises(ValueError, match="arx is solved at once"):
        tuned(kind=ArxSettings())
    with pytest.raises(ValueError, match=r"set window_training.validation above 0"):
        tuned(training=replace(TRAINING, validation=0.0))
    with pytest.raises(ValueError, match="there is one recording, 'r0'"):
        tuned(data=DATA.of("r0"))
