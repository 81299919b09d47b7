"""Groups of blocks before and after: their F and S, time, cost, load, and what binds them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.optimisation.optimise import Result
from pipeline.optimisation.problem.constraints import CONSTRAINTS
from pipeline.twin.cut import Cut
from pipeline.twin.cut_document import AssessedCut
from pipeline.twin.cut_tables import figure

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """A program, before or after, by the M rows that it had before.

    Parameters
    ----------
    cut, of : Cut, Judged
        Of its own M' rows.
    time, cost : ndarray, shape (M,)
        Of each row with those that were added before it [s], [currency]; NaN where not known.
    feed, speed : ndarray, shape (M,)
        F and S, in the units of ``Moves``.
    peak : ndarray, shape (M,)
        Greatest load of each row [N].
    """

    cut: Cut = field(repr=False)
    of: AssessedCut = field(repr=False)
    time: Floats = field(repr=False)
    cost: Floats = field(repr=False)
    feed: Floats = field(repr=False)
    speed: Floats = field(repr=False)
    peak: Floats = field(repr=False)

    @classmethod
    def of_rows(cls, cut: Cut, of: AssessedCut, rows: Rows) -> "Side":
        """``rows`` (M,) are those of the cut that the rows before have become."""
        moves, cost = cut.plan.path.moves, of.found.cost
        owner = np.minimum(np.searchsorted(rows, np.arange(len(moves))), len(rows) - 1)
        each = np.full(len(moves), np.nan) if cost is None else cost.block
        return cls(
            cut=cut, of=of,
            time=np.bincount(owner, cut.plan.time, minlength=len(rows)).astype(np.float64),
            cost=np.bincount(owner, each, minlength=len(rows)).astype(np.float64),
            feed=moves.feed[rows], speed=moves.speed[rows], peak=cut.block_loads.peak[rows],
        )  # fmt: skip


def group_rows(result: Result, before: Side, after: Side) -> list[dict[str, Any]]:
    """Each run of blocks of one F and one S, in the order of the program."""
    moves, decision = result.moves, result.answer.decision
    binds = result.problem.binding(decision.row_feeds, decision.row_speeds)
    per_turn = result.before.plan.path.motion == Motion.PER_TURN
    return [
        {
            "first_line": int(moves.line[rows].min()),
            "last_line": int(moves.line[rows].max()),
            "tool": int(moves.tool[rows[0]]),
            "feed_before": _mean(before.feed, before.time, rows),
            "feed_after": _mean(after.feed, after.time, rows),
            "feed_unit": "mm/rev" if per_turn[rows[0]] else "mm/min",
            "speed_before": _mean(before.speed, before.time, rows),
            "speed_after": _mean(after.speed, after.time, rows),
            "time_before_s": figure(float(before.time[rows].sum())),
            "time_after_s": figure(float(after.time[rows].sum())),
            "cost_before": figure(float(before.cost[rows].sum())),
            "cost_after": figure(float(after.cost[rows].sum())),
            "peak_load_before_N": figure(float(before.peak[rows].max())),
            "peak_load_after_N": figure(float(after.peak[rows].max())),
            "binds": _binds(binds, after.time, rows[result.problem.cuts[rows]]),
        }
        for rows in _runs(result)
    ]  # fmt: skip


def _runs(result: Result) -> list[Rows]:
    """Rows of each group; what neither cuts nor has an F of its own to change is in none."""
    groups, moves = result.answer.decision.groups, result.moves
    rows = np.flatnonzero((groups.feed >= 0) | result.problem.cuts)
    if not len(rows):
        return []
    per_turn = result.before.plan.path.motion == Motion.PER_TURN
    keys = np.stack([groups.feed, groups.speed, moves.tool, moves.file, per_turn])[:, rows]
    edges = np.flatnonzero((np.diff(keys, axis=1) != 0).any(axis=0)) + 1
    return np.split(rows, edges)


def _mean(values: Floats, seconds: Floats, rows: Rows) -> float | None:
    """Of the rows, each counted by its time; by their number where they take none."""
    weights = seconds[rows] if seconds[rows].sum() > 0 else np.ones(len(rows))
    if np.ptp(values[rows]) == 0:
        return figure(float(values[rows[0]]))
    return figure(float(values[rows] @ weights / weights.sum()))


def _binds(binds: Rows, seconds: Floats, rows: Rows) -> str | None:
    """What binds for the longest; None where nothing does for longer."""
    if not len(rows):
        return None
    times = np.bincount(binds[rows] + 1, seconds[rows], minlength=len(CONSTRAINTS) + 1)
    worst = int(np.argmax(times)) - 1
    return CONSTRAINTS[worst] if worst >= 0 else None
