"""Expressions have the value that the dialect's manual, Python or LinuxCNC's interpreter gives."""

import math
import random
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import strategies as st

from pipeline.gcode.dialects.expression_parser import Cursor, ExpressionParser
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.statements import ExpressionError, evaluate
from tests.gcode.following import fuzzed

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
    it may jump.
    """
    if depth == 0:
        return rng.choice(["1", "2.5", "-3", ".75", "10", "#1", "#2", "#<gap>", "0", "-#3"])
    case = rng.randrange(6)
    exact = exact or case in (1, 2)
    a, b = written(rng, depth - 1, exact), written(rng, rng.randrange(depth), exact)
    match case:
        case 0:
            return f"[{a}]{rng.choice(['+', '-', '*', '/'] if exact else SMOOTH)}[{b}]"
        case 1:
            return f"{a}{rng.choice([*STEPS, '+', '-', '*'])}{b}"
        case 2:
            return f"{rng.choice(['fix', 'fup', 'round'])}[{a}]"
        case 3:
            return f"{rng.choice(['abs'] if exact else ['sin', 'cos', 'abs', 'sqrt'])}[{a}]"
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
    program += [line for text in texts for line in (f"#9=[{text}]", "(print,#9)")]
    (tmp_path / "expressions.ngc").write_text("\n".join([*program, "m2", ""]))
    (tmp_path / "tool.tbl").touch()  # without one it reads an example's
    done = subprocess.run(
        [str(RS274), "-t", "tool.tbl", "-g", "expressions.ngc"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    theirs = [float(line) for line in done.stdout.splitlines() if " N....." not in line]
    assert len(theirs) == len(ours), done.stderr
    for text, mine, other in zip(texts, ours, theirs, strict=True):
        assert mine == pytest.approx(other, abs=1e-6), text  # printed with six decimals


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
