"""Segments of runs between two polls of the line number: measured duration, rows covered."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.gcode.moves import AXES, Kind, Moves
from pipeline.schema.arrays import Floats, Ints
from pipeline.submodels.control.runs import (
    STEADY,
    Operator,
    Run,
    lines_at,
    operator_of,
    plateau,
    steady,
    stopped_within,
)
from pipeline.twin.control import Overrides
from pipeline.twin.simulation import TYPES, type_of

WAITS = (Kind.TOOL_CHANGE, Kind.SPINDLE, Kind.STOP, Kind.M_CODE, Kind.DWELL, Kind.END)
TIME = "run time"
"""Quantity: time of a whole run, or of its rows of one type, without the operator's stops [s]."""
NAIVE, OVERRIDE_ONLY = "path over programmed feed", "recorded override only"
"""Baselines: no acceleration or waiting; overrides as recorded, feeds not read from speeds."""
TOGETHER = 8
"""Segments in a cluster."""


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Run, or matched part of one, with the rows of its program."""

    run: Run
    """Lines numbered as in the program."""
    program: str
    """Its name."""
    moves: Moves
    """Moves of the program."""
    operator: Operator
    """Overrides and stops of the operator."""
    unit: str
    """Unit among several machines of a kind."""
    begin: Floats
    end: Floats
    """Begin and end of each segment in the recording [s]; shape (N,)."""
    measured: Floats
    """Its duration without stops [s]; shape (N,)."""
    first: Ints
    after: Ints
    """Rows that it covers: ``first`` to before ``after``; shape (N,)."""

    @property
    def overrides(self) -> Overrides:
        """Overrides of the operator, by row."""
        line = self.moves.line
        return Overrides(
            feed=self.operator.feed[line],
            rapid=self.operator.rapid[line],
            spindle=self.operator.spindle[line],
        )


def observe(run: Run, program: str, moves: Moves, unit: str, shortest_s: float) -> Observed:
    """Segments of a run of at least ``shortest_s`` [s], waits excepted, cut at new lines."""
    operator = operator_of(run, moves)
    time, row = _polls(run, moves)
    cut = _cuts(time, row, moves, shortest_s)
    begin, end = time[cut[:-1]], time[cut[1:]]
    return Observed(
        run=run,
        program=program,
        moves=moves,
        operator=operator,
        unit=unit,
        begin=begin,
        end=end,
        measured=end - begin - stopped_within(operator.stops, begin, end),
        first=row[cut[:-1]],
        after=row[cut[1:]],
    )


def _polls(run: Run, moves: Moves) -> tuple[Floats, Ints]:
    """Polls that saw a later line than any before, and the first row of that line.

    A program that ran to its end was last seen there, behind its last row.
    """
    line = run.line.value.astype(np.int64)
    highest = np.maximum.accumulate(np.concatenate([[0], line]))[:-1]
    keep = (line > highest) & (run.line.time >= run.start)
    time, row = run.line.time[keep], np.searchsorted(moves.line, line[keep]).astype(np.int64)
    if run.completed:
        time, row = np.append(time, run.end), np.append(row, len(moves))
    return time, row


def _cuts(time: Floats, row: Ints, moves: Moves, shortest_s: float) -> Ints:
    """Indices of the polls that segments begin and end at; none or at least two.

    A segment is closed when it lasts long enough; and before what waits for the machine, so that
    waiting times stand apart from motion.  None is closed before the program's end: its line shows
    while the last move is still under way, since nothing is left to be read ahead.
    """
    if len(time) < 2:
        return np.empty(0, dtype=np.int64)
    waits = np.concatenate([[0], np.cumsum(np.isin(moves.kind, WAITS))])[row]
    ends = np.append(moves.kind, Kind.END)[row] == Kind.END
    cut = [0]
    for i in range(1, len(time) - 1):
        if ends[i]:
            continue
        waited, will_wait = waits[i] > waits[cut[-1]], waits[i + 1] > waits[i]
        if time[i] - time[cut[-1]] >= shortest_s or waited or will_wait:
            cut.append(i)
    return np.array([*cut, len(time) - 1], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Share:
    """Time of the rows of one type in a run [s]."""

    measured: float
    predicted: float
    """Measured and predicted time [s]; a segment's measured time is split over its types in
    proportion to the predicted times."""
    late: float
    """Half width of the interval that late stamps at the ends of the segments leave."""


def shares(observed: Observed, times: Floats) -> dict[str, Share]:
    """Measured and predicted time of each type of row, from row ``times``, (rows,) [s]."""
    own = {w: type_of(observed.moves.kind) == w for w in TYPES}
    time = {w: _within(observed, times * mine) for w, mine in own.items()}
    rows = {w: _within(observed, mine.astype(float)) > 0 for w, mine in own.items()}
    total, kinds = sum(time.values()), sum(there.astype(float) for there in rows.values())
    found = {}
    for word in TYPES:
        if rows[word].any():
            even = rows[word] / np.maximum(kinds, 1.0)
            share = np.divide(time[word], total, out=even, where=total > 0)
            found[word] = Share(
                measured=float(share @ observed.measured),
                predicted=float(time[word].sum()),
                late=late(share, observed.run.latency),
            )
    return {word: one for word, one in found.items() if one.measured or one.predicted}


def _within(observed: Observed, amount: Floats) -> Floats:
    """Sum over the rows of each segment of what they have each; shape (N,)."""
    until = np.concatenate([[0.0], np.cumsum(amount)])
    return until[observed.after] - until[observed.first]


def late(share: Floats, latency: float) -> float:
    """Half width of a time made of shares of adjoining segments, whose stamps may be late [s].

    A stamp moves the shares on its two sides against each other.  A single stretch is off by
    ``latency`` at most, several by the root of the sum of squares.

    >>> round(late(np.array([1.0]), 0.2), 3), round(late(np.array([1.0, 0.0, 1.0]), 0.2), 3)
    (0.2, 0.283)
    """
    moved = np.diff(share, prepend=0.0, append=0.0)
    return latency * float(np.sqrt((moved**2).sum() / 2))


def clusters(observed: Sequence[Observed]) -> Ints:
    """Number of the cluster of each segment: neighbours share a poll and the same kind of work."""
    found, before = [], 0
    for one in observed:
        index = np.arange(len(one.measured)) // TOGETHER
        found.append(before + index)
        before += int(index.max(initial=-1)) + 1
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Rate:
    """A rapid rate with its 95 % interval [mm/min]."""

    value: float
    low: float
    high: float


def rapid_rates(observed: Sequence[Observed]) -> dict[str, Rate]:
    """Rapid rate of each axis that rapids of one machine show, by its letter.

    A rapid of several axes is as fast as the axis with the longest travel allows, so that a steady
    reading tells the rate of that axis: speed along the path x its share of the path / override.
    """
    if not observed:
        return {}
    axes, speeds = zip(*(_readings(one) for one in observed), strict=True)
    axis, speed = np.concatenate(axes), np.concatenate(speeds)
    found = {AXES[i]: _rate(speed[axis == i]) for i in np.unique(axis)}
    return {letter: rate for letter, rate in found.items() if rate is not None}


def _readings(one: Observed) -> tuple[Ints, Floats]:
    """Leading axis and its speed at an override of 100 % [mm/min] at each steady reading."""
    moves, run = one.moves, one.run
    rapid_of = _rapid_of_lines(moves)
    feed = run.feed.polled()
    row = rapid_of[lines_at(run, feed.time, len(rapid_of))]
    override = run.rapid_override.at(feed.time, before=100.0) / 100
    scaled = np.divide(
        feed.value, override, out=np.full_like(feed.value, np.nan), where=override > 0
    )
    same = np.concatenate([[-1], row])[:-1] == row
    kept = (row >= 0) & same & steady(scaled)
    step = np.abs(moves.end - moves.start)[row[kept], :3]
    share = step / moves.length[row[kept], None]
    return share.argmax(axis=1), scaled[kept] * share.max(axis=1) * 60


def _rapid_of_lines(moves: Moves) -> Ints:
    """The row of the only rapid of each line, -1 where there is none or are several."""
    rapid = np.flatnonzero((moves.kind == Kind.RAPID) & (moves.length > 0))
    row_of = np.full(int(moves.line.max(initial=0)) + 1, -1)
    row_of[moves.line[rapid]] = rapid
    row_of[np.bincount(moves.line[rapid], minlength=len(row_of)) > 1] = -1
    return row_of


def _rate(speed: Floats) -> Rate | None:
    """The level that the readings share: short rapids stay below it."""
    top = float(np.max(speed))
    level = plateau(speed / top, 2 * STEADY) if top > 0 else None
    if level is None:
        return None
    value = level * top
    near = speed[np.abs(speed / value - 1) < 2 * STEADY]
    half = max(2 * float(np.std(near)), STEADY * value / 2)
    return Rate(value=value, low=value - half, high=value + half)
