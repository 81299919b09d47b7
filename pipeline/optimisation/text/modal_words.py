"""Line runs that read F or S along a program, and the lines where it may be written.

A new word must leave every run of a line its value, in whatever order the lines are executed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.optimisation.text.words import NONE, OTHER, ProgramWords
from pipeline.schema.arrays import Bools, Floats, Rows

READS_F = (Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)
OTHER_MEANING = (4, 10, 25, 26, 50, 65, 66, 66.1, 92)
"""G codes whose line has words of these letters that leave the register alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LineRuns:
    """V runs of rows of one line, of M rows, in the order in which the control takes them."""

    of: Rows = field(repr=False)
    """Line run of each row; shape (M,)."""
    line: Rows = field(repr=False)
    """Line in the program's own file, 0 for those of other files; shape (V,)."""
    first: Rows = field(repr=False)
    """First row of each; shape (V,)."""
    taps: Bools = field(repr=False)
    """Whether the spindle reverses in it; shape (V,)."""
    again: Bools = field(repr=False)
    """Whether the line has other line_runs; shape (V,)."""

    @classmethod
    def among(cls, moves: Moves) -> "LineRuns":
        """Line runs of a program."""
        rows = len(moves)
        place = np.stack([moves.file, moves.line]).astype(np.intp)
        new = np.ones(rows, dtype=np.bool_)
        new[1:] = (place[:, 1:] != place[:, :-1]).any(axis=0)
        of = np.cumsum(new) - 1
        first = np.flatnonzero(new)
        line = np.where(place[0, first] == 0, place[1, first], 0)
        count = np.bincount(line, minlength=1) if rows else np.zeros(1, dtype=np.intp)
        line_runs = cls(
            of=of, line=line, first=first, taps=np.zeros(len(first), dtype=np.bool_),
            again=count[line] > 1,
        )  # fmt: skip
        line_runs.taps[:] = line_runs.any(moves.direction > 0) & line_runs.any(moves.direction < 0)
        return line_runs

    def any(self, rows: Bools) -> Bools:
        """Whether one of the rows of each run is among some (V,)."""
        among = np.zeros(len(self.line), dtype=np.bool_)
        among[self.of[rows]] = True
        return among

    def first_of(self, rows: Bools) -> Rows:
        """First row of each run that is among some (V,), -1 where none is."""
        among = np.flatnonzero(rows)
        first = np.full(len(self.line), -1, dtype=np.intp)
        first[self.of[among[::-1]]] = among[::-1]
        return first

    def one_value(self, values: Floats, rows: Bools) -> Floats:
        """Value that some rows of each run share (V,), NaN where they differ or none is."""
        first = self.first_of(rows)
        common = np.where(first >= 0, values[first], np.nan) if len(values) else np.zeros(0)
        differs = rows & (values != common[self.of])
        common[self.any(differs)] = np.nan
        return common


def reads_feed(moves: Moves) -> Bools:
    """Rows whose feed comes of the F in force (M,)."""
    return np.isin(moves.kind, READS_F) & ~_repeats_point(moves)


def cuts_at_feed(moves: Moves) -> Bools:
    """Rows whose F is a feed a minute or a revolution (M,)."""
    cutting = np.isin(moves.kind, (Kind.FEED, Kind.ARC)) & ~_repeats_point(moves)
    timed = moves.feed_mode == FeedMode.INVERSE_TIME
    return cutting & ~timed & (moves.feed > 0)


def _repeats_point(moves: Moves) -> Bools:
    """Feed and arc rows that end where they begin: they take no time, whatever their F (M,)."""
    fed = np.isin(moves.kind, (Kind.FEED, Kind.ARC)) & (moves.angle == 0)
    same: Bools = fed & (moves.end == moves.start).all(axis=1)
    return same


def at_speed(moves: Moves) -> Bools:
    """Rows whose S is the speed of a running spindle (M,)."""
    return (moves.direction != 0) & (moves.speed > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModalWords:
    """K line runs that read the register of one letter, in the order of the program."""

    letter: str
    """Letter, ``"F"`` or ``"S"``."""
    run: Rows = field(repr=False)
    """Index among all line_runs; shape (K,)."""
    line: Rows = field(repr=False)
    """0 in other files; shape (K,)."""
    row: Rows = field(repr=False)
    """First row that reads it; shape (K,)."""
    sets: Bools = field(repr=False)
    """Whether the line has a word of the letter; shape (K,)."""
    may_be_empty: Bools = field(repr=False)
    """Whether that word is no plain number and changes nothing: ``F#2`` without a value in #2
    leaves the register as it is; shape (K,)."""
    own: Floats = field(repr=False)
    """Value in the units of ``Moves``; shape (K,)."""
    loose: Rows = field(repr=False)
    """Lines with a word of the letter and no such run, ascending."""
    uncertain: bool
    """Whether those may be executed between any two line_runs."""
    optional: Bools = field(repr=False)
    """Whether the line begins with ``/``: it may be left out at the machine; shape (K,)."""
    loose_optional: bool
    """Whether one of the loose lines does."""

    @classmethod
    def along(
        cls, letter: str, words: ProgramWords, line_runs: LineRuns, reads: Bools, values: Floats
    ) -> "ModalWords":
        """Those of rows ``reads`` (M,) with ``values`` (M,)."""
        token = np.where(words.codes("G", OTHER_MEANING), NONE, words.token(letter))
        first = line_runs.first_of(reads)
        run = np.flatnonzero(first >= 0)
        line, row = line_runs.line[run], first[run]
        has = token != NONE
        loose = np.setdiff1d(np.flatnonzero(has), line)
        same = np.diff(values[row], prepend=np.nan) == 0
        return cls(
            letter=letter, run=run, line=line, row=row, sets=has[line] & (line > 0),
            may_be_empty=(token[line] == OTHER) & same, own=values[row], loose=loose,
            uncertain=words.winding and len(loose) > 0,
            optional=words.optional[line], loose_optional=bool(words.optional[loose].any()),
        )  # fmt: skip

    def handed_on(self, keeps: Bools, may: Bools) -> Bools:
        """Line runs (K,) whose value a run in ``keeps`` (K,) needs and cannot be given.

        ``may`` (K,): line runs whose line may be written into.
        """
        bound, needed = np.zeros(len(self.line), dtype=np.bool_), False
        ends = ((self.sets & ~self.may_be_empty) | (may & ~self._depends())).tolist()
        keeping, writable, optional = keeps.tolist(), may.tolist(), self.optional.tolist()
        for k in range(len(ends) - 1, -1, -1):
            past = needed and optional[k]  # where the line is left out
            if keeping[k] and not writable[k]:
                needed = past or not ends[k]
            elif needed:
                bound[k] = True
                needed = past or not ends[k]
        return bound

    def written(self, wanted: Floats, may: Bools) -> Mapping[int, float]:
        """Line -> value of its word, so that each run has ``wanted`` (K,).

        ``may`` (K,): line runs whose line may be written into.
        """
        values: dict[int, float] = {}
        known, value = True, 0.0
        columns = (
            self.line, self.own, wanted, self.sets, may, self._loose_before(), self.optional
        )  # fmt: skip
        for line, own, want, sets, writes, loose, optional in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            past = known, value
            if not known and loose:
                known, value = not self.uncertain, np.nan
            if sets and writes:
                values[line] = want
            elif sets and want != own:
                raise self._error(line, own, want)
            elif not sets and line in values and line > 0:
                pass
            elif not sets and want != (own if known else value):
                if not writes:
                    raise self._error(line, own, want)
                values[line] = want
            if sets or line in values:
                known, value = want == own, want
            if optional and past != (known, value) and not (known and past[0]):
                known, value = False, np.nan  # it depends on whether the line is left out
        return values

    def _depends(self) -> Bools:
        """LineRuns whose own value depends on whether lines with ``/`` are left out (K,)."""
        if self.loose_optional:
            return ~self.sets
        dependent, depends = np.zeros(len(self.line), dtype=np.bool_), False
        for k, (sets, optional) in enumerate(
            zip(self.sets.tolist(), self.optional.tolist(), strict=True)
        ):
            depends = optional if sets else depends
            dependent[k] = depends and not sets
        return dependent

    def _loose_before(self) -> Bools:
        """LineRuns before which a loose word may have been executed (K,)."""
        if self.uncertain:
            return np.ones(len(self.line), dtype=np.bool_)
        at = np.searchsorted(self.loose, self.line)
        return np.diff(at, prepend=0) != 0

    def _error(self, line: int, own: float, want: float) -> ValueError:
        return ValueError(
            f"line {line} is to have {self.letter}{want:g} in place of {self.letter}{own:g} and "
            "cannot be given that word: change only what editable_blocks says may be changed"
        )
