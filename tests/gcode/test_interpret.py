"""From text to moves: units, feeds, spindle, tools, M codes, what cannot be followed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.dialects.statement_parser import (
    parse_statement,
    statement_from_tokens,
)
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import interpret, interpret_in_parts
from pipeline.gcode.moves import FeedMode, PathMode
from pipeline.gcode.program import output_lines, parse_program
from pipeline.gcode.setup import Setup, Tool
from tests.gcode.following import follow, fuzzed, kinds, refusal


def test_motion_starts_at_the_initial_position():
    moves = follow("G91 G0 X1", initial_position=(5.0, 6.0, 7.0, 0, 0, 8.0))
    assert moves.origin.tolist() == [5, 6, 7, 0, 0, 8]
    assert moves.end.tolist() == [[6, 6, 7, 0, 0, 8]]


CUTTER = {"tools": {1: Tool(diameter=2.0)}}
LINUXCNC = {"dialect": "linuxcnc", "tools": {1: Tool()}}
STOP, PATH, ON = PathMode.EXACT_STOP, PathMode.EXACT_PATH, PathMode.CONTINUOUS
MINUTE, INVERSE, TURN = FeedMode.PER_MINUTE, FeedMode.INVERSE_TIME, FeedMode.PER_REVOLUTION
COLUMNS = {
    "G93, G94, G95 say what F means": (
        "M3 S100\nG1 X1 F60\nG93 X2 F4\nX3 F5\nG95 X4 F0.2\nG94 X5 F70", {},
        {"feed": [0, 60, 4, 5, 0.2, 70],
         "feed_mode": [MINUTE, MINUTE, INVERSE, INVERSE, TURN, MINUTE]}),
    "F counts inches, but degrees where only a table turns": (
        "G20 G1 X1 F10\nA90\nX2 A0", {}, {"feed": [254, 10, 254]}),
    "F of an inverse time has no length": ("G20 G93 G1 X1 F10", {}, {"feed": [10]}),
    "the spindle has rows of its own": (
        "S500\nM3\nS600\nG0 X1\nM4\nM5\nS700\nM19", {},
        {"kinds": "SPINDLE SPINDLE RAPID SPINDLE SPINDLE SPINDLE",
         "speed": [500, 600, 600, 600, 0, 0], "direction": [1, 1, 1, -1, 0, 0]}),
    "surface speed counts metres": (
        "G96 S200 M3\nG97 S900", {},
        {"speed": [200, 900], "constant_surface_speed": [True, False]}),
    "surface speed counts feet": ("G20 G96 S1000 M3", {}, {"speed": [304.8]}),
    "S beside G92 limits the speed": (
        "G96 S100 M3\nG92 S3000\nG1 X1 F1", {}, {"kinds": "SPINDLE FEED", "speed": [100, 100]}),
    "S beside G50 limits the speed": (
        "G96 S100 M3\nG50 S3000\nG1 X1 F1", {}, {"kinds": "SPINDLE FEED", "speed": [100, 100]}),
    "M3 starts before the motion and M5 stops after it": (
        "S9 F9\nG1 X1 M3\nG1 X2 M5", {},
        {"kinds": "SPINDLE FEED FEED SPINDLE", "direction": [1, 1, 1, 0]}),
    "T waits for M6, after the motion on a Fanuc": (
        "T3\nG91 G28 Z0 M6\nT4\nG0 X1", {},
        {"kinds": "RAPID RAPID TOOL_CHANGE RAPID", "tool": [-1, -1, 3, 3]}),
    "before it in LinuxCNC": ("G0 X1 T1 M6", LINUXCNC, {"kinds": "TOOL_CHANGE RAPID"}),
    "M codes": (
        "M8\nM0\nM1\nM51 P2\nM9 M30\nG0 X1", {"plain_m_codes": (51,)},
        {"kinds": "M_CODE STOP STOP M_CODE M_CODE END", "code": [8, 0, 1, 51, 9, 0],
         "value": [0, 0, 0, 2, 0, 0]}),
    "G9 holds in its block, G61 and G64 hold on": (
        "F9 G1 X1\nG9 X2\nG61 X3\nX4\nG64 X5\nG64 P0.02 X6", {},
        {"path_mode": [ON, STOP, STOP, STOP, ON, ON], "tolerance": [0, 0, 0, 0, 0, 0.02]}),
    "LinuxCNC runs through straight joints under G61 and drills so": (
        "F9 G61 G1 X1\nG61.1 X2\nG64 X3\nG81 X4 Z-1 R1\nG80\nG1 X5", LINUXCNC,
        {"path_mode": [PATH, STOP, ON, PATH, PATH, PATH, PATH, ON]}),
    "a dwell between two compensated moves stays where the tool is": (
        "F9 G41 D1 G1 X5 Y5\nX20\nG4 P100\nX30\nG40 Y9", CUTTER,
        {"kinds": "FEED FEED DWELL FEED FEED",
         "end": [[x, y, 0, 0, 0, 0] for x, y in ((5, 6), (20, 6), (20, 6), (30, 6), (30, 9))]}),
    **{f"{text} of {dialect}": (text, {"dialect": dialect}, {"kinds": "DWELL", "value": [seconds]})
       for text, dialect, seconds in (
           ("G4 P500", "fanuc", 0.5), ("G4 P1.5", "fanuc", 1.5), ("G4 X2.", "fanuc", 2),
           ("G4 U2", "fanuc", 2), ("G4 P1.5", "linuxcnc", 1.5), ("G4 F3", "siemens", 3))},
}  # fmt: skip
"""Rule -> program, choices of the setup, columns of its moves."""


@pytest.mark.parametrize("rule", COLUMNS)
def test_columns_are_those_of_the_rule(rule):
    text, choices, columns = COLUMNS[rule]
    moves = follow(text, **choices)
    for name, expected in columns.items():
        if name == "kinds":
            assert " ".join(kinds(moves)) == expected
        else:
            np.testing.assert_allclose(getattr(moves, name), expected, rtol=1e-15, err_msg=name)


def test_a_contour_that_does_not_fit_names_its_line():
    said = refusal("F9 G41 D1 G1 X5 Y5\nX9\nG3 X10 Y6 J1\nG40 Y9", tools={1: Tool(diameter=9.0)})
    assert said.startswith("P:3:1: G41: ")


def test_progress_is_told():
    told = []
    interpret(parse_program(b"G0 X1\n" * 50_000, "P"), Setup(), told.append)
    assert told
    assert told == sorted(told)
    assert told[-1] <= 50_000


@pytest.mark.parametrize(("text", "dialect", "words"), [
    ("G1 X1", "fanuc", ["P:1:1", "G1", "no feed", "F above 0"]),
    ("G0 X1\nG7.1 C5", "fanuc", ["P:2:1", "G7.1", "cylindrical", "not supported"]),
    ("G5.2 X1 Y1", "linuxcnc", ["P:1:1", "G5.2", "NURBS"]),
    ("G71.1 Q1", "linuxcnc", ["G71.1", "lathe cycle"]),
    ("M6 T7", "linuxcnc", ["T7", "setup.tools"]),
    ("M250", "linuxcnc", ["M250", "not known"]),
    ("G0 X1 P5", "fanuc", ["P:1:7", "P5", "nothing in this block takes"]),
    ("G0 U1", "fanuc", ["U1", "no axis U"]),
    ("X1", "linuxcnc", ["X1", "no motion is in force"]),
    ("G123", "fanuc", ["G123 is not known"]),
    ("G1.23 X1", "fanuc", ["G1.23"]),
    ("F-5", "fanuc", ["F is -5"]),
    ("M3 S-5", "fanuc", ["S is -5", "M4"]),
    ("G96 M3", "fanuc", ["G96", "add"]),
    ("G95 F1 G1 X1", "fanuc", ["G95", "spindle stands"]),
    ("G4", "fanuc", ["how long", "add P"]),
    ("G38.2 Z-1 F9\n#1=#5061", "linuxcnc", ["#5061", "when the machine has run"]),
    ("#1=10\nG0 X[EXP[70*#1]]", "fanuc", ["P:2:4", "EXP", "keep numbers below"]),
    ("(ABORT,worn out)", "linuxcnc", ["worn out"]),
    ("T1.5", "fanuc", ["T1.5 must be a whole number"]),
    ("M3 S9\nG33 Z1 K-1", "linuxcnc", ["lead is -1"]),
    ("G10 L2 P1 R30\nM3 S9\nG76 P1 Z-1 I-1 J.3 K.6", "linuxcnc", ["rotated or scaled"]),
    ("G10 L20 P1 X1 R5", "linuxcnc", ["takes no R"]),
    ("F9 G2", "linuxcnc", ["no axis words"]),
    ("F9 G2 X5", "fanuc", ["neither I J K nor R"]),
    ("F9 G0 X5\nG2 X-5 R4", "fanuc", ["R is 4 mm", "half the chord 5 mm"]),
    ("F9 G0 X5\nG3 X0 Y6 I-5", "fanuc", ["starts 5 mm", "ends 6 mm", "0.05 mm"]),
    ("F9 G0 X5\nG3 X1 I0", "fanuc", ["radius 0"]),
    ("F9 G0 X5\nG17 G3 X0 Y5 I-5 K1", "fanuc", ["K1", "nothing in this block takes"]),
])  # fmt: skip
def test_what_cannot_be_followed_is_said_with_place_word_and_remedy(text, dialect, words):
    said = refusal(text, dialect=dialect)
    assert said.startswith("P:") and all(word in said for word in words), said


@pytest.mark.parametrize(("choice", "words"), [
    ({"dialect": "heidenhain"}, "dialect is 'heidenhain'"),
    ({"decimal": "comma"}, "decimal is 'comma'"),
    ({"arc_tolerance": -1.0}, "setup.arc_tolerance = -1.0 mm must be at least 0"),
    ({"block_limit": 0}, "setup.block_limit = 0 blocks must be at least 1"),
    ({"boring_shift": "Q"}, "boring_shift is 'Q'"),
])  # fmt: skip
def test_a_setup_that_cannot_be_is_refused(choice, words):
    with pytest.raises(ValueError, match=words):
        Setup(**choice)


@given(st.text("gGxYnN019.+- \t\x00/aE\xff(;", max_size=12), st.sampled_from(["fanuc", "linuxcnc"]))
def test_plain_lines_say_what_the_parser_reads(text, dialect):
    program = parse_program(text.encode("latin-1") + b"\n", "P")
    found = statement_from_tokens(program, 1)
    assert found is None or found == parse_statement(program.line(1), "P", dialect)


CODE = """
G0 G1 G2 G3 G4 G10 G17 G18 G19 G20 G28 G40 G41 G42 G43 G49 G5.2 G51 G52 G54 G54.1 G68 G73 G76 G81
G83 G84 G87 G90 G91 G92 G93 G95 G98 G65 G66 G67 G33 G38.2 G53 G16 M3 M4 M5 M6 M19 M30 M98 M99 M70
M72 X Y Z A I J K R P Q L F S T D H N O U E @ ^ # [ ] ( ) ; % / = + - * 1 2 3 10 -5 0.5 99999999999
1e9 #1 #100 #5221 #3000 #<a> [#1+2] SIN[ GOTO IF WHILE DO1 END1 THEN EQ SUB ENDSUB CALL RETURN
REPEAT ENDREPEAT BREAK O1 O<a> _X=1 TRAORI CYCLE81( MSG("a") AC( CR= \x00 ÿ
"""
PIECES = st.sampled_from([*CODE.split(), "\n", "\r"])


@fuzzed(
    st.lists(PIECES | st.just("\n"), max_size=40).map(" ".join),
    st.sampled_from(["fanuc", "linuxcnc", "siemens"]),
)
def test_no_program_does_anything_but_be_read_or_refused(text, dialect):
    program = parse_program(text.encode("latin-1"), "P")
    setup = Setup(dialect=dialect, block_limit=500, tools={1: Tool(diameter=1.0, length=2.0)})
    try:
        moves = interpret(program, setup)
    except GcodeError as error:
        assert str(error).startswith("P:")
    else:
        assert np.isfinite(moves.end).all()


def test_words_that_are_passed_over_are_told():
    found = output_lines(b"G0 X1\nN20 POPEN\n/ DPRNT[X]\n(DPRNT)\nDPRNT[Y]\n")
    assert found == {"POPEN": [2], "DPRNT": [3, 5]}


CORNER = "F100 G0 X0 Y0\nG1 X10 {word}\nY{end}\nX0\n"


@pytest.mark.parametrize("turn", [1, -1], ids=["left", "right"])
def test_a_rounded_corner_is_an_arc_that_touches_both_lines(turn):
    moves = follow(CORNER.format(word=",R2.", end=10 * turn))
    rows = moves.end[1:5, :2].round(9).tolist()
    assert rows == [[8, 0], [10, 2 * turn], [10, 10 * turn], [0, 10 * turn]]
    assert kinds(moves)[1:5] == ["FEED", "ARC", "FEED", "FEED"]
    assert moves.centre[2, :2].round(9).tolist() == [8, 2 * turn]
    assert moves.angle[2] == pytest.approx(turn * np.pi / 2)
    assert moves.length.sum() == pytest.approx(8 + np.pi + 8 + 10)


def test_a_chamfer_takes_as_much_of_both_lines():
    moves = follow(CORNER.format(word=",C3", end="10 F50"))
    assert moves.feed[1:4].tolist() == [100, 100, 50]
    assert moves.end[1:5, :2].tolist() == [[7, 0], [10, 3], [10, 10], [0, 10]]
    assert kinds(moves)[1:5] == ["FEED"] * 4


def test_corners_follow_each_other_in_any_plane_and_at_any_angle():
    moves = follow("G18 F100 G0 X0 Z0\nG1 Z10,R1\nG91 X10 Z10,C2.\nG90 Z50\n")
    assert kinds(moves)[1:6] == ["FEED", "ARC", "FEED", "FEED", "FEED"]
    centre, leave, join = moves.centre[2], moves.end[1], moves.end[2]
    np.testing.assert_allclose([np.linalg.norm(p[:3] - centre) for p in (leave, join)], 1.0)
    assert abs(moves.angle[2]) == pytest.approx(np.pi / 4)
    np.testing.assert_allclose(np.linalg.norm(moves.end[4] - moves.end[3]), 4 * np.cos(np.pi / 8))


IN_PARTS = (
    "O1\nF100 G0 X0 Y0 Z5\nG1 X10 ,R2.\nY10\nX0\nG81 X1 Z-5 R2\nX2\nG80\nM98 P20002\nT1 M6\n"
    "G41 D1 G1 X20\nY20\nG3 X10 Y30 I-10\nG40 G1 X0\nG54 G0 X1\nG9 G1 X3\nG52 X5\nX1\nM30\n"
    "O2\nG91 G1 X1\nG2 X2 Y2 I2\nG90\nM99\n"
)


@pytest.mark.parametrize("rows", [1, 2, 5, 1000])
def test_parts_of_a_program_are_its_moves(rows):
    program, setup = parse_program(IN_PARTS.encode(), "P"), Setup(tools={1: Tool(diameter=4.0)})
    whole = interpret(program, setup)
    parts = list(interpret_in_parts(program, setup, None, rows))
    assert len(parts) == 1 if rows > len(whole) else len(parts) > 3
    for name, column in whole.columns():
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, column, err_msg=name)
    starts = np.concatenate([part.start for part in parts if len(part)])
    np.testing.assert_array_equal(starts, whole.start)
    assert (parts[-1].frames, parts[-1].files) == (whole.frames, whole.files)
    assert parts[-1].cutter_radii == whole.cutter_radii


@pytest.mark.parametrize("dialect", ["fanuc", "siemens"])
def test_no_arc_comes_right_after_g40(dialect):
    contour = "F100 G41 D1 G1 X10\nY10\nG40{}\nG2 X20 Y10 I5"
    if dialect == "siemens":
        contour = "T1 M6\n" + contour
    tools = {1: Tool(diameter=4.0)}
    for between in ("", "\nM8"):
        said = refusal(contour.format(between), dialect=dialect, tools=tools)
        assert "G2: no arc may come right after G40" in said
    assert "ARC" in kinds(follow(contour.format(" G1 X10"), dialect=dialect, tools=tools))
