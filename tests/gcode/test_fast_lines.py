"""Fast lines are what the interpreter makes of them one by one: same bits, same errors."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Kind
from pipeline.gcode.program import Program, parse_program, read_program
from pipeline.gcode.setup import Setup, Tool
from tests.gcode.following import RECORDINGS, fuzzed, long_in_proof, recorded, short

FANUC = recorded("gcode/nist_d2mi/*.NC", "nist_box/programs/*.NC")
LINUXCNC = recorded("gcode/linuxcnc/**/*.ngc")
TOOLS = {number: Tool(length=50.0 + number, diameter=number) for number in range(100)}
OFFSETS = {"G54": (10.1, -20.2, 30.3, 1.0, 2.0, 3.0), "G55": (0.1, 0.2, 0.3, 0.0, 0.0, 0.0)}


def outcome(program: Program, setup: Setup, compiled: bool) -> tuple[str, list[bytes], Interpreter]:
    """Error or nothing, the bytes of each column written so far, and who wrote them."""
    interpreter = Interpreter(program, setup, compiled=compiled)
    error = ""
    try:
        interpreter.moves()
    except GcodeError as refused:
        error = str(refused)
    rows = interpreter.run.rows
    return error, [array[: rows.count].tobytes() for array in rows.arrays.values()], interpreter


def assert_equal_both_ways(program: Program, setup: Setup) -> Interpreter:
    error, columns, fast = outcome(program, setup, compiled=True)
    error_slowly, columns_slowly, slow = outcome(program, setup, compiled=False)
    assert error == error_slowly
    assert columns == columns_slowly
    assert repr(fast.run.state) == repr(slow.run.state)  # -0 too
    assert fast.run.group_1 == slow.run.group_1
    assert fast.run.compensated_position == slow.run.compensated_position
    return fast


@pytest.mark.skipif(RECORDINGS is None, reason="KERF_RECORDINGS names no folder")
@pytest.mark.parametrize("path", long_in_proof(FANUC + LINUXCNC), ids=short)
def test_recorded_programs_are_the_same_bits(path: Path) -> None:
    dialect = "linuxcnc" if path in LINUXCNC else "fanuc"
    setup = Setup(
        dialect=dialect, tools=TOOLS, work_offsets=OFFSETS, folders=(path.parent,),
        block_limit=30_000,
    )  # fmt: skip
    interpreter = assert_equal_both_ways(read_program(path), setup)
    if path in FANUC:
        assert interpreter.run.rows.count > 100  # so that there was something to compare


NUMBER = st.one_of(
    st.integers(-20, 20).map(str),
    st.integers(-20_000, 20_000).map(lambda n: f"{n / 1000:.3f}"),
    st.sampled_from(["-0", "0.", ".5", "1e", "12345678901234567890.123", "9" * 31]),
)
OPERAND = st.sampled_from(
    ["1", "-2.5", "#1", "#2", "-#1", "#<a>", "# < B c >", "#3", "#5", "#100", "#5221",
     "#<_x>", "#<n>", "0", "1e", "--3", "##1", "SIN[#1]", "#<_line>",
     "12345678901234567890.123", "9" * 20, "9" * 31]
)  # fmt: skip
EXPRESSION = st.recursive(
    OPERAND,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", " * ", "**", "MOD", "EQ", ""]), inner)
        .map("".join)
        .map(lambda text: f"[{text}]"),
        inner.map(lambda text: f"-[{text}]"),
        inner.map(lambda text: f"[[{text}]"),
    ),
    max_leaves=6,
)
VALUE = st.tuples(st.sampled_from("XYZXYZAIFG"), EXPRESSION).map("".join)
AXIS = st.tuples(st.sampled_from("XYZXYZABC"), NUMBER).map("".join)
FINE = st.tuples(st.sampled_from("XYZ"), st.integers(-9, 9).map(str)).map("".join)
CENTRE = st.tuples(st.sampled_from("IJIJKR"), st.integers(-9, 9).map(str)).map("".join)
CODE = st.sampled_from(
    ["G0", "G1", "G2", "G3", "G01", "G17", "G18", "G19", "G20", "G21", "G90", "G91", "G90.1",
     "G91.1", "G94", "G93", "G40", "G80", "G54", "G55", "G4P1", "G81R1Z-1", "G43H2", "G49", "G9",
     "G53", "G61", "G68X0Y0R30", "G69", "G98", "G41D1", "G52X1", "G92X0"]
)  # fmt: skip
OTHER = st.sampled_from(
    ["F100", "F1.5", "F0", "F-1", "S1000", "M3", "M5", "M8", "T2M6", "N10", "/", "P2", "X#1", "H1",
     "X[1+1]", "#1=2", "(text)", "(a (b)", "(abort,stop)", "; rest", "L2", "Q1", "D1", "M30", "%"]
)  # fmt: skip
PIECE = st.one_of(AXIS, FINE, CENTRE, CODE, OTHER)
MOVE = st.tuples(
    st.sampled_from(["", "", "N5", "G1", "G0"]), st.lists(AXIS, min_size=1, max_size=3)
).map(lambda parts: parts[0] + "".join(parts[1]))
ARC = st.builds(
    lambda code, u, v, i, j: f"{code}X{u}Y{v}I{i}J{j}",
    st.sampled_from(["G2", "G3", "G91G2", "G90G3"]),
    *[st.integers(-3, 3)] * 4,
)
RADIUS = st.builds(
    lambda code, u, v, r: f"{code}X{u}Y{v}R{r}",
    st.sampled_from(["G2", "G3"]),
    *[st.integers(-3, 3)] * 2,
    st.integers(-9, 9),
)
CIRCLE = st.sampled_from(["G91G2X0I1", "G91G3Y0J-2Z1", "G91G18G2X0K1Y2", "G91G19G3Z0J1K-1", "G2I3"])
LINE = st.one_of(
    MOVE, MOVE, ARC, RADIUS, CIRCLE, VALUE, st.lists(PIECE, max_size=3).map("".join), CODE, OTHER
)
ASSIGNED = ["#1=2.5", "#2=[0-#1]", "#3=0", "#100=7"]
TEXT = st.lists(LINE, max_size=12).map(
    lambda lines: "\n".join(["F500G1", *ASSIGNED, *lines]).encode()
)
SETUPS = st.builds(
    Setup, dialect=st.sampled_from(["fanuc", "linuxcnc"]),
    decimal=st.sampled_from(["calculator", "calculator", "increment"]), inch=st.booleans(),
    tools=st.just(TOOLS), work_offsets=st.sampled_from([{}, OFFSETS]),
    arc_tolerance=st.sampled_from([0.05, 5.0]),
)  # fmt: skip


@fuzzed(TEXT, SETUPS)
def test_written_programs_are_the_same_bits(text: bytes, setup: Setup) -> None:
    if setup.dialect == "linuxcnc":
        text = b"\n".join([b"#<a>=0.1", b"#<bc>=3", text])
    assert_equal_both_ways(parse_program(text, "test"), setup)


DEEP = "[" * 20 + "#1" + "]" * 20
LONG = "[" + "-[1+" * 12 + "2*#1/3-4" + "]" * 12 + "]"


@pytest.mark.parametrize(
    "text",
    ["[#1+2*3]", "[#1*2+3]", "[2-3-#1]", "[8/#1/2]", "[[1+#1]*-[2-3]]", "-#1", "--#1", "-[-#1]",
     "[-#1*-2]", "#<a b>", "#<AB>", "[#1/3*3]", "[0.1+0.2-#1]", "[-0*#1]", DEEP, LONG],
)  # fmt: skip
def test_expressions_are_the_same_bits(text: str) -> None:
    program = parse_program(f"#1=2.5\n#<ab>=0.3\nG1F100X{text}Y1Z{text}\n".encode(), "test")
    assert_equal_both_ways(program, Setup(dialect="linuxcnc"))


@pytest.mark.parametrize("dialect", ["fanuc", "linuxcnc"])
def test_fast_lines_with_expressions_are_done_at_once(dialect: str) -> None:
    lines = ["#1=2", "G1 X[#1*2] F#1", "Y#1", "N5 G2 X[#1*3] Y-[-#1] R[1+0]", "G0 Z-#1"]
    interpreter = Interpreter(
        parse_program("\n".join(lines).encode(), "test"), Setup(dialect=dialect)
    )
    interpreter._step()
    interpreter._step()
    assert interpreter.blocks == 5
    assert interpreter.run.state.position == [6.0, 2.0, -2.0, 0.0, 0.0, 0.0]


def test_consecutive_fast_lines_are_done_at_once() -> None:
    """Else all of the above would compare the interpreter with itself."""
    lines = [
        "G90 G1 X1 F100 (text)",
        "",
        "N3 Y2 ; rest",
        "G2 X2 Y3 I1 J0",
        "G91 G3 X-1 Y-1 R2",
        "G1A5",
    ]
    interpreter = Interpreter(parse_program("\n".join(lines).encode(), "test"), Setup())
    interpreter._step()
    assert interpreter.blocks == len(lines)
    rows = interpreter.run.rows
    kinds = [Kind.FEED, Kind.FEED, Kind.ARC, Kind.ARC, Kind.FEED]
    assert rows.arrays["kind"][: rows.count].tolist() == kinds
    assert np.array_equal(rows.arrays["line"][: rows.count], [1, 3, 4, 5, 6])


@pytest.mark.parametrize("line", [
    "X1 X2", "G0 G1 X1", "G1 X1 I2", "G2 X1", "G2 X1 R1 I1", "G17 G2 X1 K1", "M8", "S1", "O1",
    "X#1", "/X1", "X1 N2", "F0 X1", "G1.5 X1", "G4", "X", "X1e5", "P1", "%", "X[#1]", "X[1/0]",
    "X#2",
    "X[#<none>]", "X[SIN[1]]", "X[2**3]", "X##1", "X#<_line>",
])  # fmt: skip
def test_what_is_no_fast_line_is_left_to_the_interpreter(line: str) -> None:
    interpreter = Interpreter(parse_program(f"G1 F100\n{line}\n".encode(), "test"), Setup())
    interpreter._step()
    assert interpreter.blocks == 1
