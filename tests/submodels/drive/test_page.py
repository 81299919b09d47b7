"""What the page of the feed drives alone shows: axes, truth, disturbances, traces."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, strips_figure
from pipeline.schema.drive import CurvePoint, DriveAxis, FrictionPoint, RecursiveMass
from pipeline.schema.model import Parameter
from pipeline.schema.verdict import Fact
from pipeline.submodels.drive.figures import friction_strip, mass_strip
from pipeline.submodels.drive.submodel import SUBMODEL
from pipeline.submodels.drive.truth import truth_as_fitted
from tests.submodels.drive.shown_drives import (
    drive_axis,
    drive_model,
    parameter,
    recursive,
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


NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)


def friction(axis: DriveAxis) -> str:
    """Figure of friction; empty where there is none."""
    found = friction_strip(axis)
    return "" if found is None else str(strips_figure([found[0]], found[1], "x"))


def mass(found: RecursiveMass, batch: Parameter) -> str:
    """Figure of the mass; empty where there is none."""
    made = mass_strip(found, batch if batch.determined else None)
    return "" if made is None else str(strips_figure([made[0]], made[1], "x"))


def points(*rows: tuple[float, float, float], **changes) -> DriveAxis:
    found = tuple(
        FrictionPoint(velocity_mm_s=v, force=f, half_width=h, seconds=1.0) for v, f, h in rows
    )
    return drive_axis("X", **{"friction_points": found, "friction_curve": (), **changes})


def circles(drawn: str, kind: str) -> np.ndarray:
    """Places (N, 2) of the points of one direction: percent, pixels."""
    found = re.findall(rf'<circle cx="([\d.]+)%" cy="([\d.]+)" r="3.5" class="point {kind}"', drawn)
    return np.array(found, dtype=float)


def test_both_directions_share_one_scale_of_force_against_motion():
    drawn = friction(points((5, 300, 1), (-5, -300, 1), (-50, -400, 1)))
    there, back = circles(drawn, "p-positive"), circles(drawn, "p-negative")
    assert np.array_equal(there[0], back[0])
    assert back[1, 1] < back[0, 1]  # a larger force stands higher


def test_error_bars_are_as_long_as_their_intervals_and_centred_on_their_points():
    drawn = friction(points((1, 300, 20), (10, 250, 40), (100, 320, 0)))
    path = re.search(r'<path d="([^"]*)" class="curve bar-positive"', drawn).group(1)
    bars = np.array(re.findall(r"M(\d+) (\d+)l0 -(\d+)", path), dtype=float)
    dots = circles(drawn, "p-positive")
    assert len(bars) == 2  # of no width there is no bar
    assert bars[1, 2] / bars[0, 2] == pytest.approx(2.0, rel=0.01)  # whole units of 1000
    middle = 18 + 260 * (bars[:, 1] - bars[:, 2] / 2) / svg.FULL
    assert middle == pytest.approx(dots[:2, 1], abs=0.3)
    assert bars[:, 0] / UNITS * 100 == pytest.approx(dots[:2, 0], abs=0.05)


def test_one_wide_interval_does_not_flatten_the_curve():
    drawn = friction(points((1, 400, 5), (10, 300, 4000), (100, 500, 5)))
    y = circles(drawn, "p-positive")[:, 1]
    assert np.ptp(y) > 0.3 * 260  # 200 N on a scale from 0 to 530 N
    assert drawn.count('class="beyond"') == 2  # both ends of the bar, which the scale cuts
    assert "▲ above, up to 4300 N; ▼ below, down to −3700 N" in drawn


def test_the_curve_is_cut_where_nothing_was_measured():
    curve = tuple(CurvePoint(velocity_mm_s=float(v), force=300.0 + float(v))
                  for v in np.geomspace(1e-4, 100, 200))  # fmt: skip
    axis = points((4, 300, 1), (80, 350, 1), friction_curve=curve)
    drawn = friction(axis)
    path = re.search(r'<path d="M(-?\d+) [^"]*" class="curve curve-positive"', drawn)
    assert 0 <= int(path.group(1)) < 0.02 * UNITS  # one step of the curve, 7 % of a decade
    assert "0.1<" not in drawn and ">5<" in drawn


NUMBER = st.floats()


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.builds(FrictionPoint, velocity_mm_s=NUMBER, force=NUMBER,
                  half_width=NUMBER | st.none(), seconds=NUMBER),
        max_size=6,
    )
)  # fmt: skip
def test_any_numbers_of_friction_give_a_figure_or_none(rows):
    curve = tuple(CurvePoint(velocity_mm_s=r.velocity_mm_s, force=r.force) for r in rows[:3])
    assert not NOT_A_NUMBER.search(friction(points(friction_points=tuple(rows),
                                                   friction_curve=curve)))  # fmt: skip


SOME = st.lists(NUMBER, min_size=3, max_size=9)


@settings(max_examples=40, deadline=None)
@given(SOME, SOME, SOME)
def test_any_numbers_of_a_recursive_estimate_give_a_figure_or_none(seconds, value, half):
    rows = min(len(seconds), len(value), len(half))
    found = RecursiveMass(recording="a", unit="kg", time_s=tuple(seconds[:rows]),
                          value=tuple(value[:rows]), half_width=tuple(half[:rows]))  # fmt: skip
    assert not NOT_A_NUMBER.search(mass(found, parameter(420.0, "kg")))


def test_the_batch_value_stands_at_its_level_and_only_if_it_was_determined():
    drawn = mass(recursive(), parameter(420.0, "kg", 0.006))
    line = r'<line x1="0" x2="100%" y1="([\d.]+)" [^>]*class="grid limit"'
    level = float(re.search(line, drawn)[1])
    grid = dict(re.findall(r'<text x="0%" y="([\d.]+)" dx="-6" class="tick end">(\d+)<', drawn))
    heights = {float(value): float(y) - 4 for y, value in grid.items()}
    low, high = min(heights), max(heights)
    share = (420.0 - low) / (high - low)
    assert level == pytest.approx(heights[low] + share * (heights[high] - heights[low]), abs=0.1)
    assert 'class="grid limit"' not in mass(recursive(), parameter(None, "kg"))


def test_a_wide_start_does_not_flatten_the_rest_of_the_estimate():
    found = recursive()
    found = replace(found, half_width=(1e6, *found.half_width[1:]),
                    value=(found.value[0], -1e5, *found.value[2:]))  # fmt: skip
    drawn = mass(found, parameter(420.0, "kg"))
    assert ">450<" in drawn and ">500<" in drawn
    assert 'class="beyond"' in drawn and "▼ below" in drawn
