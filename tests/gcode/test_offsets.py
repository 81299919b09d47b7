"""A Fanuc's coordinate systems, tool lengths, rotation, scaling and references."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.modal import Offsets
from pipeline.gcode.moves import Kind
from pipeline.gcode.setup import Tool
from tests.gcode.following import follow, points, refusal

OFFSETS = {
    "G54": (10.0, 20.0, 30.0, 0.0, 0.0, 0.0),
    "G55": (-1.0, -2.0, -3.0, 5.0, 0.0, 0.0),
    "G54.1 P7": (100.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "EXT": (0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
}
TOOLS = {1: Tool(length=50.0, diameter=10.0), 2: Tool(length=80.0)}


def last(text: str, **choices) -> list[float]:
    """Where the machine stands in the end."""
    return follow(text, **choices).end[-1].round(9).tolist()


def xyz(text: str, **choices) -> list[float]:
    return last(text, **choices)[:3]


def test_without_offsets_the_program_counts_in_the_machine():
    assert xyz("G0 X1 Y2 Z3") == [1, 2, 3]


def test_work_offsets_lie_on_the_external_one():
    assert xyz("G0 X1 Y1 Z1", work_offsets=OFFSETS) == [11.5, 21, 31]
    assert last("G55 G0 X1 A1", work_offsets=OFFSETS)[:4] == [0.5, 0, 0, 6]
    assert xyz("G54.1 P7 G0 X1", work_offsets=OFFSETS) == [101.5, 0, 0]
    assert xyz("G54 P7 G0 X1", work_offsets=OFFSETS) == [101.5, 0, 0]


def test_an_axis_that_is_not_named_stays_where_it_is():
    assert xyz("G0 X1 Y1\nG55 X1", work_offsets=OFFSETS) == [0.5 - 0, 21, 0]


def test_frames_are_named_and_shared():
    moves = follow("G0 X1\nG55 X1\nG54 X1\nG52 X5\nX1", work_offsets=OFFSETS)
    names = [moves.frames[index].name for index in moves.frame]
    assert names == ["G54", "G55", "G54", "G54+G52"]
    assert moves.frames[moves.frame[-1]].translation[0] == 15.5


def test_frame_maps_the_program_to_the_machine():
    moves = follow(
        "G54 G43 H1 G0 X1 Z2\nG68 X3 Y4 R30\nX6 Y7 Z8", work_offsets=OFFSETS, tools=TOOLS
    )
    frame = moves.frames[moves.frame[-1]]
    c, s = math.cos(math.radians(frame.rotation)), math.sin(math.radians(frame.rotation))
    turned = np.array([c * 6 - s * 7, s * 6 + c * 7, 8.0])
    np.testing.assert_allclose(turned + frame.translation[:3], moves.end[-1, :3], atol=1e-9)


def test_g10_l2_sets_offsets_and_adds_under_g91():
    assert xyz("G90 G10 L2 P2 X7\nG55 G0 X1") == [8, 0, 0]
    assert xyz("G91 G10 L2 P2 X7\nG10 L2 P2 X7\nG90 G55 G0 X1") == [15, 0, 0]
    assert xyz("G10 L2 P0 X7\nG0 X1") == [8, 0, 0]
    assert xyz("G10 L20 P3 Y7\nG54.1 P3 G0 Y1") == [0, 8, 0]
    assert xyz("G20 G10 L2 P1 X1\nG0 X1") == [50.8, 0, 0]


def test_g10_l10_to_l13_set_registers():
    assert xyz("G10 L10 P5 R25\nG43 H5 G0 Z1") == [0, 0, 26]
    assert xyz("G10 L10 P5 R25\nG10 L11 P5 R-1\nG43 H5 G0 Z1") == [0, 0, 25]
    beside = points(follow("F9 G10 L12 P5 R2\nG10 L13 P5 R1\nG41 D5 G1 X0 Y10\nY20\nG40 X9"))
    assert beside[-2][:2] == [-3, 20]


def test_g52_shifts_every_system_until_it_is_zero():
    assert xyz("G52 X5\nG0 X1") == [6, 0, 0]
    assert xyz("G52 X5\nG55 G0 X1", work_offsets={"G55": (1.0, 0, 0, 0, 0, 0)}) == [7, 0, 0]
    assert xyz("G52 X5\nG52 X0\nG0 X1") == [1, 0, 0]


def test_g92_names_the_point_where_the_tool_stands():
    assert xyz("G0 X10\nG92 X3\nG0 X4") == [11, 0, 0]
    assert xyz("G0 X10\nG92 X3\nG55 G0 X4") == [11, 0, 0]
    assert xyz("G0 X10\nG92 X3\nG92.1 X0\nG0 X4") == [4, 0, 0]


def test_g43_and_g44_move_by_the_length():
    assert xyz("G43 H1 G0 Z5", tools=TOOLS) == [0, 0, 55]
    assert xyz("G44 H1 G0 Z5", tools=TOOLS) == [0, 0, -45]
    assert xyz("G43 H1 G0 Z5\nH2 Z5", tools=TOOLS) == [0, 0, 85]
    assert xyz("G43 H1 G0 Z5\nG49 Z5", tools=TOOLS) == [0, 0, 5]
    assert xyz("G43 H7 G0 Z5", tools=TOOLS) == [0, 0, 5]  # a register that nobody filled


def test_a_length_without_axis_moves_or_shifts_as_the_control_is_set():
    assert xyz("G0 Z5\nG43 H1", tools=TOOLS) == [0, 0, 55]
    assert xyz("G0 Z5\nG43 H1\nX1", tools=TOOLS, length_moves=False) == [1, 0, 5]
    assert xyz("G0 Z5\nG43 H1\nG49\nX1", tools=TOOLS) == [1, 0, 5]
    assert xyz("G0 Z5\nG91 G43 H1 Z1", tools=TOOLS) == [0, 0, 56]


def test_g53_counts_in_the_machine_and_is_rapid():
    moves = follow("F9 G1 X1\nG53 X7 Z8\nX1", work_offsets=OFFSETS)
    assert points(moves)[1:] == [[7, 0, 8], [11.5, 0, 8]]
    assert moves.kind.tolist() == [Kind.FEED, Kind.RAPID, Kind.FEED]
    assert "G91" in refusal("G91 G53 X1")


def test_g28_goes_over_a_point_to_the_reference_by_the_axes_named():
    references = {"G28": (1.0, 2.0, 300.0, 0, 0, 0), "G30 P3": (9.0, 9.0, 9.0, 0, 0, 0)}
    assert points(follow("G0 X5 Z5\nG91 G28 Z10", references=references)) == [
        [5, 0, 5], [5, 0, 15], [5, 0, 300],
    ]  # fmt: skip
    assert xyz("G0 X5\nG90 G28 X6 Y7", references=references) == [1, 2, 0]
    assert xyz("G30 P3 X0 Y0 Z0", references=references) == [9, 9, 9]
    assert points(follow("G0 X5 Z5\nG28", references=references))[-1] == [1, 2, 300]  # of a Haas
    assert "G28 names no axis" in follow("G28", references=references).notices[0]


def test_g68_rotates_about_a_point_and_g69_ends_it():
    assert xyz("G68 X1 Y0 R90\nG0 X3 Y0") == [1, 2, 0]
    assert xyz("G68 X0 Y0 R90\nG0 X3 Y0\nG69\nX3 Y0") == [3, 0, 0]
    assert xyz("G68 X0 Y0 R30\nG91 G68 R60\nG90 G0 X3 Y0") == [0, 3, 0]
    assert xyz("G0 X2\nG68 R90\nX3 Y0") == [2, 1, 0]
    assert xyz("G18 G68 X0 Z0 R90\nG0 Z3 X0") == [3, 0, 0]


def test_an_arc_turns_with_g68():
    plain = follow("F9 G0 X5\nG3 X0 Y5 I-5")
    turned = follow("F9 G68 X0 Y0 R90\nG0 X5\nG3 X0 Y5 I-5")
    assert turned.end[-1, :2].round(9).tolist() == [-5, 0]
    assert turned.angle[-1] == pytest.approx(plain.angle[-1])
    assert turned.length[-1] == pytest.approx(plain.length[-1])
    assert "leave its plane" in refusal("F9 G18 G68 X0 Z0 R9\nG17 G3 X2 I1")


def test_g51_scales_about_a_point():
    assert xyz("G51 X1 Y0 Z0 P2000\nG0 X3 Y4") == [5, 8, 0]
    assert xyz("G51 X0 Y0 Z0 P0.5\nG0 X3 Y4") == [1.5, 2, 0]
    assert xyz("G51 X0 Y0 Z0 I2000 J3000 K1000\nG0 X1 Y1 Z1") == [2, 3, 1]
    assert xyz("G51 X0 Y0 Z0 P2000\nG50\nG0 X3") == [3, 0, 0]
    assert "ellipse" in refusal("F9 G51 X0 Y0 Z0 I2000 J1000 K1000\nG2 X1 Y1 I1")


def test_g51_1_mirrors_and_turns_arcs_round():
    moves = follow("F9 G51.1 X0\nG0 X5\nG3 X0 Y5 I-5\nG50.1 X0\nG0 X5")
    assert points(moves) == [[-5, 0, 0], [0, 5, 0], [5, 5, 0]]
    assert moves.angle[1] == pytest.approx(-math.pi / 2)
    assert moves.centre[1].tolist() == [0, 0, 0]


def test_g16_takes_radius_and_angle():
    assert xyz("G16 G0 X10 Y30") == [pytest.approx(8.660254038), 5, 0]
    assert xyz("G16 G0 X10 Y30\nG91 Y60") == [0, 10, 0]
    assert xyz("G16 G0 X10 Y30\nG15 X1 Y1") == [1, 1, 0]


def test_inch_programs_become_millimetres():
    assert last("G20 G0 X1 A1")[:4] == [25.4, 0, 0, 1]


@pytest.mark.parametrize(
    "code", ["G55", "G52 X1", "G92 X1", "G28 X0", "G68 R1", "G51 P2000", "G10 L2 P1 X1"]
)
def test_offsets_stay_beside_a_contour(code):
    said = refusal(f"F9 G41 D1 G1 X9\n{code}\nY9", tools=TOOLS)
    assert "G40" in said


number = st.floats(-500, 500)


@given(
    st.lists(number, min_size=6, max_size=6),
    number, number, st.sampled_from([17, 18, 19]),
    st.lists(st.floats(0.1, 5), min_size=3, max_size=3),
    st.lists(st.sampled_from([1.0, -1.0]), min_size=3, max_size=3),
    st.lists(number, min_size=6, max_size=6),
)  # fmt: skip
def test_program_coordinates_come_back_from_the_machine(
    point, angle, turn, plane, scale, mirror, shift
):
    offsets = Offsets(work={"G54": shift}, rotations={"G54": turn})
    offsets.rotation, offsets.centre_of_rotation, offsets.plane_of_rotation = (
        angle,
        (shift[0], shift[1]),
        plane,
    )
    offsets.scale, offsets.mirror, offsets.g92 = scale, mirror, shift
    offsets.scale_centre = offsets.mirror_centre = shift[:3]
    mapping = offsets.transform()
    back = mapping.program(mapping.machine(point))
    # 1e4 mm times the rounding of doubles, divided by the smallest scale
    np.testing.assert_allclose(back, point, atol=1e-9, rtol=0)
