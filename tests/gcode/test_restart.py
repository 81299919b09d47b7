"""What a restart at a line needs: with it, the rest of a program makes the same moves."""

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret, restart_at, restart_lines
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup, Tool

SETUP = Setup(
    work_offsets={"G54": (10, 20, -300, 0, 0, 0), "G55": (1, 2, -250, 0, 0, 0)},
    tools={4: Tool(length=80.0, diameter=10.0), 7: Tool(length=95.0)},
)
LINES = """G21 G17 G90 G94 G40 G80
T4 M6
T7
G55 S6000 M3 M8
G0 X5 Y5
G43 H4 Z10
G1 Z-2 F300
G18 G3 X15 Z-2 I5 K0 F200
G20 G1 X1 F10
G91 Y1
Y1 M9
G90 G95 S500 M4 F0.01 X2
G17 G2 X3 R0.6
M6
G0 G43 H7 Z2
M30
""".splitlines()


def program(lines: list[str]):
    return parse_program(("\n".join(lines) + "\n").encode(), "part.nc")


@pytest.mark.parametrize("line", range(4, len(LINES)))
def test_the_rest_of_a_program_is_the_same_after_its_restart(line: int) -> None:
    whole = interpret(program(LINES), SETUP)
    found = restart_at(program(LINES), SETUP, line)
    say = {name: words.partition(" (")[0] for name, words in found.words.items()}
    offset, length = say["work offset"].partition("+")[0], say["tool length"]
    absolute = " ".join(f"{axis}{value}" for axis, value in zip("XYZ", found.program, strict=False))
    head = [
        f"{say['tool']} M6" if say["tool"] != "none yet" else "",
        f"{say['units']} {say['plane']} G90 {offset} {say['cutter radius']}",
        f"{say['spindle']} {say['coolant']}", "" if length == "G49" else length, say["feed"],
        say.get("next tool", ""), f"G0 {absolute}",
        f"{say['distance mode']} {say.get('motion', '')}",
    ]  # fmt: skip
    again = interpret(program([*head, *LINES[line - 1 :]]), SETUP)
    rest = whole.part(int(np.searchsorted(whole.line, line)), len(whole))
    tail = again.part(len(again) - len(rest), len(again))
    # the position is said to six digits of the program's unit
    np.testing.assert_allclose(tail.end, rest.end, atol=2 * 25.4 * 5e-7)
    for name in ("kind", "plane", "tool", "direction", "feed_mode", "speed"):
        np.testing.assert_array_equal(getattr(tail, name), getattr(rest, name), err_msg=name)
    np.testing.assert_allclose(tail.feed, rest.feed, rtol=1e-9)


def test_what_has_to_be_said_is_said() -> None:
    said = "\n".join(restart_lines(restart_at(program(LINES), SETUP, 11)))
    for words in ("units            G20 (inch)", "distance mode    G91", "work offset      G55+G43",
                  "tool             T4", "next tool        T7", "tool length      G43 H4",
                  "spindle          S6000 M3", "feed             G94 F10", "coolant          M8",
                  "warning: G91 is in force"):  # fmt: skip
        assert words in said
    lines = ["G21 G81 X1 Z-5 R1 F100", "X2", "G80", "G41 D4 G1 X9", "X20", "M30"]
    found = restart_at(program(lines), SETUP, 2)
    assert found.words["cycle"] == "G81 G98 R1 Z-5" and "canned cycle" in found.warnings[0]
    (warning,) = restart_at(program(lines), SETUP, 5).warnings
    assert "cutter radius compensation is on" in warning


def test_long_stretches_of_plain_lines_stop_at_the_line() -> None:
    lines = ["G21 G1 F100", *(f"X{k}" for k in range(500)), "M30"]
    assert restart_at(program(lines), SETUP, 300).program[0] == 297.0


@pytest.mark.parametrize(
    ("line", "said"), [(0, "has no line 0"), (9, "has no line 9"), (3, "never comes to line 3")]
)
def test_a_line_that_is_none_is_one_sentence(line: int, said: str) -> None:
    with pytest.raises(ValueError, match=f"part.nc {said}: name one"):
        restart_at(program(["G1 X1 F100", "M30", "X2"]), SETUP, line)


def test_a_cycle_of_mcall_is_named() -> None:
    lines = "G90 G17\nG0 X0 Z9 F9\nMCALL CYCLE81(9,0,1,-2)\nX5\nMCALL\nX9\nM30".splitlines()
    setup = Setup(dialect="siemens")
    said = [restart_at(program(lines), setup, line).warnings for line in (3, 4, 6)]
    assert said == [(), ("MCALL CYCLE81 is in force: call it again with its values",), ()]
