"""Programs of other people, each as the control or a manual has it: the value, or the sentence."""

import pytest
from typer.testing import CliRunner

from pipeline.app.program_commands import app
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter, interpret
from pipeline.gcode.moves import INCH, Kind
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from tests.gcode.following import follow, kinds, points, refusal

TAPPING = "G20G90G17\nS200M3\nG0X0Y0Z1.\nG98G84Z-.292R.1Q.05F4.83\nX1.\nX2.\nX3.\nG80\nM30\n"


def interpreted(program, dialect="fanuc"):
    """`kerf interpret` of a file."""
    out = str(program.with_name("o.csv"))
    return CliRunner().invoke(app, ["interpret", str(program), "--dialect", dialect, "--out", out])


def feed_seconds(moves) -> float:
    """Time of the cuts as path over feed [s]."""
    cuts = (moves.kind == Kind.FEED) | (moves.kind == Kind.ARC)
    return float((moves.length[cuts] / moves.feed[cuts]).sum() * 60)


def test_peck_tapping_goes_back_to_r_and_reverses_at_each_peck():
    # depths 0.05 … 0.35 and 0.392 inch below R, down and up, four holes at 4.83 inch/min
    path = 4 * 2 * (0.05 * (1 + 2 + 3 + 4 + 5 + 6 + 7) + 0.392)
    moves = follow(TAPPING)
    assert feed_seconds(moves) == pytest.approx(path / 4.83 * 60)
    reversals = (moves.kind == Kind.SPINDLE) & (moves.code != 3)
    assert reversals.sum() == 4 * 8 * 2
    assert "G84 with Q is peck tapping" in moves.notices[0]


def test_peck_tapping_retracts_by_the_amount_of_the_control():
    moves = follow("G90 S200 M3 G0 Z10\nG99 G84 Z-3 R2 Q2 F200", tapping_retract=0.5)
    assert [z for _, _, z in points(moves)] == [10, 2, 0, 0.5, -2, -1.5, -3, 2]
    assert not moves.notices


def test_a_dwell_has_its_time_in_the_table(tmp_path):
    (tmp_path / "a.nc").write_text("G21\nG4 P2500\nM3 S120\nM30\n")
    out = tmp_path / "o.csv"
    assert interpreted(tmp_path / "a.nc").exit_code == 0
    head, dwell, *_ = (line.split(",") for line in out.read_text().splitlines())
    assert float(dwell[[name.strip('"') for name in head].index("dwell_s")]) == 2.5


def test_g70_of_a_siemens_leaves_the_feed_in_mm():
    moves = follow("G70 G90 G17\nG1 X1 F100\nG700 X2 F100\nG71 X3 F100\nM30", dialect="siemens")
    cuts = moves.kind == Kind.FEED
    assert moves.end[cuts, 0].tolist() == [INCH, 2 * INCH, 3]
    assert moves.feed[cuts].tolist() == [100, 100 * INCH, 100]


@pytest.mark.parametrize(
    ("blocks", "machine_x"),
    [
        ("G92 X20\nG0 X30", 30), ("G53 G0 X10", 5), ("G10 L2 P1 X10\nG0 X0", 5),
        ("G10 L20 P1 X10\nG0 X0", 20), ("G52 X10\nG0 X0", 5), ("G43.1 X4\nG0 X0", 2),
        ("F9 G81 X10 Y0 Z-1 R2", 5), ("G8 X50", 50), ("G91 G0 X10", 30),
    ],
)  # fmt: skip
def test_g7_makes_x_of_every_code_a_diameter(blocks, machine_x):
    # each as LinuxCNC's own interpreter
    moves = follow("G21 G90 G7\nG0 X50\n" + blocks + "\nM2", dialect="linuxcnc")
    assert moves.end[-1, 0] == pytest.approx(machine_x, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("G21 G90; G1 X10 F100; G1 X20;\nM30;", [10, 20]),
        ("G90 F9;\nG1 X10; (in) ; X12 ;\nX13; to the edge;\nM30; X99;", [10, 12, 13]),
        ("G90 F9\nG1 X10 ; X12\n", [10]),
        ("G90 F9;\n#1=4;#2=5; G1 X#1; X#2;\n", [4, 5]),
    ],
)
def test_a_semicolon_ends_a_block_where_lines_end_in_it(text, ends):
    program = parse_program(text.encode(), "P")
    for compiled in (True, False):
        moves = Interpreter(program, Setup(), compiled=compiled).moves()
        assert moves.end[moves.kind == Kind.FEED, 0].tolist() == ends


def test_a_jump_before_another_block_of_its_line_is_refused():
    assert "give each a line" in refusal("G90;\nM98 P9; G0 X1;\nM30;\nO9;\nM99;")


def test_a_block_behind_a_remark_sign_is_named(tmp_path):
    (tmp_path / "a.nc").write_text("G21 G90 F9\nG1 X10 ; G1 X20\nX5 ; to the edge\n")
    done = interpreted(tmp_path / "a.nc")
    assert "behind ; is a comment here and was left out (line 2)" in done.output


@pytest.mark.parametrize("word", ["Y--2", "X-+3", "Z+-#1"])
def test_two_signs_stop_a_fanuc(word):
    assert f"P:2:4: {word[:3]}: two signs" in refusal(f"G90 F9\nG1 {word}\nM30")
    with pytest.raises(GcodeError, match="two signs"):
        interpret(parse_program(f"G90 F9\nG1 {word}".encode(), "P"), Setup())


def test_two_signs_are_a_value_of_linuxcnc():
    assert points(follow("G90 F9\nG1 Y--2\nM2", dialect="linuxcnc")) == [[0, 2, 0]]


@pytest.mark.parametrize("control", "\x11\x12\x13\x14")
def test_codes_of_a_punch_are_read_over(control):
    moves = follow(f"{control}%\nO1\nG21 G90\nG1 X1{control}0 F100\nM30\n%\n{control}")
    assert points(moves) == [[10, 0, 0]]


def test_spindle_0_is_the_spindle_of_a_mill():
    moves = follow("G21\nM3 $0 S1000\nG1 X1 F100\nM2", dialect="linuxcnc")
    assert points(moves) == [[1, 0, 0]]
    assert moves.speed[1] == 1000
    assert "$1 must be a whole number from -1 to 0" in refusal("M3 $1 S9", dialect="linuxcnc")
    assert "nothing in this block takes" in refusal("G0 X1 $0", dialect="linuxcnc")


def test_a_message_of_texts_and_values_moves_nothing():
    text = 'DEF REAL POS1=1.5\nMSG("Y " << POS1)\nMSG("A"<<R1<<"B"<<(R2+1))\nG1 G90 X10 F100\nM30'
    assert points(follow(text, dialect="siemens")) == [[10, 0, 0]]


def test_atrans_adds_to_trans():
    text = "G90 F100\nTRANS X10 Y1\nATRANS X5\nATRANS X=R1+1 Z2\nG1 X0 Y0 Z0\nM30"
    assert points(follow(text, dialect="siemens")) == [[16, 1, 2]]
    assert "AROT turned" in refusal("TRANS X1\nAROT Z90\nATRANS X1\nM30", dialect="siemens")


def test_g28_alone_sends_all_axes_home():
    moves = follow("G21 G90\nG1 X10 Z5 F100\nG28\nM30", references={"G28": (1, 2, 3, 0, 0, 0)})
    assert moves.end[-1, :3].tolist() == [1, 2, 3]
    assert "as on a Haas (line 3)" in moves.notices[0]


@pytest.mark.parametrize("first", ["G71 P45 Q60 U0 W0 D.025 F.01", "G71 U2. R1."])
def test_a_turning_cycle_is_named_and_not_to_be_deleted(first):
    text = f"G20 G18 G99\nG0 X2. Z.1\n{first}\nN45 G0 X1.1\nN60 G1 Z-1.\nM30\n"
    with pytest.raises(GcodeError, match="this is a lathe's program") as refused:
        interpret(parse_program(text.encode(), "P"), Setup())
    assert refused.value.line <= 3
    assert "delete" not in str(refused.value)


def test_a_program_in_utf_16_is_named(tmp_path):
    (tmp_path / "a.nc").write_bytes("G21 G90\nG1 X10 F100\nM30\n".encode("utf-16"))
    done = interpreted(tmp_path / "a.nc")
    assert done.exit_code == 2
    assert "UTF-16" in done.output


@pytest.mark.parametrize("text", ["", "%\n%\n", "(nothing)\n", "\n; G1 X10\n"])
def test_a_program_without_a_block_is_refused(tmp_path, text):
    (tmp_path / "a.nc").write_text(text)
    done = interpreted(tmp_path / "a.nc")
    assert done.exit_code == 2
    assert "holds no block" in done.output


def test_the_unit_that_is_assumed_is_named(tmp_path):
    (tmp_path / "a.nc").write_text("G90 G17\nG0 X1.5 Y.25\nG1 X4.5 F25.\nM30\n")
    done = interpreted(tmp_path / "a.nc")
    assert "neither G20 nor G21 comes before the first move: millimetres are assumed" in done.output
    (tmp_path / "a.nc").write_text("G90 G20\nG0 X1.5\nM30\n")
    assert "are assumed" not in interpreted(tmp_path / "a.nc").output


def test_a_drilling_cycle_without_mcall_makes_one_hole_where_it_stands():
    head = "G90 G17 F100 S1000 M3\nG0 X0 Y0 Z20\n"
    moves = follow(head + "CYCLE81(10,0,2,-5)\nX9\nM30", dialect="siemens")
    assert [z for _, _, z in points(moves)] == [20, 2, -5, 10, 10]
    assert moves.length[moves.kind == Kind.FEED].sum() == 7
    assert kinds(moves)[-2] == "RAPID"
    moves = follow(head + "G91\nCYCLE82(10,0,2,-5,,1.5)\nM30", dialect="siemens")
    assert moves.value[moves.kind == Kind.DWELL].tolist() == [1.5]
    assert moves.end[-1, 2] == 10
    moves = follow(head + "CYCLE81(10,0,2,,7)\nM30", dialect="siemens")
    assert [z for _, _, z in points(moves)] == [20, 2, -7, 10]
    assert "under G17" in refusal(head + "G18\nCYCLE81(10,0,2,-5)", dialect="siemens")


def test_mcall_cycle82_dwells_at_each_hole():
    text = "G90 G17 F100 S1000 M3\nG0 Z10\nMCALL CYCLE82(10,0,2,-5,0,0.5)\nX1\nX2\nMCALL\nX3\nM30"
    moves = follow(text, dialect="siemens")
    assert moves.value[moves.kind == Kind.DWELL].tolist() == [0.5, 0.5]
    assert moves.length[moves.kind == Kind.FEED].tolist() == [7, 7]


@pytest.mark.parametrize("dialect", ["fanuc", "linuxcnc", "siemens"])
@pytest.mark.parametrize(
    ("code", "sign", "said"),
    [
        ("utf-8", "\u2212", "U+2212 (MINUS SIGN) stands for the minus sign -: type - instead"),
        ("utf-8", "\u2013", "U+2013 (EN DASH) stands for the minus sign -"),
        ("cp1252", "\u2013", "U+2013 (EN DASH) stands for the minus sign -"),
        ("utf-8", "\uff11", "U+FF11 (FULLWIDTH DIGIT ONE) stands for 1: type 1 instead"),
        ("utf-8", "\u00b5", "U+00B5 (MICRO SIGN) has no meaning in a program"),
    ],
)
def test_a_character_that_looks_like_another_is_named(dialect, code, sign, said):
    text = f"G90\nG1 X{sign}10 F100\n".encode(code)
    with pytest.raises(GcodeError) as refused:
        interpret(parse_program(text, "P"), Setup(dialect=dialect))
    assert said in str(refused.value)
    assert refused.value.line == 2


def test_a_cyrillic_letter_is_named():
    assert "(CYRILLIC CAPITAL LETTER HA) stands for X" in refusal("G90\nG1 \u042510 F9")


def test_no_remedy_takes_an_unknown_code_out_of_the_program():
    for text in ("G47 X1", "G1 X1 F9 Q5", "M98 P1"):
        assert "delete" not in refusal(text)
    assert "delete" not in refusal("M98 P1", dialect="siemens")
