"""Feed drive of one axis from its recordings: mass, friction of both directions, offset.

Filtered motion and force of all training recordings make one table, strokes of constant speed among
them, in which bounded robust least squares fits all parameters together.  Those that the recordings
do not determine are taken out: the Stribeck amplitude where slow strokes are missing, viscous
friction where there is one speed only.  A genetic algorithm searches the same objective for
comparison: with the weights of the rows given, the sum of squares is a quadratic form of moments of
the table, so that an individual costs no pass over the rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.machine.axis.friction import DirectionFriction, FrictionParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.search.genetic import GeneticSettings, minimise
from pipeline.submodels.drive.mechanics.estimates import (
    FITTED,
    GENETIC,
    INSTRUMENTAL,
    Estimates,
    estimates,
    gravity_split,
    units,
    with_load,
)
from pipeline.submodels.drive.mechanics.friction import (
    FrictionPoint,
    constant_speed_segments,
    friction_points,
    genetic_curves,
    least_squares_curves,
)
from pipeline.submodels.drive.mechanics.identifiability import (
    aligned,
    at_other_bandwidths,
    determined_dynamics,
    force_constant_by_load,
    load_factor,
    replaced,
    with_force_constant,
)
from pipeline.submodels.drive.mechanics.inverse_dynamics import (
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

    Parameters
    ----------
    rows : Regressors
        The table.
    like : Dynamics
        Optimum of least squares: its weights and its choice of parameters are used.
    settings : GeneticSettings
        Of the search.
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
class FeedDriveFit:
    """Feed drive identified from records, D parameters in the order of ``names``.

    Parameters
    ----------
    axis : str
        Its letter.
    command_unit, force_unit : str
        Of the motor's command; of forces, the command's where the force constant is not listed.
    names, units : tuple of str
        Of the parameters.
    values, low, high : ndarray, shape (D,)
        With the 95 % interval; those of what is not determined have no meaning.
    determined : ndarray of bool, shape (D,)
        Whether the records determine it.
    how, remedy : tuple of str
        Where each value comes from; what to record where it is not determined.
    feed_drive : FeedDriveParameters
        With all of them, for the twin.
    points : tuple of FrictionPoint
        Friction at constant speed.
    methods : tuple of mapping
        Each method that was tried: task, method, chosen, error, error_unit, evaluations.
    samples : int
        Rows that were fitted.
    relative_error_percent : float
        Of the force, ||F - F_model|| / ||F|| on those rows [%].
    bandwidth_Hz : float
        Below which motion and force were compared [Hz]; nan where records were taken as they are.
    delay : float
        Of the motion behind the command [s].
    condition : float
        Of the Jacobian with columns scaled to length one.
    rank : int
        Of the same.
    correlated : tuple of str
        Names of the parameters in ``correlation``.
    correlation : ndarray, shape (S, S)
        Of the parameters that were fitted.
    recordings : tuple of str
        Its training recordings.
    """

    axis: str
    command_unit: str
    force_unit: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Bools
    how: tuple[str, ...]
    remedy: tuple[str, ...]
    feed_drive: FeedDriveParameters
    points: tuple[FrictionPoint, ...] = ()
    methods: tuple[Mapping[str, Any], ...] = ()
    samples: int = 0
    relative_error_percent: float = np.nan
    bandwidth_Hz: float = np.nan
    delay: float = 0.0
    condition: float = np.nan
    rank: int = 0
    correlated: tuple[str, ...] = ()
    correlation: Floats
    recordings: tuple[str, ...] = ()


def identify_feed_drive(
    recordings: Sequence[Recording], axis: str, known: DrivePrior, settings: DriveFitSettings
) -> FeedDriveFit:
    """Feed drive of ``axis`` from its training recordings.

    Parameters
    ----------
    recordings : sequence of Recording
        Those not for training are ignored.
    axis : str
        Its letter.
    known : DrivePrior
        What is known of the axes.
    settings : DriveFitSettings
        Choices of the identification.

    Raises
    ------
    ValueError
        When no training recording shows the axis moving, or their commands have different units.
    """
    # one filter for motion and force, the command delayed like the motion
    training = _training(recordings, axis)
    record = training[0].axes[axis]
    bandwidth = settings.bandwidth_Hz or parallel_bandwidth(training, axis, settings.shortest_s)
    motions, rows, delay = aligned(training, axis, bandwidth)
    points = friction_points(constant_speed_segments(motions, settings.shortest_s))
    found, uncertainty = determined_dynamics(
        rows, [one.velocity for one in points], settings.widest
    )
    # forces in newton, where a recorded load determines the force constant
    constant = None
    if record.force_unit != "N":
        constant = force_constant_by_load(found, uncertainty, settings.widest)
    if constant is not None:
        training = with_force_constant(training, axis, constant.value)
        record = training[0].axes[axis]
        motions, rows, delay = aligned(training, axis, bandwidth)
        points = friction_points(constant_speed_segments(motions, settings.shortest_s))
        found, uncertainty = determined_dynamics(
            rows, [one.velocity for one in points], settings.widest
        )
    # the effect of the filter, and the other methods
    others = at_other_bandwidths(training, axis, bandwidth, delay, found)
    methods, blind = _compared(rows, found, points, record.force_unit, settings)
    factor = None if constant is not None else load_factor(found, uncertainty)
    found, uncertainty, others, how = _chosen(
        rows, found, uncertainty, others, blind, bandwidth=bandwidth, settings=settings
    )
    # from Coulomb levels to named parameters with intervals
    split = gravity_split(found, known.axis(axis).coulomb)
    estimated = estimates(
        found,
        uncertainty.half_width,
        uncertainty.correlation,
        others,
        split,
        widest=settings.widest,
        how=how,
    )
    estimated = with_load(estimated, constant, factor, settings.widest)
    return FeedDriveFit(
        axis=axis, command_unit=record.command_unit, force_unit=record.force_unit,
        names=estimated.names, units=units(record.force_unit, estimated.names, record.command_unit),
        values=estimated.values, low=estimated.low, high=estimated.high,
        determined=estimated.determined, how=estimated.how, remedy=estimated.remedy,
        feed_drive=feed_drive_of(estimated, record.force_constant),
        points=tuple(points), methods=methods, samples=len(rows.force), delay=delay,
        relative_error_percent=_percent(found.residuals, rows.force),
        bandwidth_Hz=np.nan if bandwidth is None else bandwidth, condition=uncertainty.condition,
        rank=_rank(rows, found), correlation=uncertainty.correlation,
        correlated=tuple(n for n, s in zip(found.names, found.fitted, strict=True) if s),
        recordings=tuple(one.name for one in training),
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
        return *replaced(rows, found, uncertainty, better), [], INSTRUMENTAL
    if bandwidth is None:
        uncertainty = replace(
            uncertainty, half_width=biased_half_width(better, found, uncertainty.half_width)
        )
    return found, uncertainty, others, FITTED


def _training(recordings: Sequence[Recording], axis: str) -> list[Recording]:
    """Training recordings of one unit of force."""
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
) -> tuple[tuple[dict[str, Any], ...], Dynamics | None]:
    """Methods compared on both tasks, and the optimum of the genetic algorithm."""
    tried: dict[tuple[str, str], tuple[float, int]] = {}
    both = settings.compare or settings.method == "genetic"
    blind = genetic_dynamics(rows, found, settings.genetic) if both else None
    tried["inverse_dynamics", "least_squares"] = _rmse(found), found.evaluations
    if blind is not None:
        tried["inverse_dynamics", "genetic"] = _rmse(blind), blind.evaluations
    if points:
        curves = least_squares_curves(points)
        tried["friction", "least_squares"] = curves.error, curves.evaluations
        if both:
            curves = genetic_curves(points, settings.genetic)
            tried["friction", "genetic"] = curves.error, curves.evaluations
    methods = tuple(
        {
            "task": task, "method": method, "chosen": method == settings.method,
            "error": error, "error_unit": unit, "evaluations": evaluations,
        }
        for (task, method), (error, evaluations) in tried.items()
    )  # fmt: skip
    return methods, blind


def feed_drive_of(estimated: Estimates, force_constant: float) -> FeedDriveParameters:
    """The drive for the twin; static friction is never below Coulomb friction.

    Parameters
    ----------
    estimated : Estimates
        As identified.
    force_constant : float
        Force for one unit of the command [N/A].
    """
    value = dict(zip(estimated.names, np.maximum(estimated.values, 0).tolist(), strict=True))
    directions = {
        direction: DirectionFriction(
            coulomb=value[f"coulomb_{direction}"],
            static=max(value[f"static_{direction}"], value[f"coulomb_{direction}"]),
            stribeck_velocity=value[f"stribeck_velocity_{direction}"],
            viscous=value[f"viscous_{direction}"],
        )
        for direction in ("positive", "negative")
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
    """Rank of the Jacobian of the fitted parameters."""
    slopes = jacobian(rows, found.values)[:, found.fitted]
    length = np.linalg.norm(slopes, axis=0)
    singular = np.linalg.svd(slopes / np.where(length > 0, length, 1.0), compute_uv=False)
    return int(np.count_nonzero(singular > RANK * singular[0]))
