"""Forces of a trial cut against those of straight passes, and along ways that no pass has."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from pipeline.shop.cutting.force import Motion, pass_forces, wear
from pipeline.shop.cutting.parameters import Conditions, Dynamometer, EndMill, Workpiece
from pipeline.shop.parameters import Cutting, ShopParameters
from pipeline.shop.trial.cutting import Chance, Steps, _chip, cut
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.trials import prepare

STEADY = ShopParameters(
    machine="trial", cutting=Cutting(dynamometer=Dynamometer(speed_error=0.0, speed_wander=0.0))
)
PLAIN = EndMill(
    number=1, diameter=6.0, flutes=2, helix=0.0, runout=0.0, tilt=0.0, sharpness=(1.0, 1.0)
)
EVEN = replace(PLAIN, break_in=0.0, wear_rate=0.0)
OFFSET = replace(EVEN, runout=6.0, runout_angle=40.0, tilt=0.5, tilt_angle=100.0)
HELIX = EndMill(
    number=1, runout=6.5, tilt=0.6, break_in=0.0, wear_rate=0.0
)  # of 12 mm, three teeth, 30 degrees
"""Wears as aluminium wears it; its tests leave that out, as a pass has the wear of its middle."""
BLANK = (0.0, 40.0, 0.0, 30.0, -10.0, 0.0)
USED = 5.0
"""What a tooth has cut before [m]."""


def loads(lines: str, tool: EndMill, blank=BLANK, speed: int = 5000) -> dict[int, float]:
    """Of a program that begins at X-20 Y-20 Z5, without any chance."""
    text = f"G21 G90 G54\nG0 X-20 Y-20 S{speed} M3\nG43 Z5 H1\n{lines}\nG0 Z5\nM30\n"
    job = TrialJob(blank=blank, limit_load_N=60.0, tools={1: tool})
    its = prepare(text, "P", job, STEADY)
    part = Chance(
        workpiece=job.workpiece, tools={1: tool}, used={1: USED}, deeper={1: 0.0},
        speed_error=0.0, angle=0.3,
    )  # fmt: skip
    return cut(its.track, its.swept, part, STEADY, np.random.default_rng(0))


def straight(tool: EndMill, immersion: str, width: float, feed: float, speed: float, depth: float):
    """Peak load of a straight pass in the middle of its block [N]."""
    c = Conditions(immersion=immersion, depth=depth, width=width, feed=feed, speed=speed)
    angle = np.arange(6 * 720) * 2 * pi / 720
    x = 0.02 + angle / (2 * pi) * feed / speed * 1e-3
    force = pass_forces(
        c,
        tool,
        Workpiece(),
        Motion(angle=angle, x=x),
        VB=wear(tool, USED),
        length=40.0,
        slice_height=0.0625,
    )
    return float(np.hypot(force[:, 0], force[:, 1]).max())


@pytest.mark.parametrize("tool", [EVEN, OFFSET, HELIX], ids=["plain", "offset", "helix"])
@pytest.mark.parametrize(("immersion", "share"), [("slot", 1), ("up", 0.5), ("down", 0.5),
                                                  ("up", 0.1), ("down", 0.1)])  # fmt: skip
def test_a_straight_cut_is_a_straight_pass(tool, immersion, share):
    """1 % of the peak: steps of 3 degrees, slices of 0.25 mm, walls known to half a cell."""
    width, feed, r = share * tool.diameter, 300.0, tool.diameter / 2
    y = {"slot": 15.0, "up": 30.0 - width + r, "down": width - r}[immersion]
    found = loads(f"G0 Y{y}\nG1 Z-1 F200\nX30 F{feed}", tool)
    expected = straight(tool, immersion, width, feed, 5000.0, 1.0)
    assert found[6] == pytest.approx(expected, rel=0.01)


def test_an_inside_corner_loads_the_tool_more_than_the_walls_beside_it():
    """0.3 mm along two walls of a frame that was slotted before; the corner has its own lines."""
    frame = "G0 X8 Y8\nG1 Z-1 F200\nX32 F300\nY22\nG0 Z5\n"
    walls = "G0 X8 Y7.7\nG1 Z-1 F200\nX26 F300\nX32.3\nY14\nY18\nG0 Z5"
    found = loads(frame + walls, EVEN)
    wall = straight(EVEN, "down", 0.3, 300.0, 5000.0, 1.0)
    slot = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    assert [found[11], found[14]] == pytest.approx([wall, wall], rel=0.02)
    assert wall < 0.85 * slot and found[12] == pytest.approx(slot, rel=0.02)


def test_what_was_cut_before_is_cut_no_more():
    """A second pass along the first, with teeth that are alike, finds nothing."""
    way = "G0 Y15\nG1 Z-1 F200\nX45 F300\nG0 Z5\nX-20\n"
    found = loads(2 * way, EVEN)
    assert found[6] > 50 and found.get(11, 0.0) == 0
    deeper = loads(way + way.replace("Z-1", "Z-1.5"), EVEN)
    assert deeper[11] == pytest.approx(found[6] / 2, rel=0.02)


def test_an_open_arc_is_cut_like_the_line_that_it_nearly_is():
    """On a radius of 12 mm the chip is that of the slot: the tool's centre moves at the feed."""
    found = loads("G0 X5 Y15\nG1 Z-1 F300\nX8\nG2 X32 Y15 I12 J0\nG0 Z5", EVEN)
    expected = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    assert found[7] == pytest.approx(expected, rel=0.02)


def test_the_load_goes_with_the_depth_and_the_chip():
    way = "G0 Y15\nG1 Z-1 F200\nX45 F300\nG0 Z5"
    one = loads(way, EVEN)[6]
    assert loads(way.replace("Z-1", "Z-2"), EVEN)[6] == pytest.approx(2 * one, rel=1e-3)
    fast = straight(EVEN, "slot", 6.0, 500.0, 5000.0, 1.0)
    assert loads(way.replace("F300", "F500"), EVEN)[6] == pytest.approx(fast, rel=0.01)


def test_a_ramp_reaches_the_load_of_its_depth_little_by_little():
    """Layers of a quarter of a millimetre, each cut from where the tip stands in it."""
    found = loads("G0 X0 Y15\nG1 Z0 F300\nX40 Z-1\nG0 Z5", EVEN, blank=(-30.0, 80.0, 0, 30, -5, 0))
    whole = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    half = loads("G0 X0 Y15\nG1 Z0 F300\nX20 Z-0.5\nG0 Z5", EVEN, blank=(-30.0, 80.0, 0, 30, -5, 0))
    assert found[6] == pytest.approx(whole, rel=0.03)
    assert half[6] == pytest.approx(whole / 2, rel=0.04)


def test_where_the_blank_ends_the_cut_ends():
    found = loads("G0 Y15\nG1 Z-1 F200\nX-4 F300\nG0 Z5\nX46\nG1 Z-1\nX50\nG0 Z5", EVEN)
    assert not any(found.values())


@settings(max_examples=12, deadline=None)
@given(turned=st.floats(0, 2 * pi))
def test_the_load_does_not_ask_where_the_way_points(turned):
    """A slot and a shoulder of a quarter beside it, up and back down, 12 mm through a wide blank.

    1.5 %: cells are squares, and the shoulder's wall is known to a cell.
    """
    along, left = (
        np.array([np.cos(turned), np.sin(turned)]),
        np.array([-np.sin(turned), np.cos(turned)]),
    )
    places = [-6 * along, 6 * along, 6 * along + 1.5 * left, -2 * along + 1.5 * left]
    a, b, c, d = (f"X{20 + x:.4f} Y{15 + y:.4f}" for x, y in places)
    way = f"G0 {a}\nG1 Z-1 F300\n{b} F300\nG0 Z5\n{c}\nG1 Z-1\n{d}\nG0 Z5"
    found = loads(way, EVEN, blank=(0.0, 40.0, 0.0, 30.0, -5.0, 0.0))
    assert found[6] == pytest.approx(straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0), rel=0.015)
    assert found[10] == pytest.approx(straight(EVEN, "down", 1.5, 300.0, 5000.0, 1.0), rel=0.015)


def test_chips_on_a_bent_way_are_those_of_true_paths():
    """Against a root finder on the ways of all earlier teeth about a centre that turns.

    The centre goes 0.25 mm a turn on a radius of 2 mm; 0.1 um of chips of 20 um and more: between
    two pitches the centre's way counts as straight.
    """
    turn, feed, bend = 360, 0.25, 2.0
    angle = 2 * pi + np.arange(3 * turn) * 2 * pi / turn
    at = feed * angle / (2 * pi) / bend
    steps = Steps(angle=angle, x=bend * np.sin(at), y=-bend * np.cos(at), z=0 * at, path=bend * at)
    radii = np.array([[3.004], [2.997], [3.0]])
    found, expected = [], []
    for k in range(2 * turn, 3 * turn, 7):
        phi = angle[k]
        found.append(_chip(radii, 0, 0, np.sin(phi), np.cos(phi), steps, k, turn))
        reached = [_reached(phi, back, radii[-back % 3, 0], feed, bend) for back in (1, 2, 3)]
        expected.append(max(radii[0, 0] - max(reached), 0.0))
    assert found == pytest.approx(expected, abs=1e-4)
    assert sum(h > 0.02 for h in found) > 20


def _reached(phi: float, back: int, radius: float, feed: float, bend: float) -> float:
    """How far out on today's radius at ``phi`` the tooth ``back`` teeth earlier came (of three)."""

    def centre(angle: float) -> np.ndarray:
        at = feed * angle / (2 * pi) / bend
        return bend * np.array([np.sin(at), -np.cos(at)])

    def place(gone: float) -> np.ndarray:
        own = phi + back * 2 * pi / 3 - gone
        return centre(phi - gone) + radius * np.array([np.sin(own), np.cos(own)]) - centre(phi)

    middle, across = back * 2 * pi / 3, np.array([np.cos(phi), -np.sin(phi)])
    crossed = brentq(lambda gone: float(place(gone) @ across), middle - 0.4, middle + 0.4)
    return float(place(crossed) @ [np.sin(phi), np.cos(phi)])
