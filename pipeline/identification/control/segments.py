"""Stretches of runs between two polls: what was measured, and which rows it covers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Kind, Moves
from pipeline.identification.control.overrides import Operator, operator_of
from pipeline.identification.control.runs import Run
from pipeline.identification.control.spans import stopped_within
from pipeline.twin.program import Overrides
from pipeline.twin.simulation import TYPES, type_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WAITS = (Kind.TOOL_CHANGE, Kind.SPINDLE, Kind.STOP, Kind.M_CODE, Kind.DWELL, Kind.END)
TOGETHER = 8
"""Segments in a cluster."""


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
    """Cut a run into segments, at polls that saw a later line.

    Parameters
    ----------
    run : Run
        Lines numbered as in the program.
    program : str
        Its name.
    moves : Moves
        Of the program.
    unit : str
        Which of several machines of a kind.
    shortest_s : float
        Segments last at least as long [s], those of waits excepted.
    """
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
    waiting times stand apart from motion.
    """
    if len(time) < 2:
        return np.empty(0, dtype=np.int64)
    waits = np.concatenate([[0], np.cumsum(np.isin(moves.kind, WAITS))])[row]
    cut = [0]
    for i in range(1, len(time) - 1):
        waited, will_wait = waits[i] > waits[cut[-1]], waits[i + 1] > waits[i]
        if time[i] - time[cut[-1]] >= shortest_s or waited or will_wait:
            cut.append(i)
    return np.array([*cut, len(time) - 1], dtype=np.int64)


def shares(observed: Observed, times: Floats) -> dict[str, tuple[float, float]]:
    """Measured and predicted time of each type of row [s].

    What was measured of a segment goes to its types in proportion to what is predicted of them.

    Parameters
    ----------
    observed : Observed
        What was measured.
    times : ndarray, shape (rows,)
        Predicted time of each row of the program [s].
    """
    kinds = type_of(observed.moves.kind)
    measured, predicted = dict.fromkeys(TYPES, 0.0), dict.fromkeys(TYPES, 0.0)
    for first, after, duration in zip(
        observed.first, observed.after, observed.measured, strict=True
    ):
        rows = slice(first, after)
        total = float(times[rows].sum())
        words = np.unique(kinds[rows]).tolist()
        for word in words:
            of_type = float(times[rows][kinds[rows] == word].sum())
            share = of_type / total if total > 0 else 1 / len(words)
            measured[word] += share * float(duration)
            predicted[word] += of_type
    return {w: (measured[w], predicted[w]) for w in TYPES if measured[w] or predicted[w]}


def clusters(observed: Sequence[Observed]) -> Ints:
    """Number of the cluster of each segment: neighbours share a poll and the same kind of work."""
    found, before = [], 0
    for one in observed:
        index = np.arange(len(one.measured)) // TOGETHER
        found.append(before + index)
        before += int(index.max(initial=-1)) + 1
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)
