"""The spindle in its state table, the forest's features, and the stored model's predictions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.model import Correlation
from pipeline.schema.store import json_text, parsed, write_json
from pipeline.submodels.spindle.calibration import ForestSettings, examples, fitted_forest
from pipeline.thermal.network import SOURCES, SpindleThermalParameters
from pipeline.twin.spindle import (
    SMOOTHING_S,
    TARGET,
    Forest,
    ResidualForest,
    SpindleFitFacts,
    SpindleModel,
    SpindleModelFile,
    SpindleRecords,
    feature_names,
    features,
    load_spindle_model,
    save_forest,
    smoothed_inputs,
    spindle_stretches,
    stretch_of,
    with_heat,
)
from tests.submodels.spindle.spindle_days import ONE, RECORDS, TWO, day_of, days_of, state_table

C_AXIS = replace(RECORDS, position_control=True)


def test_heat_sources_come_from_rpm_and_percent() -> None:
    """3000 rpm is 314.159 rad/s, 40 % is 0.4: the five sources worked out by hand."""
    state = pd.DataFrame(
        {
            "spindle_speed": [3000.0, -3000.0],
            "spindle_load": [40.0, -40.0],
            "spindle_position_control": [0.0, 1.0],
        }
    )
    found = with_heat(state, C_AXIS)
    omega = 314.1592653589793
    by_hand = {
        "bearing_friction": omega ** (5 / 3),
        "load_speed": 0.4 * omega,
        "copper": 0.16,
        "windage": omega**2,
    }
    for name, value in by_hand.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    np.testing.assert_array_equal(found["position_hold"], [0.0, 1.0])


def test_sources_are_taken_before_they_are_averaged() -> None:
    """Half the time at n is 2^(-1) of n^(5/3), not the 5/3 power of n/2."""
    state = state_table(ONE, 0, "2026-01-05", hours=1.0)
    state["spindle_speed"] = np.where(np.arange(3600) % 2, 3000.0, 0.0)
    (piece,) = spindle_stretches(
        state, "2026-01-05", RECORDS, step=10.0, bridge_s=60.0, shortest_s=60.0
    )
    np.testing.assert_allclose(
        piece.frame["bearing_friction"], 314.1592653589793 ** (5 / 3) / 2, rtol=1e-12
    )


@pytest.mark.parametrize(("records", "name"), [
    (RECORDS, "spindle_speed"),
    (RECORDS, "spindle_load"),
    (C_AXIS, "spindle_position_control"),
    (replace(RECORDS, ambient=True), "ambient_temperature"),
])  # fmt: skip
def test_a_missing_column_is_named(records: SpindleRecords, name: str) -> None:
    have = [s for s in records.signals if s != name]
    with pytest.raises(ValueError, match=f"no column {name}"):
        with_heat(pd.DataFrame({s: [1.0] for s in have}), records)


def test_position_control_that_is_not_recorded_heats_nothing() -> None:
    state = pd.DataFrame({"spindle_speed": [100.0], "spindle_load": [10.0]})
    assert with_heat(state, RECORDS)["position_hold"].tolist() == [0.0]
    assert "position_hold" not in RECORDS.sources
    assert C_AXIS.sources == list(SOURCES)


def test_a_stretch_to_predict_never_looks_at_the_temperature() -> None:
    state = state_table(ONE, 1, "2026-01-05", hours=1.0)
    first = stretch_of(state, 25.0, RECORDS, step=10.0)
    second = stretch_of(state.assign(**{TARGET: np.nan}), 25.0, RECORDS, step=10.0)
    pd.testing.assert_frame_equal(first.frame, second.frame)
    third = stretch_of(state.drop(columns=TARGET), 25.0, RECORDS, step=10.0)
    np.testing.assert_array_equal(first.frame["copper"], third.frame["copper"])
    assert len(first.frame) == 360
    assert first.frame[TARGET].iloc[0] == 25.0


def test_inputs_are_held_however_long_but_not_backwards() -> None:
    state = state_table(ONE, 2, "2026-01-05", hours=2.0)
    state["spindle_speed"] = 1000.0
    state.iloc[1000:5000, 0] = np.nan
    held = stretch_of(state, 25.0, RECORDS, step=10.0)
    assert len(held.frame) == 720
    assert held.bridged == 400
    assert held.frame["bearing_friction"].nunique() == 1
    state.iloc[:30, 0] = np.nan
    with pytest.raises(ValueError, match=r"06:00:30.*start where they are known"):
        stretch_of(state, 25.0, RECORDS, step=10.0)


def test_nothing_can_be_predicted_from_nothing() -> None:
    state = state_table(ONE, 3, "2026-01-05", hours=0.1)
    with pytest.raises(ValueError, match="no row of the state table knows all of spindle_speed"):
        stretch_of(state.assign(spindle_load=np.nan), 25.0, RECORDS, step=10.0)
    with pytest.raises(ValueError, match="has no row"):
        stretch_of(state.iloc[:0], 25.0, RECORDS, step=10.0)
    with pytest.raises(ValueError, match="start temperature nan"):
        stretch_of(state, float("nan"), RECORDS, step=10.0)


def test_a_missing_feature_is_refused_by_its_name() -> None:
    frame = pd.DataFrame({"copper": [0.0, 1.0]})
    with pytest.raises(ValueError, match="the forest needs coolant_flow, which the records do not"):
        smoothed_inputs(frame, 10.0, ["copper", "coolant_flow"])


def test_the_mean_is_the_exponential_one_of_what_was_known() -> None:
    values, step = np.array([3.0, 0.0, 1.0, 5.0]), 60.0
    found = smoothed_inputs(pd.DataFrame({"a": values}), step, ["a"])
    for tau in SMOOTHING_S:
        for t in range(4):
            weight = np.exp(-step / tau) ** np.arange(t, -1, -1)
            by_hand = (weight * values[: t + 1]).sum() / weight.sum()
            assert found[f"a_over_{tau:g}_s"].iloc[t] == pytest.approx(by_hand, rel=1e-12)


def test_the_future_changes_nothing() -> None:
    values = np.random.default_rng(0).normal(size=50)
    changed = np.concatenate([values[:30], np.full(20, 1e6)])
    first = smoothed_inputs(pd.DataFrame({"a": values}), 10.0, ["a"])[:30]
    second = smoothed_inputs(pd.DataFrame({"a": changed}), 10.0, ["a"])[:30]
    pd.testing.assert_frame_equal(first, second)


def test_unknown_stays_unknown() -> None:
    """Not zero, and not what it was before either."""
    values = np.array([np.nan, 2.0, np.nan, np.nan, 4.0])
    found = smoothed_inputs(pd.DataFrame({"a": values}), 10.0, ["a"])
    for name in found:
        np.testing.assert_array_equal(found[name].isna(), np.isnan(values))
        assert 2.0 < found[name].iloc[4] < 4.0


def test_columns_stand_in_the_order_of_their_names() -> None:
    frame = pd.DataFrame({"b": [1.0, 1.0], "a": [2.0, 2.0]})
    inputs = smoothed_inputs(frame, 10.0, ["a", "b"])
    x = features(inputs, np.array([30.0, 31.0]), 25.0, np.array([0.0, 10.0]), ["b"], ["a"])
    names = feature_names(["b"], ["a"])
    assert x.shape == (2, len(names))
    row = dict(zip(names, x[1], strict=True))
    assert (row["physics"], row["start_temperature"], row["horizon_s"]) == (31.0, 25.0, 10.0)
    assert {row[f"b_over_{tau:g}_s"] for tau in SMOOTHING_S} == {1.0}
    assert {row[f"a_over_{tau:g}_s"] for tau in SMOOTHING_S} == {2.0}


MODEL = SpindleModel(network=ONE, records=RECORDS, step_s=10.0)


def test_the_truth_predicts_the_truth() -> None:
    state = state_table(ONE, 0, "2026-01-05", hours=2.0)
    found = MODEL.predict(state, ONE.ambient)
    # records are rounded to whole degrees
    at = state[TARGET].reindex(found.index)
    assert np.abs(found["physics"] - at).max() <= 0.5 + 0.05
    np.testing.assert_array_equal(found["physics"], found[TARGET])


@pytest.mark.parametrize("truth", [ONE, TWO], ids=["one node", "two nodes"])
def test_windows_start_from_what_was_measured(truth: object) -> None:
    """From a free run of the truth itself, windows go on along it: the body's state is kept."""
    network = ONE if truth is ONE else TWO
    piece = day_of(network, 1, hours=4.0)
    model = SpindleModel(network=network, records=RECORDS, step_s=60.0)
    physics, (whole,), persistence = model.windows(piece, 3600.0)
    measured = piece.frame[TARGET].to_numpy()
    np.testing.assert_allclose(physics, measured, atol=1e-9)
    np.testing.assert_array_equal(physics, whole)
    np.testing.assert_array_equal(persistence, np.repeat(measured[::60], 60))


def test_a_window_without_a_measured_start_waits_for_one() -> None:
    piece = day_of(ONE, 2, hours=3.0)
    measured = piece.frame[TARGET].to_numpy().copy()
    measured[60:65] = np.nan
    gap = replace(piece, frame=piece.frame.assign(**{TARGET: measured}))
    physics, _, persistence = SpindleModel(network=ONE, records=RECORDS, step_s=60.0).windows(
        gap, 3600.0
    )
    assert np.isnan(physics[60:65]).all()
    np.testing.assert_array_equal(persistence[65:125], measured[65])
    assert np.isfinite(np.delete(physics, range(60, 65))).all()


def test_what_is_measured_in_a_window_does_not_change_its_prediction() -> None:
    piece = day_of(ONE, 3, hours=3.0)
    model = SpindleModel(network=ONE, records=RECORDS, step_s=60.0)
    other = piece.frame[TARGET].to_numpy().copy()
    other[61:120] += 50.0
    physics, _, _ = model.windows(piece, 3600.0)
    disturbed, _, _ = model.windows(
        replace(piece, frame=piece.frame.assign(**{TARGET: other})), 3600.0
    )
    np.testing.assert_array_equal(physics, disturbed)


def test_a_stored_model_predicts_the_same(tmp_path: Path) -> None:
    days = days_of(ONE, 4, 4, noise_K=0.3)
    quick = ForestSettings(trees=5, depth=4, every_s=1800.0, sample_s=300.0)
    trees = fitted_forest(examples(days, RECORDS, ONE, quick), quick)
    about = Forest(
        used=True, why="", sources=tuple(RECORDS.sources), extra=(), days=(), examples=1,
        rmse_days_left_out_K=None, rmse_without_K=None,
    )  # fmt: skip
    facts = SpindleFitFacts(
        step_s=60.0, nodes=1, rmse_K=0.1, rmse_days_left_out_K={}, condition=None,
        correlation=Correlation(), evaluations=1, seconds=60.0, bridged_s=0.0,
    )  # fmt: skip
    stored = SpindleModelFile(
        submodel="spindle", machine="mill", origin="simulated", parameters={}, trained_on=(),
        network=ONE, records=RECORDS, fit=facts, training_days=(), forest=about,
    )  # fmt: skip
    write_json(stored, tmp_path / "model.json")
    save_forest(trees, tmp_path / "residual")
    loaded = load_spindle_model(tmp_path)
    assert (loaded.records, loaded.network) == (RECORDS, ONE)
    forest = ResidualForest(forest=trees, sources=about.sources, extra=about.extra)
    kept = SpindleModel(network=ONE, records=RECORDS, step_s=60.0, forest=forest)
    state = state_table(ONE, 5, "2026-01-12", hours=1.0)
    expected = kept.predict(state, 24.0)
    np.testing.assert_array_equal(loaded.predict(state, 24.0), expected)
    assert not np.array_equal(expected["physics"], expected[TARGET])
    # the forest of a window sees the window's own start and horizon
    piece = stretch_of(state, 24.0, RECORDS, step=60.0)
    physics, model = loaded.free_run(piece)
    first = loaded.windows(piece, 3600.0)
    np.testing.assert_allclose(first[0], physics)
    np.testing.assert_allclose(first[1], model)
    # trees drawn with replacement stand behind the forest's own prediction
    drawn = load_spindle_model(tmp_path, draws=4)
    for found, own in ((drawn.free_run(piece)[1], model), (drawn.windows(piece, 3600.0)[1], model)):
        assert found.shape == (5, len(piece.frame))
        np.testing.assert_allclose(found[0], own[0])
        assert len({one.tobytes() for one in found}) == 5


@pytest.mark.parametrize("network", [ONE, TWO], ids=["one node", "two nodes"])
def test_a_network_comes_back_from_json(network: object) -> None:
    given = ONE if network is ONE else TWO
    assert parsed(json_text(given).encode(), SpindleThermalParameters, "network") == given


def test_a_model_that_was_never_made_says_what_makes_it(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"model\.json does not exist: run `dvc repro`"):
        load_spindle_model(tmp_path)
