"""What the page of the cut alone shows: coefficients, wear, the spindle's load, truth."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.charts.parameters import KnownValue
from pipeline.schema.model import LeftOut, Parameter
from pipeline.submodels.cutting.page import wear_note
from tests.submodels.cutting.cutting_files import (
    POWERS,
    SPINDLE,
    TRUTH,
    coefficients,
    cross,
    folds,
    model,
    page,
    parameter,
    predictions,
    run,
    verdict,
    without_forces,
)
from tests.submodels.made_pages import held_to_golden, tables, words


def test_the_page_is_the_golden_one():
    found = page(model(), verdict(), predictions(), truth={"cutting": TRUTH})
    held_to_golden(found, Path(__file__).with_name("page.txt"))


def test_the_load_of_the_spindle_gives_a_power_for_each_volume_of_chips():
    # 2010 N/mm^2 = 2010 J/cm^3; over a minute 2010 / 60 W
    assert "each cm³ of chips a minute takes 33.5 W at the tool" in words(page(model()))
    nothing = parameter(None, "N/mm^2", method="too few levels", remedy="record passes of 10 s")
    spindle = replace(SPINDLE, recordings=("a",), reason="no pass was long enough", assumed="")
    said = words(page(model({"spindle": {"specific_force": nothing}}, spindle=spindle)))
    assert "no specific force could be had. No pass was long enough." in said
    assert "record passes of 10 s" in said


def test_logs_of_the_spindle_say_what_of_them_is_not_used():
    lost = "idle.txt is a copy of free.txt: record another"
    spindle = replace(
        SPINDLE, recordings=("free.txt", "passes.txt"),
        notes=("passes.txt: 2 of 9 lines that cut are not used (line 12, 14): too short",),
        left_out=(LeftOut(case="idle.txt", reason=lost),),
        reason=f"{lost}; no pass was long enough",
    )  # fmt: skip
    rows = tables(page(model(spindle=spindle)))["Logs of the spindle’s load (3)"]
    assert rows[0] == ["free.txt", "used", "–"] and "line 12" in rows[1][2]
    assert rows[2][1:] == ["left out", "is a copy of free.txt: record another"]


def test_a_machine_with_nothing_but_its_spindles_load_says_what_forces_would_take():
    said = words(page(without_forces()))
    assert "No force was recorded on a dynamometer" in said and "edge: measure" not in said
    assert "each cm³ of chips a minute takes 33.5 W" in said
    assert "Power of the spindle" not in words(page(model({"spindle": None}, spindle=None)))


@pytest.mark.parametrize(("errors", "status"), [((9.0, 8.0), "within"), ((9.0, 31.0), "beyond")])
def test_where_all_was_learnt_from_cross_predictions_are_told(errors, status):
    """They are no verdict; where they are beyond the limits the twin is under reservation."""
    judged = verdict(run(600, 3.0, "training"), cross(600, errors[0]), cross(1200, errors[1]))
    found = page(model(folds=folds((600, 1200), (1200, 600))), judged).verdict
    assert found.status == "unknown" and found.reserved == (status == "beyond")
    assert "Predicted from the others: error of cutting forces (RMS) up to" in found.sentence


def test_the_truth_stands_beside_what_was_found():
    found = page(model(), verdict(), None, truth={"cutting": TRUTH})
    (rows,) = (rows for caption, rows in tables(found).items() if "hold the truth" in caption)
    truth = {row[0]: row[1:] for row in rows}
    # K_te misses: 21 +- 12 % ends at 23.52; three pitches of two teeth are 540 deg
    assert (
        truth["K_tc"][:3] == ["1 800", "1 820", "+1.11"] and truth["K_te"][5] == "misses the truth"
    )
    assert truth["runout_angle"][5] == "holds the truth, modulo 180°"
    assert truth["helix"][1] == "not determined"
    # at the tool 0.9 of what the motor takes: 603 W, and 1710 W against 1564 +- 42 W
    assert truth["no-load power at 6 000"][:2] == ["603", "614"]
    assert truth["no-load power at 12 000"][5] == "misses the truth"
    assert "no-load power at 500" not in truth
    assert not page(model(), verdict()).truth


@pytest.mark.parametrize(("factor", "worn"), [(1.4, True), (1.2, False), (0.7, False)])
def test_growth_counts_only_beyond_both_intervals(factor, worn):
    """12 % each way: 21 * 1.12 = 23.5 against 29.4 * 0.88 = 25.9."""
    note = wear_note("", "K_te", coefficients()["K_te"], coefficients(factor=factor)["K_te"])
    said = "K_te grew by more than both intervals allow: look for an edge that has worn since"
    assert note.startswith(said) == worn and bool(note) == worn


def test_grown_runout_sends_to_the_holder_and_shrunk_runout_to_nobody():
    before, grown, less = (parameter(value, "um", 0.08) for value in (11.4, 14.0, 8.0))
    assert "look for a tool that no longer runs true" in wear_note("", "runout", before, grown)
    assert wear_note("", "runout", before, less) == ""
    assert wear_note("channel x", "damping", before, grown) == ""
    force = POWERS["specific_force"]
    more = parameter(3000.0, "N/mm^2")
    assert wear_note("spindle", "specific_force", force, more).startswith("spindle specific_force")


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e3), st.floats(-2, 2), st.integers(-5, 5))
def test_an_interval_holds_what_lies_within_it_and_whole_periods_from_it(value, half, place, k):
    p = Parameter(
        value=value, unit="deg", interval_95=(value - half, value + half), determined=True,
        method="",
    )  # fmt: skip
    true = value + place * half
    inside = value - half <= true <= value + half
    assert KnownValue(name="a", true=true, parameter=p).holds == inside
    later = KnownValue(name="a", true=true + 120.0 * k, parameter=p, period=120.0)
    if abs(place) < 0.99:  # away from the ends, where a period's rounding counts
        assert later.holds
    if half < 50 and 1.01 < abs(place) < 1.2:  # beyond the end and short of the next period
        assert not later.holds
