"""No-load power of a spindle and specific cutting force, from levels of its power.

P eta = P_0(n) + K_tc Q + K_te w, with the no-load power P_0(n) = p0 + p1 n + p2 n^2: the motor's
power P times the efficiency eta covers the spindle running without load, the volume Q removed per
second, and the width of chip times cutting speed w of the edges.  K_tc and K_te are those of the
linear-edge model; P_0 is that of :class:`pipeline.cutting.economics.spindle_power.SpindleDrive`.
All of it scales with rated power, efficiency and meaning of the load, which are premises.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE
from pipeline.submodels.cutting.regression import Regression, regression
from pipeline.submodels.cutting.spindle_load.levels import Levels

TERMS = 3
"""Terms of the no-load power where there are enough speeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NoLoad:
    """No-load power of a spindle."""

    fit: Regression
    """Regression for p0, p1, p2 [W], [W s], [W s^2], n in rev/s, as far as determined."""
    lowest: float
    highest: float
    """Speeds between which it holds [rev/s]."""
    levels: Levels
    """Levels that it was identified from."""

    def power(self, n: ArrayLike) -> Floats:
        """P_0 at the speed n [rev/s], in W."""
        power: Floats = powers(n, len(self.fit.values)) @ self.fit.values
        return power

    def half_width(self, n: ArrayLike) -> Floats:
        """Half of the 95 % interval of P_0 at the speed n [rev/s], in W."""
        rows = powers(n, len(self.fit.values))
        variance = np.einsum("...i,ij,...j->...", rows, self.fit.covariance, rows)
        half: Floats = self.fit.quantile * np.sqrt(np.maximum(variance, 0.0))
        return half


def no_load(levels: Levels) -> NoLoad:
    """No-load power by levels without a cut; ValueError when there are fewer than two speeds."""
    idle = levels.where((levels.removal == 0.0) & (levels.edge == 0.0))
    if len(idle) < 2:
        raise ValueError(
            f"the spindle turns free at {len(idle)} settled speed(s): record it at 4 or more, 20 s "
            "each"
        )
    terms = min(TERMS, len(idle) - 1)
    fit = regression(
        powers(idle.speed, terms), idle.power, np.diag(idle.deviation**2), np.abs(idle.power)
    )
    return NoLoad(
        fit=fit,
        lowest=float(idle.speed.min()),
        highest=float(idle.speed.max()),
        levels=idle,
    )


def powers(n: ArrayLike, terms: int) -> Floats:
    """1, n, n^2, … up to as many terms; shape of ``n`` + (terms,)."""
    rows: Floats = np.asarray(n, dtype=np.float64)[..., None] ** np.arange(terms)
    return rows


BEYOND = 0.02
"""Share by which a cut's speed may lie outside the no-load record [1]."""
NORMAL = 1.959963984540054
"""Half width of the 95 % interval over the standard deviation, with many degrees of freedom."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecificForce:
    """Cutting energy per volume removed."""

    value: float
    half_width: float
    """Power of these cuts over the rates at which they remove material, edges and all
    [N/m^2 = J/m^3], summed over levels, each for the same time; and half of its 95 % interval: by
    how much cuts of the same kind differ is counted where there is more than one level."""
    fit: Regression
    """Regression for K_tc [N/m^2], then K_te [N/m] where the cuts were to determine it."""
    cuts: int
    """Number of levels."""


def specific_force(levels: Levels, idle: NoLoad) -> SpecificForce:
    """Specific cutting force from levels with a cut at speeds of the no-load record.

    The no-load power's own uncertainty is counted, common to cuts at the same speed. ValueError
    when no cut is at a speed of the no-load record.
    """
    cuts = _cuts(levels, idle)
    power, covariance = _above_no_load(cuts, idle)
    alone = regression(cuts.removal[:, None], power, covariance, np.abs(power))
    terms = 2 if cuts.edge.any() else 1
    design = np.stack([cuts.removal, cuts.edge], axis=1)[:, :terms]
    fit = regression(design, power, covariance, np.abs(power))
    weight = np.full(len(cuts), 1.0 / cuts.removal.sum())
    return SpecificForce(
        value=float(weight @ power),
        half_width=_together(weight, covariance, power, (fit, alone)),
        fit=fit,
        cuts=len(cuts),
    )


def _cuts(levels: Levels, idle: NoLoad) -> Levels:
    if not np.isfinite(idle.fit.half_width).all():
        raise ValueError(
            "the no-load power is not determined, nothing can be taken off the cuts: record the "
            "spindle turning free at 4 speeds or more"
        )
    low, high = idle.lowest * (1 - BEYOND), idle.highest * (1 + BEYOND)
    cuts = levels.where((levels.speed >= low) & (levels.speed <= high) & (levels.removal > 0.0))
    if not len(cuts):
        raise ValueError(
            "no settled cut is at a speed that the spindle also turned free at: record cuts "
            f"between {idle.lowest * MINUTE:.0f} and {idle.highest * MINUTE:.0f} rpm"
        )
    return cuts


def _above_no_load(cuts: Levels, idle: NoLoad) -> tuple[Floats, Floats]:
    """Cutting powers [W] and their covariance, that of the no-load power in common."""
    rows = powers(cuts.speed, len(idle.fit.values))
    wider = (idle.fit.quantile / NORMAL) ** 2  # its few degrees of freedom
    free = rows @ idle.fit.covariance @ rows.T * wider
    return cuts.power - idle.power(cuts.speed), np.diag(cuts.deviation**2) + free


def _together(
    weight: Floats, covariance: Floats, power: Floats, fits: tuple[Regression, ...]
) -> float:
    """Half of the 95 % interval of the weighted sum of powers.

    The scatter of cuts is that of the first fit that the levels determine; a single level has only
    its measurement uncertainty.
    """
    determined = next((fit for fit in fits if np.isfinite(fit.half_width).all()), None)
    share, quantile = (
        (0.0, NORMAL) if determined is None else (determined.share, determined.quantile)
    )
    variance = weight @ (covariance + np.diag((share * power) ** 2)) @ weight
    return quantile * float(np.sqrt(variance))
