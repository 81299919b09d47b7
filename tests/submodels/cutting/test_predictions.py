"""Judgement of a cut: errors by hand, who is judged, and what passes."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.cutting import (
    BY_LOAD,
    BY_LOAD_SHARE,
    CHANNEL_FORCE,
    MAGNITUDE,
    MEAN,
    MECHANICS,
    OTHERS,
    PEAK,
    PLAIN,
    PLANE,
    SPINDLE,
    CuttingModel,
)
from pipeline.schema.model import Model, Parameter, SourceFile
from pipeline.schema.store import read_json, write_json
from pipeline.submodels.cases import Case, Cases, conditions_of
from pipeline.submodels.contract import Shown
from pipeline.submodels.cutting.identify import cutting_model, identify_cutting_force
from pipeline.submodels.cutting.predictions import ForcePredictor, force_targets
from pipeline.submodels.cutting.recordings import CuttingRecording
from pipeline.submodels.cutting.settings import CuttingLimits
from pipeline.submodels.cutting.submodel import SUBMODEL, _facts
from pipeline.submodels.judge import judge
from tests.submodels.cutting.recorded import SETTINGS, SLOT, SLOTS, identified, known_of, recordings
from tests.submodels.made_pages import made, tables

HEAD = Model(submodel="cutting", machine="m", origin="simulated", parameters={}, trained_on=())
BETWEEN = ("training", "held_out", "training")


@cache
def fitted(roles: tuple[str, ...]) -> CuttingModel:
    """The model of those slots that are learnt from, as it was stored and read again."""
    known = known_of(SLOT)
    found = [
        replace(one, role=role) for one, role in zip(recordings(SLOT, SLOTS), roles, strict=True)
    ]
    result = (
        identified(SLOT, SLOTS) if set(roles) == {"training"}
        else identify_cutting_force(found, known, SETTINGS)
    )  # fmt: skip
    learnt = conditions_of(case_of(one) for one in found if one.role == "training")
    head = replace(HEAD, conditions=learnt)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        write_json(cutting_model(head, result, known, SETTINGS, None), path)
        return read_json(path, CuttingModel)


def case_of(one: CuttingRecording) -> Case:
    file = SourceFile(file=one.name, sha256=one.sha256)
    return Case(
        name=one.name, group=one.name, role=one.role, files=(file,), load=lambda: one,
        conditions=_facts(one.conditions),
    )  # fmt: skip


@cache
def judged(roles=BETWEEN, feed_error=1.0):
    """Verdict and predictions; the feed of the second slot was another than it says."""
    model = fitted(roles)
    found = [
        replace(one, role=role) for one, role in zip(recordings(SLOT, SLOTS), roles, strict=True)
    ]
    conditions = found[1].cut[0]
    found[1] = replace(found[1], conditions=replace(conditions, f_z=feed_error * conditions.f_z))
    predictor = ForcePredictor(model, known_of(SLOT), SETTINGS)
    return judge(
        model, lambda case: predictor.prediction(case.load()),
        Cases(cases=tuple(map(case_of, found))), force_targets(CuttingLimits()), sets=None,
        files={},
    )  # fmt: skip


def test_a_feed_between_is_predicted():
    verdict = judged().verdict
    assert verdict.status == "passed" and verdict.judged_role == "held_out"
    (score,) = (s for s in verdict.of(PLANE, role="held_out") if s.group != "all")
    assert (score.group, score.status) == ("1.csv", "passed")
    assert score.relative_percent < 3  # noise of 1.5 N in 100 N, zeros of 1 N
    assert score.baselines[PLAIN].relative_percent > 10
    assert set(score.baselines) == {PLAIN, MECHANICS}


def test_a_cut_that_was_not_what_it_says_fails():
    verdict = judged(feed_error=2.0).verdict
    assert verdict.status == "failed"
    assert any("error of the mean" in reason for reason in verdict.reasons)


def test_every_training_recording_is_predicted_from_the_others():
    """Each is left out of one fit, and that fit's errors stand beside the model's own."""
    model, verdict = fitted(("training",) * 3), judged(("training",) * 3).verdict
    assert verdict.status == "not judged"  # what was learnt from is no proof
    crossed = [s for s in verdict.of(PLANE) if s.regime == OTHERS and s.group != "all"]
    assert sorted(s.group for s in crossed) == ["0.csv", "1.csv", "2.csv"]
    assert all(s.relative_percent < 5 for s in crossed)
    for fold in model.folds:
        assert not set(fold.left_out) & set(fold.fitted_on)
        assert sorted(fold.left_out + fold.fitted_on) == ["0.csv", "1.csv", "2.csv"]


def test_without_a_recording_to_learn_from_nothing_is_judged():
    verdict = judged(("held_out",) * 3).verdict
    assert fitted(("held_out",) * 3).fit is None
    assert verdict.status == "not judged" and verdict.scores == ()
    assert all("roles.training" in case.note for case in verdict.cases)


def test_errors_of_the_force_in_the_plane_are_those_of_the_vector():
    """Both components one after the other: the RMSE of the vector over the RMS of its length."""
    frame = judged().predictions
    rows = frame[(frame["case"] == "1.csv") & (frame["regime"] == "")]
    by = {name: part for name, part in rows.groupby("quantity")}
    x, y = by[CHANNEL_FORCE + "x"], by[CHANNEL_FORCE + "y"]  # the channels are feed and normal
    columns = [one[name].to_numpy() for one in (x, y) for name in ("measured", "predicted")]
    error = np.hypot(columns[1] - columns[0], columns[3] - columns[2])
    length = np.hypot(columns[0], columns[2])
    found = judged().verdict.of(PLANE, group="1.csv")[0]
    expected = 100 * np.sqrt((error**2).mean() / (length**2).mean())
    assert found.relative_percent == pytest.approx(expected, rel=1e-5)  # six digits are stored
    magnitude = judged().verdict.of(MAGNITUDE, group="1.csv")[0]
    predicted = np.hypot(columns[1], columns[3])
    peak = 100 * (predicted.max() / length.max() - 1)
    assert magnitude.peak_percent == pytest.approx(peak, rel=1e-4, abs=1e-4)


def test_served_forces_are_those_of_the_model(tmp_path):
    """A table of conditions: peak, mean and RMS of the force in the plane of a trained slot."""
    model = fitted(BETWEEN)
    write_json(model, tmp_path / "model.json")
    table = SUBMODEL.example(tmp_path)
    assert table["feed_per_tooth_mm"].iloc[0] == pytest.approx(0.05, rel=1e-3)
    served = SUBMODEL.serve(tmp_path)(table).iloc[0]
    frame = judged().predictions
    rows = frame[(frame["case"] == "0.csv") & (frame["quantity"] == MAGNITUDE)]
    predicted = rows[rows["regime"] == ""]["predicted"]
    # the recording has fewer harmonics than are served
    assert served["peak_N"] == pytest.approx(predicted.max(), rel=0.02)
    assert served["mean_N"] == pytest.approx(predicted.mean(), rel=0.02)
    assert served["peak_low_N"] < served["peak_N"] < served["peak_high_N"]
    assert served["outside"] == ""
    with pytest.raises(ValueError, match=r"row 1 has .* from 180 to 0 deg: .* 0 <= entry < exit"):
        SUBMODEL.serve(tmp_path)(table.assign(entry_deg=180.0, exit_deg=0.0))
    further = SUBMODEL.serve(tmp_path)(table.assign(feed_per_tooth_mm=0.3, axial_depth_mm=4.0))
    assert further["outside"].iloc[0] == "feed per tooth, axial depth of cut"
    wide, near = (
        (one["mean_high_N"] - one["mean_N"]) / one["mean_N"] for one in (further.iloc[0], served)
    )
    assert wide > near  # the zero counts less in a heavier cut
    with pytest.raises(ValueError, match="no column exit_deg"):
        SUBMODEL.serve(tmp_path)(table.drop(columns="exit_deg"))


def test_intervals_of_peak_and_mean_are_judged_and_shown():
    """Coverage of what was held out is a score; the page says whether each lies inside."""
    found = judged()
    for quantity in (PEAK, MEAN):
        (score,) = found.verdict.of(quantity, role="held_out", group="1.csv")
        assert score.coverage_90 == 1.0 and score.n == 1
        assert found.verdict.of(quantity, role="held_out", group="all")[0].coverage_90 == 1.0
    page = made(SUBMODEL, Shown(
        machine="m", origin="simulated", model=fitted(BETWEEN), verdict=found.verdict,
        predictions=found.predictions,
    ))  # fmt: skip
    assert page.verdict is not None and page.verdict.status == "passed"
    rows = next(rows for name, rows in tables(page).items() if name.startswith("Single values"))
    held = {row[0]: row[7] for row in rows if row[1] == "1.csv"}
    assert held == {PEAK: "inside", MEAN: "inside"}


def test_the_spindles_load_is_compared_with_the_dynamometer():
    """K_tc and K_te of the load that are those of the cut give its tangential force."""
    true = {"K_tc": (SLOT.cutting[0], "N/mm^2"), "K_te": (SLOT.edge[0], "N/mm")}
    load = {
        name: Parameter(
            value=1.1 * value, unit=unit, interval_95=(value, 1.2 * value), determined=True,
            method="load",
        )
        for name, (value, unit) in true.items()
    }  # fmt: skip
    model = fitted(BETWEEN)
    model = replace(model, parameters={**model.parameters, SPINDLE: load})
    predictor = ForcePredictor(model, known_of(SLOT), SETTINGS)
    found = [replace(one, role="held_out") for one in recordings(SLOT, SLOTS)]
    frame = pd.concat([predictor.prediction(one).frame.assign(case=one.name) for one in found])
    share = frame[frame["quantity"] == BY_LOAD_SHARE]
    assert len(share) == 3 and share["measured"].to_numpy() == pytest.approx(100.0)
    assert share["predicted"].to_numpy() == pytest.approx(110.0, abs=2.5)  # zeros of 1 N
    rows = frame[frame["quantity"] == BY_LOAD]
    f_z, a_p = 1e-4, 2.0
    by_hand = 2 * a_p / (2 * np.pi) * 1.1 * (850 * 2 * f_z * 1e3 + 22 * np.pi)
    assert rows["predicted"].iloc[1] == pytest.approx(by_hand, rel=1e-3)
