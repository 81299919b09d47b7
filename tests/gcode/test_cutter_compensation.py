"""Cutter radius compensation: distances, corners and refusals."""

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pipeline.gcode.cutter_compensation import RULES, CompensationError, Element, compensate
from tests.gcode.compensated_contours import (
    SCALE,
    distance,
    points,
    random_contour,
    signed_offset,
)
from tests.gcode.rs274 import AXES, RS274, Oracle

EXACT = 1e-9
"""Rounding of coordinates of some hundred mm, a few operations each [mm]."""


def line(start, end, row=0, **more):
    return Element(start=complex(start), end=complex(end), normal=0.0, row=row, **more)


def arc(start, centre, angle, row=0):
    end = centre + (start - centre) * cmath.exp(1j * angle)
    return Element(start=start, end=end, normal=0.0, row=row, centre=centre, angle=angle)


def through(*corners):
    """Lines from point to point."""
    return [line(a, b, row) for row, (a, b) in enumerate(pairwise(corners))]


@st.composite
def hills(draw):
    """Contours that go on in x by 6 mm or more at a time and stay low, for a tool of 1 mm."""
    steps = draw(st.lists(st.floats(6, 10), min_size=1, max_size=8))
    heights = draw(st.lists(st.floats(-2, 2), min_size=len(steps), max_size=len(steps)))
    bends = draw(st.lists(st.sampled_from([0, 1, -1]), min_size=len(steps), max_size=len(steps)))
    here, elements = 0j, [line(-10 + 10j, 0)]
    for row, (step, height, bend) in enumerate(zip(steps, heights, bends, strict=True), 1):
        there = complex(here.real + step, height)
        elements.append(bent(here, there, bend, row) if bend else line(here, there, row))
        here = elements[-1].end
    return elements


def bent(start, end, sense, row):
    """An arc whose radius is 1.2 times its chord."""
    chord = end - start
    half = math.asin(1 / 2.4)
    centre = (start + end) / 2 + 1j * sense * chord / 2 / math.tan(half)
    return arc(start, centre, sense * 2 * half, row)


def turns(elements):
    return [abs(cmath.phase(b.first_direction / a.last_direction)) for a, b in pairwise(elements)]


def mirrored(element):
    centre = element.centre
    return Element(
        start=element.start.conjugate(), end=element.end.conjugate(), normal=element.normal,
        row=element.row, centre=None if centre is None else centre.conjugate(),
        angle=-element.angle,
    )  # fmt: skip


@pytest.mark.parametrize("dialect", RULES)
@given(elements=hills())
@settings(max_examples=60, deadline=None)
def test_tool_keeps_its_radius_from_the_whole_contour(dialect, elements):
    # below these turns corners are left out, see Rules.tangent and NEARLY_TANGENT
    smallest = max(RULES[dialect].tangent, math.radians(1))
    assume(all(turn > smallest or turn < 1e-12 for turn in turns(elements)))
    path = compensate(elements, side=1, radius=1.0, dialect=dialect)
    contour = elements[1:]
    for piece in path[1:]:
        along = points(piece)
        nearest = np.min([distance(along, element) for element in contour], axis=0)
        assert nearest.min() >= 1.0 - EXACT
        if not piece.inserted:
            np.testing.assert_allclose(
                signed_offset(along, elements[piece.row]), 1.0, atol=EXACT, rtol=0
            )


@pytest.mark.parametrize("dialect", RULES)
@given(elements=hills())
@settings(max_examples=40, deadline=None)
def test_path_has_no_gaps_and_arcs_have_one_radius(dialect, elements):
    assume(all(turn > 0.06 or turn < 1e-12 for turn in turns(elements)))
    path = compensate(elements, side=1, radius=1.0, dialect=dialect)
    assert path[0].start == elements[0].start
    assert all(before.end == after.start for before, after in pairwise(path))
    assert [piece.row for piece in path if not piece.inserted] == [e.row for e in elements]
    for piece in path:
        if piece.centre is not None:
            turned = piece.centre + (piece.start - piece.centre) * cmath.exp(1j * piece.angle)
            assert abs(turned - piece.end) < EXACT


@pytest.mark.parametrize("dialect", RULES)
@given(elements=hills())
@settings(max_examples=20, deadline=None)
def test_right_is_the_mirror_image_of_left(dialect, elements):
    left = compensate(elements, side=1, radius=1.0, dialect=dialect)
    reflected = [mirrored(element) for element in elements]
    right = compensate(reflected, side=-1, radius=1.0, dialect=dialect)
    opposite = compensate(reflected, side=1, radius=-1.0, dialect=dialect)
    expected = [mirrored(piece).end for piece in left]
    np.testing.assert_allclose([piece.end for piece in right], expected, atol=EXACT, rtol=0)
    assert right == opposite


@pytest.mark.parametrize("dialect", RULES)
def test_a_radius_of_0_changes_nothing(dialect):
    contour = through(0, 10, 10 + 10j)
    assert compensate(contour, side=1, radius=0.0, dialect=dialect) == contour


SLANT = (20 + 20j) / abs(20 + 20j)
SQUARE = through(-20 - 5j, 0, 20, 20 + 20j, 20j)
PATHS = {
    "LinuxCNC cuts an inner square corner where the lines meet": (
        "linuxcnc", SQUARE, [2j * (4 + 1j) / 17**0.5, 2j, 18 + 2j, 18 + 18j, 18j], {1: 0}),
    **{f"{dialect} cuts an inner square corner where the lines meet": (
        dialect, SQUARE, [2j, 18 + 2j, 18 + 18j, 18j], {}) for dialect in ("fanuc", "siemens")},
    "LinuxCNC goes round an outer corner about it": (
        "linuxcnc", through(0, 20, 20 - 20j), [20 + 2j, 22, 22 - 20j], {1: 20}),
    "LinuxCNC goes round before a rapid straight": (
        "linuxcnc", [line(0, 20), line(20, 20 - 20j, 1, rapid=True)], [20 + 2j, 22, 22 - 20j], {}),
    "LinuxCNC enters beside the first move itself": (
        "linuxcnc", through(-10 - 20j, 0, 30), [2j * (1 + 2j) / 5**0.5, 2j, 30 + 2j], {1: 0}),
    # |centre - start| = |centre - end| on the line of centre and end: u² + 10² = (8 - u)²
    "LinuxCNC enters on an arc that ends tangent to the programmed one": (
        "linuxcnc", [arc(0j, 10j, math.pi / 2), line(10 + 10j, 10 + 30j, 1)], [8 + 10j, 8 + 30j],
        {0: -2.25 + 10j}),
    **{f"Fanuc A enters and leaves square to the next and last block, to {corner}": (
        "fanuc", through(-20 + 30j, 0, 20 * corner),
        [2j * corner / abs(corner), 20 * corner + 2j * corner / abs(corner)], {})
       for corner in (-2 + 0j, 2 + 0j, 0.5 - 2j)},
    "Fanuc lengthens obtuse outer corners until they meet": (
        "fanuc", through(-20, 0, 20, 40 - 20j),
        [2j, 20 + 2 * math.tan(math.pi / 8) + 2j, 40 - 20j + 2 * SLANT], {}),
    "Fanuc lengthens acute outer corners by the radius": (
        "fanuc", through(-20, 0, 20, -20j),
        [2j, 22 + 2j, 20 - 2j * SLANT + 2 * SLANT, -20j - 2j * SLANT], {}),
    "Fanuc leads from an arc round a corner along tangents": (
        "fanuc", [line(-20 - 5j, 0), arc(0j, -10j, -math.pi / 2, 1), line(10 - 10j, -10j, 2)],
        [2j, 12 - 10j, 12 - 12j, -12j], {1: -10j}),
    "Siemens enters square and goes round": (
        "siemens", through(-20 - 9j, 0, 20, 20 - 20j), [2j, 20 + 2j, 22, 22 - 20j], {2: 20}),
    **{f"{dialect}: a circle that begins and ends in a tangent stays a circle": (
        dialect, [line(-30, 0), arc(0j, 10j, math.tau, 1), line(0, 30, 2)], [2j, 2j, 30 + 2j],
        {1: 10j}) for dialect in RULES},
}  # fmt: skip
"""Rule -> dialect, contour, ends of the moves of a tool of 2 mm to its left, centres of arcs."""


@pytest.mark.parametrize("rule", PATHS)
def test_path_is_that_of_the_rule(rule):
    dialect, contour, expected, centres = PATHS[rule]
    path = compensate(contour, side=1, radius=2.0, dialect=dialect)
    np.testing.assert_allclose([piece.end for piece in path], expected, atol=EXACT)
    arcs = {n: piece for n, piece in enumerate(path) if piece.centre is not None}
    assert arcs.keys() == centres.keys()
    for n, piece in arcs.items():
        assert piece.centre == pytest.approx(centres[n], abs=EXACT)
        turned = (piece.start - piece.centre) * cmath.exp(1j * piece.angle) + piece.centre
        assert piece.end == pytest.approx(turned, abs=EXACT)
        assert abs(piece.angle) == pytest.approx(math.tau) if "circle" in rule else piece.angle


@pytest.mark.parametrize("dialect", RULES)
@given(
    sweeps=st.lists(st.floats(0.3, 1.5), min_size=2, max_size=6),
    radii=st.lists(st.floats(2, 10), min_size=6, max_size=6),
    senses=st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6),
)
@settings(max_examples=60, deadline=None)
def test_rounded_coordinates_make_no_corners_where_arcs_meet_in_a_tangent(
    dialect, sweeps, radii, senses
):
    contour, heading = [line(-9, 0)], 1 + 0j
    for row, (sweep, radius, sense) in enumerate(zip(sweeps, radii, senses, strict=False), 1):
        here = contour[-1].end
        exact = arc(here, here + 1j * sense * radius * heading, sense * sweep, row)
        heading *= cmath.exp(1j * sense * sweep)
        centre, end = written(exact.centre), written(exact.end)
        swept = sweep + sense * cmath.phase((end - centre) / (exact.end - exact.centre))
        contour.append(
            Element(start=here, end=end, normal=0.0, row=row, centre=centre, angle=sense * swept)
        )
    path = compensate(contour, side=1, radius=1.0, dialect=dialect)
    assert len(path) == len(contour)
    # the end of an arc may lie 0.1 µm beside its circle, and so may what is beside it
    for piece, element in zip(path, contour, strict=True):
        beside = element.end + 1j * element.last_direction
        assert abs(piece.end - beside) < 4e-4


def written(point):
    return complex(round(point.real, 4), round(point.imag, 4))


def test_a_plunge_stays_at_the_corner_of_the_moves_around_it():
    contour = through(0, 20, 20 + 20j)
    plunge = Element(start=20 + 0j, end=20 + 0j, normal=-5.0, row=9)
    path = compensate([contour[0], plunge, contour[1]], side=1, radius=2.0, dialect="linuxcnc")
    assert (path[1].start, path[1].end, path[1].normal) == (18 + 2j, 18 + 2j, -5.0)


def test_an_inserted_arc_keeps_the_level_of_the_move_before():
    contour = [
        Element(start=0j, end=20 + 0j, normal=3.0, row=0),
        Element(start=20 + 0j, end=20 - 20j, normal=7.0, row=1),
    ]
    path = compensate(contour, side=1, radius=2.0, dialect="linuxcnc")
    assert [piece.normal for piece in path] == [3.0, 3.0, 7.0]


REFUSED = [
    ("arc", [line(-9, 0), arc(0j, 1.5j, 1.0, 1)], 1, "radius of 1.5 mm is not greater"),
    ("circle", [line(-9, 0), arc(0j, 2j, math.tau, 1)], 1, "radius of 2 mm is not greater"),
    ("narrow slot", through(-9, 0, 20, 20 + 3j, 3j), 2, "run backwards"),
    ("acute", through(-90, 0, 10, 1j, -30 + 5j), 1, "run backwards"),
]


@pytest.mark.parametrize("dialect", RULES)
@pytest.mark.parametrize(
    ("elements", "row", "said"), [case[1:] for case in REFUSED], ids=[case[0] for case in REFUSED]
)
def test_what_the_tool_cannot_follow_is_refused(dialect, elements, row, said):
    with pytest.raises(CompensationError, match=said) as refused:
        compensate(elements, side=1, radius=2.0, dialect=dialect)
    assert refused.value.row == row
    assert "2 mm" in str(refused.value)


@pytest.mark.parametrize("dialect", RULES)
def test_a_corner_between_arcs_that_never_meet_beside_is_refused(dialect):
    # circles of 3 mm, their centres 2.9 mm apart, leave no point 2.4 mm inside of both
    first = arc(0j, 3j, 1.2, 1)
    inward = 3j * first.last_direction * cmath.exp(1j)
    contour = [line(-9, 0), first, arc(first.end, first.end + inward, 1.2, 2)]
    with pytest.raises(CompensationError, match=r"2\.4 mm does not fit into the inner corner"):
        compensate(contour, side=1, radius=2.4, dialect=dialect)


def test_fanuc_refuses_an_arc_as_first_move():
    with pytest.raises(CompensationError, match="begin with a line"):
        compensate([arc(0j, 10j, 1.0)], side=1, radius=2.0, dialect="fanuc")


@pytest.mark.parametrize("first", [line(0, 2), line(0, 1), arc(0j, 1j, 1.0)])
def test_linuxcnc_refuses_a_first_move_within_the_tools_radius(first):
    with pytest.raises(CompensationError, match="not more than the tool's radius of 2 mm"):
        compensate([first], side=1, radius=2.0, dialect="linuxcnc")


def test_linuxcnc_refuses_a_first_move_that_only_plunges():
    plunge = Element(start=0j, end=0j, normal=-5.0, row=0)
    with pytest.raises(CompensationError, match="does not move in the plane"):
        compensate([plunge], side=1, radius=2.0, dialect="linuxcnc")


# against LinuxCNC's own interpreter

SAME = 1e-6
"""What places may differ by in contours of metres [mm], and angles of arcs [rad]."""
STRICTER = (
    "would run backwards",  # rs274 does not look at a line whose next element is an arc
    "no arc can follow",  # rs274 then arrives backwards, around a circle on the other side
)


@pytest.fixture(scope="module")
def oracle(tmp_path_factory):
    return Oracle(tmp_path_factory.mktemp("rs274"))


@pytest.mark.skipif(not RS274.exists(), reason=f"{RS274} is not installed")
@pytest.mark.parametrize("plane", [17, 18])
@pytest.mark.parametrize("block", range(4))
@pytest.mark.parametrize("seeds", [5, pytest.param(50, marks=pytest.mark.proof)])
def test_path_is_rs274s(plane, block, seeds, oracle):
    same = 0
    for seed in range(seeds):
        rng = np.random.default_rng([plane, block, seed])
        contour = random_contour(rng, plane)
        side, radius = int(rng.choice([1, -1])), round(rng.uniform(0.05, 3) * SCALE, 9)
        code = f"G{41 if side > 0 else 42}.1 D{2 * radius:.9f}"
        head = f"G21 G{plane} F100\nG0 X0 Y0 Z0\n{code}"
        answer = oracle.ask_text("\n".join([head, *contour.blocks, "G40", "M2", ""]))
        try:
            path = compensate(contour.elements, side=side, radius=radius, dialect="linuxcnc")
        except CompensationError as refused:
            assert answer.error or any(why in str(refused) for why in STRICTER), (seed, refused)
            continue
        if answer.error:
            continue
        same += 1
        made = [(piece.end.real, piece.end.imag, piece.normal) for piece in path]
        given = answer.ends[1:, AXES[plane]]
        np.testing.assert_allclose(made, given, atol=SAME, rtol=0, err_msg=str(seed))
        arcs = [(p.centre.real, p.centre.imag, p.angle) for p in path if p.centre is not None]
        given = answer.arcs[:, :3]
        np.testing.assert_allclose(np.reshape(arcs, (-1, 3)), given, atol=SAME, err_msg=str(seed))
    assert same > 0.5 * seeds
