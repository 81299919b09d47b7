"""Feed drive of one axis from its recordings: mass, friction of both directions, offset.

Filtered motion and force of all training recordings make one table, strokes of constant speed among
them, in which bounded robust least squares fits all parameters together.  Those that the recordings
do not determine are taken out: the Stribeck amplitude where slow strokes are missing, viscous
friction where there is one speed only.  A genetic algorithm searches the same objective for
comparison: with the weights of the rows given, the sum of squares is a quadratic form of moments of
the table, so that an individual costs no pass over the rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.machine.axis.drive_parameters import (
    DirectionFriction,
    FeedDriveParameters,
    FrictionParameters,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import Method
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.drive.mechanics import friction, identifiability
from pipeline.submodels.drive.mechanics.estimates import (
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
from pipeline.submodels.drive.mechanics.inverse_dynamics import (
    DIRECTIONS,
    Dynamics,
    Regressors,
    bounds,
    jacobian,
    modelled_force,
)
from pipeline.submodels.drive.mechanics.motion import parallel_bandwidth
from pipeline.submodels.drive.mechanics.uncertainty import (
    biased_half_width,
    instrumental,
    is_better,
)
from pipeline.submodels.drive.prior import DriveFitSettings, DrivePrior
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import Uncertainty

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
        squares: Floats = power - 2 * spread @ right + ((spread @ moments) * spread).sum(axis=1)
        return squares

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
    points: tuple[friction.FrictionPoint, ...] = ()
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

    def fitted() -> tuple[Regressors, float, list[friction.FrictionPoint], Dynamics, Uncertainty]:
        motions, rows, delay = identifiability.aligned(training, axis, bandwidth)
        points = friction.friction_points(
            friction.constant_speed_segments(motions, settings.shortest_s)
        )
        velocities = [one.velocity for one in points]
        return (
            rows,
            delay,
            points,
            *identifiability.determined_dynamics(rows, velocities, settings.widest),
        )

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
    error = _percent(found.residuals, rows.force)
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
    better = instrumental(rows, found)
    if better is None:
        return found, uncertainty, others, FITTED
    if is_better(better, found, uncertainty.half_width, settings.widest):
        return *identifiability.replaced(rows, found, uncertainty, better), [], INSTRUMENTAL
    if bandwidth is None:
        half_width = biased_half_width(better, found, uncertainty.half_width)
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
    points: Sequence[friction.FrictionPoint],
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
        curves = friction.least_squares_curves(points)
        tried["friction", "least_squares"] = curves.error, curves.evaluations
        if both:
            curves = friction.genetic_curves(points, settings.genetic)
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


def _percent(residuals: Floats, force: Floats) -> float:
    return 100 * float(np.linalg.norm(residuals) / np.linalg.norm(force))


def _rank(rows: Regressors, found: Dynamics) -> int:
    slopes = jacobian(rows, found.values)[:, found.fitted]
    length = np.linalg.norm(slopes, axis=0)
    singular = np.linalg.svd(slopes / np.where(length > 0, length, 1.0), compute_uv=False)
    return int(np.count_nonzero(singular > RANK * singular[0]))
