"""Visits: a program's rows in runs of one line, in the order in which the control takes them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

READS_F = (Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)


@dataclass(frozen=True, kw_only=True, eq=False)
class Visits:
    """V runs of M rows.

    Parameters
    ----------
    of : ndarray of intp, shape (M,)
        Visit of each row.
    line : ndarray of intp, shape (V,)
        In the program's own file, 0 for those of other files.
    first : ndarray of intp, shape (V,)
        First row of each.
    taps : ndarray of bool, shape (V,)
        Whether the spindle turns back in it.
    again : ndarray of bool, shape (V,)
        Whether the line has other visits.
    """

    of: Rows = field(repr=False)
    line: Rows = field(repr=False)
    first: Rows = field(repr=False)
    taps: Flags = field(repr=False)
    again: Flags = field(repr=False)

    @classmethod
    def among(cls, moves: Moves) -> "Visits":
        """Those of a program."""
        rows = len(moves)
        place = np.stack([moves.file, moves.line]).astype(np.intp)
        new = np.ones(rows, dtype=np.bool_)
        new[1:] = (place[:, 1:] != place[:, :-1]).any(axis=0)
        of = np.cumsum(new) - 1
        first = np.flatnonzero(new)
        line = np.where(place[0, first] == 0, place[1, first], 0)
        count = np.bincount(line, minlength=1) if rows else np.zeros(1, dtype=np.intp)
        visits = cls(
            of=of, line=line, first=first, taps=np.zeros(len(first), dtype=np.bool_),
            again=count[line] > 1,
        )  # fmt: skip
        visits.taps[:] = visits.any(moves.direction > 0) & visits.any(moves.direction < 0)
        return visits

    def any(self, rows: Flags) -> Flags:
        """Whether one of the rows of each visit is among some (V,)."""
        found = np.zeros(len(self.line), dtype=np.bool_)
        found[self.of[rows]] = True
        return found

    def first_of(self, rows: Flags) -> Rows:
        """First row of each visit that is among some (V,), -1 where none is."""
        among = np.flatnonzero(rows)
        first = np.full(len(self.line), -1, dtype=np.intp)
        first[self.of[among[::-1]]] = among[::-1]
        return first

    def one_value(self, values: Floats, rows: Flags) -> Floats:
        """What some rows of each visit have in common (V,), NaN where they differ or none is."""
        first = self.first_of(rows)
        common = np.where(first >= 0, values[first], np.nan) if len(values) else np.zeros(0)
        differs = rows & (values != common[self.of])
        common[self.any(differs)] = np.nan
        return common


def reads_feed(moves: Moves) -> Flags:
    """Rows whose feed comes of the F in force (M,)."""
    return np.isin(moves.kind, READS_F)


def cuts_at_feed(moves: Moves) -> Flags:
    """Rows whose F is a feed a minute or a revolution (M,)."""
    cutting = np.isin(moves.kind, (Kind.FEED, Kind.ARC))
    timed = moves.feed_mode == FeedMode.INVERSE_TIME
    return cutting & ~timed & (moves.feed > 0)


def turns(moves: Moves) -> Flags:
    """Rows whose S is that of a turning spindle (M,)."""
    return (moves.direction != 0) & (moves.speed > 0)
