"""Verdict on a cut: its figures by hand, who is judged, and what passes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.identification.cutting.document import cutting_document
from pipeline.identification.cutting.identify import identify_cut
from pipeline.identification.cutting.known import Dynamometer
from pipeline.signals.ingest import MachineIdentity
from pipeline.validation.cutting import CuttingLimits, cutting_metrics, cutting_verdict
from pipeline.validation.cutting_errors import components, over_limits
from tests.identification.cutting.milling import Truth
from tests.identification.cutting.recorded import SETTINGS, known_of, recordings

TRUTH = Truth(flutes=2, runout=0.004, runout_angle=0.0, natural=(1900.0, 1500.0, 2600.0))
SLOTS = [(6000.0, f, 2.0, 0.0, np.pi) for f in (0.05, 0.1, 0.15)]
IDENTITY = MachineIdentity(name="m", description="", origin="simulated")
STRAIGHT = Dynamometer(feed="x", normal="y", axial="z")


@cache
def judged(trained=(True, False, True), feed_error=1.0):
    """Documents where some are trained; the feed of the second was another than it says."""
    found = [
        replace(one, trained=learn)
        for one, learn in zip(recordings(TRUTH, SLOTS), trained, strict=True)
    ]
    conditions = found[1].cut[0]
    found[1] = replace(found[1], conditions=replace(conditions, f_z=feed_error * conditions.f_z))
    known = known_of(TRUTH)
    document = cutting_document(
        IDENTITY, known, identify_cut(found, known, SETTINGS), SETTINGS, spindle={}
    )
    verdict, traces = cutting_verdict(document, found, IDENTITY, known, SETTINGS, CuttingLimits())
    return document, verdict, traces


def test_a_feed_between_is_predicted():
    _, verdict, _ = judged()
    assert verdict["passed"] is True
    row = verdict["recordings"][1]
    assert (row["role"], row["status"]) == ("judged", "passed")
    resultant = row["components"]["resultant"]
    assert resultant["rms_error_percent"] < 3  # noise of 1.5 N in 100 N, zeros of 1 N
    assert row["plain"]["components"]["resultant"]["rms_error_percent"] > 10


def test_what_was_learnt_from_is_not_judged():
    _, verdict, _ = judged((True, True, True))
    assert verdict["passed"] is None
    assert "found from all recordings of use" in verdict["reason"]
    assert {row["status"] for row in verdict["recordings"]} == {"not judged"}


def test_a_cut_that_was_not_what_it_says_fails():
    _, verdict, _ = judged(feed_error=1.3)
    assert verdict["passed"] is False
    assert "mean: " in verdict["recordings"][1]["reason"]


def test_every_training_recording_is_predicted_from_the_others():
    document, verdict, _ = judged((True, True, True))
    names = [one["recording"] for one in document["recordings"]]
    assert sorted(row["recording"] for row in verdict["cross"]) == names
    for row in verdict["cross"]:
        assert row["recording"] not in row["from"]
        assert row["components"]["resultant"]["rms_error_percent"] < 5


def test_without_a_recording_to_learn_from_nothing_is_judged():
    document, verdict, traces = judged((False, False, False))
    assert document["fit"] is None
    assert verdict["passed"] is None
    assert "cutting_records.training" in verdict["reason"]
    assert traces.num_rows == 0 and "plain_z" in traces.column_names


def test_traces_are_revolutions_in_the_channels():
    _, _, traces = judged()
    frame = traces.to_pandas()
    assert list(frame.groupby("recording").size()) == [128] * 3
    inside = (frame.low_x <= frame.measured_x + 1) & (frame.measured_x - 1 <= frame.high_x)
    assert inside.mean() > 0.9
    error = frame.modelled_x - frame.measured_x
    assert np.sqrt((error**2).mean()) < 0.05 * np.sqrt((frame.measured_x**2).mean())


def test_metrics_are_flat():
    _, verdict, _ = judged()
    metrics = cutting_metrics(verdict)
    assert metrics["verdict"] == "passed"
    assert metrics["recordings_judged"] == 1
    assert all(isinstance(value, float | int | str) for value in metrics.values())


def test_figures_of_a_force_that_turns():
    """10 N that turn once a revolution about a mean of (3, 4) N, predicted 10 % too large."""
    lines = np.zeros((3, 3), dtype=complex)
    lines[0], lines[1] = (3.0, 4.0, 0.0), (10.0, -10.0j, 0.0)
    found = components(lines, 1.1 * lines, STRAIGHT)
    assert found["x"]["measured"] == pytest.approx(
        {"peak": 13.0, "mean": 3.0, "rms": np.sqrt(9 + 50)}, rel=1e-4
    )
    for name in ("x", "y", "resultant"):
        for figure in ("peak", "mean", "rms"):
            assert found[name][f"{figure}_error_percent"] == pytest.approx(10.0, abs=0.01)
    assert found["resultant"]["measured"]["peak"] == pytest.approx(15.0, rel=1e-4)
    assert found["resultant"]["measured"]["rms"] == pytest.approx(np.sqrt(125), rel=1e-4)


def test_a_mean_next_to_nothing_is_no_measure():
    lines = np.zeros((2, 3), dtype=complex)
    lines[1] = 10.0
    assert components(lines, lines, STRAIGHT)["x"]["mean_error_percent"] is None


def test_limits_are_of_either_sign():
    figures = {"peak_error_percent": -6.0, "mean_error_percent": 4.0, "rms_error_percent": 21.0}
    assert over_limits(figures, peak=5, mean=5, rms=20) == ["peak: 6 % > 5 %",
                                                            "RMS error: 21 % > 20 %"]  # fmt: skip
    with pytest.raises(ValueError, match=r"cutting_limits\.rms_percent = 0"):
        CuttingLimits(rms_percent=0.0)
