"""Expressions of Macro B and LinuxCNC: text to tree.

The tree holds what the dialect means: ``FIX`` is towards zero (Fanuc) and ``FLOOR`` is LinuxCNC's
``FIX``; ``REM`` has the sign of the dividend (Fanuc) and ``MOD`` has none (LinuxCNC); ``&`` ``|``
``^`` work on bits (Fanuc) and ``AND`` ``OR`` ``XOR`` on truth; ``NEAR`` is LinuxCNC's ``EQ``.
"""

from pipeline.gcode.cursor import Cursor
from pipeline.gcode.statements import Binary, Call, Expression, Number, Parameter, Unary

DEEPEST = 100
"""Operators and brackets on the way from the whole of an expression to a number of it."""

_LINUXCNC = {
    "**": (6, "**"), "*": (5, "*"), "/": (5, "/"), "MOD": (5, "MOD"), "+": (4, "+"), "-": (4, "-"),
    "EQ": (3, "NEAR"), "NE": (3, "FAR"), "GT": (3, "GT"), "GE": (3, "GE"), "LT": (3, "LT"),
    "LE": (3, "LE"), "AND": (2, "AND"), "OR": (2, "OR"), "XOR": (2, "XOR"),
}  # fmt: skip
_FANUC = {
    "*": (5, "*"), "/": (5, "/"), "AND": (5, "&"), "MOD": (5, "REM"), "+": (4, "+"), "-": (4, "-"),
    "OR": (4, "|"), "XOR": (4, "^"), "EQ": (3, "EQ"), "NE": (3, "NE"), "GT": (3, "GT"),
    "GE": (3, "GE"), "LT": (3, "LT"), "LE": (3, "LE"),
}  # fmt: skip
OPERATORS = {"linuxcnc": _LINUXCNC, "fanuc": _FANUC}
"""Dialect -> operator as written -> (how tightly it binds, operator in the tree)."""

_COMMON = {name: name for name in ("ABS", "ACOS", "COS", "EXP", "LN", "SIN", "SQRT", "TAN")}
FUNCTIONS = {
    "linuxcnc": _COMMON
    | {"ASIN": "ASIN", "ATAN": "ATAN", "FIX": "FLOOR", "FUP": "CEIL", "ROUND": "ROUND"}
    | {"EXISTS": "EXISTS"},
    "fanuc": _COMMON
    | {"ASIN": "ASIN360", "ATAN": "ATAN360", "FIX": "FIX", "FUP": "FUP", "ROUND": "ROUND"}
    | {"BIN": "BIN", "BCD": "BCD", "SQR": "SQRT", "RND": "ROUND", "POW": "**"},
}
"""Dialect -> function as written -> function in the tree."""


class ExpressionParser:
    """Reads expressions of one dialect from a cursor."""

    def __init__(self, cursor: Cursor, dialect: str) -> None:
        self.cursor = cursor
        self.operators = OPERATORS[dialect]
        self.functions = FUNCTIONS[dialect]
        self.fanuc = dialect == "fanuc"

    def bracketed(self) -> Expression:
        """``[…]``."""
        cursor = self.cursor
        start = cursor.at
        if not cursor.take("["):
            raise cursor.error(start, "an expression in [ ] is expected here")
        inside = self.expression()
        if not cursor.take("]"):
            raise cursor.error(cursor.at, "an operator or ] is expected here")
        return inside

    def expression(self, binding: int = 0) -> Expression:
        """Values joined by operators that bind more tightly than ``binding``."""
        cursor = self.cursor
        start, count = cursor.at, 0
        self._deeper(start)
        left = self.value()
        while (operator := self._operator()) is not None:
            tightness, meaning = self.operators[operator]
            if tightness <= binding:
                break
            cursor.at += len(operator)
            left = Binary(meaning, left, self.expression(tightness))
            count += 1
            self._deeper(start)
        cursor.nesting -= count + 1
        return left

    def value(self) -> Expression:
        """A number, parameter, function or bracket, with its signs."""
        cursor = self.cursor
        start = cursor.at
        signs = 0
        while cursor.peek() in ("+", "-"):
            signs += cursor.peek() == "-"
            cursor.at += 1
        bare = self._unsigned(start)
        if signs % 2 == 0:
            return bare
        return Number(-bare.value) if isinstance(bare, Number) else Unary("-", bare)

    def parameter(self) -> Parameter:
        """``#5``, ``#<name>``, ``##5``, ``#[…]``; the first ``#`` comes next."""
        cursor = self.cursor
        start = cursor.at
        self._deeper(start)
        cursor.take("#")
        key: Expression | str
        if cursor.take("<"):
            key = cursor.name()
        elif cursor.peek() == "#":
            key = self.parameter()
        elif cursor.peek() == "[":
            key = self.bracketed()
        elif (number := cursor.number()) is not None:
            key = Number(number)
        else:
            raise cursor.error(start, "# is followed by no number, name or [expression]: add it")
        cursor.nesting -= 1
        return Parameter(key)

    def _unsigned(self, start: int) -> Expression:
        cursor = self.cursor
        following = cursor.peek()
        if following == "#":
            return self.parameter()
        if following == "[":
            return self.bracketed()
        if (number := cursor.number()) is not None:
            return Number(number)
        name = cursor.letters()
        if name in self.functions:
            return self._call(name)
        cursor.at = max(cursor.at, min(start + 1, len(cursor.code)))
        raise cursor.error(
            start, "a number, # parameter, function or [expression] is expected here"
        )

    def _call(self, name: str) -> Expression:
        cursor = self.cursor
        start = cursor.at
        cursor.at += len(name)
        arguments = [self._argument(name)]
        if self.fanuc and name in ("ATAN", "POW") and cursor.take(","):
            arguments.append(self.expression())
        if not cursor.take("]"):
            raise cursor.error(cursor.at, "an operator or ] is expected here")
        if name == "ATAN" and len(arguments) == 1 and cursor.peek(2) == "/[":
            cursor.at += 1
            arguments.append(self.bracketed())
        meaning = self.functions[name]
        if name == "ATAN" and len(arguments) == 1:
            if not self.fanuc:
                raise cursor.error(start, "ATAN takes two arguments: write ATAN[y]/[x]")
            meaning = "ATAN"
        if name == "POW":
            if len(arguments) == 1:
                raise cursor.error(start, "POW takes two arguments: write POW[base,exponent]")
            return Binary("**", *arguments)
        if name == "EXISTS" and not _names_a_parameter(arguments[0]):
            raise cursor.error(start, "EXISTS asks for a named parameter: write EXISTS[#<name>]")
        return Call(meaning, tuple(arguments))

    def _argument(self, name: str) -> Expression:
        if not self.cursor.take("["):
            raise self.cursor.error(self.cursor.at, f"{name} is followed by [: add its argument")
        return self.expression()

    def _operator(self) -> str | None:
        text = self.cursor.peek(3)
        for length in (3, 2, 1):
            if text[:length] in self.operators:
                return text[:length]
        return None

    def _deeper(self, start: int) -> None:
        self.cursor.nesting += 1
        if self.cursor.nesting > DEEPEST:
            raise self.cursor.error(
                start,
                f"the expression nests or chains more than {DEEPEST} values: split it into several",
            )


def _names_a_parameter(expression: Expression) -> bool:
    return isinstance(expression, Parameter) and isinstance(expression.key, str)
