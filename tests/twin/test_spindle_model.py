"""The stored model: what it predicts, from where, and that it comes back from disk the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.schema.model import Correlation
from pipeline.schema.store import json_text, parsed, write_json
from pipeline.submodels.spindle.residual import ForestSettings, examples, fitted_forest
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import (
    TARGET,
    Forest,
    ResidualForest,
    SpindleFitFacts,
    SpindleModel,
    SpindleModelFile,
    load_spindle_model,
    save_forest,
    stretch_of,
)
from tests.submodels.spindle.spindle_days import ONE, RECORDS, TWO, day_of, days_of, state_table

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
