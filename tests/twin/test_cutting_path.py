"""Moves become the way of the tool's tip through the stock, in work coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.moves import INCH
from pipeline.gcode.setup import Tool
from pipeline.twin.cut.path import cutting_path
from tests.gcode.following import follow

OFFSETS = {
    "G54": (-410.0, -235.0, -470.0, 0.0, 0.0, 0.0),
    "G55": (-210.0, -35.0, -400.0, 0.0, 0.0, 0.0),
    "EXT": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0),
}
TOOLS = {1: Tool(length=133.165), 2: Tool(length=109.977)}
ROUNDING = 1e-9  # [mm] of sums of numbers up to 1 m


def path(text: str, *, offset=None, chord=1e-5, tools=(1, 2), **setup):
    setup = {"work_offsets": OFFSETS, "tools": TOOLS, **setup}
    moves = follow(text, **setup)
    return cutting_path(moves, tools, chord=chord, offsets=setup["work_offsets"], offset=offset)


def fed(found) -> list[list[float]]:
    """Ends of the pieces at feed [mm]."""
    return (found.pieces.end[found.pieces.feed] * 1e3).round(9).tolist()


HEAD = "T1 M6\nG0 G54 X0 Y0 S1000 M3\nG43 Z5 H1\n"


def test_the_tip_is_where_the_program_says():
    found = path(HEAD + "G1 Z-2 F100\nX30\nG91 Y4\nM30")
    assert fed(found) == [[0, 0, -2], [30, 0, -2], [30, 4, -2]]
    assert found.frame.name == "G54"


def test_each_tool_has_its_own_length():
    found = path(HEAD + "G1 Z-2 F100\nG0 Z5\nT2 M6\nG43 H2 Z5\nG1 Z-3\nM30")
    assert fed(found) == [[0, 0, -2], [0, 0, -3]]
    assert found.pieces.tool[found.pieces.feed].tolist() == [0, 1]


def test_inch_programs_end_in_metres():
    found = path("G20\n" + HEAD.replace("Z5", "Z1") + "G1 Z-.5 F4\nX1.25\nM30")
    assert fed(found) == [[0, 0, -0.5 * INCH], [1.25 * INCH, 0, -0.5 * INCH]]


def test_other_offsets_lie_where_the_setup_puts_them():
    """Stock measured in G54; the same words under G55 are cut elsewhere on it."""
    text = HEAD + "G1 Z-2 F100\nG0 Z5\nG55 X0 Y0\nG1 Z-72\nM30"
    shift = np.subtract(OFFSETS["G55"][:3], OFFSETS["G54"][:3])
    assert fed(path(text)) == [[0, 0, -2], (shift + [0, 0, -72]).tolist()]
    assert fed(path(text, offset="G55")) == [(-shift + [0, 0, -2]).tolist(), [0, 0, -72]]


def test_a_fixture_of_two_parts_counts_from_the_one_that_is_named():
    assert path(HEAD + "G1 Z-2 F100\nM30", offset="G55").frame.name == "G55"


@pytest.mark.parametrize(("shift", "end"), [
    ("G52 X7 Y8 Z1", [7 + 10, 8, -1]),
    ("G92 X100 Y0 Z5", [10 - 100, 0, -2]),
    ("G68 X0 Y0 R90", [0, 10, -2]),
    ("G52 X7\nG68 X0 Y0 R90", [7, 10, -2]),
])  # fmt: skip
def test_shifts_and_rotations_move_the_cut_not_the_stock(shift, end):
    found = path(HEAD + shift + "\nG1 X10 Y0 Z-2 F100\nM30")
    assert fed(found)[-1] == pytest.approx(end, abs=ROUNDING)


def test_a_shift_that_stays_over_a_tool_change_is_no_length():
    text = HEAD + "G52 X7 Z1\nG1 X1 Z-2 F100\nG0 Z9\nT2 M6\nG43 H2 Z9\nG1 X2 Z-3\nM30"
    assert fed(path(text)) == [[8, 0, -1], [9, 0, -2]]


def test_an_offset_set_by_the_program_goes_before_the_setup():
    text = "G10 L2 P1 X5 Y6 Z7\n" + HEAD + "G1 X1 Y2 Z-3 F100\nG0 Z5\nG55 X0 Y0\nG1 Z0\nM30"
    found = path(text)
    assert fed(found)[0] == [1, 2, -3]
    assert fed(found)[1] == (np.array(OFFSETS["G55"][:3]) - [5, 6, 7]).tolist()


def test_a_turned_work_offset_turns_with_its_stock():
    """LinuxCNC keeps a rotation with the offset: on the stock the path is as programmed."""
    text = "T1 M6\nG10 L2 P1 X5 Y6 Z7 R30\nG54 G0 X0 Y0 S1000 M3\nG43 Z5 H1\nG1 X4 Y3 Z-3 F100\nM30"
    found = path(text, dialect="linuxcnc", work_offsets={})
    assert fed(found)[-1] == pytest.approx([4, 3, -3], abs=ROUNDING)


def test_a_length_that_cannot_be_told_is_refused():
    text = "T1 M6\nG52 X1 Z2\nG43 H1 Z5 G0\nS1000 M3\nG1 X1 Z-2 F100\nM30"
    with pytest.raises(ValueError, match=r"length cannot be told .*G54\+G52\+G43.*program G43"):
        path(text)


@settings(deadline=None)  # the reference is slow for many chords
@given(
    radius=st.floats(0.5, 300.0),
    growth=st.floats(-0.4, 0.4),
    turn=st.floats(5.0, 355.0),
    rise=st.floats(-30.0, 30.0),
    plane=st.sampled_from(["G17", "G18", "G19"]),
    chord=st.sampled_from([1e-6, 2e-5, 1e-3]),
)
def test_chords_stay_within_their_error(radius, growth, turn, rise, plane, chord):
    """Points of the arc, helix or spiral lie within the chord error of the pieces."""
    u, v, w = {"G17": "XYZ", "G18": "ZXY", "G19": "YZX"}[plane]
    i, j = {"G17": "IJ", "G18": "KI", "G19": "JK"}[plane]
    last = radius * (1 + growth)
    end = last * np.cos(np.radians(turn)), last * np.sin(np.radians(turn))
    start = f"G1 {u}{radius:.9f} {v}0 {w}0 F100\n"
    arc = f"{plane} G3 {u}{end[0]:.9f} {v}{end[1]:.9f} {w}{rise:.9f} {i}{-radius:.9f} {j}0\n"
    moves = follow(HEAD + start + arc + "M30", tools=TOOLS, arc_tolerance=1e3)
    found = cutting_path(moves, [1], chord=chord, offsets={})
    pieces = found.pieces
    mine = pieces.block == pieces.block[-1]
    share = np.linspace(0, 1, 211)
    r, phi = radius + share * (last - radius), share * moves.angle[pieces.block[-1]]
    axes = ["XYZ".index(a) for a in (u, v, w)]
    true = np.empty((len(share), 3))
    true[:, axes[0]], true[:, axes[1]] = r * np.cos(phi), r * np.sin(phi)
    true[:, axes[2]] = share * rise
    a, b = pieces.start[mine] * 1e3, pieces.end[mine] * 1e3
    assert distance(true, a, b).max() <= chord * 1e3 + 2e-6  # words have nine decimals
    assert np.array_equal(a[1:], b[:-1])


def distance(points, a, b):
    """From each point to the nearest of the pieces."""
    step = b - a
    along = ((points[:, None] - a) * step).sum(-1) / (step**2).sum(-1)
    foot = a + np.clip(along, 0, 1)[..., None] * step
    return np.linalg.norm(points[:, None] - foot, axis=-1).min(axis=1)


def test_blocks_are_rows_and_rapids_are_there():
    moves = follow(HEAD + "G1 Z-2 F100\nG3 X0 Y0 I5 J0\nG0 Z5\nM30", tools=TOOLS)
    found = cutting_path(moves, [1], chord=1e-5, offsets={})
    pieces = found.pieces
    assert np.all(np.diff(pieces.block) >= 0)
    length = np.bincount(pieces.block, pieces.length, minlength=len(moves)) * 1e3
    moving = moves.length > 0
    # an arc's chords are shorter by (d/2)^2/6 of it at most, d = 2 sqrt(2 error / r)
    assert length[moving] == pytest.approx(moves.length[moving], rel=2 * 1e-2 / 5 / 6)
    assert (~pieces.feed[pieces.block == pieces.block[-1]]).all()
    assert (pieces.direction[pieces.feed] == 1).all()


def test_axes_that_do_not_interpolate_make_dog_legs():
    """X is there after 1 s, Z after 2 s, Y after 4 s; a feed stays straight."""
    moves = follow(HEAD + "G0 X100 Y800 Z205\nG1 X0 Y0 Z0 F100\nM30", tools=TOOLS)
    speeds = np.array([100.0, 200.0, 100.0])
    pieces = cutting_path(moves, [1], chord=1e-5, offsets={}, rapid_speeds=speeds).pieces
    last = pieces.block[-1]
    legs = pieces.block == last - 1
    ends = [[100, 200, 105], [100, 400, 205], [100, 800, 205]]
    assert (pieces.end[legs] * 1e3).round(9).tolist() == ends
    assert np.array_equal(pieces.start[legs][1:], pieces.end[legs][:-1])
    assert (pieces.block == last).sum() == 1 and (pieces.length > 0).all()


def test_a_number_of_a_tool_may_be_any():
    moves = follow(HEAD + "G1 Z-2 F100\nM30", tools=TOOLS)
    found = cutting_path(moves, [2_000_000_000, 7, 1], chord=1e-5, offsets={})
    assert set(found.pieces.tool.tolist()) == {2}


@pytest.mark.parametrize(("cut", "reason"), [
    ("G31 Z-9 F50\n", "probing"),
    ("G1 X2 A30 F50\n", "rotary axes"),
    ("G96 S100\nG1 X9 F50\nG97 S1000\n", "G96"),
])  # fmt: skip
def test_what_is_not_computed_is_counted_and_named(cut, reason):
    found = path(HEAD + "G1 Z-2 F100\n" + cut + "M30")
    assert any(reason in one.reason and one.rows >= 1 for one in found.left_out)
    assert all(":" in one.first for one in found.left_out)
    assert fed(found) == [[0, 0, -2]]


@pytest.mark.parametrize(("text", "said"), [
    ("G1 X5 F100\nM30", "no tool is in the spindle.*program T and M6"),
    ("T7 M6\nG1 X5 F100\nM30", "T7 cuts and is not in the tool table, which has T1, T2"),
    ("T1 M6\nM30", "has no moves"),
    ("T1 M6\nS100 M3\nG31 X5 F100\nM30", r"no move cuts \(probing"),
])  # fmt: skip
def test_what_cannot_be_cut_is_one_sentence(text, said):
    with pytest.raises(ValueError, match=said) as caught:
        path(text)
    assert "\n" not in str(caught.value)


def test_an_offset_that_is_nowhere_is_refused():
    with pytest.raises(ValueError, match=r"'G59' is neither in the set-up nor in the program"):
        path(HEAD + "G1 Z-2 F100\nM30", offset="G59")


def test_the_rapids_of_an_oriented_boring_bar_are_not_on_the_path():
    """G76 leaves the wall with its one edge, not with the envelope of a turning tool."""
    cycle = "G98 G76 Z-9 R2 Q0.3 F80"
    found = path(HEAD + f"{cycle}\nX30\nG80\nM5\nG0 Z50\nM3\nM30")
    assert fed(found) == [[0, 0, -9], [30, 0, -9]]
    ends = (found.pieces.end[~found.pieces.feed] * 1e3).round(9)
    assert set(ends[:, 0]) == {0.0, 30.0} and (ends[:, 2] > 0).all()
    # a rapid with a spindle that M5 has stopped is one that the program is to answer for
    assert ends[-1, 2] == 50.0
