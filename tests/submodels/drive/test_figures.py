"""Figures of the drives: where things stand, odd numbers, what is drawn of a recording."""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, readings
from pipeline.schema.drive import CurvePoint, DriveAxis, FrictionPoint, RecursiveMass
from pipeline.submodels.drive.figures import (
    Curve,
    DriveTrace,
    closest_look,
    drawn_bands,
    friction_figure,
    friction_shown,
    mass_figure,
    mass_shown,
    trace_figure,
)
from pipeline.submodels.drive.page import Driven, DriveRun, drive_page, drive_trace, telling
from tests.submodels.drive.shown_drives import (
    drive_axis,
    parameter,
    recursive,
    shown,
    trace,
    verdict_on,
)

NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)


def points(*rows: tuple[float, float, float], **changes) -> DriveAxis:
    found = tuple(
        FrictionPoint(velocity_mm_s=v, force=f, half_width=h, seconds=1.0) for v, f, h in rows
    )
    return drive_axis("X", **{"friction_points": found, "friction_curve": (), **changes})


def circles(drawn: str, kind: str) -> np.ndarray:
    """Places (N, 2) of the points of one direction: percent, pixels."""
    found = re.findall(rf'<circle cx="([\d.]+)%" cy="([\d.]+)" r="3.5" class="point {kind}"', drawn)
    return np.array(found, dtype=float)


def test_speeds_of_equal_ratio_stand_at_equal_distances():
    found = friction_shown(points((0.1, 400, 1), (1, 300, 1), (10, 250, 1), (100, 300, 1)))
    x = circles(str(friction_figure(found, "")), "p-positive")[:, 0]
    assert np.diff(x) == pytest.approx(np.diff(x)[0], abs=0.02)  # two decimals of a percent
    assert 0 < x[0] < x[-1] < 100


def test_both_directions_share_one_scale_of_force_against_motion():
    found = friction_shown(points((5, 300, 1), (-5, -300, 1), (-50, -400, 1)))
    drawn = str(friction_figure(found, ""))
    there, back = circles(drawn, "p-positive"), circles(drawn, "p-negative")
    assert np.array_equal(there[0], back[0])
    assert back[1, 1] < back[0, 1]  # a larger force stands higher


def test_error_bars_are_as_long_as_their_intervals_and_centred_on_their_points():
    found = friction_shown(points((1, 300, 20), (10, 250, 40), (100, 320, 0)))
    drawn = str(friction_figure(found, ""))
    path = re.search(r'<path d="([^"]*)" class="curve bar-positive"', drawn).group(1)
    bars = np.array(re.findall(r"M(\d+) (\d+)v(\d+)", path), dtype=float)
    dots = circles(drawn, "p-positive")
    assert len(bars) == 2  # of no width there is no bar
    assert bars[1, 2] / bars[0, 2] == pytest.approx(2.0, rel=0.01)  # whole units of 1000
    middle = 18 + 260 * (bars[:, 1] + bars[:, 2] / 2) / svg.FULL
    assert middle == pytest.approx(dots[:2, 1], abs=0.3)
    assert bars[:, 0] / UNITS * 100 == pytest.approx(dots[:2, 0], abs=0.05)


def test_one_wide_interval_does_not_flatten_the_curve():
    found = friction_shown(points((1, 400, 5), (10, 300, 4000), (100, 500, 5)))
    y = circles(str(friction_figure(found, "")), "p-positive")[:, 1]
    assert np.ptp(y) > 0.3 * 260  # 200 N on a scale from 0 to 530 N
    drawn = str(friction_figure(found, ""))
    assert drawn.count('class="beyond"') == 2  # both ends of the bar, which the scale cuts
    assert "▲ beyond, up to 4300 N" in drawn


def test_the_curve_is_cut_where_nothing_was_measured():
    curve = tuple(CurvePoint(velocity_mm_s=float(v), force=300.0 + float(v))
                  for v in np.geomspace(1e-4, 100, 200))  # fmt: skip
    axis = points((4, 300, 1), (80, 350, 1), friction_curve=curve)
    drawn = str(friction_figure(friction_shown(axis), ""))
    path = re.search(r'<path d="M(-?\d+) [^"]*" class="curve curve-positive"', drawn)
    assert 0 <= int(path.group(1)) < 0.02 * UNITS  # one step of the curve, 7 % of a decade
    assert "0.1<" not in drawn and ">5<" in drawn


def test_the_longest_stretches_are_drawn_when_there_are_too_many():
    rows = tuple(
        FrictionPoint(velocity_mm_s=1.0 + i, force=300.0, half_width=1.0, seconds=float(i))
        for i in range(900)
    )
    found = friction_shown(points(friction_points=rows))
    assert found.count == 300
    assert found.points["positive"].speed.min() == 601


def test_an_axis_without_friction_has_no_figure():
    assert friction_shown(points()) is None


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
    found = friction_shown(points(friction_points=tuple(rows), friction_curve=curve))
    assert found is None or not NOT_A_NUMBER.search(str(friction_figure(found, "x")))


SOME = st.lists(NUMBER, min_size=3, max_size=9)


@cache
def any_run() -> DriveRun:
    return telling(driven({("X", "a"): (1.0, 1.0)}), "X")


@settings(max_examples=40, deadline=None)
@given(SOME, SOME, SOME)
def test_any_numbers_of_a_trace_give_a_figure_or_none(measured, modelled, seconds):
    rows = min(len(measured), len(modelled), len(seconds))
    frame = trace("a", "X", rows=rows)
    frame["t"] = np.tile(seconds[:rows], 3)
    frame["measured"] = np.tile(measured[:rows], 3)
    frame["predicted"] = np.tile(modelled[:rows], 3)
    found = drive_trace(frame, any_run())
    if found is None:
        return
    bands = drawn_bands(found, "A")
    for span in (found.span, closest_look(found)):
        if span is not None and bands:
            assert not NOT_A_NUMBER.search(str(trace_figure(bands, span, "x")))


@settings(max_examples=40, deadline=None)
@given(SOME, SOME, SOME)
def test_any_numbers_of_a_recursive_estimate_give_a_figure_or_none(seconds, value, half):
    rows = min(len(seconds), len(value), len(half))
    found = mass_shown(
        RecursiveMass(recording="a", unit="kg", time_s=tuple(seconds[:rows]),
                      value=tuple(value[:rows]), half_width=tuple(half[:rows])),
        parameter(420.0, "kg"),
    )  # fmt: skip
    assert found is None or not NOT_A_NUMBER.search(str(mass_figure(found, "x")))


def driven(runs, **changes) -> Driven:
    frames = pd.concat([trace(name, axis, rows=9) for axis, name in runs])
    return Driven.of(shown(verdict=verdict_on(runs, **changes), predictions=frames))


def shown_trace(**changes) -> DriveTrace:
    frame = trace("a", "X", rows=2000)

    def curve(name):
        rows = frame[frame["quantity"] == f"{name} X"]
        return Curve(seconds=rows["t"].to_numpy(), measured=rows["measured"].to_numpy(),
                     modelled=rows["predicted"].to_numpy())  # fmt: skip

    made = DriveTrace(axis="X", recording="a", following=curve("following error"),
                      command=curve("command"), speed=curve("speed"))  # fmt: skip
    return replace(made, **changes)


def test_the_close_look_is_where_the_model_is_farthest_off():
    made = shown_trace().following
    modelled = made.modelled.copy()
    modelled[[700, 1999]] += [400.0, 500.0]
    start, end = closest_look(shown_trace(following=replace(made, modelled=modelled)))
    assert end == made.seconds[-1] and end - start == pytest.approx(0.08 * 24.6)
    modelled[1999] = np.nan
    start, end = closest_look(shown_trace(following=replace(made, modelled=modelled)))
    assert (start + end) / 2 == pytest.approx(made.seconds[700])


def test_a_record_too_short_to_look_closer_is_drawn_once():
    made = shown_trace().following
    short = shown_trace(following=replace(made, seconds=made.seconds / 30))
    assert closest_look(short) is None


@pytest.mark.parametrize(("largest", "unit"), [(2990.0, "µm"), (3010.0, "mm")])
def test_large_following_errors_are_drawn_in_millimetres(largest, unit):
    measured = np.linspace(-largest, 0, 2000)
    made = replace(shown_trace().following, measured=measured, modelled=measured * 0.9)
    bands = drawn_bands(shown_trace(following=made), "A")
    found = next(b for b in bands if b.head == f"Following error, {unit}")
    factor = 1e-3 if unit == "mm" else 1.0
    assert found.curves["measured"][1].min() == pytest.approx(-largest * factor)
    left = next(b for b in bands if b.head == f"Modelled less measured, {unit}")
    assert left.curves["modelled"][1].max() == pytest.approx(0.1 * largest * factor)


def test_what_was_not_recorded_has_no_band():
    nothing = np.full(2000, np.nan)
    made = shown_trace()
    empty = replace(made.following, measured=nothing, modelled=nothing)
    bands = drawn_bands(shown_trace(following=empty), "V")
    assert [b.head for b in bands] == ["Speed, mm/s", "Command, V"]
    alone = replace(made.command, modelled=nothing)
    assert drawn_bands(shown_trace(following=empty, command=alone), "V") == []


def test_a_judged_recording_is_shown_before_a_longer_training_recording():
    runs = {("X", "long"): (1.0, 1.0, "training"), ("X", "short"): (1.0, 1.0),
            ("X", "middle"): (1.0, 1.0)}  # fmt: skip
    found = driven(runs, seconds={"long": 90.0, "short": 5.0, "middle": 9.0})
    assert telling(found, "X").case.case == "middle"
    assert telling(driven({("X", "long"): (1.0, 1.0, "training")}), "X").case.case == "long"
    assert telling(found, "Y") is None


def test_the_batch_value_stands_at_its_level_and_only_if_it_was_determined():
    drawn = str(mass_figure(mass_shown(recursive(), parameter(420.0, "kg", 0.006)), ""))
    level = float(re.search(r'<line x1="0" x2="100%" y1="([\d.]+)" [^>]*class="batch"', drawn)[1])
    grid = dict(re.findall(r'<text x="0%" y="([\d.]+)" dx="-6" class="tick end">(\d+)<', drawn))
    heights = {float(value): float(y) - 4 for y, value in grid.items()}
    low, high = min(heights), max(heights)
    share = (420.0 - low) / (high - low)
    assert level == pytest.approx(heights[low] + share * (heights[high] - heights[low]), abs=0.1)
    open_ = mass_shown(recursive(), parameter(None, "kg"))
    assert 'class="batch"' not in str(mass_figure(open_, ""))


def test_a_wide_start_does_not_flatten_the_rest_of_the_estimate():
    found = recursive()
    found = replace(found, half_width=(1e6, *found.half_width[1:]),
                    value=(found.value[0], -1e5, *found.value[2:]))  # fmt: skip
    drawn = str(mass_figure(mass_shown(found, parameter(420.0, "kg")), ""))
    assert ">450<" in drawn and ">500<" in drawn
    assert 'class="beyond"' in drawn and "▲ beyond" in drawn


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.booleans())
def test_a_band_holds_all_its_values_upright(values, zero):
    into = band(10.0, 100.0, np.array(values), zero=zero)
    drawn = [into.pixel(v) for v in sorted(values)]
    assert all(10.0 < y < 110.0 for y in drawn)
    assert all(a >= b for a, b in pairwise(drawn))
    assert not zero or into.low < 0 < into.high
    assert isinstance(into, Band)


def test_what_no_drive_can_have_shown_is_no_reading():
    found = readings(np.array([1.0, np.inf, -np.inf, 1e13, np.nan]))
    assert found[0] == 1.0 and np.isnan(found[1:]).all()


def test_every_figure_is_labelled_and_small():
    sections = drive_page(shown()).sections
    figures = [
        figure for section in sections for block in section.blocks
        for figure in getattr(block, "figures", [])
    ]  # fmt: skip
    assert len(figures) == 3 + 1 + 2 * 3  # friction, mass of X, whole and close look
    assert max(len(str(one.svg)) for one in figures) < 60_000
    labels = re.findall(r'role="img" aria-label="([^"]*)"', "".join(str(f.svg) for f in figures))
    assert len(labels) == len(figures) and all(len(label) > 40 for label in labels)


def test_text_from_files_stays_text():
    hostile = "<script>alert('x')</script>"
    axis = drive_axis("X", command_unit=hostile, force_unit=hostile)
    found = friction_figure(friction_shown(axis), hostile)
    assert "alert" in str(found) and "<script" not in str(found)
    bands = drawn_bands(shown_trace(), hostile)
    assert "<script" not in str(trace_figure(bands, shown_trace().span, hostile))
