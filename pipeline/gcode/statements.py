"""Statements of a program: the parsed tree of a line, and the values of its expressions."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


class ExpressionError(ArithmeticError):
    """An expression without a value; the caller adds the place and raises a GcodeError."""


LARGEST = 1e30
"""Numbers beyond are refused: no machine has them, and products of a few would overflow."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number as written."""

    value: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """``#5``, ``#[1+2]``, ``##3`` or ``#<name>``."""

    key: "Expression | str"


@dataclass(frozen=True, slots=True)
class Unary:
    """``-x`` or ``+x``."""

    operator: str
    operand: "Expression"


@dataclass(frozen=True, slots=True)
class Binary:
    """Two values joined by an operator, named by what it does, whatever the dialect writes.

    ``+ - * / ** GT GE LT LE``; ``MOD`` (never negative, LinuxCNC) and ``REM`` (sign of the left
    side, Fanuc's MOD); ``EQ NE`` (vacant is no 0), ``NEAR FAR`` (EQ and NE of
    LinuxCNC) and ``ALIKE UNLIKE ABOVE BELOW`` (relative equality, Sinumerik);
    ``AND OR XOR`` of truth (LinuxCNC) and ``& | ^`` of bits (Fanuc).
    """

    operator: str
    left: "Expression"
    right: "Expression"


@dataclass(frozen=True, slots=True)
class Call:
    """``SIN[x]``, ``ATAN[y]/[x]``, ``EXISTS[#<name>]``; functions too are named by what they do.

    ``FIX FUP`` (towards and from zero, Fanuc) and ``FLOOR CEIL`` (LinuxCNC's FIX and FUP);
    ``ASIN360 ATAN360`` have values from 0 to 360 degrees.
    """

    function: str
    arguments: tuple["Expression", ...]


Expression = Number | Parameter | Unary | Binary | Call


@dataclass(frozen=True, slots=True)
class WordItem:
    """Letter and value at ``column`` (from 1); ``absolute`` None: as G90 and G91 say."""

    letter: str
    value: Expression
    column: int
    text: str
    absolute: bool | None = None


@dataclass(frozen=True, slots=True)
class Assignment:
    """``#5 = …`` or ``#<name> = …``; takes effect after the line's words were evaluated."""

    target: Parameter
    value: Expression
    column: int


@dataclass(frozen=True, slots=True)
class Control:
    """Flow control of a line."""

    kind: str
    """Kind: ``goto``, ``if_goto``, ``if_then``, ``while_do``, ``do``, ``end`` (Macro B) or, of
    O-words, ``sub``, ``endsub``, ``call``, ``return``, ``if``, ``elseif``, ``else``, ``endif``,
    ``while``, ``endwhile``, ``repeat``, ``endrepeat``, ``break``, ``continue``, ``program``
    (``O1000`` that names a program)."""
    label: "Expression | str | None"
    """Name or number of an O-word as text (``"100"`` for ``O0100``), an expression where it is
    computed; loop number of DO and END; target of GOTO."""
    column: int
    condition: Expression | None = None
    """Condition of ``if``, ``while``; count of ``repeat``; value of ``return`` or ``endsub``."""
    arguments: tuple[Expression, ...] = ()
    then: tuple[Assignment, ...] = ()
    """Assignments of ``if_then``."""
    part: tuple[str, str] = ("", "")
    """Labels of the first and last line that a Sinumerik's REPEAT or CALL BLOCK carries out."""


@dataclass(frozen=True, slots=True)
class Statement:
    """Parsed line: number in the file, N word, words and control in their order.

    ``rest`` holds further blocks of the line, which are carried out after it.
    """

    line: int
    skip: int | None
    number: float | None
    words: tuple[WordItem, ...]
    assignments: tuple[Assignment, ...]
    control: Control | None
    comments: tuple[str, ...]
    rest: tuple["Statement", ...] = ()


ALIKE = 1e-12
"""Relative difference of two values that a Sinumerik takes for equal [1]."""
NEAR = 1e-4
"""Numbers that differ by less are equal to LinuxCNC (TOLERANCE_EQUAL of its interpreter)."""


class ParameterStore(Protocol):
    """Store of ``#`` variables, by number (int) or by name (str)."""

    def read(self, key: int | str) -> float | None:
        """Value, None where it is vacant."""

    def write(self, key: int | str, value: float | None) -> None:
        """Keep a value; None makes it vacant."""

    def exists(self, key: int | str) -> bool:
        """Whether the parameter was ever given a value."""


def constant(value: Expression) -> float | None:
    """Value of a number with its signs, None of anything else."""
    if isinstance(value, Number):
        return value.value
    if isinstance(value, Unary):
        inner = constant(value.operand)
        return None if inner is None else -inner if value.operator == "-" else inner
    return None


def evaluate(expression: Expression, parameters: ParameterStore) -> float | None:
    """Value of an expression; None where it is Fanuc's <vacant>.

    A vacant variable alone is vacant; in arithmetic it counts 0; it equals (EQ) nothing but another
    vacant one.  Raises ExpressionError for a division by zero, a root of a negative number and
    such.
    """
    if isinstance(expression, Number):
        return expression.value
    if isinstance(expression, Parameter):
        kept = parameters.read(parameter_key(expression, parameters))
        return None if kept is None else _bounded(kept, "the parameter")
    if isinstance(expression, Unary):
        operand = evaluate(expression.operand, parameters)
        return -_filled(operand) if expression.operator == "-" else operand
    if isinstance(expression, Binary):
        left = evaluate(expression.left, parameters)
        right = evaluate(expression.right, parameters)
        return _bounded(_binary(expression.operator, left, right), expression.operator)
    return _bounded(_call(expression, parameters), expression.function)


def parameter_key(parameter: Parameter, parameters: ParameterStore) -> int | str:
    """Number or name that ``#…`` stands for.

    Raises ExpressionError if the number is vacant, negative or not whole.
    """
    if isinstance(parameter.key, str):
        return parameter.key
    number = evaluate(parameter.key, parameters)
    if number is None:
        raise ExpressionError("the number of the parameter is vacant: give it a value first")
    if abs(number - round(number)) >= NEAR or round(number) < 0:
        raise ExpressionError(
            f"parameter #{number:g} does not exist: its number must be whole and not negative"
        )
    return round(number)


def _binary(operator: str, left: float | None, right: float | None) -> float:
    if operator in ("EQ", "NE"):
        return float((left == right) == (operator == "EQ"))
    a, b = _filled(left), _filled(right)
    if operator in _BITS:
        return float(_BITS[operator](_whole(a, operator), _whole(b, operator)))
    if operator in ("/", "MOD", "REM") and b == 0:
        raise ExpressionError(f"{a:g} {operator} 0 has no value: check the divisor first")
    try:
        return _ARITHMETIC[operator](a, b)
    except (ValueError, OverflowError, ZeroDivisionError):
        raise ExpressionError(
            f"{a:g} {operator} {b:g} has no value: check the numbers before"
        ) from None


def _filled(value: float | None) -> float:
    """Vacant counts 0; ``or`` would take the sign from -0."""
    return 0.0 if value is None else value


def _modulo(a: float, b: float) -> float:
    rest = math.fmod(a, b)
    return rest + abs(b) if rest < 0 else rest


def _alike(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=ALIKE)


_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "**": math.pow,
    "MOD": _modulo,
    "REM": math.fmod,
    "NEAR": lambda a, b: float(abs(a - b) < NEAR),
    "FAR": lambda a, b: float(abs(a - b) >= NEAR),
    "ALIKE": lambda a, b: float(_alike(a, b)),
    "UNLIKE": lambda a, b: float(not _alike(a, b)),
    "ABOVE": lambda a, b: float(a > b and not _alike(a, b)),
    "BELOW": lambda a, b: float(a < b and not _alike(a, b)),
    "GT": lambda a, b: float(a > b),
    "GE": lambda a, b: float(a >= b),
    "LT": lambda a, b: float(a < b),
    "LE": lambda a, b: float(a <= b),
    "AND": lambda a, b: float(a != 0 and b != 0),
    "OR": lambda a, b: float(a != 0 or b != 0),
    "XOR": lambda a, b: float((a != 0) != (b != 0)),
}
_BITS: dict[str, Callable[[int, int], int]] = {
    "&": lambda a, b: a & b,
    "|": lambda a, b: a | b,
    "^": lambda a, b: a ^ b,
}


def _call(call: Call, parameters: ParameterStore) -> float:
    if call.function == "EXISTS":
        parameter = call.arguments[0]
        named = isinstance(parameter, Parameter) and isinstance(parameter.key, str)
        # every numbered parameter of LinuxCNC exists
        return float(not named or parameters.exists(parameter.key))  # type: ignore[union-attr,arg-type]
    values = [_filled(evaluate(argument, parameters)) for argument in call.arguments]
    try:
        return _FUNCTIONS[call.function, len(values)](*values)
    except (ValueError, OverflowError):
        shown = ", ".join(f"{value:g}" for value in values)
        raise ExpressionError(
            f"{call.function} of {shown} has no value: check the number before"
        ) from None


def _radians(a: float) -> float:
    """Radians as LinuxCNC rounds them, which ``math.radians`` does not always."""
    return a * math.pi / 180


def _degrees(a: float) -> float:
    return a * 180 / math.pi


def _round(a: float) -> float:
    """Halves go away from zero; there is no -0."""
    return math.copysign(math.floor(abs(a) + 0.5), a) + 0.0


def _whole(a: float, operator: str) -> int:
    if abs(a - round(a)) >= NEAR:
        raise ExpressionError(f"{a:g} is not whole: {operator} works on whole numbers, use ROUND")
    return round(a)


def _from_bcd(a: float) -> float:
    digits = f"{_whole(a, 'BIN'):x}"
    try:
        return float(int(digits))
    except ValueError:
        raise ExpressionError(f"{a:g} is no binary-coded decimal: BIN takes one") from None


_FUNCTIONS: dict[tuple[str, int], Callable[..., float]] = {
    ("ABS", 1): abs,
    ("SIN", 1): lambda a: math.sin(_radians(a)),
    ("COS", 1): lambda a: math.cos(_radians(a)),
    ("TAN", 1): lambda a: math.tan(_radians(a)),
    ("ASIN", 1): lambda a: _degrees(math.asin(a)),
    ("ASIN360", 1): lambda a: _degrees(math.asin(a)) % 360,
    ("ACOS", 1): lambda a: _degrees(math.acos(a)),
    ("ATAN", 1): lambda a: _degrees(math.atan(a)),
    ("ATAN", 2): lambda a, b: _degrees(math.atan2(a, b)),
    ("ATAN360", 2): lambda a, b: _degrees(math.atan2(a, b)) % 360,
    ("SQRT", 1): math.sqrt,
    ("EXP", 1): math.exp,
    ("LN", 1): math.log,
    ("ROUND", 1): _round,
    ("FIX", 1): lambda a: float(math.trunc(a)),
    ("FUP", 1): lambda a: math.copysign(math.ceil(abs(a)), a),
    ("FLOOR", 1): lambda a: math.copysign(math.floor(a), a),
    ("CEIL", 1): lambda a: math.copysign(math.ceil(a), a),
    ("BIN", 1): _from_bcd,
    ("BCD", 1): lambda a: float(int(str(_whole(a, "BCD")), 16)),
}


def _bounded(value: float, what: str) -> float:
    if not abs(value) <= LARGEST:
        raise ExpressionError(f"{what} gives {value:g}: keep numbers below {LARGEST:g}")
    return value
