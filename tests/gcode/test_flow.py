"""Macro B: variables, IF, WHILE, GOTO, G65, M98."""

import pytest

from pipeline.gcode.moves import Kind
from pipeline.gcode.setup import Tool
from tests.gcode.following import follow, kinds, points, refusal


def xs(text: str, **choices) -> list[float]:
    """X of every moving row that moves."""
    return [point[0] for point in points(follow(text, **choices))]


def test_variables_and_arithmetic():
    assert xs("#1=3\n#2=#1*2+[4-1]/3\nG0 X#2\nX[#1+#2]\nX-#1") == [7, 10, -3]


def test_assignment_takes_effect_after_the_words():
    assert xs("#100=1\nG0 X#100 #100=5\nX#100") == [1, 5]


def test_a_vacant_variable_leaves_the_word_out():
    assert points(follow("G0 X1 Y1\nG0 X#5 Y2")) == [[1, 1, 0], [1, 2, 0]]


def test_if_goto_searches_forward_then_from_the_top():
    assert xs("#1=0\nN10 #1=#1+1\nG0 X#1\nIF [#1 LT 3] GOTO 10\nGOTO 20\nG0 X99\nN20 G0 X50") == [
        1, 2, 3, 50,
    ]  # fmt: skip


def test_if_then():
    assert xs("#1=5\nIF [#1 EQ 5] THEN #2=7\nIF [#1 EQ 6] THEN #2=8\nG0 X#2") == [7]


def test_while_loops_nest():
    text = (
        "#1=0\nWHILE [#1 LT 2] DO1\n#2=0\nWHILE [#2 LT 2] DO2\n#2=#2+1\nG0 X[10*#1+#2]\nEND2\n"
        "#1=#1+1\nEND1\nG0 X99"
    )
    assert xs(text) == [1, 2, 11, 12, 99]


def test_a_while_that_is_false_at_once_is_passed_over():
    assert xs("WHILE [1 EQ 2] DO1\nG0 X1\nEND1\nG0 X5") == [5]


def test_do_without_while_is_left_by_goto():
    assert xs("#1=0\nDO1\n#1=#1+1\nG0 X#1\nIF [#1 EQ 3] GOTO 9\nEND1\nN9 G0 X9") == [1, 2, 3, 9]


def test_m98_counts_in_l_or_before_the_last_four_digits():
    body = "\nM30\nO1000\nG91 G0 X1\nM99"
    for call in ("M98 P1000 L3", "M98 P31000", "M98 P00031000"):
        assert xs(call + body) == [1, 2, 3]
    assert xs("M98 P1000 L0" + body) == []


def test_m98_moves_before_it_calls():
    assert xs("G0 X5 M98 P1000\nM30\nO1000\nG0 X7\nM99") == [5, 7]


def test_m99_p_returns_to_a_block():
    assert xs("M98 P1000\nG0 X1\nN50 G0 X2\nM30\nO1000\nG0 X9\nM99 P50") == [9, 2]


def test_m99_ends_one_pass_of_an_endless_program():
    moves = follow("G0 X1\nM99")
    assert kinds(moves) == ["RAPID", "END"]


def test_subprograms_share_local_variables_and_macros_have_their_own():
    body = "\nG0 X#1\nM30\nO1000\n#1=7\nM99"
    assert xs("#1=3\nM98 P1000" + body) == [7]
    assert xs("#1=3\nG65 P1000" + body) == [3]


def test_g65_arguments():
    text = (
        "G65 P9010 A1 B2 C3 D7 E8 F9 H11 M13 Q17 R18 S19 T20 U21 V22 W23 X24 Y25 Z26\nM30\nO9010\n"
    )
    for number in (1, 2, 3, 7, 8, 9, 11, 13, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26):
        assert xs(f"{text}G0 X#{number}\nM99") == [number]


def test_g65_repeats_i_j_k():
    text = "G65 P9010 A1 I4 J5 K6 I7 K9 J11\nM30\nO9010\n"
    for number in (1, 4, 5, 6, 7, 9, 11):
        assert xs(f"{text}G0 X#{number}\nM99") == [number]


def test_g65_counts_and_starts_each_time_with_its_arguments():
    assert xs("G91\nG65 P9010 L3 A1\nM30\nO9010\nG0 X#1\n#1=5\nM99") == [1, 2, 3]


def test_g66_calls_after_each_move_until_g67():
    text = "G66 P9010 A2\nX1\nM8\nX5\nG67\nX9\nM30\nO9010\nG91 G0 Z#1\nG90\nM99"
    assert points(follow("G0 " + text.replace("G66", "\nG66", 1))) == [
        [1, 0, 0], [1, 0, 2], [5, 0, 2], [5, 0, 4], [9, 0, 4],
    ]  # fmt: skip


def test_subprograms_in_other_files(tmp_path):
    (tmp_path / "O1234.nc").write_text("%\nO1234\nG0 X4\nM99\n%\n")
    (tmp_path / "9010").write_text("G0 X#1\nM99\n")
    moves = follow("M98 P1234\nG65 P9010 A7\nG0 X1\nM30", folders=(tmp_path,))
    assert [point[0] for point in points(moves)] == [4, 7, 1]
    assert moves.files == ("P", "O1234.nc", "9010")
    assert [moves.files[file] for file in moves.file] == ["O1234.nc", "9010", "P", "P"]
    assert moves.line.tolist() == [3, 1, 3, 4]


def test_system_variables():
    offsets = {"G54": (10.0, 0, 0, 0, 0, 0), "G54.1 P2": (7.0, 0, 0, 0, 0, 0)}
    assert xs("G0 Y3\nX#5221\nX#5042", work_offsets=offsets) == [0, 20, 13]
    assert xs("G0 X2\nX#5021", work_offsets=offsets) == [12, 22]
    assert xs("G0 X#7021\nX#4003", work_offsets=offsets)[1] == 100
    assert xs("#5221=4\nG0 X1") == [5]
    assert xs("G0 X#11003", tools={3: Tool(length=12.0)}) == [12]
    assert xs("F250 S99 T5\nG0 X#4109\nX#4119\nX#4120") == [250, 99, 5]
    assert xs("G20\n#5221=1\nG0 X#5221") == [50.8]


def test_3000_is_an_alarm_and_3006_a_stop():
    assert "alarm 7" in refusal("#3000=7 (PART MISSING)")
    assert follow("#3006=1 (LOOK)").kind.tolist() == [Kind.STOP]


def test_block_skip_levels():
    text = "G0 X1\n/X2\n/3 X3"
    assert xs(text) == [1, 2, 3]
    assert xs(text, block_skip=(1,)) == [1, 3]
    assert xs(text, block_skip=(1, 3)) == [1]


def test_percent_ends_a_file():
    assert xs("%\nO1\nG0 X1\n%\nG0 X9") == [1]


@pytest.mark.parametrize(("text", "words"), [
    ("GOTO 7", "N7 is not in the program"),
    ("WHILE [1 EQ 1] DO1\nG0 X1", "do not match"),
    ("END1", "do not match"),
    ("M98 P77", "O0077 is neither in this file nor"),
    ("M98 P1\nM30\nO1\nG0 X1", "does not return"),
    ("O1\nG0 X1\nO2\nG0 X2", "runs into the next"),
    ("M98 P1\nM30\nO1\nM98 P1\nM99", "100 levels"),
    ("G65 A1", "which macro"),
    ("N1 GOTO 1", "more than 5001 blocks"),
    ("G0 X[1/0]", "1 / 0"),
    ("#1=SQRT[-1]", "SQRT of -1"),
    ("#9999=1", "#9999 cannot be written"),
    ("G0 X#3001", "only the machine knows"),
    ("M98", "needs P"),
])  # fmt: skip
def test_flow_that_leads_nowhere_is_said(text, words):
    said = refusal(text, block_limit=5000)
    assert words in said
    assert said.startswith("P:")


@pytest.mark.parametrize("head", ["", "O1\n"])
def test_m99_p_returns_to_a_block_of_the_caller(head: str) -> None:
    text = head + "G21G90\nM98P2\nG1X1.F100\nN50 G1X2.F100\nM30\nO2\nG1X9.F100\nM99P50\n"
    assert xs(text) == [9, 2]


def test_macro_arguments_are_taken_as_written_where_lengths_count_increments():
    text = "G65 P1000 A1 X2.\nM30\nO1000\nG0 X#24 Y#1\nM99"
    assert points(follow(text, decimal="increment")) == [[2, 1, 0]]


@pytest.mark.parametrize("dialect", ["fanuc", "linuxcnc"])
@pytest.mark.parametrize(
    "head", ["%\n\nO16\n", "(by hand)\n%\n(part)\n\nO16 (BRACKET)\n", "\nO1 (main)\n"]
)
def test_comments_and_blank_lines_may_stand_before_the_number(head, dialect):
    text = head + "G21 G90 G94 F100\nM98 P2\nG1 X2\nM30\nO2\nG1 X1\nM99\n"
    assert xs(text, dialect=dialect) == [1, 2]


def test_a_number_after_code_is_the_next_program():
    assert "runs into the next" in refusal("\nG0 X1\nO16\nG0 X2\nM30")


def test_m97_calls_lines_of_the_same_program():
    text = "G0 X1\nM97 P100 L2\nG0 X9\nM30\nN100 G91 G0 X1\nG90\nM99\n"
    assert xs(text) == [1, 2, 3, 9]
    assert "N7 to call is not in the program" in refusal("M97 P7\nM30")
