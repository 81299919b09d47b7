"""F and S words of a program: positions, lines that could take one more, rounding.

Rows with assignments, flow control, calls, or codes under which F or S is no feed or speed (a
pitch, a dwell, a limit, an argument) are closed: nothing is written into them.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.gcode.moves import INCH, FeedMode, Kind, Moves
from pipeline.gcode.program import Program
from pipeline.gcode.program import TokenKind as Token
from pipeline.gcode.scanner import BLANKS
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.part_sheet import FeedUnit

CLOSED_G = (
    4, 10, 11, 25, 26, 31, 33, 33.1, 34, 35, 38.2, 38.3, 38.4, 38.5, 50, 63, 65, 66, 66.1, 67, 74,
    76, 84, 92, 92.1, 92.2, 92.3, 93, 96, 961, 962, 331, 332,
)  # fmt: skip
"""G codes under which F or S of the same line means something else, or might."""
CLOSED_M = (19, 29, 70, 71, 72, 73, 96, 97, 98, 99, 198)
WINDING_M = (96, 97, 98, 99, 198)
WINDING_G = (65, 66, 66.1)
UNITS = {20: INCH, 21: 1.0, 70: INCH, 71: 1.0, 700: INCH, 710: 1.0}
NONE, OTHER = -1, -2
"""No word of a letter in a line; one that is no single number."""
FEED_UNITS: tuple[FeedUnit, ...] = get_args(FeedUnit)
"""Units of F by their code: of length a minute and a turn in mm and inch, and a share of time."""
_READS = re.compile(rb"(?i)_feed|_rpm|#\s*41[01]9|\$P_F|\$P_S|\$AC_")
ROUNDING = 1e-3
"""Share that rounding may take off an F [1]."""
MOST_DECIMALS = 9
SLACK = 1.5e-9
"""Share by which arithmetic may leave a number below the one it means [1]."""
_NUMBER = re.compile(rb"[+-]?[0-9.%b]*[0-9.]" % re.escape(BLANKS))


@dataclass(frozen=True, eq=False)
class ProgramWords:
    """Words of a program by line; arrays have L + 1 places, that of line n is n."""

    program: Program = field(repr=False)
    """Program of L lines."""

    @cached_property
    def line_of(self) -> Rows:
        """Line of each token (K,)."""
        counts = np.diff(self.program.tokens.first)
        return np.repeat(np.arange(1, len(self.program) + 1), counts)

    @cached_property
    def _letters(self) -> NDArray[np.uint8]:
        """Capital letter of each WORD, VALUED and LONE (K,); 0 of other tokens."""
        tokens = self.program.tokens
        data = np.frombuffer(self.program.data, dtype=np.uint8)
        capital = data[tokens.start[:-1]] & 0xDF if len(data) else np.zeros(0, dtype=np.uint8)
        lettered = np.isin(tokens.kind, (Token.WORD, Token.VALUED, Token.LONE))
        return np.where(lettered, capital, 0).astype(np.uint8)

    def _has(self, token: Bools | Rows) -> Bools:
        lines = np.zeros(len(self.program) + 1, dtype=np.bool_)
        lines[self.line_of[token]] = True
        return lines

    def codes(self, letter: str, codes: tuple[float, ...]) -> Bools:
        """Rows with one of some G or M codes (L + 1,)."""
        tokens = self.program.tokens
        named = np.flatnonzero((self._letters == ord(letter)) & (tokens.kind == Token.WORD))
        near = np.round(self.program.numbers(named) * 10)
        return self._has(named[np.isin(near, np.round(np.array(codes) * 10))])

    def token(self, letter: str) -> Rows:
        """Token of each line's word of a letter (L + 1,), ``NONE`` or ``OTHER``."""
        tokens = np.flatnonzero(self._letters == ord(letter))
        at = np.full(len(self.program) + 1, NONE, dtype=np.intp)
        lines = self.line_of[tokens]
        at[lines] = np.where(self.program.tokens.kind[tokens] == Token.WORD, tokens, OTHER)
        several = np.bincount(lines, minlength=len(at)) > 1
        at[several[: len(at)]] = OTHER
        return at

    @cached_property
    def closed(self) -> Bools:
        """Lines that nothing is written into (L + 1,)."""
        kind = self.program.tokens.kind
        plain = (
            Token.BLANK, Token.WORD, Token.VALUED, Token.COMMENT, Token.REMARK, Token.SKIP,
            Token.LINE_END,
        )  # fmt: skip
        odd = ~np.isin(kind, plain) | (self._letters == ord("O")) | self._odd_values
        return self._has(odd) | self.codes("G", CLOSED_G) | self.codes("M", CLOSED_M)

    @cached_property
    def _odd_values(self) -> Bools:
        """Expressions that are no variable and no bracket, or those of G and M (K,)."""
        tokens = self.program.tokens
        odd = tokens.kind == Token.VALUED
        for at in np.flatnonzero(odd).tolist():
            text = self.program.data[tokens.start[at] : tokens.start[at + 1]]
            value = text[1:].strip(BLANKS + b"+-")
            odd[at] = value[:1] not in (b"#", b"[") or text[:1] in b"GMgm"
        return odd

    @cached_property
    def optional(self) -> Bools:
        """Rows that begin with ``/`` and may be left out at the machine (L + 1,)."""
        return self._has(self.program.tokens.kind == Token.SKIP)

    @cached_property
    def winding(self) -> bool:
        """Whether lines may be left out or come again: jumps, loops, calls, block skip."""
        tokens = self.program.tokens
        data = np.frombuffer(self.program.data, dtype=np.uint8)
        macros = tokens.start[:-1][tokens.kind == Token.MACRO]
        return bool(
            (data[macros] != ord("#")).any()
            or (tokens.kind == Token.SKIP).any()
            or self.codes("M", WINDING_M).any()
            or self.codes("G", WINDING_G).any()
        )

    @cached_property
    def reads_itself(self) -> bool:
        """Whether its expressions may read the F or S in force, or it saves and restores them."""
        return bool(_READS.search(self.program.data)) or bool(self.codes("M", (72, 73)).any())

    @cached_property
    def unit(self) -> Floats | None:
        """Millimetres in the unit of each line (L + 1,), NaN before the first G20 or G21.

        None where both are in a program whose lines do not run in their order.
        """
        units = np.full(len(self.program) + 1, np.nan)
        for code, unit in UNITS.items():
            units[self.codes("G", (code,))] = unit
        given = np.flatnonzero(~np.isnan(units))
        if not len(given):
            return units
        if self.winding:
            first = units[given[0]]
            return np.full(len(units), first) if (units[given] == first).all() else None
        last = np.maximum.accumulate(np.where(np.isnan(units), 0, np.arange(len(units))))
        return units[last]

    @cached_property
    def _spaced(self) -> bool:
        kind, letters = self.program.tokens.kind, self._letters
        if len(kind) < 3:
            return True
        word = letters > 0
        together = np.count_nonzero(word[1:] & word[:-1])
        apart = np.count_nonzero(word[2:] & (kind[1:-1] == Token.BLANK) & word[:-2])
        return bool(apart >= together)

    def place(self, line: int) -> tuple[int, bytes, bool]:
        """Place of a word added to a line: the byte, the separator, whether in small letters."""
        tokens, letters = self.program.tokens, self._letters
        first, last = tokens.first[line - 1 : line + 1].tolist()
        words = first + np.flatnonzero(letters[first:last])
        at = int(tokens.start[words[-1] + 1])
        spaced = self._spaced
        if len(words) > 1 and not (len(words) == 2 and letters[words[0]] == ord("N")):
            spaced = bool(tokens.kind[words[-1] - 1] == Token.BLANK)
        small = self.program.data[tokens.start[words[-1]]] >= ord("a")
        return at, b" " * spaced, bool(small)


def decimals(values: ArrayLike, least: int = 0) -> NDArray[np.intp]:
    """Decimals with which rounding down costs less than :data:`ROUNDING` of a value."""
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.ceil(-np.log10(ROUNDING * np.asarray(values, dtype=np.float64)) - SLACK)
    needed = np.where(np.isfinite(needed), needed, MOST_DECIMALS)
    return np.clip(needed, least, max(MOST_DECIMALS, least)).astype(np.intp)


def rounded_down(values: ArrayLike, least: int = 0) -> Floats:
    """Values as words hold them: rounded down, with as many decimals as are needed."""
    given = np.asarray(values, dtype=np.float64)
    power = 10.0 ** decimals(given, least)
    steps: Floats = np.floor(given * power * (1 + SLACK))
    return steps / power


def stepped(values: ArrayLike, step: ArrayLike, to: Callable[[Floats], Floats] = np.rint) -> Floats:
    """Values as people write them: whole multiples of a step, below ten steps of a tenth of it.

    ``step``: in their unit, one for all or for each; one 0 leaves all as they are.

    >>> stepped([3827.0, 423.0, 42.0], 50.0).tolist(), stepped([1534.0, 87.6], 10.0).tolist()
    ([3850.0, 425.0, 42.0], [1530.0, 88.0])
    """
    given, unit = (np.asarray(one, dtype=np.float64) for one in (values, step))
    if not unit.all():
        return given
    with np.errstate(divide="ignore", invalid="ignore"):
        smaller = np.minimum(np.floor(np.log10(given / (10 * unit)) + SLACK), 0.0)
    steps = unit * 10.0 ** np.where(np.isfinite(smaller), smaller, 0.0)
    slack = 1 + SLACK if to is np.floor else 1 - SLACK if to is np.ceil else 1.0
    return np.round(to(given * slack / steps) * steps, MOST_DECIMALS)


@dataclass(frozen=True, kw_only=True)
class NumberStyle:
    """Style in which a program writes the numbers of one letter."""

    point: bool = False
    """Whether they have a decimal point even where nothing follows it."""
    least: int = 0
    """Decimals that they have at least."""

    @classmethod
    def of(cls, numbers: list[bytes]) -> "NumberStyle":
        """Style of most of some numbers as written."""
        pointed = [number for number in numbers if b"." in number]
        if not numbers or 2 * len(pointed) < len(numbers):
            return cls()
        least = min(len(number.partition(b".")[2]) for number in pointed)
        return cls(point=True, least=min(least, MOST_DECIMALS))

    def text(self, value: float) -> bytes:
        """A number that was rounded by :func:`rounded_down`."""
        written = f"{value:.{MOST_DECIMALS}f}".rstrip("0")
        whole, _, fraction = written.partition(".")
        fraction = fraction.ljust(self.least, "0")
        return f"{whole}{'.' if fraction or self.point else ''}{fraction}".encode("ascii")


def digits(word: bytes) -> bytes:
    """The number of a word as written, without blanks."""
    number = _NUMBER.search(word, 1)
    return b"" if number is None else number[0].translate(None, BLANKS)


def in_place_of(word: bytes, number: bytes) -> bytes:
    """A word with another number, its letter and the blanks before its number kept."""
    old = _NUMBER.search(word, 1)
    if old is None:
        return word[:1] + number
    lead = old.start() + len(old[0]) - len(old[0].lstrip(BLANKS))
    return word[:lead] + number + word[old.end() :]


def rounded_feeds(program: Program, moves: Moves, feeds: ArrayLike) -> Floats:
    """Feeds (…, M), in the units of ``Moves``, rounded down by less than 0.1 % for the text."""
    return FeedText.of(ProgramWords(program), moves).rounded(feeds)


def rounded_speeds(speeds: ArrayLike) -> Floats:
    """Speeds as the text will hold them: the nearest whole number [rev/min], at least 1."""
    return np.maximum(np.rint(np.asarray(speeds, dtype=np.float64)), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedText:
    """Units and numbers in which the F of each row of a program is written."""

    unit: Floats = field(repr=False)
    """Millimetres in the unit of length that F counts; shape (M,)."""
    style: NumberStyle
    """Number style of the program's own F words."""
    own: Mapping[float, bytes] = field(repr=False)
    """Values of its F words in the units of ``Moves`` -> their numbers as written."""

    @classmethod
    def of(cls, words: ProgramWords, moves: Moves) -> Self:
        """Units and numbers of a program of M rows."""
        lines = _line_units(words, moves)
        program, token = words.program, words.token("F")
        given = np.flatnonzero(token >= 0)
        start = program.tokens.start
        numbers = [digits(program.data[start[at] : start[at + 1]]) for at in token[given].tolist()]
        values = program.numbers(token[given]) * lines[given]
        return cls(
            unit=lines[np.where(moves.file == 0, moves.line, 0)], style=NumberStyle.of(numbers),
            own=dict(zip(values.tolist(), numbers, strict=True)),
        )  # fmt: skip

    def rounded(self, feeds: ArrayLike) -> Floats:
        """Feeds rounded by :func:`rounded_feeds`."""
        given = np.asarray(feeds, dtype=np.float64)
        down = rounded_down(given / self.unit, self.style.least) * self.unit
        return np.where(np.isin(given, np.array(list(self.own))), given, down)

    def number(self, row: int, feed: float) -> bytes:
        """A rounded feed of one row, without its letter."""
        return self.own.get(feed) or self.style.text(feed / float(self.unit[row]))


def _line_units(words: ProgramWords, moves: Moves) -> Floats:
    """Millimetres in the unit of each line (L + 1,)."""
    units = words.unit
    if units is None:
        return np.ones(len(words.program) + 1)
    unknown = np.isnan(units)
    if unknown.any():
        units = np.where(unknown, INCH if _counts_inches(words, moves, unknown) else 1.0, units)
    return units


def _counts_inches(words: ProgramWords, moves: Moves, unknown: Bools) -> bool:
    """Whether F counts inches where no line says so: by the first word that a row took."""
    line = np.where(moves.file == 0, moves.line, 0)
    token = words.token("F")[line]
    plain = np.isin(moves.kind, (Kind.FEED, Kind.ARC)) & (moves.feed_mode != FeedMode.INVERSE_TIME)
    rows = np.flatnonzero(unknown[line] & (token >= 0) & plain & (line > 0))
    value = words.program.numbers(token[rows])
    return bool(len(rows) and (moves.feed[rows] == value * INCH).any())


class FeedWords:
    """F of each row of a program in the unit in which the program writes it."""

    def __init__(self, program: Program, moves: Moves) -> None:
        by_time = moves.feed_mode == FeedMode.INVERSE_TIME
        self.length = FeedText.of(ProgramWords(program), moves).unit
        self._factor = np.where(by_time, 1.0, self.length)
        self.code = np.select(
            [by_time, moves.feed_mode == FeedMode.PER_REVOLUTION], [4, 1], 0
        ) + np.where((self.length != 1.0) & ~by_time, 2, 0)

    def unit(self, row: int) -> FeedUnit:
        """Unit of the F of a row."""
        return FEED_UNITS[int(self.code[row])]

    def written(self, feeds: Floats) -> Floats:
        """F (M,) in the units of ``Moves`` as the text has it."""
        return np.round(feeds / self._factor, 9)

    def program_unit(self, rows: Bools) -> Literal["mm", "inch"]:
        """Unit of length of most of some rows."""
        return "inch" if 2 * np.count_nonzero(self.length[rows] != 1.0) > rows.sum() else "mm"
