"""Arcs: the centre that R means, the angle from start to end, what is refused."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.gcode import geometry
from tests.gcode.following import follow, refusal

coordinate = st.floats(-1e3, 1e3)
angle = st.floats(0.01, 2 * math.pi - 0.01)


@given(
    coordinate, coordinate, st.floats(0.1, 500), st.floats(0, 6.28), angle, st.sampled_from([1, -1])
)
def test_sweep_leads_from_start_to_end(u_c, v_c, radius, start, swept, turn):
    """Turning the start about the centre by the angle gives the end."""
    ends = [
        (u_c + radius * math.cos(phi), v_c + radius * math.sin(phi))
        for phi in (start, start + turn * swept)
    ]
    found = geometry.sweep(*ends[0], *ends[1], u_c, v_c, turn, 1)
    # coordinates of 1000 mm round by 1e-13, seen from 0.1 mm
    assert found == pytest.approx(turn * swept, abs=1e-11)


@pytest.mark.parametrize("turns", [1, 2, 5])
def test_same_start_and_end_are_full_circles(turns):
    assert geometry.sweep(3, 4, 3, 4, 0, 0, -1, turns) == pytest.approx(-2 * math.pi * turns)


@given(
    coordinate, coordinate, st.floats(0.1, 100), st.floats(0, 6.28), angle, st.sampled_from([1, -1])
)
def test_r_finds_the_centre_again(u_c, v_c, radius, start, swept, turn):
    """From an arc to R, negative for more than a semicircle, and back."""
    assume(abs(swept - math.pi) > 0.01)  # near a semicircle R hardly tells where the centre lies
    u_0, v_0 = u_c + radius * math.cos(start), v_c + radius * math.sin(start)
    end = start + turn * swept
    u_1, v_1 = u_c + radius * math.cos(end), v_c + radius * math.sin(end)
    written = radius if swept < math.pi else -radius
    verdict, u, v = geometry.centre_of_radius(u_0, v_0, u_1, v_1, written, turn, 0.0)
    assert verdict == geometry.OK
    # rounding of 1e-13 mm, enlarged where the chord is short or nearly a diameter
    assert (u, v) == pytest.approx((u_c, v_c), abs=1e-7)


def test_half_a_chord_that_passes_r_within_the_tolerance_is_a_semicircle():
    assert geometry.centre_of_radius(0, 0, 10, 0, 4.999, 1, 0.01) == (geometry.OK, 5, 0)
    assert geometry.centre_of_radius(0, 0, 10, 0, 4.9, 1, 0.01)[0] == geometry.TOO_FAR
    assert geometry.centre_of_radius(1, 1, 1, 1, 4.9, 1, 0.01)[0] == geometry.NO_CHORD


def test_radii_that_differ():
    agree = geometry.radii_agree
    assert agree(10, 0, 0, 10.04, 0, 0, 0.05, 0.0) == geometry.OK
    assert agree(10, 0, 0, 10.06, 0, 0, 0.05, 0.0) == geometry.UNEQUAL_RADII
    assert agree(10, 0, 0, 10.06, 0, 0, 0.05, 0.01) == geometry.OK
    assert agree(1e4, 0, 0, 1e4 + 6, 0, 0, 0.05, 0.01) == geometry.UNEQUAL_RADII
    assert agree(0, 0, 0, 10, 0, 0, 0.05, 0.0) == geometry.NO_RADIUS


def test_length_of_a_helix_is_the_closed_form():
    moves = follow("F9 G0 X5\nG3 X5 Z3 I-5\n")
    assert moves.length[-1] == pytest.approx(math.hypot(2 * math.pi * 5, 3))


def test_centre_keeps_the_height_of_the_start():
    moves = follow("F9 G0 X5 Z2\nG3 X0 Y5 Z8 I-5\n")
    assert moves.centre[-1].tolist() == [0, 0, 2]
    assert moves.angle[-1] == pytest.approx(math.pi / 2)


def test_an_arc_by_r_that_ends_where_it_starts_turns_by_0_on_a_fanuc_and_is_none_elsewhere():
    moves = follow("F9 G0 X5\nG2 X5 R5\nG1 X6")
    assert moves.end[:, 0].tolist() == [5, 6]
    assert "0 degree, no motion (line 2)" in moves.notices[0]
    assert "I J K" in refusal("F9 G0 X5\nG2 X5 R5", dialect="linuxcnc")
