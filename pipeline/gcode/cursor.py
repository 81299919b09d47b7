"""Reading one line from left to right: blanks do not count, comments stand between words."""

import re

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.statements import LARGEST

COMMENT = "\x01"
"""Stands for a comment in a cursor's text, so that ``G1 (slow) 0`` does not become ``G10``."""

_PIECE = re.compile(
    r"\(([^)]*)\)|;(.*)|[\x00\t\v\f \x7f\r\n]+|([^(;\x00\t\v\f \x7f\r\n]+|\()", re.S
)
_NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
_LETTERS = re.compile(r"[A-Z]+")


class Cursor:
    """The code of a line, upper case and without blanks, and where each character stood.

    Parameters
    ----------
    text : str
        The line, a character for each byte.
    line : int
        Its number, counting from 1.
    file : str
        Name of the program.
    start : int
        Where the code begins in ``text``.
    """

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
        self.code = _ascii_upper("".join(code))
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
        found = _LETTERS.match(self.code, self.at)
        return found.group() if found else ""

    def number(self) -> float | None:
        """The number without sign that comes next, or None."""
        start = self.at
        found = _NUMBER.match(self.code, start)
        if found is None:
            return None
        self.at = found.end()
        value = float(found.group())
        if value > LARGEST:
            raise self.error(start, f"the number is too large: {LARGEST:g} is the most")
        return value

    def name(self) -> str:
        """What stands up to ``>``, in lower case; the ``<`` is behind the cursor."""
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
        return GcodeError(
            file=self.file,
            line=self.line,
            column=self.columns[start],
            word=self.written(start) or "end of line",
            reason=reason,
        )


def _ascii_upper(text: str) -> str:
    return text if text.isupper() and text.isascii() else text.translate(_UPPER)


_UPPER = {ord(letter): ord(letter) - 32 for letter in "abcdefghijklmnopqrstuvwxyz"}
