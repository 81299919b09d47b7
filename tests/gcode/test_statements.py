"""A line is understood as written, or refused with one sentence that names the place."""

from pathlib import Path

import pytest
from hypothesis import strategies as st

from pipeline.gcode.dialects.statement_parser import parse_statement
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.program import TokenKind, parse_program, read_program
from pipeline.gcode.statements import (
    Assignment,
    Binary,
    Call,
    Control,
    Number,
    Parameter,
    Statement,
    Unary,
    WordItem,
)
from tests.gcode.following import BYTES, PROGRAM, RECORDINGS, fuzzed, recorded, short

LINUXCNC = recorded("gcode/linuxcnc/**/*.ngc")
FANUC = recorded("gcode/nist_d2mi/*.NC", "nist_box/programs/*.NC")
REFUSED = {"nestedcall.ngc": ["nestedcall.ngc:11:15: s: nothing may follow here"]}
"""Recorded lines that LinuxCNC refuses too (``O<g20sub> callsub``)."""


def parse(text: str, dialect: str = "fanuc") -> Statement:
    return parse_statement(parse_program(text.encode(), "p.nc").line(1), "p.nc", dialect)


def one(value: float) -> Number:
    return Number(value)


def test_words_with_numbers_and_expressions() -> None:
    statement = parse("/2 N10 G01 x-1.5 (in) F[#1*2] Y-#2 ; out\r\n")
    assert statement == Statement(
        line=1,
        skip=2,
        number=10.0,
        words=(
            WordItem("G", one(1.0), 8, "G01"),
            WordItem("X", one(-1.5), 12, "x-1.5"),
            WordItem("F", Binary("*", Parameter(one(1.0)), one(2.0)), 23, "F[#1*2]"),
            WordItem("Y", Unary("-", Parameter(one(2.0))), 31, "Y-#2"),
        ),
        assignments=(),
        control=None,
        comments=("in", " out"),
    )


def test_blanks_do_not_count() -> None:
    assert parse("g 0 x +0. 12 34 y\t7").words == (
        WordItem("G", one(0.0), 1, "g 0"),
        WordItem("X", one(0.1234), 5, "x +0. 12 34"),
        WordItem("Y", one(7.0), 17, "y\t7"),
    )


def test_a_comment_ends_a_number() -> None:
    with pytest.raises(GcodeError, match=r"p.nc:1:11: 0: this character has no meaning here"):
        parse("G1 (slow) 0")


@pytest.mark.parametrize(("text", "control"), [
    ("o0100 SUB", Control("sub", "100", 1)),
    ("n1 o<My Sub> sub ; x", Control("sub", "mysub", 4)),
    ("o100 endsub [1]", Control("endsub", "100", 1, one(1.0))),
    ("o100 return", Control("return", "100", 1)),
    ("o100 call [1] [#2]", Control("call", "100", 1, None, (one(1.0), Parameter(one(2.0))))),
    ("o#1 call", Control("call", Parameter(one(1.0)), 1)),
    ("o[1+2] call", Control("call", Binary("+", one(1.0), one(2.0)), 1)),
    ("o1 if [#1]", Control("if", "1", 1, Parameter(one(1.0)))),
    ("o1 elseif [#1]", Control("elseif", "1", 1, Parameter(one(1.0)))),
    ("o1 else", Control("else", "1", 1)),
    ("o1 endif", Control("endif", "1", 1)),
    ("o1 while [#1]", Control("while", "1", 1, Parameter(one(1.0)))),
    ("o1 endwhile", Control("endwhile", "1", 1)),
    ("o1 do", Control("do", "1", 1)),
    ("o1 repeat [3]", Control("repeat", "1", 1, one(3.0))),
    ("o1 endrepeat", Control("endrepeat", "1", 1)),
    ("o1 break", Control("break", "1", 1)),
    ("o1 continue", Control("continue", "1", 1)),
    ("o1000", Control("program", "1000", 1)),
])  # fmt: skip
def test_control_of_linuxcnc(text: str, control: Control) -> None:
    assert parse(text, "linuxcnc").control == control


def test_assignments_and_the_number_of_a_program() -> None:
    assert parse(":12").control == parse("O0012(NAME)").control == Control("program", "12", 1)
    assert parse("#1=#2+1").assignments == (
        Assignment(Parameter(one(1.0)), Binary("+", Parameter(one(2.0)), one(1.0)), 1),
    )
    statement = parse("#<a>=[1] #[2]=sin[3] X#1", "linuxcnc")
    assert statement.assignments == (
        Assignment(Parameter("a"), one(1.0), 1),
        Assignment(Parameter(one(2.0)), Call("SIN", (one(3.0),)), 10),
    )
    assert statement.words == (WordItem("X", Parameter(one(1.0)), 22, "X#1"),)


@pytest.mark.parametrize(("dialect", "text", "told"), [
    ("fanuc", "G1 X", "p.nc:1:4: X: X is followed by no value: add a number"),
    ("fanuc", "G1 X.", "1:5: .: a number, # parameter, function or"),
    ("fanuc", "G1 X1.2.3", "1:8: .: this character has no meaning here"),
    ("fanuc", "G1 é", "1:4: \xc3: U+00E9 (LATIN SMALL LETTER E WITH ACUTE)"),
    ("fanuc", "G1 (open", "1:4: (: the comment is not closed: add )"),
    ("fanuc", "G1 /2", "1:4: /: block skip stands only at the head of a line"),
    ("fanuc", "G1 %", "1:4: %: % stands only on a line of its own"),
    ("fanuc", "DEF REAL _A", "1:1: DEF REAL: this is no word of the dialect"),
    ("fanuc", "N G1", "1:1: N: N is followed by no number"),
    ("fanuc", "IF #1 GOTO 2", "1:4: #: an expression in [ ] is expected here"),
    ("fanuc", "IF [#1] G0", "1:9: G: after IF [ ] only GOTO n or THEN"),
    ("fanuc", "IF [#1] THEN G0", "1:9: THEN: after IF [ ] only GOTO n or THEN"),
    ("fanuc", "WHILE [#1]", "1:11: end of line: DO is expected after WHILE [ ]"),
    ("fanuc", "DO4", "1:3: 4: DO and END are followed by 1, 2 or 3"),
    ("fanuc", "GOTO 1 G0", "1:8: G: nothing may follow here"),
    ("fanuc", "#1 5", "1:1: #1 5: = is expected after the parameter"),
    ("fanuc", "X[ROUND[#1]]", "1:1: X[ROUND[#1]]: ROUND in a word rounds to the control's"),
    ("fanuc", "O<", "1:2: <: a name in < > is missing or open"),
    ("linuxcnc", "IF [#1] GOTO 2", "1:1: IF: LinuxCNC has no such word"),
    ("linuxcnc", "o1 jump", "1:4: jump: no O-word of LinuxCNC"),
    ("linuxcnc", "#1=2+3", "1:5: +: this character has no meaning here"),
    ("linuxcnc", "G1 (a(b)", "1:4: (a(b): a comment holds another ("),
    ("linuxcnc", "X1,R2", "1:3: ,: this character has no meaning here"),
])  # fmt: skip
def test_what_cannot_be_understood(dialect: str, text: str, told: str) -> None:
    with pytest.raises(GcodeError) as caught:
        parse(text, dialect)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(RECORDINGS is None, reason="KERF_RECORDINGS names no folder")
@pytest.mark.proof
@pytest.mark.parametrize("path", LINUXCNC + FANUC, ids=short)
def test_recorded_programs_are_understood(path: Path) -> None:
    program = read_program(path)
    told = []
    for number in program.body:
        try:
            parse_statement(
                program.line(number), path.name, "linuxcnc" if path in LINUXCNC else "fanuc"
            )
        except GcodeError as error:
            told.append(str(error))
    expected = REFUSED.get(path.name, [])
    assert len(told) == len(expected)
    assert all(t.startswith(e) for t, e in zip(told, expected, strict=True))


@fuzzed(st.one_of(BYTES, PROGRAM), st.sampled_from(["fanuc", "linuxcnc"]))
def test_any_line_is_understood_or_refused(data: bytes, dialect: str) -> None:
    """Words that the tree shows and those of the statement are the same, but for macro text."""
    for line in parse_program(data, "p.nc").lines:
        if any(piece.kind == TokenKind.PERCENT for piece in line.pieces):
            continue
        try:
            statement = parse_statement(line, "p.nc", dialect)
        except GcodeError as error:
            assert error.line == line.number
            assert 1 <= error.column <= len(line.text) + 1
            assert str(error).startswith(f"p.nc:{line.number}:{error.column}: ")
            continue
        shown = {word.column: word for word in line.words}
        for item in statement.words:
            if item.column in shown:
                word = shown[item.column]
                assert (word.letter, word.text.decode("latin-1")) == (item.letter, item.text)
                if word.value is not None:
                    assert item.value == Number(word.value)
        if not statement.assignments and statement.control is None:
            columns = {item.column for item in statement.words}
            assert {w.column for w in line.words if w.letter != "N"} <= columns


def test_a_line_of_many_bytes_is_read_in_time() -> None:
    statement = parse("G1" + "X1" * 5_000)
    assert len(statement.words) == 5_001
