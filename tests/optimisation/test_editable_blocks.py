"""Which F and S may be changed: each rule with the smallest program that needs it."""

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.text.editable_blocks import editable_blocks

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
    assert made.may_start.tolist() == [True, True, False, False, False, False, True, True]
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
