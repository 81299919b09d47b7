"""Editable blocks of a program: which F and S may change, and why the others may not.

F and S are modal: a block may change only where every line that reads its F afterwards can be given
its own again.  Line runs read the register of F or S along a program; a new word must leave every
run of a line its value, in whatever order the lines are executed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.text.words import NONE, OTHER, FeedText, ProgramWords
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.part import HeldRows

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
    return fed & (moves.end == moves.start).all(axis=1)


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
        columns = (self.line, self.own, wanted, self.sets, may, self._loose_before(), self.optional)
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


Reasons = Sequence[tuple[str, Bools]]

SELF = "the program's own expressions may read F and S"
ELSEWHERE = "it is in another file"
PITCH = "it is a thread or a tapping cycle, where F is bound to S"
PROBES = "it probes"
CLOSED = "its line calls, computes or sets something, and nothing is written into it"


def editable_blocks(
    program: Program, moves: Moves, kept_feed: Reasons = (), kept_speed: Reasons = (),
    no_more: Reasons = (),
) -> Editable:  # fmt: skip
    """Blocks of a program whose F and S may change, in the order of their lines.

    ``kept_feed``, ``kept_speed`` and ``no_more``: rows (M,) that keep their F, their S, or whose F
    and S may not rise, by reason.
    """
    places = places_of(program, moves, kept_feed, kept_speed)
    speed = places.speed
    lines = np.unique(moves.line[places.feed_free])
    block = np.full(len(moves), -1, dtype=np.intp)
    block[places.feed_free] = np.searchsorted(lines, moves.line[places.feed_free])
    may_start, own_start = np.zeros((2, len(moves)), dtype=np.bool_)
    may_start[speed.row[places.speed_may]] = True
    own_start[speed.row[places.speed_may & speed.sets]] = True
    cutting = reads_feed(moves)
    held = [
        *_held("F", places.feed_reasons, cutting & ~places.feed_free, moves),
        *_held("S", places.speed_reasons, cutting & at_speed(moves) & ~places.speed_free, moves),
        *_held("F and S", no_more, cutting, moves),
    ]
    return Editable(
        block=block, line=lines.astype(np.intp), speed=places.speed_free, may_start=may_start,
        own_start=own_start, held=tuple(held),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Places where F and S are read along a program, and where they may be written."""

    words: ProgramWords
    """Words of the text."""
    line_runs: LineRuns = field(repr=False)
    """Line runs of the program."""
    feed: ModalWords = field(repr=False)
    speed: ModalWords = field(repr=False)
    """LineRuns that read F, and S."""
    feed_may: Bools = field(repr=False)
    speed_may: Bools = field(repr=False)
    """Line runs whose line may be given a word, or another in its place."""
    feed_free: Bools = field(repr=False)
    speed_free: Bools = field(repr=False)
    """Rows whose F, S may be changed; shape (M,)."""
    feed_reasons: Reasons = field(repr=False)
    speed_reasons: Reasons = field(repr=False)
    """Reasons why others may not, first reasons first."""


def places_of(
    program: Program, moves: Moves, kept_feed: Reasons = (), kept_speed: Reasons = ()
) -> Places:
    """Places where F and S of a program are read and may be written."""
    words, line_runs = ProgramWords(program), LineRuns.among(moves)
    feed = ModalWords.along("F", words, line_runs, reads_feed(moves), moves.feed)
    speed = ModalWords.along("S", words, line_runs, at_speed(moves), moves.speed)
    feed_reasons = _feed_reasons(words, line_runs, moves)
    free = cuts_at_feed(moves) & ~_any(feed_reasons)
    may = free[feed.row]
    bound = np.isin(feed.line, feed.line[feed.handed_on(~may, may)]) & may
    stands = _lines_with(moves, free & ~at_speed(moves))
    handed = _rows(feed, bound, line_runs)
    kept = [(reason, _lines_with(moves, rows & reads_feed(moves))) for reason, rows in kept_feed]
    feed_reasons += [
        ("the spindle stands", stands),
        ("the lines after it take its F, and cannot be given one", handed),
        *kept,
    ]
    free &= ~_any([("", stands), *kept])
    speed_may, speed_reasons = _speed_places(words, line_runs, speed, moves, kept_speed)
    return Places(
        words=words, line_runs=line_runs, feed=feed, speed=speed, feed_may=may, speed_may=speed_may,
        feed_free=free & ~handed, speed_free=at_speed(moves) & ~_any(speed_reasons),
        feed_reasons=feed_reasons, speed_reasons=speed_reasons,
    )  # fmt: skip


def _feed_reasons(
    words: ProgramWords, line_runs: LineRuns, moves: Moves
) -> list[tuple[str, Bools]]:
    """Reasons why the F of rows may not change (M,), but for what is handed on."""
    file_line = np.where(moves.file == 0, moves.line, 0)
    cutting, token = cuts_at_feed(moves), words.token("F")[file_line]
    text = FeedText.of(words, moves)
    reasons: list[tuple[str, Bools]] = [
        (SELF, np.full(len(moves), words.reads_itself)),
        (ELSEWHERE, moves.file != 0),
        (PITCH, (moves.kind == Kind.THREAD) | line_runs.taps[line_runs.of]),
        (PROBES, moves.kind == Kind.PROBE),
        ("G93 is in force", moves.feed_mode == FeedMode.INVERSE_TIME),
        ("F is an expression, or stands twice in the line", token == OTHER),
        (CLOSED, words.closed[file_line]),
        ("G20 and G21 are both in a program that jumps", np.full(len(moves), words.unit is None)),
        ("rotary axes move alone in a program in inches", _turns_alone(words, moves, text.unit)),
        ("its F comes of an expression", text.rounded(np.maximum(moves.feed, 1e-9)) != moves.feed),
    ]
    reading = reads_feed(moves)
    other = reading & (_any(reasons) | ~cutting | _differs(moves, file_line, reading))
    reasons.append(("another pass through its line needs another F", _lines_with(moves, other)))
    return reasons


def _lines_with(moves: Moves, rows: Bools) -> Bools:
    """Rows of the program's own lines that some rows come of (M,)."""
    own = moves.file == 0
    return np.isin(moves.line, np.unique(moves.line[rows & own])) & own


def _turns_alone(words: ProgramWords, moves: Moves, unit: Floats) -> Bools:
    """Rows whose F may count degrees, which know no inch (M,)."""
    linear = np.zeros(len(words.program) + 1, dtype=np.bool_)
    for letter in "XYZ":
        linear |= words.token(letter) != NONE
    inside = np.where(moves.file == 0, moves.line, 0)
    return (unit != 1.0) & ~linear[inside] & (moves.kind == Kind.FEED)


def _differs(moves: Moves, line: Rows, reading: Bools) -> Bools:
    """Rows of lines that are passed with several feeds or feed modes (M,)."""
    own = np.stack([line, moves.feed_mode, moves.feed])[:, reading]
    passes = np.unique(own, axis=1)[0].astype(np.intp)
    return (np.bincount(passes, minlength=line.max(initial=0) + 1) > 1)[line]


def _speed_places(
    words: ProgramWords, line_runs: LineRuns, speed: ModalWords, moves: Moves, kept: Reasons
) -> tuple[Bools, list[tuple[str, Bools]]]:
    """LineRuns whose line may take an S word (K,), and why the S of rows may not change (M,)."""
    line, inside = speed.line, np.where(moves.file == 0, moves.line, 0)
    token = words.token("S")
    may = (line > 0) & ~words.closed[line] & (token[line] != OTHER) & ~line_runs.again[speed.run]
    may &= ~np.bool_(words.reads_itself or speed.uncertain)
    starts = (moves.kind == Kind.SPINDLE) & (moves.direction != 0)
    may &= speed.sets | line_runs.any(starts | (moves.length > 0))[speed.run]
    may &= ~moves.constant_surface_speed[speed.row] & (speed.own == np.rint(speed.own))
    may = _certain_after(speed, may)
    everywhere = np.ones(len(moves), dtype=np.bool_)
    reasons: list[tuple[str, Bools]] = [
        (SELF, everywhere & words.reads_itself),
        (ELSEWHERE, moves.file != 0),
        (PITCH, (moves.kind == Kind.THREAD) | line_runs.taps[line_runs.of]),
        (PROBES, moves.kind == Kind.PROBE),
        ("G96 is in force", moves.constant_surface_speed),
        ("S is no whole number", moves.speed != np.rint(moves.speed)),
        (CLOSED, words.closed[inside] & (token[inside] != NONE)),
        ("S words stand alone in a program that jumps", everywhere & speed.uncertain),
        *((reason, rows & at_speed(moves)) for reason, rows in kept),
    ]
    keeps = line_runs.any(_any(reasons) & at_speed(moves))[speed.run]
    keeps |= speed.sets & ~may
    after = _until_a_start(keeps | speed.handed_on(keeps, may), may)
    reasons.append(
        (
            "no line before takes an S word that holds only from there",
            _rows(speed, after, line_runs),
        )
    )
    return may, reasons


def _certain_after(speed: ModalWords, may: Bools) -> Bools:
    """``may`` without lines with ``/`` before one that takes no word: it would not know its S."""
    certain, ends = may.copy(), speed.sets & ~speed.optional
    for k in range(len(may) - 2, -1, -1):
        if speed.optional[k] and not (certain[k + 1] or ends[k + 1]):
            certain[k] = False
    return certain


def _until_a_start(keeps: Bools, may: Bools) -> Bools:
    """LineRuns that keep S, with those after them up to the next that may be given one (K,)."""
    kept, keeping = keeps.copy(), True
    for k, (holds, starts) in enumerate(zip(keeps.tolist(), may.tolist(), strict=True)):
        keeping = holds or (keeping and not starts)
        kept[k] = keeping
    return kept


def _any(reasons: Reasons) -> Bools:
    return np.logical_or.reduce([rows for _, rows in reasons])


def _rows(modal: ModalWords, chosen: Bools, line_runs: LineRuns) -> Bools:
    flags = np.zeros(len(line_runs.line), dtype=np.bool_)
    flags[modal.run[chosen]] = True
    return flags[line_runs.of]


def _held(letter: str, reasons: Reasons, left: Bools, moves: Moves) -> Iterator[HeldRows]:
    for reason, rows in reasons:
        first_held = np.flatnonzero(rows & left)
        if len(first_held):
            first = f"{moves.files[moves.file[first_held[0]]]}:{moves.line[first_held[0]]}"
            yield HeldRows(reason=f"{letter}: {reason}", rows=len(first_held), first=first)
        left = left & ~rows
