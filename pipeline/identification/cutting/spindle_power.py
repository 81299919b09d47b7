"""Specific cutting force from the power that a spindle shows.

P eta = P_0(n) + K_tc Q + K_te w: the motor's power P times the efficiency is what the spindle takes
turning free and what the cut takes, by the volume Q removed in each second and the width of chip
times cutting speed w of its edges.  K_tc and K_te are those of the linear-edge law.  All of it
scales with the rated power, the efficiency and the kind of load that are taken for known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.identification.cutting.spindle_power_levels import Levels
from pipeline.identification.cutting.spindle_power_no_load import NoLoad, powers
from pipeline.identification.cutting.spindle_power_regression import Regression, regression

Floats = NDArray[np.float64]

BEYOND = 0.02
"""Share by which a cut's speed may lie outside those of the no-load record."""
RPM = 60.0
NORMAL = 1.959963984540054
"""Half width of the 95 % interval over the standard deviation, with many degrees of freedom."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecificForce:
    """What cutting takes for each volume removed.

    Parameters
    ----------
    value, half_width : float
        Power of these cuts over the rates at which they remove material, edges and all
        [N/m^2 = J/m^3], summed over levels, each for the same time; and half of its 95 % interval:
        by how much cuts of the same kind differ is counted where there is more than one level.
    fit : Regression
        Of K_tc [N/m^2], then of K_te [N/m] where the cuts were to tell it.
    cuts : int
        Levels that it was found from.
    edge : tuple of float, optional
        K_te and its standard deviation [N/m], where it was known before.
    """

    value: float
    half_width: float
    fit: Regression
    cuts: int
    edge: tuple[float, float] | None


def specific_force(
    levels: Levels, idle: NoLoad, *, edge: tuple[float, float] | None = None
) -> SpecificForce:
    """Specific cutting force from levels with a cut at speeds of the no-load record.

    The no-load power's own uncertainty is counted, common to cuts at the same speed.

    Parameters
    ----------
    levels : Levels
        Those without removal are left out.
    idle : NoLoad
        Of the same spindle.
    edge : tuple of float, optional
        K_te and its standard deviation [N/m], known from elsewhere; otherwise it is found too.

    Raises
    ------
    ValueError
        When no cut is at a speed of the no-load record.
    """
    cuts = _cuts(levels, idle)
    power, known = _above_no_load(cuts, idle)
    alone = regression(cuts.removal[:, None], power, known, np.abs(power))
    whole, sure = power, known
    terms = 2 if edge is None and cuts.edge.any() else 1
    if edge is not None:
        power = power - edge[0] * cuts.edge
        known = known + edge[1] ** 2 * np.outer(cuts.edge, cuts.edge)
    design = np.stack([cuts.removal, cuts.edge], axis=1)[:, :terms]
    fit = regression(design, power, known, np.abs(power))
    weight = np.full(len(cuts), 1.0 / cuts.removal.sum())
    return SpecificForce(
        value=float(weight @ whole),
        half_width=_together(weight, sure, whole, (fit, alone)),
        fit=fit,
        cuts=len(cuts),
        edge=edge,
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
            f"between {idle.lowest * RPM:.0f} and {idle.highest * RPM:.0f} rpm"
        )
    return cuts


def _above_no_load(cuts: Levels, idle: NoLoad) -> tuple[Floats, Floats]:
    """Cutting powers [W] and their covariance, that of the no-load power in common."""
    rows = powers(cuts.speed, len(idle.fit.values))
    wider = (idle.fit.quantile / NORMAL) ** 2  # its few degrees of freedom
    free = rows @ idle.fit.covariance @ rows.T * wider
    return cuts.power - idle.power(cuts.speed), np.diag(cuts.deviation**2) + free


def _together(weight: Floats, known: Floats, power: Floats, fits: tuple[Regression, ...]) -> float:
    """Half of the 95 % interval of the weighted sum of powers.

    The scatter of cuts is that of the first fit that the levels determine; of one level nothing is
    known but its measurement.
    """
    told = next((fit for fit in fits if np.isfinite(fit.half_width).all()), None)
    share, quantile = (0.0, NORMAL) if told is None else (told.share, told.quantile)
    variance = weight @ (known + np.diag((share * power) ** 2)) @ weight
    return quantile * float(np.sqrt(variance))


def cut_rates(
    *, flutes: ArrayLike, diameter: ArrayLike, n: ArrayLike, f_z: ArrayLike, a_p: ArrayLike,
    phi_st: ArrayLike, phi_ex: ArrayLike,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Removal rate [m^3/s] and edge rate [m^2/s] of a cut with constant engagement.

    Parameters
    ----------
    flutes : array_like
        Number of teeth.
    diameter, f_z, a_p : array_like
        Of the tool, feed for each tooth, axial depth [m].
    n : array_like
        Spindle speed [rev/s].
    phi_st, phi_ex : array_like
        Where teeth enter and leave [rad].
    """
    teeth, D, speed = (np.asarray(v, dtype=np.float64) for v in (flutes, diameter, n))
    entry, leave = np.asarray(phi_st), np.asarray(phi_ex)
    removal = teeth * speed * np.asarray(f_z) * a_p * D / 2 * (np.cos(entry) - np.cos(leave))
    edge = teeth * speed * np.asarray(a_p) * D / 2 * (leave - entry)
    return removal, edge
