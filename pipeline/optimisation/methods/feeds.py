"""Best feed of each block at given spindle speeds: exact where blocks do not interact.

Limits of a row hold its feed for each tooth f_z and its F; at one S they are one interval of F:

    max(F_low, f_z_low N S) <= F <= min(F_high, f_z_high N S, f_z_power(S) N S)

in the row's own units.  Feeds faster than axes, arcs and tolerances allow (``Path.cap``) change
nothing; where the tool descends in air F is at most as programmed.  Rows that share an F have to
suit all their intervals.  Time falls with F; where wear depends on f_z the best F may lie inside
and is found by golden section.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import plan
from pipeline.optimisation.problem.arrays import RowGroups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES
from pipeline.optimisation.text.words import ROUNDING, rounded_down
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.part import Objective
from pipeline.schema.si import HOUR

SLACK = 1e-9
"""Share of the greatest F kept free, so that no rounding of products passes a limit."""
ROUNDED = 1.01 * ROUNDING
"""Share of the least F kept free: words round F down."""
TINY = 1e-9
"""Value below any F that a word holds."""
REACHED = 1.0 - 1e-6
"""Share of its F from which on a row counts as fast as that."""
STEP = 1e-4
"""Step below the greatest feed, as a share, at which the objective is compared with that at it."""
GOLDEN = (np.sqrt(5) - 1) / 2
SECTIONS = 32
AT_ONCE = 2**18
"""Rows times individuals of one pass."""


def feed_bounds(problem: Problem, speeds: Floats) -> tuple[Floats, Floats]:
    """Least and greatest F of each row at S (P, M) [rev/min], in the units of ``Moves``.

    Shape (P, M) each; the least is infinite where no F is allowed at that S.
    """
    path, cuts = problem.cut.plan.path, problem.cuts
    spindle_speed = np.where(path.moves.direction == 0, 0.0, speeds)
    engaged = cuts & (spindle_speed > 0)
    teeth = np.where(engaged, problem.flutes * spindle_speed / 60, 0.0)
    with np.errstate(invalid="ignore"):
        most = np.minimum(problem.bounds.high, problem.power_f_z(speeds)) * teeth
        most = np.where(engaged, most, np.inf)
        least = np.where(engaged, problem.bounds.least * teeth, 0.0)
    allowed = (problem.ranges.speed_low <= speeds) & (speeds <= problem.ranges.speed_high)
    allowed |= ~problem.ranges.counted
    allowed &= (problem.stable(speeds) | ~engaged) & (least <= path.cap * (1 + SLACK))
    scale, in_F = (
        _scale(problem, spindle_speed),
        np.where(_per_turn(problem) & (spindle_speed > 0), spindle_speed, 1.0),
    )
    high = np.where(most < path.cap, most / scale, np.inf)
    high = np.minimum(high, problem.ranges.feed_high / in_F)
    low = np.maximum(least / scale, problem.ranges.feed_low / in_F)
    return np.where(allowed, low, np.inf), high


def common_bounds(
    problem: Problem, groups: RowGroups, low: Floats, high: Floats, speeds: Floats
) -> tuple[Floats, Floats]:
    """Interval of F that suits all rows of each group, (P, U) each, empty where low > high.

    It reaches up to F as programmed where that is allowed, and holds after a word rounds F down; an
    interval too narrow for that is one F.  ``low`` and ``high`` (P, M): of :func:`feed_bounds`;
    ``speeds`` (P, M): [rev/min].
    """
    path = problem.cut.plan.path
    spindle_speed = np.where(path.moves.direction == 0, 0.0, speeds)
    least, most = groups.intersection(low, high)
    useful = groups.greatest(np.broadcast_to(path.cap / _scale(problem, spindle_speed), low.shape))
    wide = least * (1 + ROUNDED) <= most * (1 - SLACK)
    own = groups.common(path.moves.feed)
    allowed = (least <= own) & (own <= most)
    useful = np.maximum(useful, np.where(allowed, own, 0.0))
    kept = np.where(allowed, own, rounded_down(np.maximum(most, TINY)))
    least = np.where(wide, least * (1 + ROUNDED), np.where(kept >= least, kept, np.inf))
    most = np.where(wide, np.clip(useful, least, most * (1 - SLACK)), kept)
    return least, most


def _scale(problem: Problem, spindle_speed: Floats) -> Floats:
    """Speed along the path for one unit of F [m/s]; 1 where nothing moves."""
    path = problem.cut.plan.path
    scale = path.factor * np.where(_per_turn(problem), spindle_speed, 1.0)
    return np.where(scale > 0, scale, 1.0)


def _per_turn(problem: Problem) -> NDArray[np.bool_]:
    return problem.cut.plan.path.motion == Motion.PER_TURN


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockModel:
    """M rows of a problem and the objective to be minimised, reckoned row by row.

    A row runs at its F, or as fast as it can, and takes an excess of time beside:

        t = L / min(v(F), v_reach) + t_excess

    At first every row reaches what axes and arcs allow, and nothing is in excess: as if each ran at
    its F all along.  Of a plan, v_reach is the greatest speed of rows too short for their F, and
    t_excess what speeding up and slowing down takes; then the model holds near that plan.
    """

    problem: Problem = field(repr=False)
    """Limits and objectives of the rows."""
    objective: Objective
    """Objective; ``pareto`` counts as time."""
    reach: Floats = field(repr=False)
    """Greatest speed along the path [m/s]; shape (M,)."""
    excess: Floats = field(repr=False)
    """Time beside that at this speed [s]; shape (M,)."""

    @classmethod
    def alone(cls, problem: Problem, objective: Objective) -> Self:
        """Model in which each row runs at its F all along."""
        cap = problem.cut.plan.path.cap
        return cls(problem=problem, objective=objective, reach=cap, excess=np.zeros(len(cap)))

    @classmethod
    def planned(cls, problem: Problem, objective: Objective, feeds: Floats, speeds: Floats) -> Self:
        """Each row as the control runs it at F and S of rows, both of shape (M,)."""
        path = problem.cut.plan.path
        planned = plan(path, feeds=feeds, speeds=speeds)
        commanded = problem.speed(planned.feed, planned.spindle_speed)
        short = planned.v_peak < commanded * REACHED
        reach = np.where(short & (planned.v_peak > 0), planned.v_peak, path.cap)
        along = np.minimum(commanded, reach)
        steady = np.divide(path.length, along, out=np.zeros(len(along)), where=along > 0)
        excess = np.where(_fed(problem), np.maximum(planned.motion.time - steady, 0.0), 0.0)
        return cls(problem=problem, objective=objective, reach=reach, excess=excess)

    @property
    def column(self) -> int:
        """Column of the objective in arrays that have one for each."""
        return column(self.objective)

    def values(self, feeds: Floats, speeds: Floats) -> Floats:
        """Objective of each row, (P, M), at F and S of that shape in the units of ``Moves``."""
        return self.demands(feeds, speeds)[self.column]

    def demands(self, feeds: Floats, speeds: Floats) -> Floats:
        """All objectives of each row; shape (4, P, M)."""
        problem = self.problem
        before, spindle_speed = problem.cut.plan, problem.spindle_speed(speeds)
        fed = _fed(problem)
        along = np.minimum(problem.speed(feeds, spindle_speed), self.reach)
        time = before.path.length / np.where(fed, along, 1.0) + self.excess
        time = np.where(fed, time, before.motion.time)
        return problem.demand.of_rows(time, np.tile(before.wait, (len(time), 1)), spindle_speed)

    @property
    def second_price(self) -> float:
        """Price of a second of standstill in the units of the objective."""
        basis = self.problem.basis
        power = 0.0 if basis.energy is None else basis.energy.base_load_kW
        if self.objective == "cost" and basis.rates is not None:
            return basis.rates.per_second + power / HOUR * basis.rates.energy_per_kWh
        if self.objective == "energy":
            return power / HOUR
        return 1.0 if self.objective in ("time", "pareto") else 0.0


def column(objective: Objective) -> int:
    """Column of an objective in arrays that have one for each."""
    return OBJECTIVES.index("time" if objective == "pareto" else objective)


def _fed(problem: Problem) -> NDArray[np.bool_]:
    motion = problem.cut.plan.path.motion
    return np.isin(motion, (Motion.CUTTING, Motion.PER_TURN))


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockFeeds:
    """Best feeds of M rows at P choices of S."""

    feeds: Floats = field(repr=False)
    """F in the units of ``Moves``; rows that keep theirs have their own; shape (P, M)."""
    values: Floats = field(repr=False)
    """Objective of each row at that F and S; infinite where no F meets the limits; shape (P, M)."""
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)
    """Interval that suits all rows of a group; empty where ``low`` is above ``high``;
    shape (P, M)."""


def block_feeds(model: BlockModel, group: Rows, speeds: Floats) -> BlockFeeds:
    """Best F of each group of rows, (M,), -1 where a row keeps its own, at S (P, M) [rev/min]."""
    many = max(1, AT_ONCE // max(speeds.shape[1], 1))
    parts = [
        _solved(model, group, speeds[first : first + many]) for first in range(0, len(speeds), many)
    ]
    names = [item.name for item in fields(BlockFeeds)]
    whole = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return BlockFeeds(**dict(zip(names, whole, strict=True)))


def best_feeds(
    model: BlockModel, groups: RowGroups, speeds: Floats, low: Floats, high: Floats
) -> Floats:
    """Best F of each row from ``low`` to ``high`` (P, U) of its group; shape (P, M).

    ``speeds`` (P, M): S of each row [rev/min]; where the interval is empty the mean of the group's
    own feeds is taken.
    """
    own = model.problem.cut.plan.path.moves.feed

    def values(feeds: Floats, rows: Rows | slice) -> Floats:
        return groups.total(model.values(groups.spread(feeds, own), speeds[rows]))

    possible, given = low <= high, groups.mean(own)
    best = _lowest(values, np.where(possible, low, given), np.where(possible, high, given))
    return groups.spread(best, own)


def _solved(model: BlockModel, group: Rows, speeds: Floats) -> BlockFeeds:
    problem = model.problem
    own, groups = problem.cut.plan.path.moves.feed, RowGroups(group)
    low, high = feed_bounds(problem, speeds)
    least, most = common_bounds(problem, groups, low, high, speeds)
    feeds = best_feeds(model, groups, speeds, least, most)
    bad = groups.spread(np.where(least <= most, 0.0, 1.0), np.zeros(len(own))) > 0
    held = problem.cuts & (group < 0)
    bad |= held & ~((low <= own * (1 + SLACK)) & (own <= high * (1 + SLACK)))
    return BlockFeeds(
        feeds=feeds,
        values=np.where(bad, np.inf, model.values(feeds, speeds)),
        low=groups.spread(least, own),
        high=groups.spread(most, own),
    )


def _lowest(values: Callable[[Floats, Rows | slice], Floats], low: Floats, high: Floats) -> Floats:
    """Feeds from ``low`` to ``high`` of the least values; shapes (P, U)."""
    every = slice(None)
    inside = np.maximum(high * (1 - STEP), low)
    interior = values(inside, every) < values(high, every)
    rows = np.flatnonzero(interior.any(axis=1))
    if not len(rows):
        return high
    best = high.copy()
    interior_best = _golden(lambda feeds: values(feeds, rows), low[rows], high[rows])
    best[rows] = np.where(interior[rows], interior_best, high[rows])
    return best


def _golden(values: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Minimum of a function with one valley by golden section over log F."""
    left, right = np.log(low), np.log(high)
    one, two = right - GOLDEN * (right - left), left + GOLDEN * (right - left)
    at_one, at_two = values(np.exp(one)), values(np.exp(two))
    for _ in range(SECTIONS):
        lower = at_one <= at_two  # the valley is left of the second
        left, right = np.where(lower, left, one), np.where(lower, two, right)
        new_one = right - GOLDEN * (right - left)
        new_two = left + GOLDEN * (right - left)
        new = values(np.exp(np.where(lower, new_one, new_two)))
        at_one, at_two = np.where(lower, new, at_two), np.where(lower, at_one, new)
        one, two = new_one, new_two
    ends = np.stack([low, np.clip(np.exp(0.5 * (left + right)), low, high)])
    sides = np.stack([values(ends[0]), values(ends[1])])
    return np.where(sides[0] <= sides[1], ends[0], ends[1])
