"""Training and comparison: samples, folds, what is learnt, what cannot be, leaks, stretches."""

import os
from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from pipeline.nets.settings import TuningSettings
from pipeline.nets.windows import WindowInput, windows_of
from pipeline.submodels.following_residual.features import MEASURED, RESIDUAL, Features, inputs_of
from pipeline.submodels.following_residual.fit import (
    UseFit,
    _folds,
    enough,
    fit_axes,
    leak_shown,
    sampled,
    searched,
    stratified,
)
from pipeline.submodels.following_residual.model import (
    ESTIMATION,
    PERSISTENCE,
    PREDICTION,
    TWIN,
    ResidualFitSettings,
    key_of,
)
from tests.submodels.following_residual.axis_files import QUICK, SEARCH, Made

LINEAR = replace(QUICK, kinds=("arx",), windows=400)


@pytest.fixture(autouse=True)
def one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Starting processes takes longer than these trainings."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})


@pytest.fixture(scope="module")
def recordings() -> list[Features]:
    return [Made(seed).features for seed in range(5)]


def with_target(
    features: Sequence[Features], change, settings: ResidualFitSettings = LINEAR
) -> dict[tuple[str, str], UseFit]:
    """Fit to another residual."""
    return fit_axes({"X": [with_residual(one, change) for one in features]}, settings)


def with_residual(one: Features, change) -> Features:
    signals = dict(one.recording.signals)
    signals[RESIDUAL] = change(signals[RESIDUAL])
    return replace(one, recording=replace(one.recording, signals=signals))


def test_as_many_of_each_regime_as_there_are():
    regime = np.array(["a"] * 5 + ["b"] * 200 + ["c"] * 300 + ["d"] * 400)
    among = np.ones(len(regime), bool)
    among[-400:] = False
    rows = stratified(regime, among, 65, 0)
    names, counts = np.unique(regime[rows], return_counts=True)
    assert dict(zip(names, counts, strict=True)) == {"a": 5, "b": 30, "c": 30}
    assert len(set(rows.tolist())) == len(rows) and (np.diff(rows) > 0).all()
    assert (rows != stratified(regime, among, 65, 1)).any()


def test_fewer_windows_than_wanted_are_all_taken():
    regime = np.array(["a", "b", "b"])
    assert stratified(regime, np.array([True, True, False]), 60, 0).tolist() == [0, 1]


def test_no_recording_is_learnt_from_and_left_out_at_once():
    """Two recordings belong to one tool: they stay together."""
    features = [Made(seed, group="tool 1" if seed < 2 else "").features for seed in range(5)]
    part = sampled(features, inputs_of(features, None), PREDICTION, QUICK)
    tasks = _folds(part, QUICK)
    assert len(tasks) == QUICK.folds
    left_out: list[str] = []
    for task, rows in tasks:
        learnt, left = set(task.windows.group), set(part.windows.group[rows])
        assert learnt and left and not learnt & left
        assert len(task.windows.y) <= QUICK.windows
        np.testing.assert_array_equal(task.others, part.windows.x[rows])
        left_out += sorted(left)
    assert sorted(left_out) == ["r2", "r3", "r4", "tool 1"]


def test_samples_while_the_model_settles_and_unknown_ones_are_left_out(recordings):
    one = recordings[0]
    known = one.known.copy()
    known[100:110] = False
    part = sampled([replace(one, known=known)], inputs_of([one], None), PREDICTION, QUICK)
    rows = np.rint(part.time / one.recording.step_s).astype(int)
    assert rows.tolist() == [*range(25, 100), *range(110, len(known))]
    np.testing.assert_array_equal(part.regime, one.regime[rows])
    np.testing.assert_array_equal(part.windows.y, one.recording.signals[RESIDUAL][rows])


def test_what_the_command_tells_is_learnt(recordings):
    """Noise is 0.2 um, what the drive's model lacks several um."""
    model = fit_axes({"X": recordings}, LINEAR)["X", PREDICTION].model
    assert model.champion == "arx"
    assert model.scores[TWIN].rmse_um > 1.5
    assert model.scores["arx"].rmse_um < 0.2 * model.scores[TWIN].rmse_um
    assert max(one.upper for one in model.bands.values()) < 0.5 * model.scores[TWIN].max_um


def test_the_champion_has_the_least_error_left_out(recordings):
    for (_, use), one in fit_axes({"X": recordings}, QUICK).items():
        kinds, base = (QUICK.kinds, TWIN) if use == PREDICTION else (QUICK.estimators, PERSISTENCE)
        scores = one.model.scores
        assert set(scores) == {*kinds, base}
        assert one.model.champion == min(scores, key=lambda kind: scores[kind].rmse_um)
        assert {key: len(some) for key, some in one.documents.items()} == {
            key_of("X", use, kind): QUICK.folds for kind in kinds
        }


def test_of_pure_noise_nothing_is_learnt():
    features = [Made(seed, extra=False).features for seed in range(5)]
    model = fit_axes({"X": features}, QUICK)["X", PREDICTION].model
    assert model.scores[model.champion].rmse_um > 0.97 * model.scores[TWIN].rmse_um
    assert model.scores[TWIN].rmse_um == pytest.approx(0.2, rel=0.05)


def test_of_a_shuffled_target_nothing_is_learnt(recordings):
    random = np.random.default_rng(0)
    model = with_target(recordings, random.permutation)["X", PREDICTION].model
    assert model.scores[model.champion].rmse_um > 0.97 * model.scores[TWIN].rmse_um


def test_a_measurement_younger_than_the_horizon_is_refused(recordings):
    young = (WindowInput(name=RESIDUAL, older_than_s=0.5 * QUICK.horizon_s),)
    with pytest.raises(ValueError, match=r"younger than the horizon of 0\.02 s"):
        sampled(recordings, young, ESTIMATION, QUICK)


def test_no_measurement_enters_a_prediction(recordings):
    for name in MEASURED:
        with pytest.raises(ValueError, match="no measurement may enter"):
            sampled(recordings, (WindowInput(name=name, older_than_s=5.0),), PREDICTION, QUICK)
        with pytest.raises(ValueError, match="declared as known before the motion"):
            sampled(recordings, (WindowInput(name=name),), PREDICTION, QUICK)


def test_the_target_under_another_name_is_refused(recordings):
    given = [one.recording for one in recordings]
    copied = [replace(one, signals={**one.signals, "y": one.signals[RESIDUAL]}) for one in given]
    with pytest.raises(ValueError, match="holds the very values of the target"):
        windows_of(copied, [WindowInput(name="y")], RESIDUAL, QUICK.length, inf)


def test_an_estimation_ends_at_its_horizon(recordings):
    """Its youngest residual is five rows old, and a fit to it is no better than that allows."""
    one = recordings[0]
    part = sampled([one], inputs_of([one], QUICK.horizon_s), ESTIMATION, QUICK)
    names = [wanted.name for wanted in part.windows.inputs]
    at = np.rint(part.time / one.recording.step_s).astype(int)
    residual = one.recording.signals[RESIDUAL]
    np.testing.assert_array_equal(part.windows.x[:, -1, names.index(RESIDUAL)], residual[at - 5])


def test_persistence_is_the_last_known_residual(recordings):
    model = with_target(recordings, lambda y: 1e-6 * np.arange(len(y)))["X", ESTIMATION].model
    assert model.scores[PERSISTENCE].rmse_um == pytest.approx(5.0)  # rows of 1 um


@pytest.mark.parametrize(("many", "pieces"), [(1, 3), (2, 2)])
def test_few_recordings_are_cut_into_stretches(recordings, many, pieces):
    cut, by_time = enough(recordings[:many], QUICK)
    assert by_time
    assert len(cut) == len({one.group for one in cut}) == many * pieces > QUICK.folds
    whole = np.concatenate([one.measured for one in cut])
    np.testing.assert_array_equal(
        whole, np.concatenate([one.measured for one in recordings[:many]])
    )
    assert fit_axes({"X": recordings[:many]}, LINEAR)["X", PREDICTION].model.by_time


def test_enough_recordings_stay_whole(recordings):
    assert enough(recordings[:3], QUICK) == (recordings[:3], False)
    assert not fit_axes({"X": recordings}, LINEAR)["X", PREDICTION].model.by_time


def test_recordings_too_short_for_folds_are_refused_in_a_sentence():
    """Stretches of 80 ms hold no sample after the 100 ms in which the model settles."""
    with pytest.raises(ValueError, match=r"following_residual_fit\.settle_s"):
        fit_axes({"X": [Made(0, many=120).features]}, QUICK)


@pytest.mark.proof
def test_the_same_seed_gives_the_same_documents(recordings):
    first, again = (fit_axes({"X": recordings}, QUICK) for _ in range(2))
    assert {key: one.documents for key, one in first.items()} == {
        key: one.documents for key, one in again.items()
    }
    assert {key: one.model for key, one in first.items()} == {
        key: one.model for key, one in again.items()
    }
    other = replace(QUICK, training=replace(QUICK.training, seed=1))
    key = key_of("X", PREDICTION, "lstm")
    changed = fit_axes({"X": recordings}, other)["X", PREDICTION].documents[key]
    assert changed != first["X", PREDICTION].documents[key]


def test_a_search_sets_learning_rate_units_and_penalty(recordings):
    settings, facts = searched({"X": recordings}, replace(QUICK, searched="lstm"), SEARCH)
    assert facts is not None
    assert (facts.kind, facts.axis, facts.candidates) == ("lstm", "X", SEARCH.population)
    assert settings.units in SEARCH.units and facts.chosen["units"] == settings.units
    assert settings.training.learning_rate == pytest.approx(facts.chosen["learning_rate"], rel=1e-4)
    assert TuningSettings().learning_rate[0] <= settings.training.learning_rate
    assert replace(settings, units=QUICK.units, training=QUICK.training, searched="") == QUICK


def test_without_a_searched_kind_settings_stay(recordings):
    assert searched({"X": recordings}, QUICK, SEARCH) == (QUICK, None)


def test_the_measured_error_among_the_inputs_seems_to_gain():
    """On noise, of which nothing honest can be known; a penalty would hide it in 1 mm of error."""
    free = replace(LINEAR, ridges=(1e-10,))
    features = [Made(seed, extra=False).features for seed in range(5)]
    honest = fit_axes({"X": features}, free)["X", PREDICTION].model.scores["arx"]
    shown = leak_shown("X", features, free, honest)
    assert shown.inputs == ("measured error",)
    assert shown.rmse_um < 0.3 * shown.honest_um == pytest.approx(0.3 * honest.rmse_um)
