"""Feed drive of one axis from its recordings: mass, friction of both directions, offset.

Filtered motion and force of all training recordings make one table, strokes of constant speed among
them, in which bounded robust least squares fits all parameters together.  Those that the recordings
do not determine are taken out: the Stribeck amplitude where slow strokes are missing, viscous
friction where there is one speed only.  A genetic algorithm searches the same objective for
comparison: with the weights of the rows given, the sum of squares is a quadratic form of moments of
the table, so that an individual costs no pass over the rows.

Friction at constant speed has stretches of a record, and Stribeck's curve through them (Sim2023).
A stretch is of constant speed where the acceleration (of the reference, where that is recorded)
stays below ``STEADY`` of its greatest; the force there is friction alone, u = F_f(v) + F_g.  The
standard error of its mean force counts correlated samples once; points of a curve join stretches of
nearly one speed, whose scatter widens their error.  Each direction has a curve of its own: Coulomb
level, F_s - F_c, v_s and mu_v, found by least squares and by a genetic algorithm in the same box,
each point weighted by its duration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters, Method
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.drive import identifiability
from pipeline.submodels.drive.estimates import (
    FITTED,
    GENETIC,
    INSTRUMENTAL,
    AxisFit,
    Estimates,
    compared_methods,
    estimates,
    gravity_split,
    units,
    with_load,
    with_misfit,
    with_signs,
)
from pipeline.submodels.drive.inverse_dynamics import (
    DIRECTIONS,
    Dynamics,
    Regressors,
    bounds,
    jacobian,
    modelled_force,
)
from pipeline.submodels.drive.motion import Motion, parallel_bandwidth, reach
from pipeline.submodels.drive.records import DriveFitSettings, DrivePrior, Recording
from pipeline.submodels.statistics import NORMAL_95, Uncertainty, correlation_rows, student_quantile

STEADY = 0.02
"""Greatest acceleration of a stretch over that of the record [1]."""
CONSTANT = 0.1
"""Greatest standard deviation of the speed in a stretch over its mean [1]."""
ALIKE = 0.03
"""Greatest relative difference of speeds in one point [1]."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Stretch of constant speed."""

    recording: str
    """Its name."""
    velocity: float
    force: float
    """Means [m/s], [N]."""
    error: float
    """Standard error of ``force`` [N]."""
    seconds: float
    """Duration [s]."""


@dataclass(frozen=True, kw_only=True)
class FrictionPoint:
    """Friction at one speed; ``half_width`` is half of its 95 % interval [N]."""

    velocity: float
    force: float
    half_width: float
    seconds: float


def constant_speed_segments(motions: Sequence[Motion], shortest: float) -> list[Segment]:
    """Stretches of at least ``shortest`` [s], in the order of time.

    Recordings under a load do not show friction alone: they are left out where there are others.
    """
    free = [each for each in motions if each.load is None] or motions
    return [one for each in free for one in _segments(each, shortest)]


def _segments(motion: Motion, shortest: float) -> list[Segment]:
    commanded = motion.acceleration if motion.instruments is None else motion.instruments[1]
    greatest = float(np.percentile(np.abs(commanded), 99.9))
    if greatest == 0:
        return []
    steady = (np.abs(commanded) <= STEADY * greatest) & motion.known & motion.moving
    settle = 0 if motion.bandwidth is None else reach(motion.period, motion.bandwidth)
    edges = np.flatnonzero(np.diff(np.r_[False, steady, False]))
    found = []
    for start, end in zip(edges[::2] + settle, edges[1::2] - settle, strict=True):
        if (end - start) * motion.period < shortest or end - start < 3:
            continue
        speed, force = motion.velocity[start:end], motion.force[start:end]
        mean = float(speed.mean())
        if np.std(speed) > CONSTANT * abs(mean):
            continue
        stretch = np.zeros(end - start, np.int64)
        alone = max((end - start) / correlation_rows(force, stretch), 1.0)
        found.append(
            Segment(
                recording=motion.recording, velocity=mean, force=float(force.mean()),
                error=float(np.std(force)) / np.sqrt(alone), seconds=(end - start) * motion.period,
            )
        )  # fmt: skip
    return found


def friction_points(segments: Sequence[Segment]) -> list[FrictionPoint]:
    """The curve: stretches of nearly one speed joined, in the order of speed."""
    points: list[FrictionPoint] = []
    group: list[Segment] = []
    for one in sorted(segments, key=lambda s: s.velocity):
        if group and abs(one.velocity - group[0].velocity) > ALIKE * abs(group[0].velocity):
            points.append(_point(group))
            group = []
        group.append(one)
    return [*points, _point(group)] if group else points


def _point(group: Sequence[Segment]) -> FrictionPoint:
    seconds = np.array([one.seconds for one in group])
    share = seconds / seconds.sum()
    force = np.array([one.force for one in group])
    mean = float(share @ force)
    within = float(np.sqrt(share**2 @ np.array([one.error for one in group]) ** 2))
    half = NORMAL_95 * within
    if len(group) > 1:
        between = float(np.sqrt((share**2) @ (force - mean) ** 2 * len(group) / (len(group) - 1)))
        half = max(half, student_quantile(len(group) - 1) * between)
    velocity = float(share @ np.array([one.velocity for one in group]))
    return FrictionPoint(
        velocity=velocity, force=mean, half_width=half, seconds=float(seconds.sum())
    )


Search = tuple[Floats, float, int]
"""Values of a direction's curve, their weighted sum of squares [N^2 s], curves that were tried."""
STARTS = 6
"""Number of velocities v_s to begin with [1]."""
PARAMETERS = 4
"""Number of parameters of one direction [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit:
    """Curves of both directions."""

    values: Floats
    """Coulomb level [N], F_s - F_c [N], ln v_s, mu_v [N s/m], of the positive and the negative
    direction; shape (2, 4)."""
    error: float
    """Root mean square of the force, weighted [N]."""
    evaluations: int
    """Curves that were tried."""


def curve_force(speed: Floats, values: Floats) -> Floats:
    """Force against motion [N], (N,) or (P, N), at speeds > 0 [m/s] by values of a CurveFit."""
    level, amplitude, log_velocity, viscous = (values[..., k, None] for k in range(PARAMETERS))
    return level + amplitude * np.exp(-((speed / np.exp(log_velocity)) ** 2)) + viscous * speed


def least_squares_curves(points: Sequence[FrictionPoint]) -> CurveFit:
    """Bounded least squares from several starts, direction by direction."""
    from scipy.optimize import least_squares

    def search(speed: Floats, force: Floats, share: Floats, low: Floats, high: Floats) -> Search:
        root, margin = np.sqrt(share), 1e-9 * (high - low)

        def misses(x: Floats) -> Floats:
            return root * (curve_force(speed, x) - force)

        tried = [
            least_squares(
                misses,
                np.clip([np.median(force), 0.1 * np.ptp(force), start, 0.0], low + margin,
                        high - margin),
                bounds=(low, high), x_scale=high - low, max_nfev=100,
            )
            for start in np.linspace(low[2], high[2], STARTS + 2)[1:-1]
        ]  # fmt: skip
        best = min(tried, key=lambda one: float(one.cost))
        evaluations = sum(int(one.nfev) for one in tried) * (1 + PARAMETERS)
        return best.x, 2 * float(best.cost), evaluations

    return _curves(points, search)


def genetic_curves(points: Sequence[FrictionPoint], settings: GeneticSettings) -> CurveFit:
    """The genetic algorithm in the same box, both directions with half of the population each."""

    def search(speed: Floats, force: Floats, share: Floats, low: Floats, high: Floats) -> Search:
        def cost(x: Floats) -> Floats:
            return (curve_force(speed, x) - force) ** 2 @ share

        found = minimise(cost, low, high, settings)
        return found.x, found.cost, found.evaluations

    return _curves(points, search)


def _curves(points: Sequence[FrictionPoint], search: Callable[..., Search]) -> CurveFit:
    """Curves of both directions by a search in the box of each; NaN without points."""
    values, squares, weight, evaluations = np.full((2, PARAMETERS), np.nan), 0.0, 0.0, 0
    for direction, (speed, force, share) in enumerate(_directions(points)):
        if len(speed):
            found = search(speed, force, share, *_box(speed, force))
            values[direction], evaluations = found[0], evaluations + found[2]
            squares, weight = squares + found[1], weight + float(share.sum())
    error = float(np.sqrt(squares / weight)) if weight else np.nan
    return CurveFit(values=values, error=error, evaluations=evaluations)


def _directions(points: Sequence[FrictionPoint]) -> list[tuple[Floats, Floats, Floats]]:
    """Speed, force against motion and weight of the points of each direction."""
    rows = np.array([(one.velocity, one.force, one.seconds) for one in points]).reshape(-1, 3)
    found = []
    for sign in (1.0, -1.0):
        speed, force, seconds = rows[rows[:, 0] * sign > 0].T
        found.append((sign * speed, sign * force, seconds))
    return found


def _box(speed: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Least and greatest values of a curve through the points."""
    top = 2 * float(np.abs(force).max())
    slow, fast = float(speed.min()) / 3, float(speed.max())
    return (
        np.array([-top, 0.0, np.log(slow), 0.0]),
        np.array([top, top, np.log(max(fast / 3, 3 * slow)), top / fast]),
    )


NARROWER = 5.0
"""Bounds of least squares over those of the genetic algorithm, which needs a smaller box [1]."""


def genetic_dynamics(rows: Regressors, like: Dynamics, settings: GeneticSettings) -> Dynamics:
    """Search the parameters that ``like`` fitted, on rows weighted as there.

    Weights and choice of parameters are those of ``like``, the optimum of least squares.
    """
    k, steps = len(rows.names), len(rows.stribeck)
    wide = np.hstack([rows.linear, rows.stribeck_table[0], rows.stribeck_table[1]])
    moments = wide.T @ (like.weights[:, None] * wide)
    right = wide.T @ (like.weights * rows.force)
    power = float(like.weights @ rows.force**2)
    logs = np.log(rows.stribeck)

    def cost(x: Floats) -> Floats:
        whole = np.zeros((len(x), k + 4))
        whole[:, like.fitted] = x
        spread = np.zeros((len(x), k + 2 * steps))
        spread[:, :k] = whole[:, :k]
        everyone = np.arange(len(x))
        for direction in range(2):
            at = np.interp(whole[:, k + 2 + direction], logs, np.arange(steps))
            low = np.minimum(at.astype(np.int64), steps - 2)
            amplitude, share = whole[:, k + direction], at - low
            spread[everyone, k + direction * steps + low] = amplitude * (1 - share)
            spread[everyone, k + direction * steps + low + 1] = amplitude * share
        return power - 2 * spread @ right + ((spread @ moments) * spread).sum(axis=1)

    low, high = bounds(rows)
    narrow = np.r_[np.full(k, NARROWER), 1.0, 1.0, 1.0, 1.0]
    found = minimise(cost, (low / narrow)[like.fitted], (high / narrow)[like.fitted], settings)
    values = np.zeros(k + 4)
    values[like.fitted] = found.x
    return replace(
        like, values=values, residuals=rows.force - modelled_force(rows, values),
        evaluations=found.evaluations,
    )  # fmt: skip


RANK = 1e-6
"""Relative singular value of the scaled Jacobian below which it counts as 0 [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedDriveFit(AxisFit):
    """Feed drive identified from records."""

    command_unit: str
    force_unit: str
    """Units of the command and of forces, the command's where the force constant is not listed."""
    feed_drive: FeedDriveParameters
    """Drive with all parameters, for the twin."""
    points: tuple[FrictionPoint, ...] = ()
    """Friction at constant speed."""
    delay: float = 0.0
    """Delay of the motion behind the command [s]."""


def identify_feed_drive(
    recordings: Sequence[Recording], axis: str, prior: DrivePrior, settings: DriveFitSettings
) -> FeedDriveFit:
    """Feed drive of ``axis``; ValueError when no training recording moves it, or units differ."""
    # one filter for motion and force, the command delayed like the motion
    training = _training(recordings, axis)
    record = training[0].axes[axis]
    bandwidth = settings.bandwidth_Hz or parallel_bandwidth(training, axis, settings.shortest_s)

    def fitted() -> tuple[Regressors, float, list[FrictionPoint], Dynamics, Uncertainty]:
        motions, rows, delay = identifiability.aligned(training, axis, bandwidth)
        points = friction_points(constant_speed_segments(motions, settings.shortest_s))
        velocities = [one.velocity for one in points]
        optimum = identifiability.determined_dynamics(rows, velocities, settings.widest)
        return rows, delay, points, *optimum

    rows, delay, points, found, uncertainty = fitted()
    # forces in newton, where a recorded load determines the force constant
    constant = None
    if record.force_unit != "N":
        constant = identifiability.force_constant_by_load(found, uncertainty, settings.widest)
    if constant is not None:
        training = identifiability.with_force_constant(training, axis, constant.value)
        record = training[0].axes[axis]
        rows, delay, points, found, uncertainty = fitted()
    # the effect of the filter, and the other methods
    others = identifiability.at_other_bandwidths(training, axis, bandwidth, delay, found)
    methods, blind = _compared(rows, found, points, record.force_unit, settings)
    factor = None if constant is not None else identifiability.load_factor(found, uncertainty)
    found, uncertainty, others, how = _chosen(
        rows, found, uncertainty, others, blind, bandwidth=bandwidth, settings=settings
    )
    # from Coulomb levels to named parameters with intervals
    split = gravity_split(found, prior.axis(axis).coulomb)
    estimated = estimates(
        found, uncertainty.half_width, uncertainty.correlation, others, split,
        widest=settings.widest, how=how,
    )  # fmt: skip
    estimated = with_load(estimated, constant, factor, settings.widest)
    error = 100 * float(np.linalg.norm(found.residuals) / np.linalg.norm(rows.force))
    estimated = with_misfit(estimated, error)
    mass = rows.linear[:, rows.names.index("mass")]
    estimated = with_signs(estimated, mass, rows.velocity, rows.force)
    return FeedDriveFit(
        **vars(estimated), command_unit=record.command_unit, force_unit=record.force_unit,
        units=units(record.force_unit, estimated.names, record.command_unit),
        feed_drive=feed_drive_of(estimated, record.force_constant),
        points=tuple(points), methods=methods, samples=len(rows.force), delay=delay,
        relative_error_percent=error,
        bandwidth_Hz=np.nan if bandwidth is None else bandwidth, condition=uncertainty.condition,
        rank=_rank(rows, found), correlation=uncertainty.correlation,
        correlated=tuple(n for n, s in zip(found.names, found.fitted, strict=True) if s),
    )  # fmt: skip


def _chosen(
    rows: Regressors,
    found: Dynamics,
    uncertainty: Uncertainty,
    others: list[Dynamics],
    blind: Dynamics | None,
    *,
    bandwidth: float | None,
    settings: DriveFitSettings,
) -> tuple[Dynamics, Uncertainty, list[Dynamics], str]:
    """Optimum of the chosen method, by instruments where these are better; and its name."""
    if settings.method == "genetic" and blind is not None:
        return blind, uncertainty, others, GENETIC
    better = identifiability.instrumental(rows, found)
    if better is None:
        return found, uncertainty, others, FITTED
    if identifiability.is_better(better, found, uncertainty.half_width, settings.widest):
        return *identifiability.replaced(rows, found, uncertainty, better), [], INSTRUMENTAL
    if bandwidth is None:
        half_width = identifiability.biased_half_width(better, found, uncertainty.half_width)
        uncertainty = replace(uncertainty, half_width=half_width)
    return found, uncertainty, others, FITTED


def _training(recordings: Sequence[Recording], axis: str) -> list[Recording]:
    training = [one for one in recordings if one.trained and axis in one.axes]
    if not training:
        raise ValueError(
            f"no training recording shows axis {axis}: record its position and command, and name "
            "the recording in drive_records.training"
        )
    found = sorted({one.axes[axis].force_unit for one in training})
    if len(found) > 1:
        raise ValueError(
            f"recordings of axis {axis} have forces in {' and '.join(found)}: train with those of "
            "one unit"
        )
    return training


def _compared(
    rows: Regressors,
    found: Dynamics,
    points: Sequence[FrictionPoint],
    unit: str,
    settings: DriveFitSettings,
) -> tuple[tuple[Method, ...], Dynamics | None]:
    """Methods compared on both tasks, and the optimum of the genetic algorithm."""
    both = settings.compare or settings.method == "genetic"
    blind = genetic_dynamics(rows, found, settings.genetic) if both else None
    tried = {("inverse_dynamics", "least_squares"): (_rmse(found), found.evaluations)}
    if blind is not None:
        tried["inverse_dynamics", "genetic"] = _rmse(blind), blind.evaluations
    if points:
        curves = least_squares_curves(points)
        tried["friction", "least_squares"] = curves.error, curves.evaluations
        if both:
            curves = genetic_curves(points, settings.genetic)
            tried["friction", "genetic"] = curves.error, curves.evaluations
    return compared_methods(tried, settings.method, unit), blind


def feed_drive_of(estimated: Estimates, force_constant: float) -> FeedDriveParameters:
    """Drive for the twin, by the force constant [N/A]; static is at least Coulomb friction."""
    value = dict(zip(estimated.names, np.maximum(estimated.values, 0).tolist(), strict=True))
    directions = {
        direction: DirectionFriction(
            coulomb=value[f"coulomb_{direction}"],
            static=max(value[f"static_{direction}"], value[f"coulomb_{direction}"]),
            stribeck_velocity=value[f"stribeck_velocity_{direction}"],
            viscous=value[f"viscous_{direction}"],
        )
        for direction in DIRECTIONS
    }
    return FeedDriveParameters(
        mass=value["mass"], force_constant=force_constant,
        friction=FrictionParameters(**directions),
        offset=float(estimated.values[estimated.names.index("offset")]),
    )  # fmt: skip


def _rmse(found: Dynamics) -> float:
    return float(np.sqrt(found.cost / found.weights.sum()))


def _rank(rows: Regressors, found: Dynamics) -> int:
    slopes = jacobian(rows, found.values)[:, found.fitted]
    length = np.linalg.norm(slopes, axis=0)
    singular = np.linalg.svd(slopes / np.where(length > 0, length, 1.0), compute_uv=False)
    return int(np.count_nonzero(singular > RANK * singular[0]))
