"""Commands of the recorded drives: limits of the axes, plateaus, circles, a program's path."""

from itertools import pairwise
from math import hypot, inf

import numpy as np
import pytest

from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.drives.parameters import Drives
from pipeline.shop.drives.records import (
    circles,
    commanded,
    reciprocation,
    smoothed,
    travel,
)

from .conftest import shop_parameters

HERTZ = 2000
SOON = 300
"""Samples until most next points."""
AHEAD = 8 * HERTZ
"""Samples until the next point at the latest: a tool change and the way after it."""
EXACT = 1e-6  # of differences of ways in mm, twice divided by half a millisecond


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
@pytest.mark.parametrize("letter", ["X", "Y", "Z"])
def test_strokes_hold_twelve_speeds_and_keep_the_limits_of_the_axis(machine, letter):
    """Each speed both ways for 0.3 s at least; neither speed, acceleration nor travel is passed."""
    shop = shop_parameters(machine)
    limits, axis = getattr(shop.control, letter.lower()), shop.drives.axes[letter]
    own = limits.bounds
    moves = reciprocation(shop.drives.tool.speeds, limits.rapid / 60, own, axis.lead)
    way = travel(moves, own, HERTZ)
    v = np.diff(way) * HERTZ
    a = np.diff(v) * HERTZ
    assert np.abs(v).max() == pytest.approx(limits.rapid / 60, rel=EXACT)
    assert np.abs(a).max() <= own[0] * (1 + EXACT)
    assert np.ptp(way) < 400  # mm, the shortest travel of a mill of this size
    steady = np.abs(a) < 1e-3
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(int)))
    held: dict[float, float] = {}
    for first, last in edges.reshape(-1, 2):
        speed = round(float(v[first : last + 1].mean()), 3)
        held[speed] = max(held.get(speed, 0), (last - first) / HERTZ)
    wanted = [s * way for s in (*shop.drives.tool.speeds, limits.rapid / 60) for way in (1, -1)]
    assert len(wanted) >= 2 * 12 and min(np.abs(wanted)) == 0.2
    for speed in wanted:
        assert held[round(speed, 3)] >= 0.3


def test_smoothing_delays_by_half_its_windows_and_keeps_the_ends():
    """A ramp comes out as the same ramp, later by the middles of both windows."""
    time = np.arange(4000) / HERTZ
    ramp = 120.0 + 50.0 * np.clip(time - 0.5, 0, 1)
    out = smoothed(ramp, HERTZ)
    assert out[0] == 120.0 and out[-1] == pytest.approx(170.0, abs=1e-9)
    inside = slice(int(0.6 * HERTZ), int(1.4 * HERTZ))
    delay = (16 - 1) / 2 + (8 - 1) / 2  # of means over 16 and 8 samples
    expected = 120.0 + 50.0 * (time[inside] - delay / HERTZ - 0.5)
    assert out[inside] == pytest.approx(expected, abs=1e-9)


def test_circles_are_round_and_as_fast_as_told():
    """Radius in every sample; both feeds both ways within the path's acceleration."""
    limits = shop_parameters("mill01").control.path_bounds
    x, y = circles(80.0, (50.0, 150.0), 1.25, limits, HERTZ)
    assert np.hypot(x, y) == pytest.approx(np.full(x.size, 40.0), abs=1e-12)
    turn = np.unwrap(np.arctan2(y, x))
    speed = np.diff(turn) * 40 * HERTZ
    for feed in (50.0, 150.0):
        for sign in (1, -1):
            assert np.mean(np.abs(speed - sign * feed) < 1e-3) > 0.05
    assert np.ptp(turn) == pytest.approx(2.5 * np.pi, abs=1e-9)
    assert turn[-1] == pytest.approx(turn[0], abs=1e-9)


@pytest.fixture(scope="module", params=["mill01", pytest.param("mill02", marks=pytest.mark.proof)])
def cam(request: pytest.FixtureRequest) -> tuple[PartProgram, np.ndarray, tuple[float, ...]]:
    shop = shop_parameters(request.param)
    program = part_programs(shop.control, shop.generator("part programs"))[0][2]
    way = commanded(program, shop, HERTZ, (-400.0, 0.0, 0.0))
    return program, way, shop.control.work_offset


def test_the_axes_pass_all_points_of_the_program_in_turn(cam):
    """Every programmed end, moved by work offset and tool length, lies at the way.

    0.05 mm: what the smoothing cuts off a corner, v T / 8 with 24 mm/s in the short chords, and
    the way between two samples.
    """
    program, way, offset = cam
    lengths = {t.number: t.length for t in program.tools}
    tool, at, seen = 0, 0, 0
    for step in program.steps:
        tool = step.number if step.kind == "tool" else tool
        if step.kind not in ("rapid", "line", "arc") or step.end[2] == inf:
            continue
        goal = np.array(step.end) + np.array(offset) + [0, 0, lengths[tool]]
        ahead = way[at : at + AHEAD]
        near = np.abs(ahead[:SOON] - goal).max(axis=1) < 0.05
        if not near.any():
            near = np.abs(ahead - goal).max(axis=1) < 0.05
        assert near.any(), f"line {step.line}: {goal} is not passed after sample {at}"
        at += int(np.argmax(near))
        seen += 1
    assert seen > 500


def test_arcs_of_the_program_keep_their_radius(cam):
    """Samples in the middle of full circles stand at the radius, but for the smoothing.

    Two means of 8 and 4 ms take v^2 (T1^2 + T2^2) / (24 r) off a radius: 3 um at 40 mm/s and 2 mm.
    """
    program, way, offset = cam
    tried = 0
    for before, step in pairwise(program.steps):
        if step.kind != "arc" or abs(step.turn) < 6:
            continue
        centre = np.array(step.centre) + offset[:2]
        radius = hypot(*(np.array(before.end[:2]) - np.array(step.centre)))
        away = np.hypot(*(way[:, :2] - centre).T)
        on = np.abs(away - radius) < 4e-3
        assert on.mean() * len(way) > 2 * np.pi * radius / (step.feed / 60) * HERTZ * 0.5
        tried += 1
    assert tried > 0


def test_the_axes_keep_their_rapids(cam):
    _, way, _ = cam
    speed = np.abs(np.diff(way, axis=0)).max(axis=0) * HERTZ * 60
    assert np.all(speed <= [36000.1, 36000.1, 30000.1])
    assert Drives().x.cascade.position_frequency == HERTZ
