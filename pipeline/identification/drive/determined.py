"""What recordings determine of the inverse dynamics: found together, the loose ends taken out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.instruments import Instrumental
from pipeline.identification.drive.intervals import dynamics_certainty
from pipeline.identification.drive.inverse_dynamics import (
    Dynamics,
    all_sought,
    least_squares_dynamics,
    modelled_force,
    parameter_names,
)
from pipeline.identification.drive.motion import Motion, motion
from pipeline.identification.drive.places import pushes, shared_weights
from pipeline.identification.drive.records import Recording
from pipeline.identification.drive.regressors import Regressors, regressors
from pipeline.submodels.least_squares import Certainty

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

OTHER_BANDWIDTHS = (0.5, 2.0)
"""Over the one chosen; what they change widens the intervals."""
FEWEST = 4
"""Rows for each parameter."""
LATEST = 0.02
"""No command is further ahead of the motion than that [s]."""
APART = 1.2
"""Ratio of speeds that tell viscous from Coulomb friction, at least."""
SLOW_END = 5
"""Percentile of the speeds."""
WAYS = ("positive", "negative")


def aligned(
    recordings: Sequence[Recording], axis: str, bandwidth: float | None
) -> tuple[list[Motion], Regressors, float]:
    """Motion and its table, the command as late as the motion is behind it, and by how much [s].

    Raises
    ------
    ValueError
        When too few rows move in air.
    """
    motions = [motion(one, axis, bandwidth) for one in recordings]
    rows = _enough(regressors(motions), axis)
    if "delay" not in rows.names:
        return motions, rows, 0.0
    first = least_squares_dynamics(rows, all_sought(rows))
    delay = float(np.clip(first.value("delay") / first.value("mass"), -LATEST, LATEST))
    motions = [motion(one, axis, bandwidth, delay) for one in recordings]
    return motions, _enough(regressors(motions), axis), delay


def _enough(rows: Regressors, axis: str) -> Regressors:
    least = FEWEST * (len(rows.names) + 4)
    if len(rows.force) < least:
        raise ValueError(
            f"axis {axis} moves in {len(rows.force)} rows of its training recordings, {least} are "
            "the least: record strokes forth and back in air"
        )
    return rows


def determined(
    rows: Regressors, steady: Sequence[float], widest: float
) -> tuple[Dynamics, Certainty]:
    """The optimum of what the rows determine.

    A direction whose v_s or F_s - F_c is too loose goes without either, and so does one where no
    stroke was slower than v_s: what bends the curve there is the start of motion, not friction.  A
    direction of one constant speed goes without viscous friction; its level is that at this speed.

    Parameters
    ----------
    rows : Regressors
        The table.
    steady : sequence of float
        Velocities that were held constant [m/s].
    widest : float
        Half an interval that is wider, as a share, is no determination [1].
    """
    slowest, single = _steady(rows, steady)
    sought = all_sought(rows)
    for way in single:
        sought &= ~np.isin(parameter_names(rows), (f"viscous_{way}",))
    found = least_squares_dynamics(rows, sought)
    shares = shares_of(rows, found)
    found = least_squares_dynamics(rows, sought, shares)
    sure = dynamics_certainty(rows, found)
    while (loose := _loosest(found, sure, slowest, widest)).any():
        found = least_squares_dynamics(rows, found.sought & ~loose, shares)
        sure = dynamics_certainty(rows, found)
    return found, sure


def shares_of(rows: Regressors, found: Dynamics) -> Floats | None:
    """Weights of rows that share what their place adds; None where places add nothing."""
    seen = pushes(rows, found.residuals, found.value("mass"))
    return None if seen is None else shared_weights(rows, found.residuals, seen)


def _steady(rows: Regressors, steady: Sequence[float]) -> tuple[dict[str, float], list[str]]:
    """The slowest speed that tells friction in each direction, and directions of one speed only.

    Where no speed was held, the slow end of those passed counts.
    """
    held = np.asarray(steady)
    slowest, single = {}, []
    for sign, way in ((1.0, "positive"), (-1.0, "negative")):
        speeds = np.abs(held[held * sign > 0])
        passed = np.abs(rows.velocity[rows.velocity * sign > 0])
        if len(speeds) and speeds.max() < APART * speeds.min():
            single.append(way)
        if not len(speeds) and len(passed):
            speeds = np.array([np.percentile(passed, SLOW_END)])
        slowest[way] = float(speeds.min(initial=np.inf))
    return slowest, single


def _loosest(found: Dynamics, sure: Certainty, slowest: dict[str, float], widest: float) -> Flags:
    """What goes next; shape (D,)."""
    half = np.full(len(found.values), np.inf)
    half[found.sought] = sure.half_width
    width = dict(zip(found.names, half.tolist(), strict=True))
    dips = {}
    for way in WAYS:
        dip, speed = found.value(f"dip_{way}"), np.exp(found.value(f"log_velocity_{way}"))
        if found.sought[found.names.index(f"dip_{way}")]:
            share = width[f"dip_{way}"] / dip if dip > 0 and speed > slowest[way] else np.inf
            dips[way] = max(share, width[f"log_velocity_{way}"])
    if dips and max(dips.values()) > widest:
        way = max(dips, key=lambda one: dips[one])
        return np.isin(found.names, (f"dip_{way}", f"log_velocity_{way}"))
    for way in WAYS:
        level, viscous = f"level_{way}", f"viscous_{way}"
        open_ = [width[n] > widest * abs(found.value(n)) for n in (level, viscous)]
        if found.sought[found.names.index(viscous)] and all(open_):
            return np.isin(found.names, (viscous,))
    return np.zeros(len(found.values), bool)


def at_other_bandwidths(
    recordings: Sequence[Recording],
    axis: str,
    bandwidth: float | None,
    delay: float,
    found: Dynamics,
) -> list[Dynamics]:
    """The same parameters, sought through narrower and wider filters; those that have the rows."""
    if bandwidth is None:
        return []
    others = []
    for factor in OTHER_BANDWIDTHS:
        motions = [motion(one, axis, factor * bandwidth, delay) for one in recordings]
        try:
            rows = _enough(regressors(motions), axis)
        except ValueError:
            continue  # too narrow a filter leaves nothing between two stops
        if rows.names == found.names[: len(rows.names)]:
            one = least_squares_dynamics(rows, found.sought)
            others.append(least_squares_dynamics(rows, found.sought, shares_of(rows, one)))
    return others


def replaced(
    rows: Regressors, found: Dynamics, sure: Certainty, better: Instrumental
) -> tuple[Dynamics, Certainty]:
    """What instruments say, in place of least squares."""
    values, half = found.values.copy(), np.zeros(len(found.values))
    values[better.index] = better.values
    half[found.sought] = sure.half_width
    half[better.index] = better.half_width
    residuals = rows.force - modelled_force(rows, values)
    return (
        replace(found, values=values, residuals=residuals),
        replace(sure, half_width=half[found.sought]),
    )
