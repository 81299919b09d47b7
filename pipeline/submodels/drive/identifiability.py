"""Identifiability and uncertainty of the inverse dynamics: loose parameters go, a load adds one.

k A = (the drive's own force) + c F_d.  With k listed, c says in which direction and which unit the
load channel counts; without, forces are in the command's unit and c is 1 / k.

* Residuals of a record are autocorrelated; :func:`~pipeline.submodels.statistics.uncertainty_of`
  clusters them in blocks, some times as long as their autocorrelation reaches.
* Cogging, pitch errors and the guideway disturb the force as a function of position, not of time.
  A slow stroke stays at one position: all of its samples share one disturbance, and so does every
  repetition of it, so that scatter in time does not show it.  Variance and correlation length of
  the disturbance are estimated from strokes that travel past several of its lengths; the covariance
  of all rows at all positions follows.
* Noise in speed and acceleration makes least-squares parameters too small (errors in variables).
  The commanded motion is free of it and correlated with the true motion; as instrumental variables,
  Z' W (F - X theta) = 0, it has no such bias (Janot, Vandanjon and Gautier 2014).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.drive import FeedDriveParameters
from pipeline.submodels.drive.inverse_dynamics import (
    AMPLITUDES,
    DIRECTIONS,
    LOGS,
    Dynamics,
    Regressors,
    all_observable,
    jacobian,
    least_squares_dynamics,
    modelled_force,
    parameter_names,
    regressors,
)
from pipeline.submodels.drive.motion import Motion, motion
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import (
    Factor,
    Uncertainty,
    block_numbers,
    student_quantile,
    uncertainty_of,
)


def dynamics_uncertainty(rows: Regressors, fit: Dynamics) -> Uncertainty:
    """Uncertainty of the parameters that were fitted, in their order."""
    weights = np.sqrt(fit.weights)
    slopes = jacobian(rows, fit.values)[:, fit.fitted] * weights[:, None]
    residuals = fit.residuals * weights
    blocks = block_numbers(residuals, rows.stretch, int(fit.fitted.sum()))
    uncertainty = uncertainty_of(slopes, residuals, blocks, float(np.std(residuals)))
    added, quantile = _by_position(rows, fit, slopes * weights[:, None])
    covariance = uncertainty.covariance + added
    widened = np.hypot(uncertainty.half_width, quantile * np.sqrt(np.diag(added)))
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
    return replace(
        uncertainty, covariance=covariance, half_width=widened,
        correlation=covariance / np.outer(deviation, deviation),
    )  # fmt: skip


def _by_position(rows: Regressors, found: Dynamics, slopes: Floats) -> tuple[Floats, float]:
    """Covariance that the disturbance adds, shape (S, S), and the quantile of its interval."""
    seen = position_disturbance(rows, found.residuals, found.value("mass"))
    size = slopes.shape[1]
    if seen is None:
        return np.zeros((size, size)), 0.0
    used = jacobian(rows, found.values)[:, found.fitted]
    scale = np.linalg.norm(used, axis=0)
    scale[scale == 0] = 1.0
    information = (used / scale).T @ (slopes / scale)
    inverse = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
    middle = scores_covariance(rows, slopes / scale, seen)
    added: Floats = inverse @ middle @ inverse / np.outer(scale, scale)
    return added, seen.quantile


TRAVEL = 3.0
"""Correlation lengths that a stroke must travel to show the disturbance [1]."""
STROKE_ROWS = 8
"""Least number of rows of a stroke [1]."""
STROKES = 2
"""Least number of strokes of nearly one speed [1]."""
CELLS = 3000
"""Greatest number of cells that the travel is divided into [1]."""
STEADY = 0.1
"""Greatest share of friction that inertia may reach at constant speed [1]."""


@dataclass(frozen=True, kw_only=True)
class PositionDisturbance:
    """Disturbance of the force that repeats with position."""

    variance: float
    """Variance [N^2]."""
    length: float
    """Distance over which it is correlated [m]."""
    strokes: int
    """Strokes that show at least half of the variance."""

    @property
    def quantile(self) -> float:
        """Student's t for a 95 % interval: a variance from few strokes is uncertain itself."""
        return student_quantile(self.strokes)


def position_disturbance(
    rows: Regressors, residuals: Floats, mass: float
) -> PositionDisturbance | None:
    """Variance and correlation length of the disturbance; None when no stroke shows one.

    Strokes of constant speed are grouped by octaves of speed; each group gives the variance within
    its strokes and the distance over which it is correlated.  The group of the greatest variance
    counts: slower ones did not travel far enough to show all, in faster ones the filter removed it.
    """
    friction = float(np.median(np.abs(rows.force)))
    inertia = np.abs(mass * rows.linear[:, rows.names.index("mass")])
    steady = inertia < STEADY * friction
    groups: dict[int, list[tuple[float, float]]] = {}
    for stroke in np.unique(rows.stroke[steady]).tolist():
        chosen = np.flatnonzero(steady & (rows.stroke == stroke))
        if len(chosen) < STROKE_ROWS:
            continue
        speed = float(np.median(np.abs(rows.velocity[chosen])))
        centred = residuals[chosen] - residuals[chosen].mean()
        variance = float(centred @ centred) / (len(chosen) - 1)
        length = (
            speed * rows.period * (_persistence(centred) - 1)
        )  # less what the filter correlates
        if float(np.ptp(rows.position[chosen])) > TRAVEL * length:
            groups.setdefault(int(np.floor(np.log2(speed))), []).append((variance, length))
    enough = {octave: found for octave, found in groups.items() if len(found) >= STROKES}
    groups = {o: found for o, found in enough.items() if np.median(found, axis=0)[1] > 0}
    if not groups:
        return None
    medians = {octave: np.median(np.array(found), axis=0) for octave, found in groups.items()}
    loudest = max(medians, key=lambda octave: float(medians[octave][0]))
    variance, length = medians[loudest].tolist()
    strokes = sum(len(groups[o]) for o, one in medians.items() if one[0] >= 0.5 * variance)
    return PositionDisturbance(variance=variance, length=length, strokes=strokes)


def _persistence(centred: Floats) -> float:
    """Correlation length of a series in rows: its autocorrelation falls to 1/e there."""
    power = float(centred @ centred)
    for lag in range(1, len(centred) // 2):
        if float(centred[lag:] @ centred[:-lag]) < power / np.e:
            return float(lag)
    return len(centred) / 2


def scores_covariance(rows: Regressors, slopes: Floats, disturbance: PositionDisturbance) -> Floats:
    """Covariance of the sums of ``slopes`` times the disturbance; shape (D, D).

    Disturbances at two positions are correlated by exp(-distance / length); a row that the filter
    averages over many lengths shows little of them; the two directions are taken as independent.

    ``slopes``, shape (N, D), are the weighted derivatives of the modelled force.
    """
    averaged = np.abs(rows.velocity) * rows.period / disturbance.length
    averaged_slopes = slopes / np.sqrt(1 + averaged**2)[:, None]
    total = np.zeros((slopes.shape[1], slopes.shape[1]))
    for direction in (rows.velocity > 0, rows.velocity < 0):
        if not direction.any():
            continue
        place = rows.position[direction]
        width = max(disturbance.length / 2, float(np.ptp(place)) / CELLS, 1e-9)
        cells, member = np.unique(np.floor(place / width), return_inverse=True)
        sums = np.zeros((len(cells), slopes.shape[1]))
        np.add.at(sums, member, averaged_slopes[direction])
        away = np.abs(cells[:, None] - cells) * width
        total += sums.T @ np.exp(-away / disturbance.length) @ sums
    return disturbance.variance * total


def disturbance_weights(
    rows: Regressors, residuals: Floats, disturbance: PositionDisturbance
) -> Floats:
    """Weights by which rows of one stroke at one position count as one observation; (N,).

    n rows that share a disturbance of variance P and have independent noise of variance R are worth
    n / (1 + n P / R) rows; weights are 1 for rows that share nothing.
    """
    own = max(float(np.median(residuals**2)) / 0.455, 1e-3 * disturbance.variance)
    cell = np.stack([rows.stroke, np.floor(rows.position / disturbance.length).astype(np.int64)])
    averaged = np.abs(rows.velocity) * rows.period / disturbance.length
    _, member, count = np.unique(cell, axis=1, return_inverse=True, return_counts=True)
    weights: Floats = 1 / (
        1 + count[member.ravel()] * disturbance.variance / own / (1 + averaged**2)
    )
    return weights / weights.max()


WEAKEST = 1e-3
"""Least singular value of Z' X, with columns of length one, of a usable instrument [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Instrumental:
    """Estimates by instrumental variables of the parameters that enter linearly."""

    index: Ints
    """Their indices in the vector of parameters; shape (L,)."""
    values: Floats
    half_width: Floats
    """Values and half of their 95 % intervals; shape (L,)."""


def instrumental(rows: Regressors, fit: Dynamics) -> Instrumental | None:
    """Parameters with the reference as instruments; None without one of enough correlation."""
    if rows.instruments is None:
        return None
    linear = np.flatnonzero(fit.fitted & ~np.isin(fit.names, LOGS))
    k = len(rows.names)
    stribeck = rows.stribeck_columns(fit.values[k + 2 :])
    motion = np.hstack([rows.linear, stribeck])[:, linear]
    known = np.hstack([rows.instruments, stribeck])[:, linear]
    lengths = np.linalg.norm(motion, axis=0), np.linalg.norm(known, axis=0)
    if min(lengths[0].min(), lengths[1].min()) == 0:
        return None
    motion, known = motion / lengths[0], known / lengths[1]
    cross = known.T @ (fit.weights[:, None] * motion)
    if np.linalg.svd(cross, compute_uv=False)[-1] < WEAKEST:
        return None
    scaled = np.linalg.solve(cross, known.T @ (fit.weights * rows.force))
    residuals = fit.weights * (rows.force - motion @ scaled)
    blocks = block_numbers(residuals, rows.stretch, len(linear))
    stage = known @ np.linalg.lstsq(known, fit.weights[:, None] * motion)[0]
    half_width = uncertainty_of(stage, residuals, blocks).half_width
    if not np.isfinite(half_width).all():
        return None
    return Instrumental(
        index=linear, values=scaled / lengths[0], half_width=half_width / lengths[0]
    )


def is_better(
    by_instruments: Instrumental, fit: Dynamics, half_width: Floats, widest: float
) -> bool:
    """Whether least squares is biased and instruments are precise, by the mass, which noise biases.

    ``fit`` is the least-squares optimum, ``half_width`` (S,) that of its fitted parameters,
    ``widest`` the greatest relative half width of a determined parameter [1].
    """
    place = fit.names.index("mass")
    if place not in by_instruments.index:
        return False
    at = int(np.flatnonzero(by_instruments.index == place)[0])
    value, half = float(by_instruments.values[at]), float(by_instruments.half_width[at])
    least = float(half_width[int(np.count_nonzero(fit.fitted[:place]))])
    return value > 0 and half <= widest * value and abs(value - fit.values[place]) > least + half


def biased_half_width(by_instruments: Instrumental, fit: Dynamics, half_width: Floats) -> Floats:
    """Half widths that reach to the instrumental estimate, for unfiltered records; (S,).

    Without a filter the noise of speed and acceleration biases least squares by an unknown amount;
    the distance to the unbiased estimate, and its own half width, bound it.
    """
    half = np.zeros(len(fit.values))
    half[fit.fitted] = half_width
    at = by_instruments.index
    away = np.abs(by_instruments.values - fit.values[at]) + by_instruments.half_width
    half[at] = np.maximum(half[at], away)
    return half[fit.fitted]


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
    recordings: Sequence[Recording], axis: str, bandwidth: float | None, delay: float, fit: Dynamics
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
    return rows.linear @ linear + rows.stribeck_columns(logs) @ amplitudes
