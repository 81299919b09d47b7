"""Lossless tree of a part program: tokens, lines and words, each with its bytes."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pipeline.gcode import scanner
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.scanner import BLANKS


class TokenKind(IntEnum):
    """Kind of a token."""

    BLANK = scanner.BLANK  # blanks, NUL, DEL, the byte order mark at the start
    WORD = scanner.WORD  # a letter and a number
    VALUED = scanner.VALUED  # a letter and an expression: ``X[#1+2]``, ``F#5``, ``Xsin[30]``
    LONE = scanner.LONE  # a letter without a value
    MACRO = scanner.MACRO  # assignments, control, O-words, Siemens names: up to a comment
    COMMENT = scanner.COMMENT  # ``(…)``
    REMARK = scanner.REMARK  # ``;`` and the rest of the line
    SKIP = scanner.SKIP  # ``/`` or ``/2`` at the head of a line
    PERCENT = scanner.PERCENT  # ``%`` at the head of a line, and the rest of it
    LINE_END = scanner.LINE_END
    OTHER = scanner.OTHER  # anything else: no meaning in ISO 6983


@dataclass(frozen=True, kw_only=True)
class Tokens:
    """K tokens on L lines, in the order of the bytes; together they are all of them."""

    kind: npt.NDArray[np.uint8]
    """Kind of each token, :class:`Kind`."""
    start: npt.NDArray[np.int32]
    """Byte that each begins at; it ends where the next begins."""
    first: npt.NDArray[np.int32]
    """First token of each line."""


def tokens(data: bytes, name: str) -> Tokens:
    """Tokens of any bytes.  Raises GcodeError if it has 2 GiB or more."""
    if len(data) >= 2**31 - 1:
        raise GcodeError(name, 0, 0, f"{len(data)} bytes", "cut it: 2 GiB at most")
    capacity = len(data) + 1
    kind = np.empty(capacity, dtype=np.uint8)
    start, first = np.empty(capacity, dtype=np.int32), np.empty(capacity, dtype=np.int32)
    count, lines = scanner.scan(np.frombuffer(data, dtype=np.uint8), kind, start, first)
    for array, length in ((kind, count), (start, count + 1), (first, lines + 1)):
        array.resize(length, refcheck=False)  # in place: gives back what was not written
    return Tokens(kind=kind, start=start, first=first)


def number_text(word: bytes) -> str:
    """The digits of a word with a number, without its letter and blanks."""
    return word.translate(None, BLANKS).lstrip(LETTERS).decode("ascii")


LETTERS = b",@^$abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True, slots=True)
class Word:
    """A letter and its value, as they stand in a line."""

    letter: str
    """Upper case; ``",R"`` and ``",C"`` with their comma."""
    value: float | None
    """Value; None where it is an expression."""
    expression: str | None
    """The value as written where it is no number: ``"[#1+2]"``."""
    text: bytes
    """Text of the whole word."""
    line: int
    column: int
    """Column of its first byte, from 1."""
    start: int
    end: int
    """First and last byte in the program, from 0."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes of one kind in a line."""

    kind: TokenKind
    text: bytes
    start: int


class Line:
    """Line of a program; its words are looked up on demand.

    ``start`` is its first byte in the program, from 0; ``end`` its line end, empty where there is
    none.
    """

    __slots__ = ("_first", "_last", "_tokens", "end", "number", "start", "text")

    def __init__(self, data: bytes, made: Tokens, number: int) -> None:
        self.number = number
        self._tokens = made
        self._first, self._last = made.first[number - 1 : number + 1].tolist()
        self.start, stop = int(made.start[self._first]), int(made.start[self._last])
        ends = made.kind[self._last - 1] == TokenKind.LINE_END
        text_end = int(made.start[self._last - 1]) if ends else stop
        self.text, self.end = data[self.start : text_end], data[text_end:stop]

    @property
    def pieces(self) -> Iterator[Piece]:
        """All that the line consists of, its end too, in order."""
        made, raw = self._tokens, self.text + self.end
        for index in range(self._first, self._last):
            begin, end = made.start[index : index + 2].tolist()
            text = raw[begin - self.start : end - self.start]
            yield Piece(TokenKind(made.kind[index]), text, begin)

    @property
    def words(self) -> tuple[Word, ...]:
        """Letters with numbers or expressions, but for those of assignments and control."""
        return tuple(
            self._word(piece)
            for piece in self.pieces
            if piece.kind in (TokenKind.WORD, TokenKind.VALUED)
        )

    @property
    def comments(self) -> tuple[bytes, ...]:
        """Comments without their signs."""
        return tuple(
            piece.text[1:-1] if piece.kind == TokenKind.COMMENT else piece.text[1:]
            for piece in self.pieces
            if piece.kind in (TokenKind.COMMENT, TokenKind.REMARK)
        )

    @property
    def skip(self) -> int | None:
        """Level of block skip: 1 for ``/``, 2 for ``/2``; None where the line has none."""
        at, skips = self._head()
        if not skips:
            return None
        begin = int(self._tokens.start[at]) - self.start
        return int(self.text[begin : self.code_start].strip(b"/" + BLANKS) or b"1")

    @property
    def code_start(self) -> int:
        """Start of the code in ``text``: behind blanks, byte order mark and block skip."""
        at, skips = self._head()
        return int(self._tokens.start[at + skips]) - self.start

    def _head(self) -> tuple[int, bool]:
        """First token that is not blank, and whether it is a block skip."""
        at = self._first + int(self._tokens.kind[self._first] == TokenKind.BLANK)
        return at, bool(at < self._last and self._tokens.kind[at] == TokenKind.SKIP)

    def _word(self, piece: Piece) -> Word:
        comma = piece.text[:1] == b","
        bare = piece.text[1:].lstrip(BLANKS) if comma else piece.text
        letter = "," * comma + bare[:1].decode("ascii").upper()
        value = bare[1:].strip(BLANKS)
        number = piece.kind == TokenKind.WORD
        return Word(
            letter=letter, value=float(number_text(piece.text)) if number else None,
            expression=None if number else value.decode("latin-1"), text=piece.text,
            line=self.number, column=piece.start - self.start + 1, start=piece.start,
            end=piece.start + len(piece.text),
        )  # fmt: skip


OUTPUT = frozenset({"POPEN", "PCLOS", "DPRNT", "BPRNT", "SETVN"})
"""Words of Macro B that write to a device or name variables; what follows belongs to them."""
_OUTPUT = re.compile(rb"(?im)^[\s/\d]*(?:N\s*\d+\s*)?(%s)\b" % "|".join(sorted(OUTPUT)).encode())


def output_lines(data: bytes) -> dict[str, list[int]]:
    """Lines of a program that a word of ``OUTPUT`` heads, by that word."""
    found: dict[str, list[int]] = {}
    line, at = 1, 0
    for match in _OUTPUT.finditer(data):
        line += data.count(b"\n", at, match.start(1))
        at = match.start(1)
        found.setdefault(match[1].decode("ascii").upper(), []).append(line)
    return found


_COMMENTS = re.compile(rb"\([^)]*\)")
_BLOCK = re.compile(rb"(?i)[;/\s]*(?:[a-z]\s*[-+.\d#\[]|#|(?:IF|WHILE|GOTO|DO|END)\b)")


def is_block(remark: bytes) -> bool:
    """Whether what stands behind ``;`` begins as a block of code does, and not as a comment."""
    return _BLOCK.match(_COMMENTS.sub(b" ", remark)) is not None


class Program:
    """Bytes of a part program, and their tokens.

    Raises
    ------
    GcodeError
        If ``data`` has 2 GiB or more.
    """

    def __init__(self, data: bytes, name: str) -> None:
        self.data, self.name = data, name
        self.tokens = tokens(data, name)

    def __len__(self) -> int:
        return len(self.tokens.first) - 1

    @property
    def lines(self) -> Iterator[Line]:
        """All lines, in order."""
        return (self.line(number) for number in range(1, len(self) + 1))

    def line(self, number: int) -> Line:
        """Line ``number``, counting from 1."""
        if not 1 <= number <= len(self):
            raise IndexError(f"{self.name} has lines 1 to {len(self)}, not {number}")
        return Line(self.data, self.tokens, number)

    def numbers(self, which: npt.NDArray[np.integer]) -> npt.NDArray[np.float64]:
        """Numbers of the WORD tokens ``which`` (n,), counting from 0."""
        start, found = self.tokens.start, np.empty(len(which))
        scanner.read_numbers(np.frombuffer(self.data, dtype=np.uint8), start[which], found)
        for index in np.flatnonzero(np.isnan(found)).tolist():
            at = which[index]
            # more digits than the scanner rounds correctly
            found[index] = float(number_text(self.data[start[at] : start[at + 1]]))
        return found

    def text(self, changes: Mapping[Word, bytes] | None = None) -> bytes:
        """Program put together from its pieces, with other bytes for the words in ``changes``."""
        instead = {word.start: text for word, text in (changes or {}).items()}
        bounds = self.tokens.start.tolist()
        return b"".join(instead.get(begin, self.data[begin:end]) for begin, end in pairwise(bounds))

    @cached_property
    def content(self) -> np.ndarray:
        """Class of each line (L,): 0 numbers and comments only, 1 with expressions, 2 with more."""
        first = self.tokens.first[:-1]
        classes = _CONTENT[self.tokens.kind]
        return np.maximum.reduceat(classes, first) if len(first) else classes

    @property
    def body(self) -> range:
        """Numbers of the lines that are executed, between the two lines of ``%`` if any."""
        percents = self._line_of(np.flatnonzero(self.tokens.kind == TokenKind.PERCENT))
        first, last = 1, len(self) + 1
        if len(percents) and self._silent[: self.tokens.first[percents[0] - 1]].all():
            first, percents = int(percents[0]) + 1, percents[1:]
        if len(percents):
            last = int(percents[0])
        return range(first, last)

    def remarked_blocks(self) -> list[int]:
        """Lines where a word follows ``;``, which is a block of a Fanuc or a comment."""
        made = self.tokens
        found = np.flatnonzero(made.kind == TokenKind.REMARK).tolist()
        blocks = [o for o in found if is_block(self.data[made.start[o] : made.start[o + 1]])]
        return [int(line) for line in self._line_of(np.array(blocks, dtype=np.intp))]

    @cached_property
    def ends_blocks(self) -> bool:
        """Whether lines of code end in ``;``, as a Fanuc shows the end of a block."""
        made = self.tokens
        for one in np.flatnonzero(made.kind == TokenKind.REMARK)[:MOST_REMARKS].tolist():
            before = {*made.kind[made.first[self._line_of(np.array(one)) - 1] : one].tolist()}
            ends = self.data[made.start[one] : made.start[one + 1]].strip(BLANKS).endswith(b";")
            if ends and not before <= {TokenKind.BLANK, TokenKind.REMARK}:
                return True
        return False

    @property
    def opening(self) -> int:
        """First line of the body that holds more than comments; the body's end where none does."""
        body, first = self.body, self.tokens.first
        begin = int(first[body.start - 1])
        spoken = np.flatnonzero(~self._silent[begin : int(first[body.stop - 1])])
        return int(self._line_of(begin + spoken[0])) if len(spoken) else body.stop

    @property
    def _silent(self) -> np.ndarray:
        """Tokens (K,) that say nothing to the control."""
        return _SILENT[self.tokens.kind]

    def heads(self, letter: str) -> list[tuple[float, int]]:
        """Number and line of each word ``letter`` that is the first of its line, in order.

        ``heads("N")`` are the targets of GOTO, ``heads("O")`` the programs of the file.
        """
        kind = self.tokens.kind
        data = np.frombuffer(self.data, dtype=np.uint8)
        capital = data[self.tokens.start[:-1]] & 0xDF
        found = np.flatnonzero((kind == TokenKind.WORD) & (capital == ord(letter)))
        lines = self._line_of(found)
        first = self.tokens.first[lines - 1]
        leads = found - first <= AT_HEAD
        for back in range(1, AT_HEAD + 1):
            before = np.maximum(found - back, first)
            leads &= (before == found) | np.isin(kind[before], (TokenKind.BLANK, TokenKind.SKIP))
        return list(zip(self.numbers(found[leads]).tolist(), lines[leads].tolist(), strict=True))

    def _line_of(self, token: np.ndarray) -> np.ndarray:
        return np.searchsorted(self.tokens.first, token, side="right")


_CONTENT = np.full(len(TokenKind), 2, dtype=np.uint8)
_CONTENT[
    [TokenKind.BLANK, TokenKind.WORD, TokenKind.COMMENT, TokenKind.REMARK, TokenKind.LINE_END]
] = 0
_CONTENT[TokenKind.VALUED] = 1
_SILENT = np.zeros(len(TokenKind), dtype=np.bool_)
_SILENT[[TokenKind.BLANK, TokenKind.COMMENT, TokenKind.REMARK, TokenKind.LINE_END]] = True
MOST_REMARKS = 1000
"""Remarks that are looked at for the end of a block."""
AT_HEAD = 3
"""Tokens that may stand before the first word of a line: blanks, a block skip, blanks."""


def parse_program(data: bytes, name: str) -> Program:
    """Program of any bytes."""
    return Program(data, name)


def read_program(path: Path) -> Program:
    """Program of a file, named after it."""
    return Program(path.read_bytes(), path.name)
