"""Figures of the drives: where things stand, odd numbers, what the scale does not reach."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, strips_figure
from pipeline.schema.drive import CurvePoint, DriveAxis, FrictionPoint, RecursiveMass
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.figures import friction_strip, mass_strip
from tests.submodels.drive.shown_drives import drive_axis, parameter, recursive

NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)


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


def test_speeds_of_equal_ratio_stand_at_equal_distances():
    drawn = friction(points((0.1, 400, 1), (1, 300, 1), (10, 250, 1), (100, 300, 1)))
    x = circles(drawn, "p-positive")[:, 0]
    assert np.diff(x) == pytest.approx(np.diff(x)[0], abs=0.02)  # two decimals of a percent
    assert 0 < x[0] < x[-1] < 100


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
    assert "▲ beyond, up to 4300 N" in drawn


def test_the_curve_is_cut_where_nothing_was_measured():
    curve = tuple(CurvePoint(velocity_mm_s=float(v), force=300.0 + float(v))
                  for v in np.geomspace(1e-4, 100, 200))  # fmt: skip
    axis = points((4, 300, 1), (80, 350, 1), friction_curve=curve)
    drawn = friction(axis)
    path = re.search(r'<path d="M(-?\d+) [^"]*" class="curve curve-positive"', drawn)
    assert 0 <= int(path.group(1)) < 0.02 * UNITS  # one step of the curve, 7 % of a decade
    assert "0.1<" not in drawn and ">5<" in drawn


def test_the_longest_stretches_are_drawn_when_there_are_too_many():
    rows = tuple(
        FrictionPoint(velocity_mm_s=1.0 + i, force=300.0, half_width=1.0, seconds=float(i))
        for i in range(900)
    )
    strip, _ = friction_strip(points(friction_points=rows))
    (_, speed, _) = next(dots for dots in strip.dots if dots[0] == "p-positive")
    assert len(speed) == 250 and 10 ** speed.min() == pytest.approx(651)


def test_an_axis_without_friction_has_no_figure():
    assert friction(points()) == ""


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
    assert 'class="beyond"' in drawn and "▲ beyond" in drawn
