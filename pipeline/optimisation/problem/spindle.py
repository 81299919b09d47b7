"""Limits that a spindle sets: power and torque of its drive, changes of speed, chatter."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, no_load_power
from pipeline.cutting.stability.margins import StabilityTable
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.gcode.moves import Kind
from pipeline.machine.control.parameters import AuxiliaryParameters
from pipeline.machine.control.path import Path
from pipeline.machine.control.planner import Plan
from pipeline.machine.spindle import CUTTING, run_up_time
from pipeline.optimisation.problem.arrays import Editable, Ranges
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.limits import CutLimit
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.stability import table_of

NEAR = 1e-9
"""Rounding, as a share: two speeds count as one, a margin as kept."""
SLOWEST = 0.1
"""Slowest speed whose limits are computed, over the fastest; slower ones count as that one, where
the program has none of its own: lobes stand so close there that limits are nearly the same.
"""
COARSE = 0.012
"""Greatest step between two speeds whose limits are computed, over the speed."""
FINE = 0.35
"""Speed above which that holds, over the fastest; below it steps are up to 2.5 times as wide."""
MARGIN_FACTOR, MARGIN_ABOVE = 1.1, 0.05
"""Greatest margin resolved in a search: this share of the least that is allowed, and more."""


def allowed_power(spindle_speed: Floats, drive: SpindleDrive, limits: CutLimit) -> Floats:
    """Allowed motor power [W] at speeds [rev/min], less its margins; 0 above the top speed."""
    n = spindle_speed / 60
    margins = limits.margins
    margin = np.where(n < drive.base_speed, margins.torque, margins.power)
    power = np.nan_to_num(available_power(n, drive), nan=0.0)
    return limits.power_share * (1 - margin) * power


def allowed_torque(spindle_speed: Floats, drive: SpindleDrive, limits: CutLimit) -> Floats:
    """Mean torque over a turn that a cut may take [N m]; below 0 where idling takes all."""
    n = spindle_speed / 60
    cutting = allowed_power(spindle_speed, drive, limits) * drive.efficiency - no_load_power(
        n, drive
    )
    return np.divide(cutting, 2 * np.pi * n, out=np.full(n.shape, -np.inf), where=n > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedChanges:
    """Places where S can change in a program."""

    waiting: AuxiliaryParameters
    """Run-up of the spindle, and the control's waits for it."""
    added: Rows = field(repr=False)
    """Rows before which an S word could be added while the spindle turns, and be waited for;
    shape (A,)."""
    until: Rows = field(repr=False)
    """Row that waits for each of them; shape (A,)."""
    standstill: float
    """Time of a standstill before a wait: filters run empty, check of position [s]."""
    standing: Floats = field(repr=False)
    """Part of it that the program takes there anyway [s]; shape (A,)."""
    pairs: Rows = field(repr=False)
    """Rows of one tool, with no other between them in which the spindle turns, whose S may change;
    shape (N, 2)."""
    lead: Floats = field(repr=False)
    """Time from the second of each pair to the next cut, in rapids and at rest [s]; infinite where
    the spindle rests between them; shape (N,)."""

    @property
    def waits(self) -> bool:
        """Whether the control waits where S changes while the spindle turns."""
        return self.waiting.speed_change_waits and self.waiting.spindle_wait != "none"

    def time(self, before: ArrayLike, after: ArrayLike) -> Floats:
        """Greatest wait for a change of S [s] between speeds [rev/min] of shapes that broadcast."""
        old, new = np.broadcast_arrays(np.asarray(before, float), np.asarray(after, float))
        if not self.waits:
            return np.zeros(old.shape)
        most = self._change(old, new) + self.waiting.spindle_delay + self.standstill
        return np.where(new == old, 0.0, most)

    def add_waits(self, spindle_speed: Floats, time: Floats, wait: Floats) -> None:
        """Add to ``wait`` the waits for added S words, as for the program's own; all (P, M) [s]."""
        if not self.waits or not len(self.added):
            return
        old, new = spindle_speed[:, self.added - 1], spindle_speed[:, self.added]
        needed = self._change(old, new) + self.waiting.spindle_delay
        passed = np.cumsum(np.hstack([np.zeros((len(time), 1)), time + wait]), axis=1)
        needed -= passed[:, self.until] - passed[:, self.added]
        needed = np.maximum(needed, 0.0) + self.standstill - self.standing
        where = np.maximum(self.until - 1, self.added)
        np.add.at(wait.T, where, np.where(new == old, 0.0, needed).T)

    def ramp(self, before: ArrayLike, after: ArrayLike) -> Floats:
        """Time at another speed than commanded of a spindle that is not waited for [s]."""
        old, new = np.broadcast_arrays(np.asarray(before, float), np.asarray(after, float))
        if self.waits:
            return np.zeros(old.shape)
        return self._change(old, new)

    def _change(self, old: Floats, new: Floats) -> Floats:
        up, base = self.waiting.spindle_acceleration, self.waiting.spindle_base_speed
        rates = np.where(new < old, self.waiting.spindle_deceleration or up, up)
        return np.abs(run_up_time(new, rates, base) - run_up_time(old, rates, base))

    def violation(self, spindle_speed: Floats, least: float) -> Floats:
        """Violation by changes of S, (P,) of speeds (P, M) [rev/min].

        The sum of 1 - |dS| / least over changes that are too small, and of 1 - lead / ramp over
        those that the spindle is too slow for.
        """
        if not len(self.pairs):
            return np.zeros(len(spindle_speed))
        return self._too_small(spindle_speed, least) + self._too_late(spindle_speed)

    def _too_late(self, spindle_speed: Floats) -> Floats:
        if self.waits or not np.isfinite(self.waiting.spindle_acceleration):
            return np.zeros(len(spindle_speed))
        near = np.flatnonzero(np.isfinite(self.lead))
        pairs, lead = self.pairs[near], self.lead[near]
        needed = self.ramp(spindle_speed[:, pairs[:, 0]], spindle_speed[:, pairs[:, 1]])
        late = needed > lead * (1 + NEAR) + NEAR
        share = np.divide(lead, needed, out=np.ones(needed.shape), where=late)
        return (1.0 - share).sum(axis=1)

    def _too_small(self, spindle_speed: Floats, least: float) -> Floats:
        if not least > 0:
            return np.zeros(len(spindle_speed))
        step = np.abs(spindle_speed[:, self.pairs[:, 1]] - spindle_speed[:, self.pairs[:, 0]])
        small = (step > NEAR * least) & (step < (1 - NEAR) * least)
        share = np.divide(step, least, out=np.ones(step.shape), where=small)
        return (1.0 - share).sum(axis=1)


def speed_changes(plan: Plan, editable: Editable, cuts: NDArray[np.bool_]) -> SpeedChanges:
    """Places where S can change in a program; ``cuts`` (M,): rows that cut at feed."""
    path, free = plan.path, editable.speed
    moves = path.moves
    turning = moves.direction[1:] * moves.direction[:-1] > 0
    added = turning & (free[1:] | free[:-1]) & (moves.kind[1:] != Kind.SPINDLE)
    rows = np.flatnonzero(added) + 1
    until = _waiting(path, rows)
    row = np.flatnonzero((moves.direction != 0) & ~moves.constant_surface_speed)
    pairs = np.column_stack([row[:-1], row[1:]])
    same = moves.tool[pairs[:, 0]] == moves.tool[pairs[:, 1]]
    pairs = pairs[same & free[pairs].any(axis=1)]
    lead = leads(plan, editable, cuts)[pairs[:, 1]]
    known = until < len(moves)
    standstill = float(path.control.filters[1].sum()) + path.control.settle_time
    return SpeedChanges(
        waiting=path.control.auxiliary,
        added=rows[known],
        until=until[known],
        standstill=standstill,
        standing=np.minimum(_pauses(path)[until[known]], standstill),
        pairs=pairs,
        lead=np.where(pairs[:, 1] == pairs[:, 0] + 1, lead, np.inf),
    )


def _pauses(path: Path) -> Floats:
    """Standstill of the last row that moves before each row, all of it where none does; (M,)."""
    moving = np.append(-1, np.flatnonzero(path.moving))
    last = moving[np.searchsorted(moving, np.arange(len(path))) - 1]
    return np.where(last >= 0, path.pause[last], np.inf)


def leads(plan: Plan, editable: Editable, cuts: NDArray[np.bool_]) -> Floats:
    """Time from the start of each row to the next cut, in rapids and at rest [s]; shape (M,)."""
    passed = np.concatenate([[0.0], np.cumsum(np.where(editable.block < 0, plan.time, 0.0))])
    next_cut = np.append(np.flatnonzero(cuts), len(cuts))
    row = np.arange(len(cuts))
    return passed[next_cut[np.searchsorted(next_cut[:-1], row)]] - passed[row]


def _waiting(path: Path, rows: Rows) -> Rows:
    """First row that waits for S words before ``rows``; the number of rows where none does."""
    moves, wait = path.moves, path.control.auxiliary.spindle_wait
    if wait == "next_line":
        other = (np.diff(moves.line) != 0) | (np.diff(moves.file) != 0)
        candidates, side = np.flatnonzero(other) + 1, "right"
    elif wait == "before_cutting":
        candidates, side = np.flatnonzero(np.isin(moves.kind, CUTTING)), "left"
    else:
        return rows
    index = np.searchsorted(candidates, rows, side=side)  # type: ignore[call-overload]
    return np.append(candidates, len(moves))[index]


@dataclass(frozen=True, kw_only=True, eq=False)
class Chatter:
    """Stability of a cut over spindle speeds."""

    table: StabilityTable

    def margins(self, spindle_speed: Floats) -> Floats:
        """Least stability margin of each row [1] at S (M,) [rev/min]; inf in air."""
        return self.table.margins(np.clip(spindle_speed, *(60 * self.table.nodes[[0, -1]])))

    def violation(self, spindle_speed: Floats, least: Floats) -> Floats:
        """Sum over rows of (1 + least) / (1 + margin) - 1 where above 0; (P,) of (P, M) S."""
        over = (1.0 + least) / np.maximum(1.0 + self.margins(spindle_speed), NEAR) - 1.0
        return np.where(over > NEAR, over, 0.0).sum(axis=1)  # NaN: no dynamics


def chatter_of(
    cut: Cut, blocks: CutBlocks, dynamics: TipDynamics | None, ranges: Ranges,
    free: NDArray[np.bool_], least: float,
) -> Chatter | None:  # fmt: skip
    """Stability over the speeds that rows may have, those of the program where S is kept.

    Margins are resolved a little above ``least``, that of the part [1].  None where nothing that is
    milled has known dynamics.
    """
    row = blocks.row
    own, mine = cut.plan.spindle_speed[row], free[row]
    low = float(np.where(mine, ranges.speed_low[row], own).min(initial=np.inf))
    high = float(np.where(mine, ranges.speed_high[row], own).max(initial=0.0))
    if dynamics is None or not high > 0.0:
        return None
    nodes = speed_nodes(max(low, SLOWEST * high), high)
    nodes = np.unique(np.concatenate([nodes, own[own > 0.0]]))
    nodes = nodes[np.diff(nodes, prepend=0.0) > NEAR * nodes]  # the same speed, but for rounding
    found = table_of(cut, blocks, dynamics, nodes, MARGIN_FACTOR * least + MARGIN_ABOVE)
    return None if found is None else Chatter(table=_deepest(found[0]))


def speed_nodes(low: float, high: float) -> Floats:
    """Speeds from ``low`` to ``high`` [rev/min] at which limits are computed.

    Round ones, 0.5 to 1.2 % apart and more below a third of the fastest.
    """
    steps = [unit * 10.0**power for power in range(-3, 7) for unit in (1.0, 2.5, 5.0)]
    parts = [np.array([low, high])]
    for coarse, begin, end in ((2.5 * COARSE, low, FINE * high), (COARSE, FINE * high, high)):
        for step, next_step in pairwise(steps):
            first = np.ceil(max(begin, low, step / coarse) / step)
            last = np.floor(min(end, next_step / coarse) / step)
            parts.append(step * np.arange(first, last + 1))
    return np.unique(np.concatenate(parts))


def _deepest(table: StabilityTable) -> StabilityTable:
    """The same margins from the deepest station of each class in each block."""
    order = np.lexsort((-table.depth, table.kind, table.block))
    block, kind = table.block[order], table.kind[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(block) != 0) | (np.diff(kind) != 0)
    kept = order[first]
    return replace(table, kind=table.kind[kept], block=table.block[kept], depth=table.depth[kept])
