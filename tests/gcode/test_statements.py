"""Lines are understood as written or refused with their place; expressions have their values."""

import math
import random
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import strategies as st

from pipeline.gcode.dialects.expression_parser import Cursor, ExpressionParser
from pipeline.gcode.dialects.statement_parser import parse_statement
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.program import TokenKind, parse_program, read_program
from pipeline.gcode.statements import (
    Assignment,
    Binary,
    Call,
    Control,
    ExpressionError,
    Number,
    Parameter,
    Statement,
    Unary,
    WordItem,
    evaluate,
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


RS274 = shutil.which("rs274")
FIXED: dict[int | str, float] = {1: 2.0, 2: -0.5, 3: 4.0, 4: 1.0, 7: math.inf, "gap": 0.25}


class Store:
    """A dictionary; what is not in it is vacant."""

    def __init__(self, values: dict[int | str, float]) -> None:
        self.values = values

    def read(self, key: int | str) -> float | None:
        return self.values.get(key)

    def write(self, key: int | str, value: float | None) -> None:
        raise AssertionError("evaluating writes nothing")

    def exists(self, key: int | str) -> bool:
        return key in self.values


def value(text: str, dialect: str = "fanuc") -> float | None:
    cursor = Cursor(text, 1, "test")
    tree = ExpressionParser(cursor, dialect).expression()
    assert cursor.ended, f"{text} was read up to column {cursor.column}"
    return evaluate(tree, Store(FIXED))


@pytest.mark.parametrize(("text", "expected"), [
    ("1+2*3", 7), ("[1+2]*3", 9), ("2-3-4", -5), ("8/4/2", 1), ("-#1", -2), ("--3", 3),
    ("##1", -0.5), ("#[#1+1]", 4), ("#[#3]", 1), ("5MOD3", 2), ("-5MOD3", -2), ("5MOD-3", 2),
    ("FIX[2.7]", 2), ("FIX[-2.7]", -2), ("FUP[2.1]", 3), ("FUP[-2.1]", -3),
    ("ROUND[2.5]", 3), ("ROUND[-2.5]", -3), ("ROUND[2.4999]", 2), ("RND[0.5]", 1),
    ("SQRT[9]", 3), ("SQR[9]", 3), ("ABS[-3]", 3), ("POW[2,10]", 1024), ("BCD[12]", 18),
    ("BIN[18]", 12), ("12AND10", 8), ("12OR3", 15), ("12XOR10", 6), ("1 + 12 AND 10", 9),
    ("[1EQ1]AND[2GT1]", 1), ("[1EQ1]OR[2LT1]", 1), ("[1LE0]OR[2LT1]", 0), ("1NE1.00001", 1),
    ("EXP[0]", 1), ("LN[1]", 0), ("ATAN[1]/[-1]", 135), ("ATAN[-1]/[1]", 315),
    ("ATAN[-1]", -45), ("ATAN[1,-1]", 135), ("ATAN[-1,1]", 315), ("ASIN[-1]", 270),
    ("ACOS[-1]", 180),
    ("SIN[30]", 0.5), ("COS[60]", 0.5), ("TAN[45]", 1),
])  # fmt: skip
def test_macro_b(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, rel=1e-15)  # two roundings of a function


@pytest.mark.parametrize(("text", "expected"), [
    ("#9", None), ("#9*5", 0), ("#9+#9", 0), ("-#9", 0), ("#9EQ#8", 1), ("#9EQ0", 0),
    ("0EQ#9", 0), ("#9NE0", 1), ("#9NE#8", 0), ("#9GE0", 1), ("#9GT0", 0), ("#9LE0", 1),
    ("#9LT0", 0), ("#0", None), ("ABS[#9]", 0),
])  # fmt: skip
def test_vacant_is_not_zero(text: str, expected: float | None) -> None:
    """Fanuc B-64694EN, "Undefined variable": the tables of arithmetic and of comparisons."""
    assert value(text) == expected


@pytest.mark.parametrize(("text", "expected"), [
    ("-2**2", 4), ("2**3**2", 64), ("2*3**2", 18), ("fix[-2.8]", -3), ("fup[-2.8]", -2),
    ("5 mod -3", 2), ("-5 mod 3", 1), ("1 eq 1.00009", 1), ("1 ne 1.0002", 1),
    ("1 or 1 and 0", 0), ("2 eq 2 and 3 gt 1", 1), ("1 + 2 eq 3", 1), ("5 xor 3", 0),
    ("#<GAP>*4", 1), ("#< g a p >", 0.25), ("exists[#<gap>]", 1), ("EXISTS[#<none>]", 0),
    ("atan[-1]/[1]", -45), ("asin[-1]", -90),
])  # fmt: skip
def test_linuxcnc(text: str, expected: float) -> None:
    assert value(text, "linuxcnc") == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(("text", "told"), [
    ("1/0", "1 / 0 has no value"),
    ("1MOD0", "1 REM 0 has no value"),
    ("SQRT[-1]", "SQRT of -1 has no value"),
    ("LN[0]", "LN of 0 has no value"),
    ("ASIN[1.5]", "ASIN360 of 1.5 has no value"),
    ("EXP[1000]", "EXP of 1000 has no value"),
    ("POW[-8,1/3]", "has no value"),
    ("9" * 20 + "*" + "9" * 20, r"\* gives 1e\+40: keep numbers below 1e\+30"),
    ("#7", "the parameter gives inf"),
    ("#[1.5]", r"parameter #1\.5 does not exist"),
    ("#[-1]", "parameter #-1 does not exist"),
    ("#[#9]", "number of the parameter is vacant"),
    ("1.5OR2", r"1\.5 is not whole"),
    ("BIN[10]", "10 is no binary-coded decimal"),
])  # fmt: skip
def test_what_has_no_value_says_so(text: str, told: str) -> None:
    with pytest.raises(ExpressionError, match=told):
        value(text)


@pytest.mark.parametrize(("text", "column", "told"), [
    ("[1+2", 5, "] is expected"),
    ("1+", 3, "a number, # parameter, function or"),
    ("SIN 30", 5, r"SIN is followed by \["),
    ("#", 1, "# is followed by no number"),
    ("#<name", 2, "name in < > is missing or open"),
    ("[" * 200 + "1" + "]" * 200, 101, "nests or chains more than 100"),
    ("1" + "+1" * 200, 201, "nests or chains more than 100"),
    ("9" * 400, 1, "too large"),
])  # fmt: skip
def test_what_cannot_be_read_says_where(text: str, column: int, told: str) -> None:
    with pytest.raises(GcodeError, match=told) as caught:
        value(text)
    assert (caught.value.line, caught.value.column) == (1, column)


def written(rng: random.Random, depth: int, exact: bool = False) -> str:
    """An expression of LinuxCNC whose value is likely to exist.

    ``exact`` leaves out what LinuxCNC rounds otherwise (in long double), because a step function of
    it may jump, as the two-argument arctangent does where both are 0 but for rounding.
    """
    if depth == 0:
        return rng.choice(["1", "2.5", "-3", ".75", "10", "#1", "#2", "#<gap>", "0", "-#3"])
    case = rng.randrange(6)
    inside = exact or case in (1, 2, 4)
    a, b = written(rng, depth - 1, inside), written(rng, rng.randrange(depth), inside)
    match case:
        case 0:
            return f"[{a}]{rng.choice(['+', '-', '*', '/'] if inside else SMOOTH)}[{b}]"
        case 1:
            return f"{a}{rng.choice([*STEPS, '+', '-', '*'])}{b}"
        case 2:
            return f"{rng.choice(['fix', 'fup', 'round'])}[{a}]"
        case 3:
            return f"{rng.choice(['abs'] if inside else ['sin', 'cos', 'abs', 'sqrt'])}[{a}]"
        case 4 if not exact:
            return f"atan[{a}]/[{b}]"
        case _:
            return f"-[{a}]"


SMOOTH = ["+", "-", "*", "/", "**"]
STEPS = [f" {w} " for w in ("mod", "eq", "ne", "gt", "ge", "lt", "le", "and", "or", "xor")]


@pytest.mark.skipif(RS274 is None, reason="rs274 of LinuxCNC is not installed")
@pytest.mark.parametrize("many", [400, pytest.param(4000, marks=pytest.mark.proof)])
def test_values_are_those_of_linuxcnc(tmp_path: Path, many: int) -> None:
    rng = random.Random(7)
    texts: list[str] = []
    ours: list[float] = []
    while len(texts) < many:
        text = written(rng, rng.randrange(1, 5))
        try:
            found = value(text, "linuxcnc")
        except (ExpressionError, GcodeError):
            continue
        if found is not None and abs(found) < 1e6 and len(text) < 200:
            texts.append(text)
            ours.append(found)
    program = ["#1=2", "#2=-0.5", "#3=4", "#<gap>=0.25"]
    # values are printed in millionths: a print has six decimals, and writes 0 below 1e-4
    program += [line for text in texts for line in (f"#9=[[{text}]*1000000]", "(print,#9)")]
    (tmp_path / "expressions.ngc").write_text("\n".join([*program, "m2", ""]))
    (tmp_path / "tool.tbl").touch()  # without one it reads an example's
    done = subprocess.run(
        [str(RS274), "-t", "tool.tbl", "-g", "expressions.ngc"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    theirs = [float(line) for line in done.stdout.splitlines() if " N....." not in line]
    assert len(theirs) == len(ours), done.stderr
    for text, mine, other in zip(texts, ours, theirs, strict=True):
        assert 1e6 * mine == pytest.approx(other, rel=1e-9, abs=1e-3), text


NUMBER = st.integers(-50, 50).map(lambda n: f"{n / 8}")
TREE = st.recursive(
    NUMBER,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: "".join(t)),
        inner.map(lambda text: f"[{text}]"),
    ),
    max_leaves=12,
)


@fuzzed(TREE, st.sampled_from(["fanuc", "linuxcnc"]))
def test_sums_and_products_are_pythons(text: str, dialect: str) -> None:
    python = eval(text.replace("[", "(").replace("]", ")"))
    found = value(text, dialect)
    assert found is not None and math.isclose(found, python, rel_tol=0, abs_tol=0)
