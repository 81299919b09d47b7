"""Stretches of runs between two polls: what was measured, and which rows it covers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Kind, Moves
from pipeline.identification.control.overrides import Operator, operator_of, stopped_within
from pipeline.identification.control.programs import CUTTING
from pipeline.identification.control.runs import Run
from pipeline.twin.program import Overrides
from pipeline.twin.simulation import TYPES, type_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

AUXILIARY = (Kind.TOOL_CHANGE, Kind.SPINDLE, Kind.STOP, Kind.M_CODE, Kind.DWELL, Kind.END)
@dataclass(frozen=True, kw_only=True)
class Observed:
    """One run, or matched part of one, with the rows of its program.

    Parameters
    ----------
    run : Run
        Lines numbered as in the program.
    program : str
        Its name.
    moves : Moves
        Of the program.
    operator : Operator
        What the operator did.
    unit : str
        Which of several machines of a kind.
    begin, end : ndarray of float, shape (N,)
        Of each segment in the recording [s].
    measured : ndarray of float, shape (N,)
        Its duration without stops [s].
    first, after : ndarray of int, shape (N,)
        Rows that it covers: ``first`` to before ``after``.
    """

    run: Run
    program: str
    moves: Moves
    operator: Operator
    unit: str
    begin: Floats
    end: Floats
    measured: Floats
    first: Ints
    after: Ints

    @property
    def overrides(self) -> Overrides:
        """What the operator set, by row."""
        line = self.moves.line
        return Overrides(
            feed=self.operator.feed[line],
            rapid=self.operator.rapid[line],
            spindle=self.operator.spindle[line],
        )


def observe(run: Run, program: str, moves: Moves, unit: str, shortest_s: float) -> Observed:
    """Cut a run into segments of at least ``shortest_s``, at polls that saw a later line."""
    operator = operator_of(run, moves)
    time, line = _rising(run)
    row = np.searchsorted(moves.line, line)
    time, row = np.append(time, run.end), np.append(row, _last_row(run, moves))
    if not run.completed:
        time, row = time[:-1], row[:-1]
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


def _rising(run: Run) -> tuple[Floats, Ints]:
    """Polls that saw a later line than any before, from the first line on."""
    line = run.line.value.astype(np.int64)
    highest = np.maximum.accumulate(np.concatenate([[0], line]))[:-1]
    keep = (line > highest) & (run.line.time >= run.start)
    return run.line.time[keep], line[keep]


def _last_row(run: Run, moves: Moves) -> int:
    return len(moves) if run.completed else int(np.searchsorted(moves.line, run.line.value.max()))


def _cuts(time: Floats, row: Ints, moves: Moves, shortest_s: float) -> Ints:
    """Indices of the polls that segments begin and end at.

    A segment is closed when it lasts long enough; and before what waits for the machine, so that
    waiting times stand apart from motion.
    """
    waits = np.isin(moves.kind, AUXILIARY)
    waits_before = np.concatenate([[0], np.cumsum(waits)])
    cut = [0]
    for i in range(1, len(time)):
        aux = waits_before[row[i]] - waits_before[row[cut[-1]]] > 0
        more = i + 1 < len(time) and waits_before[row[i + 1]] - waits_before[row[i]] > 0
        if time[i] - time[cut[-1]] >= shortest_s or aux or more:
            cut.append(i)
    if cut[-1] != len(time) - 1:
        cut.append(len(time) - 1)
    return np.array(cut, dtype=np.int64)


def shares(observed: Observed, times: Floats) -> dict[str, tuple[float, float]]:
    """Measured and predicted time of each type of row [s].

    What was measured of a segment goes to its types in proportion to what is predicted of them.
    """
    kinds = type_of(observed.moves.kind)
    found = dict.fromkeys(TYPES, (0.0, 0.0))
    for first, after, measured in zip(
        observed.first, observed.after, observed.measured, strict=True
    ):
        rows = slice(first, after)
        total = times[rows].sum()
        for word in np.unique(kinds[rows]):
            predicted = float(times[rows][kinds[rows] == word].sum())
            share = predicted / total if total > 0 else 1 / len(np.unique(kinds[rows]))
            before = found[str(word)]
            found[str(word)] = (before[0] + share * measured, before[1] + predicted)
    return {word: pair for word, pair in found.items() if pair != (0.0, 0.0)}


def naive_times(moves: Moves, feed_factor: Floats, rapid_speed: float) -> Floats:
    """Path over programmed feed, without acceleration or waiting: what simple estimators do [s].

    Parameters
    ----------
    feed_factor : ndarray, shape (rows,)
        Feed override [1].
    rapid_speed : float
        [mm/min].
    """
    cutting = np.isin(moves.kind, CUTTING) & (moves.feed > 0)
    speed = np.where(cutting, moves.feed * feed_factor, rapid_speed)
    times: Floats = np.where(cutting | (moves.kind == Kind.RAPID), moves.length / speed * 60, 0.0)
    return times


def clusters(observed: Sequence[Observed]) -> Ints:
    """Number of the cluster of each segment: neighbours share a poll and the same kind of work."""
    found, before = [], 0
    for one in observed:
        index = np.arange(len(one.measured)) // TOGETHER
        found.append(before + index)
        before += int(index.max(initial=-1)) + 1
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)


TOGETHER = 8
"""Segments in a cluster."""
