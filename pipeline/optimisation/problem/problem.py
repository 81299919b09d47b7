"""Optimisation problem as arrays: limits of each row, objectives of a population of F and S.

Loads, feeds for each tooth and power count at the commanded speed or, where that is less, the speed
that axes, arcs and tolerances allow.  Times, wear and energy are those of the look-ahead.  With t
the time that a row moves, w that it stands still after it, L its length, n the speed, and
f_z = L / (t n N) the mean feed for each tooth, a row takes

    wear    W t (n / n_0)^(1/T) (f_z / f_0)^(a/T)      (T Taylor's exponent, a that of f_z)
    energy  (t + w) (P_base + P_coolant + P_0(n) / eta) + t P_drives + t c 2 pi n M(f_z) / eta

as :mod:`pipeline.twin.cut.tables` says it of one plan, whose wear gives W at n_0 and f_0; c is the
share of the row in the material, M the mean torque.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.economics.cost import life_price
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.force.load_table import TORQUE
from pipeline.gcode.moves import METRE
from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.path import Motion, Path
from pipeline.machine.control.planner import motion_times
from pipeline.optimisation.problem.arrays import (
    AS_PROGRAMMED,
    CONSTRAINTS,
    F_Z_CONSTRAINTS,
    SAME,
    STABILITY,
    Bounds,
    Decision,
    Editable,
    Evaluation,
    Groups,
    NotRaised,
    Practice,
    Ranges,
    feed_units,
    feeds_per_minute,
)
from pipeline.optimisation.problem.limits import inverse
from pipeline.optimisation.problem.spindle import (
    Chatter,
    SpeedChanges,
    allowed_torque,
    speed_changes,
)
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.limits import CutLimit
from pipeline.schema.si import KW, KWH
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import Life, coolant_on


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """Time, cost, energy and wear of rows; see :mod:`pipeline.optimisation.problem.kernels`."""

    rows: Floats = field(repr=False)
    """Demand of each row; shape (M, COLUMNS)."""
    loads: Floats = field(repr=False)
    """Torques [N m]; shape (2, M, K + 1)."""
    drive: Floats = field(repr=False)
    """Drive of the spindle; empty where it is not known."""
    prices: Floats
    """Prices of a second and of a joule; shape (2,)."""
    known: NDArray[np.bool_]
    """Whether each objective is known; shape (4,)."""

    def with_bounds(self, bounds: Bounds) -> "Demand":
        """The same with other bounds of the feed for each tooth."""
        from pipeline.optimisation.problem import kernels as at

        rows = self.rows.copy()
        rows[:, at.LOW], rows[:, at.HIGH] = bounds.least, bounds.high
        return replace(self, rows=rows)

    def with_feeds(self, low: Floats, high: Floats) -> "Demand":
        """The same with other ranges of F [mm/min], shape (M,) each."""
        from pipeline.optimisation.problem import kernels as at

        rows = self.rows.copy()
        rows[:, at.FEED_LOW], rows[:, at.FEED_HIGH] = low, high
        return replace(self, rows=rows)

    def of_rows(self, time: Floats, wait: Floats, spindle_speed: Floats) -> Floats:
        """Time [s], cost, energy [kWh], share of tool life [1] of rows, NaN unknown; (4, P, M).

        ``time`` and ``wait`` (P, M): moving, and standing after it [s]; ``spindle_speed`` (1 or P,
        M): [rev/min].
        """
        from pipeline.optimisation.problem.kernels import row_values

        out = np.empty((4, *time.shape))
        row_values(time, wait, spindle_speed, self.rows, self.loads, self.drive, self.prices, out)
        out[2] /= KWH
        out[~self.known] = np.nan
        return out

    def sums(self, time: Floats, wait: Floats, spindle_speed: Floats) -> Floats:
        """Sums of :meth:`of_rows` over the rows; shape (P, 4)."""
        from pipeline.optimisation.problem.kernels import sums

        out = np.empty((len(time), 4))
        sums(time, wait, spindle_speed, self.rows, self.loads, self.drive, self.prices, out)
        out[:, 2] /= KWH
        out[:, ~self.known] = np.nan
        return out

    def violation(self, path: Path, feed: Floats, spindle_speed: Floats) -> Floats:
        """Excess over row limits, as a share of each, summed; (P,) of F and S (P, M) [rev/min]."""
        from pipeline.optimisation.problem.kernels import violations

        out = np.empty(len(feed))
        of_rows = self.rows, self.loads, self.drive
        violations(path.motion, path.factor, path.cap, feed, spindle_speed, *of_rows, out)
        return out


def demand_of(
    cut: Cut, blocks: CutBlocks, life: Life, basis: CutBasis, limits: CutLimit, *,
    bounds: Bounds, ranges: Ranges,
) -> Demand:  # fmt: skip
    """Demand of a cut."""
    from pipeline.optimisation.problem import kernels as at

    rates, used = basis.rates, basis.energy if basis.drive is not None else None
    rows = np.zeros((len(cut.plan.path), at.COLUMNS))
    _fill_limits(rows, feed_units(cut), bounds, ranges)
    _fill_motion(rows, cut, blocks)
    _fill_wear(rows, cut, blocks, life, basis)
    if used is not None:
        pumps = coolant_on(cut) * used.coolant_kW
        rows[:, at.STEADY] = (used.base_load_kW + pumps) * KW
        rows[:, at.MOVING] = (cut.plan.path.motion != Motion.STILL) * used.drives_kW * KW
    priced = rates is not None and used is not None
    return Demand(
        rows=rows,
        loads=np.stack([cut.table.values[TORQUE], bounds.torque]),
        drive=np.zeros(0) if basis.drive is None else _drive(basis.drive, limits),
        prices=np.array([
            0.0 if rates is None else rates.per_second,
            rates.energy_per_kWh / KWH if priced and rates is not None else 0.0,
        ]),
        known=np.array([True, rates is not None, used is not None, True]),
    )  # fmt: skip


def _fill_limits(rows: Floats, units: Floats, bounds: Bounds, ranges: Ranges) -> None:
    """Columns of the ranges of each row; a range that it need not keep is 0 to infinity."""
    from pipeline.optimisation.problem import kernels as at

    limited, counted = np.isfinite(ranges.feed_high), ranges.counted
    rows[:, at.LOW], rows[:, at.HIGH] = bounds.least, bounds.high
    rows[:, at.FEED_LOW], rows[:, at.FEED_HIGH] = ranges.feed_low, ranges.feed_high
    rows[:, at.SPEED_LOW] = np.where(counted, ranges.speed_low, 0.0)
    rows[:, at.SPEED_HIGH] = np.where(counted, ranges.speed_high, np.inf)
    rows[:, at.FEED_UNIT] = np.where(limited, units, 0.0)


def _fill_motion(rows: Floats, cut: Cut, blocks: CutBlocks) -> None:
    """Columns of the path length, the teeth, and the share of the path in the material."""
    from pipeline.optimisation.problem import kernels as at

    fed = blocks.row
    flutes = np.array([tool.flutes for tool in cut.tools], dtype=np.float64)
    rows[:, at.LENGTH] = cut.plan.path.moves.length * METRE
    rows[:, at.TEETH] = np.where(cut.tool >= 0, flutes[cut.tool] / 60, 0.0)
    rows[:, at.SCALE], rows[:, at.EXPONENT] = cut.table.scale, cut.table.exponent
    rows[fed, at.CUTS] = blocks.spindle_speed > 0
    time = cut.plan.motion.time[fed]
    rows[fed, at.INSIDE] = np.divide(blocks.seconds, time, out=np.zeros(len(fed)), where=time > 0)


def _fill_wear(rows: Floats, cut: Cut, blocks: CutBlocks, life: Life, basis: CutBasis) -> None:
    from pipeline.optimisation.problem import kernels as at

    row, plan = blocks.row, cut.plan
    rows[:, at.SPEED] = rows[:, at.FEED] = 1.0
    rows[row, at.WEAR] = life.wear[row] / np.where(plan.motion.time > 0, plan.motion.time, 1.0)[row]
    rows[row, at.SPEED] = np.maximum(plan.spindle_speed[row], 1e-9)
    rows[row, at.FEED] = np.maximum(cut.mean_feed_per_tooth[row], 1e-12)
    change = 0.0 if basis.rates is None else basis.rates.tool_change * basis.rates.per_second
    for index, tool in enumerate(cut.tools):
        mine = row[blocks.tool == index]
        rows[mine, at.LIFE] = life_price(tool) + change
        taylor = basis.material.tool_life(tool)
        if taylor is not None:
            rows[mine, at.SPEED_POWER] = 1.0 / taylor.n
            rows[mine, at.FEED_POWER] = taylor.f_z_exponent / taylor.n


def _drive(drive: SpindleDrive, limits: CutLimit) -> Floats:
    rated = drive.rated_power * limits.power_share
    return np.array([
        rated * (1 - limits.margins.torque), rated * (1 - limits.margins.power),
        drive.base_speed, drive.top_speed, drive.efficiency,
        drive.efficiency * drive.motor_efficiency, *drive.no_load_W,
    ])  # fmt: skip


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
    lobes: Callable[[], Chatter | None] = field(repr=False)
    """Stability lobes, computed where they are first read and then kept: they take time."""
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
        return self.lobes()

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
        return np.minimum(path.factor * feeds * by_turn, path.cap)

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

    def decided(self, decision: Decision) -> tuple[Floats, float]:
        """Objectives, shape (4,), and violation of a decision."""
        found = self.evaluate(decision.groups, decision.feeds[None], decision.speeds[None])
        return found.objectives[0], float(found.violation[0])

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
