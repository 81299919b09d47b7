"""F and S as a program's text will hold them, so that what is judged is what is written."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.gcode.moves import INCH, FeedMode, Kind, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.text.program_words import ProgramWords
from pipeline.optimisation.text.word_numbers import OwnNumbers, rounded_down

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def rounded_feeds(program: Program, moves: Moves, feeds: ArrayLike) -> Floats:
    """Feeds as the text will hold them: rounded down, by less than 0.1 %.

    Parameters
    ----------
    program : Program
        Text.
    moves : Moves
        The program as interpreted, M rows.
    feeds : array_like, shape (…, M)
        In the units of ``Moves`` ([mm/min] or [mm/rev]), positive.

    Returns
    -------
    ndarray, shape (…, M)
        Bit for bit what the interpreter will read.
    """
    return FeedText.of(ProgramWords(program), moves).rounded(feeds)


def rounded_speeds(speeds: ArrayLike) -> Floats:
    """Speeds as the text will hold them: the nearest whole number [rev/min], at least 1."""
    return np.maximum(np.rint(np.asarray(speeds, dtype=np.float64)), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedText:
    """How the F of each row of a program is written.

    Parameters
    ----------
    unit : ndarray, shape (M,)
        Millimetres in the unit of length that F counts.
    numbers : OwnNumbers
        Of the program's own F words.
    """

    unit: Floats = field(repr=False)
    numbers: OwnNumbers

    @classmethod
    def of(cls, words: ProgramWords, moves: Moves) -> Self:
        """That of a program of M rows."""
        lines = _line_units(words, moves)
        program, token = words.program, words.token("F")
        given = np.flatnonzero(token >= 0)
        start = program.tokens.start
        texts = [program.data[start[at] : start[at + 1]] for at in token[given].tolist()]
        values = program.tokens.value[token[given]] * lines[given]
        inside = np.where(moves.file == 0, moves.line, 0)
        return cls(unit=lines[inside], numbers=OwnNumbers.of(texts, values.tolist()))

    def rounded(self, feeds: ArrayLike) -> Floats:
        """As :func:`rounded_feeds`."""
        given = np.asarray(feeds, dtype=np.float64)
        down = rounded_down(given / self.unit, self.numbers.style.least) * self.unit
        return np.where(np.isin(given, self.numbers.values), given, down)

    def number(self, row: int, feed: float) -> bytes:
        """A rounded feed of one row, without its letter."""
        own = self.numbers.texts.get(feed)
        return own or self.numbers.style.text(feed / float(self.unit[row]))


def _line_units(words: ProgramWords, moves: Moves) -> Floats:
    """Millimetres in the unit of each line (L + 1,)."""
    units = words.unit
    if units is None:
        return np.ones(len(words.program) + 1)
    unknown = np.isnan(units)
    if unknown.any():
        units = np.where(unknown, INCH if _counts_inches(words, moves, unknown) else 1.0, units)
    return units


def _counts_inches(words: ProgramWords, moves: Moves, unknown: Flags) -> bool:
    """Whether F counts inches where no line says so: by the first word that a row took."""
    line = np.where(moves.file == 0, moves.line, 0)
    token = words.token("F")[line]
    plain = np.isin(moves.kind, (Kind.FEED, Kind.ARC)) & (moves.feed_mode != FeedMode.INVERSE_TIME)
    rows = np.flatnonzero(unknown[line] & (token >= 0) & plain & (line > 0))
    value = words.program.tokens.value[token[rows]]
    return bool(len(rows) and (moves.feed[rows] == value * INCH).any())
