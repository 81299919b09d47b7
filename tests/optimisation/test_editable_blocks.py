"""Which F and S may be changed, each rule with the smallest program; repeated points are none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.proof.prove import prove
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from pipeline.schema.limits import CutLimit
from tests.optimisation.direct_parts import SIX, problem

HEAD = "G21 S3000 M3\n"


def of(text: str, setup: Setup | None = None) -> Editable:
    program = Program(text.encode("latin-1"), "P.nc")
    return editable_blocks(program, interpret(program, setup or Setup()))


def reason(editable: Editable, letter: str) -> dict[str, int]:
    """Reasons -> rows that are held."""
    return {h.reason[3:]: h.rows for h in editable.held if h.reason[0] == letter}


def test_a_block_is_a_line_whatever_it_makes() -> None:
    made = of(HEAD + "G0 Z5\nG1 Z0 F100\nX5\nG81 X1 Z-1 R1\nX2 Y2\nG80\nM8\nM30\n")
    # a drilling cycle is a block on each of its lines
    assert made.line.tolist() == [3, 4, 5, 6]
    assert made.block[made.block >= 0].tolist() == [0, 1, 2, 3]


def test_rows_of_a_repeated_line_share_a_block() -> None:
    made = of(HEAD + "G1 X1 F100\nM98 P7 L3\nM30\nO7\nG91 X1 Y1\nX2\nM99\n")
    assert made.line.tolist() == [2, 6, 7]
    assert made.block[made.block > 0].tolist() == [1, 2] * 3


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ("G33 Z-5 F2", "it is a thread or a tapping cycle, where F is bound to S"),
        ("G84 Z-5 R1 F300\nX2", "it is a thread or a tapping cycle, where F is bound to S"),
        ("G31 Z-5 F300", "it probes"),
        ("G93 G1 X1 F3", "G93 is in force"),
        ("#1=77\nG1 X1 F#1", "F is an expression, or stands twice in the line"),
        ("G1 X1 F5 F100", "F is an expression, or stands twice in the line"),
        ("#1=77.1234567891\nF#1\nG1 X1", "its F comes of an expression"),
        ("#4=#4109\nG1 X1 F100", "the program's own expressions may read F and S"),
        ("M5\nG1 X1 F100", "the spindle stands"),
        ("G1 X1 F100 M98 P7\nM30\nO7\nM99", "its line calls, computes or sets something, and "
         "nothing is written into it"),
        ("F9\nM98 P7\nF8\nM98 P7\nM30\nO7\nG91 G1 X1\nM99", "another pass through its line needs "
         "another F"),
        ("G20 G1 X1 F9\nG21 M98 P7\nM30\nO7\nM99", "G20 and G21 are both in a program that jumps"),
        ("G20 G1 A5 F9", "rotary axes move alone in a program in inches"),
    ],
)  # fmt: skip
def test_what_is_held_says_why(lines: str, why: str) -> None:
    made = of(HEAD + lines + "\n")
    assert (made.block == -1).all()
    assert list(reason(made, "F")) == [why]


def test_a_line_before_one_that_takes_its_f_is_held() -> None:
    # the thread has no F of its own: its lead is what line 3 leaves
    made = of(HEAD + "G1 X1 F100\nX2 F2\nG33 Z-5\n")
    assert made.line.tolist() == [2]
    assert reason(made, "F") == {
        "it is a thread or a tapping cycle, where F is bound to S": 1,
        "the lines after it take its F, and cannot be given one": 1,
    }
    assert of(HEAD + "G1 X1 F100\nX2 F2\nG33 Z-5 F2\n").line.tolist() == [2, 3]


def test_a_line_before_an_f_without_a_value_is_held() -> None:
    # #2 has none, so that line 3 takes the F of line 2
    made = of(HEAD + "G1 X1 F100\nX2 F#2\nX3\n")
    assert made.line.tolist() == [4]
    assert of(HEAD + "#2=80\nG1 X1 F100\nX2 F#2\nX3\n").line.tolist() == [3, 5]


def test_a_subprogram_in_another_file_is_held_and_what_it_takes(tmp_path) -> None:
    (tmp_path / "O0007.nc").write_text("O7\nG1 Y5\nG0 Y0\nM99\n")
    setup = Setup(folders=(tmp_path,))
    made = of(HEAD + "G1 X1 F100\nX2\nM98 P7\nG1 X3\nM30\n", setup)
    assert made.line.tolist() == [2, 5]
    assert made.held[0].first == "O0007.nc:2"
    assert not made.speed[[1, 2, 3, 4]].all()


def test_s_begins_at_lines_that_are_passed_once() -> None:
    made = of(HEAD + "G1 X1 F100\nM98 P7 L2\nX3\nM30\nO7\nX4\nX5\nM99\n")
    # rows: M3, X1, (X4, X5) twice, X3, M30
    assert made.may_start.tolist() == [True, True, False, False, False, False, True, False]
    assert made.own_start.tolist() == [True] + [False] * 7
    assert made.speed.all()


def test_s_of_what_follows_must_be_given_again() -> None:
    made = of(HEAD + "G1 X1 F100\nX2\nM29 S400\nG84 X3 Z-5 R1 F300\nG80\nG1 X4\n")
    held = made.speed == 0
    # G84 cannot be given an S word, M29 has its own: nothing before that is bound
    assert not held[:3].any() and made.may_start[:3].all()
    assert "it is a thread or a tapping cycle, where F is bound to S" in reason(made, "S") or (
        held[3:].any()
    )


def test_constant_surface_speed_is_held() -> None:
    made = of(HEAD + "G96 S120\nG1 X1 F100\nG97 S2000\nX2\n")
    surface = np.flatnonzero(~made.speed)
    assert surface.tolist() == [1, 2]
    assert made.line.tolist() == [3, 5]


@pytest.mark.parametrize("data", [b"", b"%", b"\n\n", b"(only a comment)", b"M30"])
def test_programs_without_a_block(data: bytes) -> None:
    program = Program(data, "P.nc")
    made = editable_blocks(program, interpret(program, Setup()))
    assert len(made.line) == 0 and made.held == ()


LIMITS = CutLimit(load_N=60.0, feed_mm_min=(50, 1000), speed_rpm=(1000, 8000))
FREE = Grouping(least_block_s=0.0, least_gain=0.0, least_speed_gain=0.0)
BEGIN = ["T1 M6", "S3000 M3", "G0 X20 Y20 Z5"]
SLOT = [
    ("G1 Z-0.5 F50", (20.0, 20.0, -0.5)),
    ("G1 Z-1", (20.0, 20.0, -1.0)),
    ("G1 X60 F120", (60.0, 20.0, -1.0)),
    ("G3 X70 Y30 I0 J10", (70.0, 30.0, -1.0)),
    ("G1 Y40", (70.0, 40.0, -1.0)),
]
BALL_FINISH = [("G1 Z-0.3 F200", (20.0, 20.0, -0.3))] + [
    (f"G1 X{20 + 2 * k} Z{-0.3 - 0.05 * (k % 3):.2f}", (20.0 + 2 * k, 20.0, -0.3 - 0.05 * (k % 3)))
    for k in range(1, 8)
]
PARTS = {"slot": (SLOT, SIX), "ball finish": (BALL_FINISH, replace(SIX, kind="ball"))}

AGAIN = {
    "absolute": "G1 X{0:g} Y{1:g} Z{2:g}",
    "one axis": "G1 X{0:g}",
    "incremental": "G91 G1 X0 Y0 Z0\nG90",
    "there and back by a thousandth": "G91 G1 X0.001\nG1 X-0.001\nG90",
    "an arc of a thousandth": "G91 G2 X0.001 Y0.001 R0.001\nG1 X-0.001 Y-0.001\nG90",
    "less than what is computed": "G91 G1 X0.0000000001\nG90",
}
STILL = ("absolute", "one axis", "incremental")
SHORT = "an arc of a thousandth"


def text(blocks, repeats=()) -> str:
    """The part with a point said again, in some spelling, after some of its blocks."""
    lines = list(BEGIN)
    for index, (block, point) in enumerate(blocks):
        lines.append(block)
        lines += [AGAIN[how].format(*point) for at, how in repeats if at == index]
    return "\n".join([*lines, "G0 Z5", "M30", ""])


def best(part: str, tool) -> tuple[float, float]:
    """Violation and time of the blockwise optimum."""
    found = problem(part, LIMITS, tool=tool)
    objectives, violation = found.decided(blockwise_optimum(found, "time", FREE))
    return violation, float(objectives[0])


@pytest.fixture(scope="module")
def without() -> dict[str, float]:
    """Least time of the parts without a repeated point [s]."""
    return {name: best(text(blocks), tool)[1] for name, (blocks, tool) in PARTS.items()}


@pytest.mark.parametrize(("part", "how"), [
    pytest.param(part, how, marks=() if part == "slot" or how == SHORT else pytest.mark.proof)
    for part in PARTS for how in AGAIN
])  # fmt: skip
def test_a_repeated_point_after_any_block_costs_nothing(part, how, without):
    """A hundredth: a block of a thousandth of a millimetre does stop, and blocks share words."""
    blocks, tool = PARTS[part]
    repeats = [(index, how) for index in range(len(blocks))]
    violation, time = best(text(blocks, repeats), tool)
    assert violation == 0.0
    assert time == pytest.approx(without[part], rel=1e-9 if how in STILL else 1e-2)


@given(
    st.sampled_from(sorted(PARTS)),
    st.lists(st.tuples(st.integers(0, 7), st.sampled_from(STILL)), min_size=1, max_size=6),
)
@settings(max_examples=6)
def test_repeated_points_anywhere_change_no_optimum_and_get_no_word(part, repeats):
    blocks, tool = PARTS[part]
    plain, doubled = (problem(text(blocks, some), LIMITS, tool=tool) for some in ((), repeats))
    decisions = [blockwise_optimum(one, "time", FREE) for one in (plain, doubled)]
    feeds = [
        one.row_feeds[found.cut.plan.path.moving]
        for one, found in zip(decisions, (plain, doubled), strict=True)
    ]
    np.testing.assert_allclose(*feeds, rtol=1e-9)
    program = Program(text(blocks, repeats).encode(), "P.nc")
    moves = interpret(program, Setup())
    editable = editable_blocks(program, moves)
    made = rewrite(
        program, moves, editable, decisions[1].row_feeds, decisions[1].row_speeds, Setup()
    )
    assert prove(program.data, made.text, "P.nc", "Q.nc", Setup()).same
    still = set(moves.line[(moves.end == moves.start).all(axis=1)].tolist())
    assert not {change.line for change in made.changes if change.letter == "F"} & still


def test_a_repeated_point_is_neither_a_block_nor_held() -> None:
    program = Program(b"G21 S3000 M3\nG1 X1 F100\nX1\nX2\n", "P.nc")
    made = editable_blocks(program, interpret(program, Setup()))
    assert made.line.tolist() == [2, 4] and made.held == ()


def test_a_full_circle_ends_where_it_begins_and_is_a_block() -> None:
    program = Program(b"G21 S3000 M3\nG1 X1 F100\nG2 I5\n", "P.nc")
    assert editable_blocks(program, interpret(program, Setup())).line.tolist() == [2, 3]
