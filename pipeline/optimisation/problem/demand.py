"""Time, cost, electricity and tool life of a cut's rows, for the times and speeds of a population.

With t the time that a row moves, w that it stands still after it, L its length, n the speed, and
f_z = L / (t n N) the mean feed for each tooth, a row takes

    wear    W t (n / n_0)^(1/T) (f_z / f_0)^(a/T)      (T Taylor's exponent, a that of f_z)
    energy  (t + w) (P_base + P_coolant + P_0(n) / eta) + t P_drives + t c 2 pi n M(f_z) / eta

as :mod:`pipeline.twin.cut.tables` says it of one plan, whose wear gives W at n_0 and f_0; c is the
share of the row in the material, M the mean torque.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.cost import life_price
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.force.load_table import TORQUE
from pipeline.gcode.moves import METRE
from pipeline.machine.control.path import Motion, Path
from pipeline.optimisation.problem.arrays import Bounds, Ranges, feed_units
from pipeline.schema.arrays import Floats
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
