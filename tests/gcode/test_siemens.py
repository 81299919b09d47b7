"""The dialect siemens: lines of a Sinumerik 840D to statements, and programs of one to moves."""

import math
import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.dialects.siemens import SiemensReader
from pipeline.gcode.dialects.siemens_tokens import VARIABLE
from pipeline.gcode.dialects.siemens_words import UNROTATED, WITHOUT_MOTION, rotated, rotation, tilt
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind, PathMode
from pipeline.gcode.program import parse_program, read_program
from pipeline.gcode.setup import Setup, Tool
from pipeline.gcode.statements import Parameter, constant
from tests.gcode.following import fuzzed, long_in_proof, recorded, short

PROGRAMS = recorded("gcode/elmoe_5axis/*.mpf", "gcode/elmoe_5axis/*ner.txt")
needs_recordings = pytest.mark.skipif(not PROGRAMS, reason="KERF_RECORDINGS is not set")
SETUP = Setup(dialect="siemens")


def statements(text):
    program = parse_program(text.encode("latin-1"), "test.mpf")
    reader = SiemensReader("test.mpf", SETUP)
    return [reader.statement(line) for line in program.lines]


def words(text):
    """Letter and value, or name of the variable, of each word of the last line."""
    return [
        (word.letter, value.key.removeprefix(VARIABLE) if isinstance(value, Parameter)
         else constant(value))
        for word in statements(text)[-1].words for value in [word.value]
    ]  # fmt: skip


def moves(text, setup=SETUP):
    return interpret(parse_program(text.encode(), "test.mpf"), setup)


def refusal(text):
    with pytest.raises(GcodeError) as refused:
        statements(text)
    return refused.value


@pytest.mark.parametrize(("text", "expected"), [
    ("N10 G1 X10. Y-.5 F100", [("G", 1), ("X", 10), ("Y", -0.5), ("F", 100)]),
    ("g0 x=_home y = -5", [("G", 0), ("X", "_home"), ("Y", -5)]),
    ("SUPA G0 Z=_Z D0", [("G", 53), ("G", 0), ("Z", "_z"), ("D", 0), ("H", 0), ("G", 43)]),
    ('T="A"\nT="B"\nT="A"', [("T", 1)]),
    ('T="A"\nM6\nD1', [("D", 1), ("H", 1), ("G", 43)]),
    ('T="A"\nM6\nT="B"\nD1', [("D", 1), ("H", 1), ("G", 43)]),
    ("G60 G601 FNORM G710 G642", [("G", 61), ("G", 710), ("G", 64)]),
    ("CYCLE832(_tol,1,1)", [("G", 64), ("P", "_tol")]),
    ("CYCLE832()", [("G", 64)]),
    ("TRANS X1 Y=2", [("G", 52), ("X", 1), ("Y", 2), ("Z", 0)]),
    ("G2 X1 CR=5.", [("G", 2), ("X", 1), ("R", 5)]),
    ("X10 ; X20", [("X", 10)]),
    ("TRAFOOF", []),
    ("CYCLE800()", []),
    ('MSG("X10 ; (Y20")', []),
])  # fmt: skip
def test_line_becomes_words(text, expected):
    assert words(text) == expected


def test_every_word_without_motion_is_read_as_such():
    assert words(" ".join(WITHOUT_MOTION)) == []


def test_variables_are_0_or_what_they_are_given():
    text = "DEF REAL AA, BB=2.\nG1 X=AA+BB*3 Y=-(BB-SIN(30)) F=BB\n"
    made = moves("DEF REAL _C=4\n" + text + "R1=_C/8\nZ=R1\nM30\n")
    np.testing.assert_allclose(made.end[1, :3], [6, -1.5, 0.5], atol=1e-15)


@pytest.mark.parametrize(("text", "x"), [
    ("G90 X10\nX=IC(5)", 15),
    ("G90 X10\nX=AC(5)", 5),
    ("X10\nG91 X=AC(5)", 5),
    ("X10\nG91 X=IC(5)", 15),
    ("X10\nX=IC(5) G91\nX1\nX=AC(7)\nX1", 8),
    ("G70 X1\nX=IC(1)", 50.8),
    ("TRANS X3\nX1\nX=IC(1)", 5),
    ("X25.4\nG70 X=IC(1)", 50.8),
    ("G70 X1\nG71 X=IC(1)", 26.4),
    ("X10\n/G91\nX=IC(5)", 15),
    ("X10\n/G91 RND=5\nX=AC(5)", 5),
    ("R01=5\nX=R1+R001", 10),
    ("TRANS X5\nX1\nROT\nX2", 2),
    ("REPEAT\nR1=R1+0.1\nX=R1\nUNTIL R1>=1", 1),
    ("IF 0.1*3==0.3\nX1\nENDIF", 1),
    ("IF 0.1*3>0.3\nX1\nENDIF", 0),
    ("DEF REAL ELSE_X\nIF R1==1\nELSE_X=5\nX10\nENDIF", 0),
    ("GOTOF N1234569\nN1234568 X5\nN1234569 X6", 6),
    ("DEF BOOL FL=5\nIF FL==TRUE\nX1\nENDIF", 1),
    ("DEF INT II\nFOR II=0.6 TO 2.4\nX=II\nENDFOR", 2),
    ("IF R1==1\nREPEAT AA BB P=2\nENDIF\nX3", 3),
    ('WORKPIECE(,"",,"BOX",112,0,-20)\nX3', 3),
    ("WORKPIECE(,(1),SIN(2)) X3", 3),
    ("T=5 D1\nX3", 3),
    ("X10\nY=IC(5) X3", 3),
    ("X10\nX=IC(5) Y=AC(3)\nY=IC(1) X=3", 3),
    ("G91 X10\nY=AC(5) X3", 13),
    ("R2=4\nX1\nX=IC(-R2*2)", -7),
    ("X1\nR1=2\nX=IC(R1)\nR1=3\nX=IC(R1)", 6),
])  # fmt: skip
def test_a_coordinate_counts_as_its_own_word_says(text, x):
    setup = Setup(dialect="siemens", block_skip=(1,))
    assert moves(f"G0 X0\n{text}\nM30\n", setup).end[-1, 0] == pytest.approx(x, abs=1e-12)


def test_a_depth_of_its_own_counts_with_the_tools_length():
    setup = Setup(dialect="siemens", tools={1: Tool(length=50.0, diameter=8.0)})
    for more in ("Z=IC(5)", "G91 Z5", "Z=AC(55)"):
        made = moves(f'G0 Z100\nT="A"\nM6\nD1\n{more}\nM30\n', setup)
        assert made.end[-1, 2] == 105


@pytest.mark.parametrize(("value", "expected"), [
    ("POT(3)", 9), ("ROUND(2.6)", 3), ("TRUNC(-2.6)", -2), ("ATAN2(1,-1)", 135),
    ("7 DIV 2", 3), ("7 MOD 4", 3), ("2*7 DIV 4 + 1", 4), ("SQRT(POT(3)+POT(4))", 5),
])  # fmt: skip
def test_functions_of_values(value, expected):
    assert moves(f"R1={value}\nX=R1\nM30\n").end[-1, 0] == pytest.approx(expected, abs=1e-12)


def test_a_whole_number_rounds_what_it_is_given():
    assert moves("DEF INT NR=7/2\nX=NR\nNR=2.4\nY=NR\nM30\n").end[-1, :2].tolist() == [4, 2]


def test_variables_of_the_setup_exist_by_any_case():
    setup = Setup(dialect="siemens", parameters={"_HOME": 5.0, "R7": 2.0})
    assert moves("_home=_Home+R7\nX=_HOME\nM30\n", setup).end[-1, 0] == 7


def test_ret_ends_as_m17_does():
    assert moves("X1\nRET\nX9\n").end[:, 0].max() == moves("X1\nM17\nX9\n").end[:, 0].max() == 1


def test_comments_and_messages_are_kept():
    first, second = statements('N1 X1 ;over there\nMSG("DRILL (A) ; B")')
    assert first.comments == ("over there",)
    assert second.comments == ("DRILL (A) ; B",)


def test_statement_says_where_its_words_stand():
    (statement,) = statements("/ N20  G1 X=5 Y3")
    assert (statement.skip, statement.number, statement.line) == (1, 20, 1)
    assert [(word.text, word.column) for word in statement.words] == [
        ("G1", 8), ("X=", 11), ("Y3", 15),
    ]  # fmt: skip


@pytest.mark.parametrize(("text", "word", "column", "said"), [
    ("G1 FOO X1", "FOO", 4, "write the call in a block of its own"),
    ("X=DC(5)", "DC(", 3, "write X=AC("),
    ("SUPA X=IC(5)", "X=", 6, "beside SUPA or G53"),
    ("R1=2 X=R1", "R1", 1, "a block before"),
    ("R1=2 CYCLE832(R1)", "R1", 1, "a block before"),
    ("R1=2 TRANS X=R1", "TRANS", 6, "block of its own"),
    ("WORKPIECE(1,(2)", "WORKPIECE(", 1, ") is missing"),
    ("X1 X2", "X2", 4, "given twice"),
    ("IF R1==1 AND R2==2", "AND", 10, "each comparison in ( )"),
    ("IF NOT R1==1", "NOT", 4, "write NOT ( )"),
    ("IF NOT NOT R1", "NOT", 8, "delete both"),
    ("DEF REAL X=5", "X=", 10, "another name"),
    ("DEF REAL", "REAL", 5, "needs the name"),
    ("FOR X=1 TO 3", "X=", 5, "define it with DEF"),
    ('EXTCALL("A"', "end of line", 1, ") is missing"),
    ("PCALL", "PCALL", 1, 'write PCALL "A"'),
    ("NAME P2 X5", "NAME", 1, "a block of its own"),
    ("G0 X1 L10", "L10", 7, "a block of its own"),
    ("RET(5)", "RET(", 1, "is not known"),
    ("PROC PP(VAR REAL AA)", "VAR", 9, "VAR and texts are not"),
    ("PROC PP BLSYNC", "BLSYNC", 9, "delete it"),
    ("MCALL HOLES2(0,0,20,0,0,4)", "HOLES2(", 7, "CYCLE81 to"),
    ("G2 X10 R5", "R5", 8, "write CR="),
    ("X=IC(5,6)", "X=", 1, "takes one value"),
    ("S=IC(5)", "IC(", 3, "no value"),
    ("G95 FZ=0.1", "FZ=", 5, "write F with G94 or G95"),
    ("TOFFL=1", "TOFFL=", 1, "define it with DEF"),
    ("R1000=1", "R1000=", 1, "from R0 to R999"),
    ("R1=ATAN2(1)", ")", 11, "takes two values"),
    ("R[1]=2", "[", 2, "fields"),
    ("REPEAT AA BB CC", "REPEAT", 1, "a block of its own"),
    ("REPEATB 5", "5", 9, "needs a label"),
    ("ROT Z30", "ROT", 1, "program's axes"),
    ("G4 S5", "G4", 1, "write G4 F"),
    ("CYCLE85(1,2,3)", "CYCLE85(", 1, "the first four at least"),
    ("CYCLE83(10,0,1,-20)", "CYCLE83(", 1, "FDEP or FDPR"),
    ("CYCLE83(10,0,1,-20,,,5,-0.5)", "CYCLE83(", 1, "_MDEP"),
    ("CYCLE83(10,0,1,-20,,,R1)", "CYCLE83(", 1, "FDPR is followed as a number"),
    ("F100\nCYCLE83(10,0,1,-20,,,5,0,-1)", "CYCLE83(", 1, "the S before"),
    ("CYCLE83(10,0,1,-20,,,5,0,0,0,0.5)", "CYCLE83(", 1, "the F before"),
    ("S100\nCYCLE84(10,0,1,-20,,,3)", "CYCLE84(", 1, "no pitch"),
    ("S100\nCYCLE84(10,0,1,-20,,,,,1)", "CYCLE84(", 1, "SDAC 3, 4 or 5"),
    ("CYCLE84(10,0,1,-20,,,3,,1,0,400)", "CYCLE84(", 1, "the S before"),
    ("G18\nG0 X0\nMCALL CYCLE81(10,0,2,-5)", "CYCLE81(", 7, "under G17"),
    ("CYCLE81(10,0,2,,R1)", "CYCLE81(", 1, "DPR is followed as a number"),
    ("HOLES2(0,0,20,0,0,4)", "HOLES2(", 1, "without a cycle"),
    ("MCALL CYCLE81(9,0,1,-2)\nHOLES2(0,0,20,0,0,1.5)", "HOLES2(", 1, "NUM is 1.5"),
    ("MCALL CYCLE81(9,0,1,-2)\nHOLES2(0,0,20)", "HOLES2(", 1, "write all of them"),
    ("G0 X=R1\nMCALL CYCLE81(9,0,1,-2)\nHOLES1(0,0,0,0,9,3)", "HOLES1(", 1, "is not known"),
    ("CYCLE800(1,2)", "CYCLE800(", 1, "machine's dimensions"),
    ("MCALL CYCLE86(1,0,1,-2)", "CYCLE86(", 7, "SDIR is 0"),
    ("MCALL POCKET4(9,0,1,-2,9,0,0,2)", "POCKET4(", 7, "MCALL is known with CYCLE81"),
    ("G41 X1\nX9\nCYCLE81(9,0,1,-2)", "CYCLE81(", 1, "write G40 before"),
    ("CYCLE81(9,0,1,-2,,0,1)", "CYCLE81(", 1, "_GMODE 0"),
    ("F1\nCYCLE83(9,0,1,-9,,,5,50,0,0,1,0,0,0,0,0,0,0,1,211111)", "CYCLE83(", 1, "_GMODE 0"),
    ("POCKET4(9,0,1,-2,9,0,0,2,0,0,300,100,0,11)", "POCKET4(", 1, "diameter of tool 0"),
    ("G1 X1 D2", "D2", 7, "write D1 or D0"),
    ("AROT", "AROT", 1, "names no axis"),
    ("TRANS A5", "A5", 7, "X, Y and Z only"),
    ("DEF STRING A", "STRING", 5, "REAL, INT or BOOL"),
    ("X=", "end of line", 1, "missing"),
    ("X=(1", "end of line", 1, ") is missing"),
    ("X?1", "?", 2, "no meaning"),
    ("G0 X1 \xe9", "\xe9", 7, "no meaning"),
    ("G43 X1", "G43", 1, "not followed in the dialect siemens"),
    ("X1 H2", "H2", 4, "no address"),
    ("X1 D=2", "D=", 4, "no expression"),
    ("G91 G0 B90 C0\nTRAORI\nAROT Y90\nX1", "X1", 1, "is not known"),
    ("GOTOF", "end of line", 1, "needs a label"),
    ("GOTOB AA X1", "X1", 10, "nothing may follow"),
    ("CASE R1 OF 1 GOTOF AA", "CASE", 1, "is not followed"),
    ("FOR R1 TO 5", "R1", 5, "FOR needs a variable"),
    ("FOR I=1", "end of line", 1, "FOR needs TO"),
    ("WHILE R1<2 X1", "X1", 12, "own line"),
    ("G2 X1 I=AC(1) J2", "J2", 15, "all of them"),
    ('MSG("open)', '"', 5, "no meaning"),
    ("TRAORI\nAROT Y90.\nG0 X1", "X1", 4, "is not known"),
    ("AROT Z10\nG1 X5", "X5", 4, "not square"),
    ("G0 B90 C0\nTRAORI\nAROT Y90\nG1 X1 B80 C0 F1", "X1", 4, "not square"),
    ("G0 B0 C0\nTRAORI\nG1 X1 C0 F1", "X1", 4, "3+2"),
    ("G0 B0 C0\nTRAORI\nTRANS X5\nG1 Y1 F1", "Y1", 4, "TRANS under TRAORI"),
    ("G1 X1 RND=2", "RND=", 7, "rounds the corner"),
    ("G2 AR=90 I5 J0", "AR=", 4, "by its angle"),
    ("S1=500 M1=3", "S1=", 1, "another spindle"),
])  # fmt: skip
def test_what_is_not_known_is_refused_with_its_place(text, word, column, said):
    error = refusal(text)
    assert (error.word, error.column) == (word, column)
    assert said in error.reason
    assert error.line == text.count("\n") + 1


@fuzzed(st.text(st.sampled_from('GXYZT=()"; +-*/.,0159_AR\t\x00\xff'), max_size=40))
def test_no_text_crashes_the_reader(text):
    try:
        statements("G0 B0 C0\nTRAORI\n" + text)
    except GcodeError as error:
        assert error.line > 2


def test_deep_brackets_are_refused():
    assert "lie in each other" in refusal("X=" + "(" * 200 + "1" + ")" * 200).reason
    assert "lie in each other" in refusal("X=" + "-" * 200 + "1").reason


def test_a_block_has_a_longest_length():
    for text in (
        "X=" + "(" * 5000,
        "R1=1" + "+1" * 400,
        "X=" + "-" * 5000 + "1",
        "X" + "1" * 20000,
    ):
        assert "more than 512 characters" in refusal(text).reason
    assert statements("X1 ;" + "long " * 500)[0].words
    assert moves("R1=1" + "+1" * 250 + "\nX=R1\nM30\n").end[-1, 0] == 251


def test_arot_turns_about_axes_already_turned():
    frame = rotated(rotated(UNROTATED, 90, 0, 0), 0, 0, 90)
    # X first lies on X; turned by Z about the new Z, which is old -Y, it becomes old Z
    np.testing.assert_allclose(frame @ [1, 0, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(
        rotated(UNROTATED, 10, 20, 30), rotation(2, 30) @ rotation(1, 20) @ rotation(0, 10)
    )


@given(st.floats(-180, 180), st.floats(-180, 180), st.floats(1e-6, 0.01))
def test_tilt_is_the_angle_that_is_left(b, c, more):
    square = rotation(2, c) @ rotation(1, b)
    assert tilt(square, b, c) < 1e-14
    assert tilt(rotated(square, 0, more, 0), b, c) == pytest.approx(math.radians(more), rel=1e-4)


def holes(text):
    """Kind, X and Z of the rows that move, and their feed per minute."""
    made = moves(f"G90 G17 G710 F100 S1000 M3\nG0 X0 Y0 Z20\n{text}\nM30")
    rows = np.flatnonzero((made.start != made.end).any(axis=1))[1:]
    return [(Kind(made.kind[i]).name[0], *made.end[i, [0, 2]].round(6).tolist()) for i in rows]


def depths(text):
    return [z for _, _, z in holes(text)]


def test_cycle83_pecks():
    """Strokes of 6, 4, then DAM; the last two halve what is left; 0.6 mm above each by G0."""
    out = "CYCLE83(10,0,2,-17,,,6,2,0,0,1,1)"
    assert depths(out) == [2, -6, 2, -5.4, -10, 2, -9.4, -12, 2, -11.4, -14, 2, -13.4, -15.5,
                           2, -14.9, -17, 10]  # fmt: skip
    chips = "CYCLE83(10,0,2,,12,-5,,0,0,0,1,0,0,0,0.5)"
    assert holes(chips) == [("R", 0, 2), ("F", 0, -5), ("F", 0, -4.5), ("F", 0, -10),
                            ("F", 0, -9.5), ("F", 0, -12), ("R", 0, 10)]  # fmt: skip
    # a factor, with strokes of _MDEP at least; a deep hole is come to from further above
    assert depths("CYCLE83(10,0,2,-10,,-4,,-0.5,0,0,1,0,0,1.5)")[1::2][:4] == [-4, -6, -7.5, -9]
    assert depths("CYCLE83(10,0,2,-50,,-25,,0,0,0,1,1)") == [2, -25, 2, -24, -50, 10]


def test_cycle83_slows_the_first_stroke_and_dwells():
    made = moves("F100\nG0 Z20\nCYCLE83(10,0,2,-10,,-4,,0,0.5,0.2,0.6,1,0,0,0,2)\nM30")
    cut = (made.kind == Kind.FEED) & (made.start != made.end).any(axis=1)
    assert made.feed[cut].tolist() == pytest.approx([60, 100, 100])
    assert made.value[made.kind == Kind.DWELL].tolist() == [0.5, 0.2, 0.5, 0.2, 2]


@pytest.mark.parametrize(("call", "seconds", "bottom"), [
    ("CYCLE82(10,0,2,-5,,3)", [3], -5), ("CYCLE82(10,0,2,-5,,-3)", [0.18], -5),
    ("CYCLE82(10,0,2,,5,3,0,1,21)", [0.18], -5), ("CYCLE82(10,0,2,-5,9,3,0,1,12)", [3], -5),
    ("CYCLE83(10,0,2,-5,,-3,,0,1,2,1,1,0,0,0,4,0,0,0,1001110)", [1, 2, 4], -5),
    ("CYCLE83(10,0,2,-5,,-3,,0,1,2,1,1,0,0,0,4,0,0,0,1001220)", [0.06, 0.12, 4], -5),
])  # fmt: skip
def test_amode_says_what_depths_and_dwells_count(call, seconds, bottom):
    made = moves(f"F100 S1000 M3\nG0 Z20\n{call}\nM30")
    assert made.value[made.kind == Kind.DWELL].tolist() == pytest.approx(seconds)
    assert made.end[:, 2].min() == bottom


@pytest.mark.parametrize(("unit", "call", "lead", "depths", "way"), [
    ("G710", "3,,1.5,0,400,500", 1.5, [-10, 2], 1),
    ("G710", "3,,-2,0,400,500", 2, [-10, 2], -1),
    ("G710", "3,8,,0,400,500", 1.25, [-10, 2], 1),
    ("G710", "3,,20,0,400,500,,2", 1.27, [-10, 2], 1),
    ("G710", "3,,0.05,0,400,500,,3", 1.27, [-10, 2], 1),
    ("G700", "3,,1.27,0,400,500,,1", 1.27, [-254, 50.8], 1),
    ("G700", "3,,0.05,0,400,500", 1.27, [-254, 50.8], 1),
    ("G710", "4,,1.5,0,400,500,0,1,0,0,5,1.4,\"\",\"\",\"\",,1,1002002", 1.5, [-10, 2], -1),
    ("G710", "3,,1.5,0,400,500,,,,1,4,0.5", 1.5, [-4, -3.5, -8, -7.5, -10, 2], 1),
    ("G710", "3,,1.5,0,400,500,,,,2,6", 1.5, [-6, 2, -10, 2], 1),
])  # fmt: skip
def test_cycle84_counts_its_pitch_in_its_own_unit_and_pecks(unit, call, lead, depths, way):
    made = moves(f"{unit} F100 S900 M3\nG0 Z20\nCYCLE84(10,0,2,-10,,,{call})\nM30")
    cut = made.kind == Kind.THREAD
    assert made.end[cut, 2].tolist() == pytest.approx(depths)
    assert made.feed[cut] == pytest.approx(lead)
    assert made.direction[cut].tolist() == [way, -way] * (len(depths) // 2)
    assert made.speed[cut].tolist() == [400, 500] * (len(depths) // 2)
    assert made.speed[-1] == 900


def test_cycle86_leaves_the_wall_with_the_spindle_at_rest():
    made = moves("F100 S900 M3\nG0 Z20\nCYCLE86(10,0,2,-5,,1,4,1,-0.5,0.2,45)\nM30")
    goes = (made.start != made.end).any(axis=1)
    assert made.end[goes, :3].tolist()[1:] == [
        [0, 0, 2], [0, 0, -5], [1, -0.5, -4.8], [1, -0.5, 2], [0, 0, 10]
    ]  # fmt: skip
    assert made.direction[goes].tolist() == [1, 1, -1, 0, 0, 0]


def test_arguments_of_cycles_are_known_when_their_line_is_read():
    """R parameters in a depth, in F and in where the tool stands; a first hole that is nearer."""
    text = "R1=-5 R2=50\nF=R2\nG0 X=R2 Y0\nMCALL CYCLE83(10,0,2,R1,,,R2/25,0,0,0,0.5,1)\nR1=9 R2=1"
    made = moves(f"S900 M3\nG0 Z20\n{text}\nHOLES1(0,0,0,10,10,2)\nMCALL\nM30")
    cut = (made.kind == Kind.FEED) & (made.start[:, 2] > made.end[:, 2])
    assert made.end[cut][:, [0, 2]].tolist() == [
        [20, -2], [20, -4], [20, -5], [10, -2], [10, -4], [10, -5]
    ]  # fmt: skip
    assert made.feed[cut].tolist() == [25, 50, 50] * 2


def test_a_cycle_keeps_the_values_of_its_mcall_and_the_motion_in_force():
    """Holes under G91 and G1 too; a variable that changes afterwards changes no hole."""
    text = "R1=-5\nMCALL CYCLE81(10,0,2,R1)\nR1=-99\nG91 G1 X5\nX5\nMCALL\nX2"
    assert [one for one in holes(text) if one[0] == "F"] == [
        ("F", 5, 20), ("F", 5, -5), ("F", 10, 10), ("F", 10, -5), ("F", 12, 10),
    ]  # fmt: skip


def test_mcall_drills_where_only_the_table_turns():
    assert [z for *_, z in holes("MCALL CYCLE81(10,0,2,-5)\nC0\nC30\nMCALL\nC60")][:8] == [
        2, -5, 10, 10, 2, -5, 10, 10
    ]  # fmt: skip


def test_supa_leaves_offset_aside_and_d1_takes_the_tools_length():
    setup = Setup(
        dialect="siemens",
        work_offsets={"G54": (100, 0, 0, 0, 0, 0)},
        tools={1: Tool(length=50.0, diameter=8.0)},
    )
    made = moves('G54\nT="A"\nM6\nG0 Z5 D1\nSUPA G0 X7 Z200 D0\nG0 X1 Z5 D1\nM30\n', setup)
    rapid = made.end[made.kind == Kind.RAPID]
    np.testing.assert_array_equal(rapid[:, [0, 2]], [[0, 55], [7, 200], [101, 55]])
    assert made.tool[-1] == 1


@pytest.mark.parametrize("change", [
    "T5 D1 M6", "T5 M6", "T5 D1\nM6", "M6 T5 D1", 'T="DRILL"\nM6', "T5\nM6\nT1",
])  # fmt: skip
def test_m6_puts_the_length_of_its_own_tool_in_force(change):
    tools = {1: Tool(length=50.0), 5: Tool(length=30.0)}
    setup = Setup(dialect="siemens", tools=tools, tool_names={"DRILL": 5})
    made = moves(f"T1 D1 M6\nG0 Z10\n{change}\nG0 Z10\nT1 M6 D0\nG0 Z10\nM30\n", setup)
    assert made.end[made.kind == Kind.RAPID, 2].tolist() == [60, 40, 10]


def test_cycle832_rounds_corners_within_its_tolerance():
    made = moves("G60\nG1 X1 F9\nCYCLE832(.02,1,1)\nX2\nG60\nX3\nM30\n")
    assert made.path_mode[:3].tolist() == [
        PathMode.EXACT_STOP, PathMode.CONTINUOUS, PathMode.EXACT_STOP
    ]  # fmt: skip
    assert made.tolerance[:3].tolist() == [0, 0.02, 0]


def test_dwell_counts_seconds_and_leaves_the_feed():
    made = moves("G1 X1 F9\nG4 F2.5\nX2\nM30\n")
    assert made.value[made.kind == Kind.DWELL].tolist() == [2.5]
    assert made.feed[made.kind == Kind.FEED].tolist() == [9, 9]


def test_compensation_goes_round_outer_corners():
    setup = Setup(dialect="siemens", tools={1: Tool(diameter=4.0)})
    made = moves('T="A"\nM6\nD1\nG0 X-10 Y-9\nG41 G1 X0 Y0 F9\nX20\nY-20\nG40 X0\nM30\n', setup)
    arcs = made.kind == Kind.ARC
    np.testing.assert_allclose(made.end[arcs, :2], [[22, 0]], atol=1e-12)


NUMBER = r"(-?\d*\.?\d+\.?|_\w+)"


def walked(path):
    """What lines with axis words say, by regular expressions alone: kind, position, feed, line."""
    where, motion, feed = dict.fromkeys("XYZABC", 0.0), 0, 0.0
    constants, rows, turning = {}, [], False
    for number, text in enumerate(path.read_text().splitlines(), 1):
        code = text.split(";")[0]
        for name, value in re.findall(rf"(_\w+)={NUMBER}", code):
            constants[name] = float(value)
        found = re.search(r"G0?([0-3])(?![\d.])", code)
        motion = int(found[1]) if found else motion
        found = re.search(r"\bF([\d.]+)", code)
        feed = float(found[1]) if found else feed
        if re.search(r"TRANS|AROT|CYCLE|MSG|DEF|T=|_\w+=", code.split("SUPA")[0]):
            turning = "MCALL CYCLE" in code or turning
            continue
        if "MCALL" in code:
            turning = False
        given = re.findall(rf"(?<![\w.])([XYZBC])=?{NUMBER}", code)
        for letter, value in given:
            where[letter] = constants.get(value) if value in constants else float(value)
        if given:
            rows.append((turning, motion, tuple(where.values()), feed, number))
    return rows


@needs_recordings
@pytest.mark.parametrize("path", long_in_proof(PROGRAMS), ids=short)
def test_recorded_program_moves_as_its_lines_say(path):
    made = interpret(read_program(path), SETUP)
    moving = np.isin(made.kind, (Kind.RAPID, Kind.FEED, Kind.ARC))
    goes = (made.start != made.end).any(axis=1)
    rows = walked(path)
    drilled = {number for hole, *_, number in rows if hole}
    plain = moving & ~np.isin(made.line, list(drilled))
    expected = [row[1:] for row in rows if not row[0]]
    kinds = {0: Kind.RAPID, 1: Kind.FEED, 2: Kind.ARC, 3: Kind.ARC}
    assert made.kind[plain].tolist() == [kinds[motion] for motion, *_ in expected]
    assert made.line[plain].tolist() == [number for *_, number in expected]
    np.testing.assert_array_equal(made.end[plain], [end for _, end, _, _ in expected])
    cutting = plain & (made.kind != Kind.RAPID)
    assert made.feed[cutting].tolist() == [feed for motion, _, feed, _ in expected if motion]
    holes = Counter(made.kind[moving & goes & ~plain].tolist())
    # the one hole is where the tool stands: down to SDIS, to the bottom, back
    assert holes == ({Kind.RAPID: 2, Kind.FEED: 1} if drilled else {})


@needs_recordings
@pytest.mark.parametrize("path", long_in_proof(PROGRAMS), ids=short)
def test_recorded_arcs_end_on_their_circles(path):
    """Of coordinates with three decimals, and at least the radius that a post would write."""
    made = interpret(read_program(path), SETUP)
    r_0, r_1 = made.radii(np.flatnonzero(made.kind == Kind.ARC))
    assert np.abs(r_0 - r_1).max() < 2.5e-3
    assert r_0.min() > 0


@needs_recordings
def test_recorded_work_planes_are_square_to_the_tool():
    """The kinematics that is assumed of the machine is the one that its post processor had."""
    path = next(path for path in PROGRAMS if "Achskreuz" in path.name)
    frame, table, planes = UNROTATED, (0.0, 0.0), 0
    for text in path.read_text().splitlines():
        if found := re.search(r"G0 B(-?[\d.]+) C(-?[\d.]+)", text):
            table = (float(found[1]), float(found[2]))
        if found := re.search(r"AROT ([XYZ])(-?[\d.]+)", text):
            frame = rotated(frame, *(float(found[2]) * (found[1] == axis) for axis in "XYZ"))
        if "TRANS" in text:
            assert tilt(frame, *table) < 1e-14
            frame, planes = UNROTATED, planes + 1
    assert planes == 21


def ends_of(text, **choices):
    """X Y Z after each row that moves."""
    made = moves(f"G71 G90 G94 F100\n{text}\nM30\n", Setup(dialect="siemens", **choices))
    return [end[:3].round(9).tolist() for end in made.end[made.kind != Kind.END]]


def test_what_a_line_means_follows_the_lines_that_ran_before_it():
    """The second time G91 is in force, and TRAORI asks where the table stands."""
    text = (
        "G0 B90 C0\nFOR I=1 TO 2\nG0 B90 C0\nTRAORI\nAROT Y90\nG1 X1\nTRAFOOF\nTRANS\nG91\nENDFOR"
    )
    with pytest.raises(GcodeError, match="where the table stands under TRAORI is not known"):
        ends_of(text)


def test_a_structure_without_its_end_is_refused():
    with pytest.raises(GcodeError, match="IF: it has no partner"):
        ends_of("IF R1==0\nG1 X1")
    with pytest.raises(GcodeError, match="blocks were executed"):
        ends_of("LOOP\nG1 X1\nENDLOOP", block_limit=500)


def test_turn_adds_full_circles_to_a_helix():
    made = moves("G0 X10\nG2 X0 Y10 Z-5 I-10 J0 TURN=2 F100\nM30\n")
    turned = np.degrees(made.angle[made.kind == Kind.ARC])
    np.testing.assert_allclose(turned, [-270 - 720], rtol=1e-12)


def test_spos_stops_the_spindle_where_it_says():
    assert moves("S100 M3\nSPOS=90\nLIMS=3000\nG0 X1\nM30\n").direction.tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize("text", ["GOTOF AA\nG1 X1", "AA: G1 X1\nGOTOF AA", "GOTOB AA\nAA: G1 X1"])
def test_a_jump_that_leads_nowhere_is_said(text):
    with pytest.raises(GcodeError, match=r"AA is no label or block number (above|below) this line"):
        ends_of(text)


SUBPROGRAMS = {
    "L10.SPF": "%_N_L10_SPF\n;$PATH=/_N_SPF_DIR\nG91 X1\nG90\nM17\n",
    "row.spf": "X10\nX20\nRET\n",
    "rough.mpf": "G0 X7\nM30\n",
    "cut.spf": "PROC CUT(REAL X, REAL YY=3) SAVE DISPLOF\nDEF REAL DEEP=2\nR9=R9+1\n"
    "TRANS X100\nG91 G1 X=X Y=YY\nZ=-DEEP\nRET\n",
    "inner.spf": "L10\nCUT(1)\n",
    "peek.spf": "X=MINE\nM17\n",
    "l10.txt": "G0 X99\nM17\n",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("programs")
    for name, text in SUBPROGRAMS.items():
        (made / name).write_text(text)
    return made


@pytest.mark.parametrize(("text", "ends"), [
    ("R1=10 R2=R1*2\nG1 X=R2 Y=R3", [[20, 0, 0]]),  # set one after the other
    ("N10G0X10Y-2.5\nN20G1X=R1+3Z.5F100", [[10, -2.5, 0], [3, -2.5, 0.5]]),
    ("G1 X10\nG3 X20 Y10 I=AC(10) J=AC(10)\nG3 X10 Y20 I-10 J0",
     [[10, 0, 0], [20, 10, 0], [10, 20, 0]]),
    ("FOR I=1 TO 2\nFOR J1=1 TO 2\nIF (I==1) AND NOT (J1==2)\nG1 X=I*10+J1\nELSE\n"
     "IF (J1>1) OR (I<>1)\nG1 Y=I*10+J1\nENDIF\nENDIF\nENDFOR\nENDFOR",
     [[11, 0, 0], [11, 12, 0], [11, 21, 0], [11, 22, 0]]),
    ("REPEAT\nR1=R1+1\nG1 X=R1 MOD 2 Y=R1\nUNTIL R1>=3\nFOR R2=5 TO 1\nG1 Z5\nENDFOR\n"
     "WHILE R1==3\nR1=0\nG91 G1 X1\nENDWHILE", [[1, 1, 0], [0, 2, 0], [1, 3, 0], [2, 3, 0]]),
    ("LOOP1: R1=R1+1\nG1 X=R1\nIF R1<3 GOTOB LOOP1\nIF R1==3 GOTOF N50\nG1 Y9\n"
     "N50 G1 Y1\nGOTO OUT1\nG1 Z9\n/ N60 OUT1: IF R1==3\nG1 Z1\nENDIF",
     [[1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0], [3, 1, 1]]),
    # GOTOB takes the nearest one above, GOTO the first below and then the first of all
    ("R1=R1+1\nAA: G1 X=R1\nR1=R1+1\nAA: G1 Y=R1\nR1=R1+1\nIF R1<5 GOTOB AA\nIF R1<8 GOTO AA",
     [[1, 0, 0], [1, 2, 0], [1, 3, 0], [1, 4, 0], [5, 4, 0], [5, 6, 0], [7, 6, 0], [7, 8, 0]]),
    ("L10\nX5", [[1, 0, 0], [5, 0, 0]]),
    ("L10 P3", [[1, 0, 0], [2, 0, 0], [3, 0, 0]]),
    ("R1=2\nL10 P=R1", [[1, 0, 0], [2, 0, 0]]),
    ("L10 P0\nX5", [[5, 0, 0]]),
    ("ROW", [[10, 0, 0], [20, 0, 0]]),
    ('CALL "L10"', [[1, 0, 0]]),
    ('EXTCALL("ROUGH")\nX8', [[7, 0, 0], [8, 0, 0]]),
    ('EXTCALL "CF_CARD:/JOB/ROUGH.MPF"', [[7, 0, 0]]),
    ("PCALL /_N_WKS_DIR/CUT(4) P2\nX1",
     [[4, 3, 0], [4, 3, -2], [8, 6, -2], [8, 6, -4], [1, 6, -4]]),
    ("EXTERN CUT(REAL, REAL)\nCUT(5, 6)\nX1", [[5, 6, 0], [5, 6, -2], [1, 6, -2]]),
    ("CUT(5,)\nX=R9", [[5, 3, 0], [5, 3, -2], [1, 3, -2]]),
    ("INNER", [[1, 0, 0], [2, 3, 0], [2, 3, -2]]),
    ("R1=5\nMCALL CUT(R1,0)\nR1=9\nX1\nX2\nMCALL\nX3",
     [[1, 0, 0], [6, 0, 0], [6, 0, -2], [2, 0, -2], [7, 0, -2], [7, 0, -4], [3, 0, -4]]),
    ("AA: X1\nX2\nREPEAT AA P=2\nX3", [[x, 0, 0] for x in (1, 2, 1, 2, 1, 2, 3)]),
    ("AA: X1\nBB: X2\nX3\nREPEAT AA BB\nREPEATB AA", [[x, 0, 0] for x in (1, 2, 3, 1, 2, 1)]),
    ("GOTOF CC\nAA: X1\nENDLABEL: X2\nX3\nCC: X4\nREPEAT AA", [[x, 0, 0] for x in (4, 1, 2)]),
    ("CALL BLOCK AA TO BB\nX9\nM30\nAA: X1\nBB: X2", [[1, 0, 0], [2, 0, 0], [9, 0, 0]]),
    ("AA: X1\nIF R1==1\nM17\nENDIF\nX2\nR1=1\nREPEAT AA\nX5", [[1, 0, 0], [2, 0, 0], [1, 0, 0]]),
    ("UP\nX3\nM30\n%_N_UP_SPF\nX4\nM17\n", [[4, 0, 0], [3, 0, 0]]),
])  # fmt: skip
def test_variables_structures_jumps_and_subprograms(text, ends, folder):
    """SAVE restores G90 and TRANS; variables are each program's own; M30 and RET return."""
    followed = [tuple(end) for end in ends_of(text, folders=(folder,))]
    without_rest = [one for n, one in enumerate(followed) if n == 0 or one != followed[n - 1]]
    assert without_rest == [tuple(end) for end in ends]


@pytest.mark.parametrize(("text", "said"), [
    ("L11", r"test.mpf:2:1: L11: the subprogram L11 is neither in this file nor"),
    ("NIX", r"NIX: this is no word that is known, and the subprogram NIX.*or rewrite the word"),
    ("L10 P1.5", r"P1.5 must be a whole number"),
    ("CUT(1,2,3)", r"cut.spf:1:6: CUT\(: takes 2 values"),
    ("DEF REAL MINE=5\nPEEK", r"peek.spf:1:.*MINE has no value.*no variables of its caller"),
    ("REPEAT QQ", r"QQ to ENDLABEL is not in the program"),
    ("AA: X1\nGOTOF CC\nBB: X2\nCC: X7\nREPEAT AA BB", r"CC leads out of the lines"),
    ("AA: L10\nAB: CALL BLOCK AA TO AB", r"levels deep"),
])  # fmt: skip
def test_calls_that_cannot_be_made_say_why(text, said, folder):
    with pytest.raises(GcodeError, match=said):
        ends_of(text, folders=(folder,))
