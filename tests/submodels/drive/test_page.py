"""What the page of the feed drives alone shows: axes, truth, disturbances, traces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.schema.model import Parameter
from pipeline.schema.verdict import Fact
from pipeline.submodels.drive.page import truth_as_fitted
from pipeline.submodels.drive.submodel import SUBMODEL
from tests.submodels.drive.shown_drives import (
    drive_axis,
    drive_model,
    parameter,
    shown,
    trace,
    verdict_on,
)
from tests.submodels.made_pages import drawn, held_to_golden, made, plain, tables, words


def said(**changes) -> str:
    return words(made(SUBMODEL, shown(**changes)))


def axes(**changes):
    """A model of X alone, with parts of the axis changed."""
    return drive_model("X", axes={"X": drive_axis("X", **changes)})


def test_the_page_is_the_golden_one():
    held_to_golden(made(SUBMODEL, shown()), Path(__file__).with_name("page.txt"))


@pytest.mark.parametrize("absent", ["model", "verdict", "predictions", "truth"])
def test_without_one_file_the_rest_stands(absent):
    found = said(**{absent: None})
    assert ("Parameters of axis X" in found) == (absent != "model")
    assert ("circle-20mm held out" in found) == (absent != "verdict")
    assert ("Worst recording" in found) == (absent == "truth")
    assert ("intervals hold the truth" in found) == (absent not in ("model", "truth"))


def test_parameters_stand_in_shop_units_with_interval_and_remedy():
    # 0.0041 m/s +- 20 %; 0.0061 H +- 4 %
    rows = tables(made(SUBMODEL, shown()))
    of_x = {row[0]: row[1:] for row in rows["Parameters of axis X"]}
    assert of_x["stribeck_velocity_positive"][1:4] == ["4.10", "3.28 to 4.92", "mm/s"]
    of_y = {row[0]: row[1:] for row in rows["Parameters of axis Y"]}
    assert of_y["static_negative"][1] == "not determined"
    assert "below 1 mm/s" in of_y["static_negative"][4]
    motor = {row[0]: row[1:] for row in rows["Parameters of the motor"]}
    assert motor["L_d"][1:4] == ["6.10", "5.86 to 6.34", "mH"]


def test_forces_of_an_unknown_drive_stay_in_its_command():
    model = axes(force_unit="A")
    found = said(model=replace(model, parameters={"X": {"mass": parameter(1.7, "A s^2/m")}}))
    assert "Nobody has said what force one A makes" in found and "1.70 1.65 to 1.75 A s²/m" in found


def test_an_axis_says_why_its_loops_were_not_identified():
    found = said(model=axes(servo_reason="X has no reference"))
    assert "Its loops could not be found: X has no reference." in found


def test_a_failed_axis_is_named_with_what_is_beyond_its_limit_and_the_cause():
    failed = verdict_on({("X", "pulses.mat"): (4.0, 16.0), ("Z", "a"): (3.0, 3.0)}, facts=DISTURBED)
    verdict = made(SUBMODEL, shown(verdict=failed)).verdict
    assert verdict.status == "failed"
    assert "up to 16 % in pulses (limit 15 %)" in plain(verdict.sentence)
    assert "error of the axes’ force" not in verdict.sentence  # which keeps its limit
    assert "enters at the speed command, not as a force on the axis" in verdict.sentence
    assert "enters at" in said(verdict=failed)


def test_the_truth_stands_beside_what_was_identified_and_misses_are_named_at_the_head():
    found = made(SUBMODEL, shown())
    (rows,) = (rows for caption, rows in tables(found).items() if "hold the truth" in caption)
    truth = {row[0]: row[1:] for row in rows}
    assert truth["X mass"] == ["421.0", "420.0", "−0.24", "417.5 to 422.5", "kg", "holds the truth"]
    assert truth["X stribeck_velocity_positive"][:3] == ["4.00", "4.10", "+2.50"]
    assert truth["Y static_positive"][1] == "not determined"
    assert "X viscous_positive misses it" in " ".join(found.notes)


def test_a_trace_has_speed_and_command_below_and_a_close_look():
    found = drawn(made(SUBMODEL, shown()))
    worst = next(svg for caption, svg in found.items() if caption.startswith("Worst recording"))
    for head in ("Following error X, µm", "Predicted less measured", "Speed, mm/s", "Command, A"):
        assert head in worst
    assert any(caption.startswith("The same about its greatest error") for caption in found)


@pytest.mark.parametrize(("largest", "unit"), [(2990.0, "µm"), (3010.0, "mm")])
def test_large_following_errors_are_drawn_in_millimetres(largest, unit):
    frame = trace("a", "X")
    rows = frame["quantity"] == "following error X"
    frame.loc[rows, "measured"] = np.linspace(-largest, 0, rows.sum())
    frame.loc[rows, "predicted"] = 0.9 * frame.loc[rows, "measured"]
    page = made(SUBMODEL, shown(verdict=verdict_on({("X", "a"): (1.0, 1.0)}), predictions=frame))
    assert any(f"Following error X, {unit}" in svg for svg in drawn(page).values())


LEVEL = st.floats(10.0, 1e3)


@given(LEVEL, LEVEL, LEVEL, st.floats(-2e3, 2e3), st.booleans())
def test_a_truth_split_as_the_fit_splits_it_has_the_same_force_in_motion(
    positive, negative, more, force, alike
):
    truth = {"coulomb_positive": positive, "coulomb_negative": negative, "offset": force,
             "static_positive": positive + more, "static_negative": negative + more}  # fmt: skip
    found = truth_as_fitted(truth, {
        "coulomb_positive": parameter(5.0, "N"),
        "coulomb_negative": parameter(5.0 if alike else 6.0, "N"),
        "offset": parameter(1.0 if alike else None, "N")})  # fmt: skip
    for kind in ("coulomb", "static"):
        there, back = (
            [t[f"{kind}_positive"] + t["offset"], -t[f"{kind}_negative"] + t["offset"]]
            for t in (truth, found)
        )
        assert back == pytest.approx(there, abs=1e-9)
    if alike:
        assert found["coulomb_positive"] == pytest.approx(found["coulomb_negative"])
    else:
        assert found["offset"] == 0


def test_a_fit_that_separates_friction_and_force_is_held_against_the_plain_truth():
    truth = {"coulomb_positive": 3.0, "coulomb_negative": 5.0, "offset": 7.0}
    found: dict[str, Parameter] = {"coulomb_positive": parameter(3.1, "N"),
                                   "coulomb_negative": parameter(4.9, "N"),
                                   "offset": parameter(7.2, "N")}  # fmt: skip
    assert truth_as_fitted(truth, found) == truth


DISTURBED = {
    "disturbance X enters at": Fact(value="the speed command"),
    "disturbance X, factor": Fact(value=2.5, unit="m/s per unit of the channel"),
    "disturbance X, factor, half width": Fact(value=0.12, unit="m/s per unit of the channel"),
    "disturbance X, error explained": Fact(value=98.0, unit="%"),
    "disturbance X, cause": Fact(value="the disturbance enters at the speed command, not as a "
                                       "force on the axis, it acts as if in mm/s"),
}  # fmt: skip
