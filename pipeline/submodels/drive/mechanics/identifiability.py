"""Identifiability of the inverse dynamics: loose parameters go, a recorded load adds one.

k A = (the drive's own force) + c F_d.  With k listed, c says in which direction and which unit the
load channel counts; without, forces are in the command's unit and c is 1 / k.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.machine.axis.drive_parameters import FeedDriveParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.submodels.drive.mechanics.inverse_dynamics import (
    AMPLITUDES,
    DIRECTIONS,
    LOGS,
    Dynamics,
    Regressors,
    all_observable,
    least_squares_dynamics,
    modelled_force,
    parameter_names,
    regressors,
)
from pipeline.submodels.drive.mechanics.motion import Motion, motion
from pipeline.submodels.drive.mechanics.uncertainty import (
    Instrumental,
    disturbance_weights,
    dynamics_uncertainty,
    position_disturbance,
)
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import Factor, Uncertainty

OTHER_BANDWIDTHS = (0.5, 2.0)
"""Bandwidths of repeated fits over the chosen one [1]; their differences widen the intervals."""
FEWEST = 4
"""Least number of rows for each parameter [1]."""
LATEST = 0.02
"""Greatest delay of the motion behind the command [s]."""
APART = 1.2
"""Least ratio of speeds that separates viscous from Coulomb friction [1]."""
SLOW_END = 5
"""Percentile of the speeds that counts as slow [%]."""


def aligned(
    recordings: Sequence[Recording], axis: str, bandwidth: float | None
) -> tuple[list[Motion], Regressors, float]:
    """Motion and its table with the command delayed like the motion, and that delay [s]."""
    motions = [motion(one, axis, bandwidth) for one in recordings]
    rows = _enough(regressors(motions), axis)
    if "delay" not in rows.names:
        return motions, rows, 0.0
    first = least_squares_dynamics(rows, all_observable(rows))
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


def determined_dynamics(
    rows: Regressors, steady: Sequence[float], widest: float
) -> tuple[Dynamics, Uncertainty]:
    """Optimum in the parameters that the rows determine.

    A direction whose v_s or F_s - F_c is too uncertain is fitted without either, and so is one
    where no stroke was slower than v_s: there the start of motion bends the curve, not friction. A
    direction of one constant speed is fitted without viscous friction; its Coulomb level is the
    force at this speed.

    ``steady`` are constant velocities [m/s]; ``widest`` is the greatest relative half width of a 95
    % interval of a determined parameter [1].
    """
    slowest, single = _steady(rows, steady)
    fitted = all_observable(rows)
    fitted &= ~np.isin(parameter_names(rows), [f"viscous_{direction}" for direction in single])
    found = least_squares_dynamics(rows, fitted)
    shares = weights_by_position(rows, found)
    found = least_squares_dynamics(rows, fitted, shares)
    uncertainty = dynamics_uncertainty(rows, found)
    while (loose := _loosest(found, uncertainty, slowest, widest)).any():
        found = least_squares_dynamics(rows, found.fitted & ~loose, shares)
        uncertainty = dynamics_uncertainty(rows, found)
    return found, uncertainty


def weights_by_position(rows: Regressors, fit: Dynamics) -> Floats | None:
    """Weights of rows that share a disturbance by position; None where there is none."""
    seen = position_disturbance(rows, fit.residuals, fit.value("mass"))
    return None if seen is None else disturbance_weights(rows, fit.residuals, seen)


def _steady(rows: Regressors, steady: Sequence[float]) -> tuple[dict[str, float], list[str]]:
    """Slowest speed of each direction that shows friction, and directions of one speed only.

    Where no speed was held constant, the slow end of those passed counts.
    """
    held = np.asarray(steady)
    slowest, single = {}, []
    for sign, direction in zip((1.0, -1.0), DIRECTIONS, strict=True):
        speeds = np.abs(held[held * sign > 0])
        passed = np.abs(rows.velocity[rows.velocity * sign > 0])
        if len(speeds) and speeds.max() < APART * speeds.min():
            single.append(direction)
        if not len(speeds) and len(passed):
            speeds = np.array([np.percentile(passed, SLOW_END)])
        slowest[direction] = float(speeds.min(initial=np.inf))
    return slowest, single


def _loosest(
    found: Dynamics, uncertainty: Uncertainty, slowest: dict[str, float], widest: float
) -> Bools:
    """Parameters to take out next; shape (D,)."""
    half = np.full(len(found.values), np.inf)
    half[found.fitted] = uncertainty.half_width
    width = dict(zip(found.names, half.tolist(), strict=True))
    amplitudes = {}
    for direction in DIRECTIONS:
        name, log_velocity = f"stribeck_amplitude_{direction}", f"log_velocity_{direction}"
        if found.is_fitted(name):
            amplitude, speed = found.value(name), np.exp(found.value(log_velocity))
            shown = amplitude > 0 and speed > slowest[direction]
            share = width[name] / amplitude if shown else np.inf
            amplitudes[direction] = max(share, width[log_velocity])
    if amplitudes and max(amplitudes.values()) > widest:
        loosest = max(amplitudes, key=lambda one: amplitudes[one])
        return np.isin(found.names, (f"stribeck_amplitude_{loosest}", f"log_velocity_{loosest}"))
    for direction in DIRECTIONS:
        level, viscous = f"coulomb_level_{direction}", f"viscous_{direction}"
        open_ = [width[n] > widest * abs(found.value(n)) for n in (level, viscous)]
        if found.is_fitted(viscous) and all(open_):
            return np.isin(found.names, (viscous,))
    return np.zeros(len(found.values), bool)


def at_other_bandwidths(
    recordings: Sequence[Recording],
    axis: str,
    bandwidth: float | None,
    delay: float,
    fit: Dynamics,
) -> list[Dynamics]:
    """The same parameters fitted through narrower and wider filters, where enough rows are left."""
    if bandwidth is None:
        return []
    others = []
    for factor in OTHER_BANDWIDTHS:
        motions = [motion(one, axis, factor * bandwidth, delay) for one in recordings]
        try:
            rows = _enough(regressors(motions), axis)
        except ValueError:
            continue  # too narrow a filter leaves nothing between two stops
        if rows.names == fit.names[: len(rows.names)]:
            one = least_squares_dynamics(rows, fit.fitted)
            others.append(least_squares_dynamics(rows, fit.fitted, weights_by_position(rows, one)))
    return others


def replaced(
    rows: Regressors, fit: Dynamics, uncertainty: Uncertainty, better: Instrumental
) -> tuple[Dynamics, Uncertainty]:
    """The optimum with the instrumental estimates in place of those of least squares."""
    values, half = fit.values.copy(), np.zeros(len(fit.values))
    values[better.index] = better.values
    half[fit.fitted] = uncertainty.half_width
    half[better.index] = better.half_width
    residuals = rows.force - modelled_force(rows, values)
    return (
        replace(fit, values=values, residuals=residuals),
        replace(uncertainty, half_width=half[fit.fitted]),
    )


ROWS = 30
"""Least number of rows of a recording for a load factor [1]."""


def load_factor(fit: Dynamics, uncertainty: Uncertainty) -> Factor | None:
    """Factor c of the load in training recordings; None where none has a load."""
    if "load" not in fit.names or not fit.is_fitted("load"):
        return None
    at = int(np.count_nonzero(fit.fitted[: fit.names.index("load")]))
    return Factor(value=fit.value("load"), half_width=float(uncertainty.half_width[at]))


def force_constant_by_load(fit: Dynamics, uncertainty: Uncertainty, widest: float) -> Factor | None:
    """K = 1 / c [N/A] of a fit in the command's unit; None where the load does not determine it."""
    factor = load_factor(fit, uncertainty)
    if factor is None or not factor.is_determined(widest) or factor.value < 0:
        return None
    k = 1 / factor.value
    return Factor(value=k, half_width=factor.half_width * k**2)


def with_force_constant(
    recordings: Sequence[Recording], axis: str, force_constant: float
) -> list[Recording]:
    """The recordings with a force constant of ``axis`` [N/A]."""
    changed = []
    for one in recordings:
        record = one.axes[axis]
        constants = replace(record.constants, force_constant=force_constant)
        axes = {**one.axes, axis: replace(record, constants=constants)}
        changed.append(replace(one, axes=axes))
    return changed


def held_out_load_factor(
    recording: Recording,
    axis: str,
    drive: FeedDriveParameters,
    bandwidth: float | None,
    delay: float = 0.0,
) -> Factor | None:
    """Factor c of the load of a held-out recording; None without a varying load in motion.

    Only the factor and the zero of the load channel are fitted: the motor's force is that of the
    identified drive plus c F_d plus the zero.  ``bandwidth`` is that of the parallel filter [Hz],
    ``delay`` that of the motion behind the command [s].
    """
    if recording.axes[axis].load is None:
        return None
    try:
        rows = regressors([motion(recording, axis, bandwidth, delay)])
    except ValueError:
        return None  # it hardly moves
    columns = [rows.names.index(name) for name in ("load", "load_zero")]
    own = rows.force - drive_force(rows, drive)
    slopes = rows.linear[:, columns]
    if len(own) < ROWS or np.ptp(slopes[:, 0]) == 0:
        return None
    values = np.linalg.lstsq(slopes, own, rcond=None)[0]
    only = np.isin(rows.names + ("",) * 4, ("load", "load_zero"))
    whole = np.zeros(len(only))
    whole[columns] = values
    found = Dynamics(
        names=rows.names + AMPLITUDES + LOGS,
        values=whole, fitted=only, weights=np.ones(len(own)), residuals=own - slopes @ values,
        evaluations=1,
    )  # fmt: skip
    factor = load_factor(found, dynamics_uncertainty(rows, found))
    return None if factor is None else replace(factor, zero=float(values[1]))


def drive_force(rows: Regressors, drive: FeedDriveParameters) -> Floats:
    """Force of the motor by an identified drive, without load [N]; shape (N,)."""
    directions = drive.friction.positive, drive.friction.negative
    value = {
        "mass": drive.mass,
        "viscous_positive": directions[0].viscous, "viscous_negative": directions[1].viscous,
        "coulomb_level_positive": directions[0].coulomb + drive.offset,
        "coulomb_level_negative": directions[1].coulomb - drive.offset,
    }  # fmt: skip
    linear = np.array([value.get(name, 0.0) for name in rows.names])
    amplitudes = np.array([one.static - one.coulomb for one in directions])
    logs = np.log([one.stribeck_velocity for one in directions])
    force: Floats = rows.linear @ linear + rows.stribeck_columns(logs) @ amplitudes
    return force
