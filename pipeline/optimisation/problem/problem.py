"""Optimisation problem as arrays: limits of each row, objectives of a population of F and S.

Loads, feeds for each tooth and power count at the commanded speed or, where that is less, the speed
that axes, arcs and tolerances allow.  Times, wear and energy are those of the look-ahead.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import motion_times
from pipeline.optimisation.problem.arrays import (
    AS_PROGRAMMED,
    CONSTRAINTS,
    F_Z_CONSTRAINTS,
    SAME,
    STABILITY,
    Bounds,
    Editable,
    Evaluation,
    Groups,
    NotRaised,
    Practice,
    Ranges,
    feeds_per_minute,
)
from pipeline.optimisation.problem.demand import Demand
from pipeline.optimisation.problem.limits import inverse
from pipeline.optimisation.problem.spindle import (
    Chatter,
    Lobes,
    SpeedChanges,
    allowed_torque,
    speed_changes,
)
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.limits import CutLimit
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import Cut

AT_ONCE = 1 << 18
"""Rows of all individuals of one pass, so that they stay in the cache."""
NEAR = 1e-9
"""Rounding of a margin [1]."""
CHATTERS = "chatter is predicted in it as programmed"
"""Reason of a feed that does not rise where no S keeps the margin of stability."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """M rows, their limits and objectives."""

    cut: Cut = field(repr=False)
    """Cut of the program as it is."""
    basis: CutBasis = field(repr=False)
    """Prices, energy, drive and dynamics of the cut."""
    limits: CutLimit
    """Limits of the part."""
    editable: Editable = field(repr=False)
    """F and S that may change."""
    blocks: CutBlocks = field(repr=False)
    """Blocks of the cut."""
    bounds: Bounds = field(repr=False)
    """Feed for each tooth of each row, whatever the speed."""
    ranges: Ranges = field(repr=False)
    """F and S of each row."""
    demand: Demand = field(repr=False)
    """Objectives of each row."""
    lobes: Lobes = field(repr=False)
    """Stability lobes."""
    practice: Practice | None = field(default=None, repr=False)
    """Ranges by tool and operation, and the greatest change from the program."""
    stays: Floats | None = field(default=None, repr=False)
    """Margin of stability that each row has to keep [1]; by default that of the limits;
    shape (M,)."""

    def __len__(self) -> int:
        return len(self.cut.plan.path)

    @property
    def speed_step(self) -> float:
        """S is a whole multiple of it, or of a part of it where S is small [rev/min]."""
        return 0.0 if self.practice is None else self.practice.settings.speed_step_rpm

    @cached_property
    def cuts(self) -> Bools:
        """Rows that cut at feed; shape (M,)."""
        return self.cut.tool >= 0

    @cached_property
    def flutes(self) -> Floats:
        """Teeth of the tool of each row, 0 where nothing is cut; shape (M,)."""
        many = np.array([tool.flutes for tool in self.cut.tools], dtype=np.float64)
        return np.where(self.cuts, many[self.cut.tool], 0.0)

    @property
    def chatter(self) -> Chatter | None:
        """Margins of stability; None where no dynamics are known."""
        return self.lobes.chatter

    def spindle_speed(self, speeds: ArrayLike) -> Floats:
        """Speed of the spindle [rev/min] for S of shape (..., M)."""
        given = np.asarray(speeds, dtype=np.float64)
        return spindle_speeds(self.cut.plan.path, given.reshape(-1, len(self))).reshape(given.shape)

    def power_f_z(self, speeds: ArrayLike) -> Floats:
        """Greatest feed for each tooth that the drive allows at S of shape (..., M) [m]."""
        spindle_speed = self.spindle_speed(speeds)
        if self.basis.drive is None:
            return np.full(spindle_speed.shape, np.inf)
        torque = allowed_torque(spindle_speed, self.basis.drive, self.limits)
        allowed = inverse(self.cut, self.bounds.torque, torque)
        return np.where(self.cuts, allowed, np.inf)

    def stable(self, speeds: ArrayLike) -> Bools:
        """Whether rows keep the margin of stability at S of shape (..., M); where known."""
        given = np.asarray(speeds, dtype=np.float64)
        if self.chatter is None:
            return np.ones(given.shape, dtype=np.bool_)
        margins = self.chatter.margins(self.spindle_speed(given).reshape(-1, len(self)))
        stable: Bools = ~(margins < self.least_margin)
        return stable.reshape(given.shape)

    @property
    def least_margin(self) -> Floats:
        """Margin of stability that each row has to keep [1]; shape (M,)."""
        given = self.limits.margins.stability
        return np.full(len(self), given) if self.stays is None else self.stays

    @cached_property
    def own_margin(self) -> Floats:
        """Margin of stability of each row as programmed [1], NaN where not known; shape (M,)."""
        if self.chatter is None:
            return np.full(len(self), np.nan)
        return self.chatter.margins(self.cut.plan.spindle_speed)

    def staying(self, rows: Bools) -> "Problem":
        """Problem in which some rows (M,) may stay as near to chatter as programmed.

        They get no more feed, nor a higher S: the lobes are those of the chip as programmed.
        """
        least = np.where(
            rows, np.fmin(self.own_margin, self.least_margin) - NEAR, self.least_margin
        )
        practice, ranges = self.practice, self.ranges
        if practice is None or not rows.any():
            return replace(self, stays=least)
        own_speed = self.cut.plan.spindle_speed
        own_feed = feeds_per_minute(self.cut, self.cut.plan.path.moves.feed, own_speed)
        f_z, feed, speed = (
            np.where(rows & ~practice.given_up, own * SAME, np.inf)
            for own in (self.cut.commanded_feed_per_tooth(), own_feed, own_speed)
        )
        near = NotRaised(CONSTRAINTS[STABILITY], CHATTERS, rows)
        most, own = self.bounds.most.copy(), F_Z_CONSTRAINTS.index(AS_PROGRAMMED)
        most[own] = np.minimum(most[own], f_z)
        return replace(
            self, stays=least, bounds=replace(self.bounds, most=most),
            practice=replace(
                practice, f_z_own=np.minimum(practice.f_z_own, f_z),
                feed_high=np.minimum(practice.feed_high, feed),
                speed_high=np.minimum(practice.speed_high, speed),
                not_raised=(*practice.not_raised, near),
            ),
            ranges=replace(
                ranges, feed_high=np.clip(feed, ranges.feed_low, ranges.feed_high),
                speed_high=np.clip(speed, ranges.speed_low, ranges.speed_high),
            ),
        )  # fmt: skip

    def feed_per_tooth(self, feeds: ArrayLike, speeds: ArrayLike) -> Floats:
        """f_z of each row at F and S [m], shape (M,) or (P, M); 0 in air."""
        both = np.broadcast_arrays(np.asarray(feeds, float), self.spindle_speed(speeds))
        return self.cut.feed_per_tooth_at(self.speed(*both), both[1])

    def speed(self, feeds: Floats, spindle_speed: Floats) -> Floats:
        """Along the path at F, as fast as axes and arcs allow [m/s]; shape of both."""
        path = self.cut.plan.path
        by_turn = np.where(path.motion == Motion.PER_TURN, spindle_speed, 1.0)
        allowed: Floats = np.minimum(path.factor * feeds * by_turn, path.cap)
        return allowed

    @cached_property
    def speed_changes(self) -> SpeedChanges:
        """Places where S can change."""
        return speed_changes(self.cut.plan, self.editable, self.cuts)

    def evaluate(self, groups: Groups, feeds: ArrayLike, speeds: ArrayLike) -> Evaluation:
        """Objectives and violation of F (P, G) in the units of ``Moves`` and S (P, H) [rev/min]."""
        feed, speed = np.asarray(feeds, float), np.asarray(speeds, float)
        return _evaluation(
            self, len(feed),
            lambda part: (groups.row_feeds(feed[part]), groups.row_speeds(speed[part])),
        )  # fmt: skip

    @cached_property
    def as_programmed(self) -> Evaluation:
        """Objectives and violation of the program as it is; P = 1."""
        moves = self.cut.plan.path.moves
        return self.evaluate_rows(moves.feed[None], moves.speed[None])

    def evaluate_rows(self, feeds: ArrayLike, speeds: ArrayLike) -> Evaluation:
        """The same for F and S of rows, of shape (P, M)."""
        feed, speed = np.asarray(feeds, float), np.asarray(speeds, float)
        return _evaluation(self, len(feed), lambda part: (feed[part], speed[part]))


def _evaluation(
    problem: Problem, many: int, rows: Callable[[slice], tuple[Floats, Floats]]
) -> Evaluation:
    path, demand = problem.cut.plan.path, problem.demand
    objectives, violation = np.empty((many, 4)), np.empty(many)
    for part in _parts(problem, many):
        feeds, speeds = rows(part)
        feed = commanded_feeds(path, feeds, 100.0, 100.0)
        spindle_speed = spindle_speeds(path, speeds)
        time = motion_times(path, feed, spindle_speed)
        wait = waits(path, spindle_speed, time)
        problem.speed_changes.add_waits(spindle_speed, time, wait)
        objectives[part] = demand.sums(time, wait, spindle_speed)
        violation[part] = _violation(problem, feed, spindle_speed)
    return Evaluation(objectives=objectives, violation=violation)


def _parts(problem: Problem, many: int) -> list[slice]:
    step = max(1, AT_ONCE // max(len(problem), 1))
    return [slice(first, first + step) for first in range(0, many, step)]


def _violation(problem: Problem, feed: Floats, spindle_speed: Floats) -> Floats:
    """Shape (P,) of F and speeds of shape (P, M)."""
    limits = problem.limits
    out = problem.demand.violation(problem.cut.plan.path, feed, spindle_speed)
    out += problem.speed_changes.violation(spindle_speed, limits.least_speed_change_rpm)
    if problem.chatter is not None:
        out += problem.chatter.violation(spindle_speed, problem.least_margin)
    return out
