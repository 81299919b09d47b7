"""Expressions of Macro B and LinuxCNC: text to tree.

The tree holds what the dialect means: ``FIX`` is towards zero (Fanuc) and ``FLOOR`` is LinuxCNC's
``FIX``; ``REM`` has the sign of the dividend (Fanuc) and ``MOD`` has none (LinuxCNC); ``&`` ``|``
``^`` work on bits (Fanuc) and ``AND`` ``OR`` ``XOR`` on truth; ``NEAR`` is LinuxCNC's ``EQ``.
"""

import re

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.statements import LARGEST, Binary, Call, Expression, Number, Parameter, Unary

COMMENT = "\x01"
"""Stands for a comment in a cursor's text, so that ``G1 (slow) 0`` does not become ``G10``."""

_PIECE = re.compile(
    r"\(([^)]*)\)|;(.*)|[\x00\t\v\f\x11-\x14\x1a \x7f\r\n]+"
    r"|([^(;\x00\t\v\f\x11-\x14\x1a \x7f\r\n]+|\()",
    re.S,
)
_NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
_LETTERS = re.compile(r"[A-Z]+")


class Cursor:
    """The code of a line, upper case and without blanks, and where each character stood."""

    __slots__ = ("at", "code", "columns", "comments", "file", "line", "nesting", "source")

    def __init__(self, text: str, line: int, file: str, start: int = 0) -> None:
        self.source, self.line, self.file = text, line, file
        self.at = self.nesting = 0
        self.comments: list[str] = []
        self.columns: list[int] = []
        code: list[str] = []
        for piece in _PIECE.finditer(text, start):
            inner, rest, letters = piece.groups()
            if letters is not None:
                code.append(letters)
                self.columns.extend(range(piece.start() + 1, piece.end() + 1))
            elif inner is not None or rest is not None:
                self.comments.append(inner if inner is not None else rest)
                code.append(COMMENT)
                self.columns.append(piece.start() + 1)
        joined = "".join(code)
        upper = joined.isupper() and joined.isascii()
        self.code = joined if upper else joined.translate(_UPPER)
        self.columns.append(len(text.rstrip()) + 1)

    @property
    def column(self) -> int:
        """Column of the next character, counting from 1."""
        return self.columns[self.at]

    @property
    def ended(self) -> bool:
        """Whether nothing but comments is left."""
        while self.code.startswith(COMMENT, self.at):
            self.at += 1
        return self.at == len(self.code)

    def peek(self, count: int = 1) -> str:
        """The next characters, fewer at the end."""
        return self.code[self.at : self.at + count]

    def take(self, literal: str) -> bool:
        """Whether ``literal`` comes next; then it is behind the cursor."""
        if not self.code.startswith(literal, self.at):
            return False
        self.at += len(literal)
        return True

    def letters(self) -> str:
        """The run of letters that comes next, left in place."""
        match = _LETTERS.match(self.code, self.at)
        return match.group() if match else ""

    def number(self) -> float | None:
        """The number without sign that comes next, or None."""
        start = self.at
        match = _NUMBER.match(self.code, start)
        if match is None:
            return None
        self.at = match.end()
        value = float(match.group())
        if value > LARGEST:
            raise self.error(start, f"the number is too large: {LARGEST:g} is the most")
        return value

    def name(self) -> str:
        """Name up to ``>``, in lower case; the ``<`` is behind the cursor."""
        start, end = self.at, self.code.find(">", self.at)
        if end <= start:
            raise self.error(self.at - 1, "a name in < > is missing or open: write it as <name>")
        self.at = end + 1
        return self.code[start:end].lower()

    def written(self, start: int) -> str:
        """The source from code position ``start`` to the cursor."""
        if self.at <= start:
            return self.source[self.columns[start] - 1 :][:1]
        return self.source[self.columns[start] - 1 : self.columns[self.at - 1]]

    def error(self, start: int, reason: str) -> GcodeError:
        """The error about what stands from code position ``start`` to the cursor."""
        word = self.written(start) or "end of line"
        return GcodeError(self.file, self.line, self.columns[start], word, reason)


_UPPER = {ord(letter): ord(letter) - 32 for letter in "abcdefghijklmnopqrstuvwxyz"}

DEEPEST = 100
"""Greatest depth of operators and brackets in an expression."""

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
        """Expression in brackets, ``[…]``."""
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
        elif not self.fanuc and cursor.letters() in self.functions:
            key = self._call(cursor.letters())
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
        if not cursor.take("["):
            raise cursor.error(cursor.at, f"{name} is followed by [: add its argument")
        arguments = [self.expression()]
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
        if name == "EXISTS" and not isinstance(arguments[0], Parameter):
            raise cursor.error(start, "EXISTS asks for a parameter: write EXISTS[#<name>]")
        return Call(meaning, tuple(arguments))

    def _operator(self) -> str | None:
        text = self.cursor.peek(3)
        return next((text[:n] for n in (3, 2, 1) if text[:n] in self.operators), None)

    def _deeper(self, start: int) -> None:
        self.cursor.nesting += 1
        if self.cursor.nesting > DEEPEST:
            raise self.cursor.error(
                start,
                f"the expression nests or chains more than {DEEPEST} values: split it into several",
            )
