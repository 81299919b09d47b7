"""A feed drive from its recordings: mass, friction of both directions, offset.

Filtered motion and force of all training recordings make one table, strokes of constant speed among
them, from which bounded robust least squares finds all parameters together.  What the recordings do
not determine is taken out: the dip of Stribeck's curve where slow strokes are missing, viscous
friction where there is one speed only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.bandwidth import parallel_bandwidth
from pipeline.identification.drive.determined import (
    aligned,
    at_other_bandwidths,
    determined,
    replaced,
)
from pipeline.identification.drive.estimates import (
    FITTED,
    GENETIC,
    INSTRUMENTAL,
    Estimates,
    estimates,
    units,
    with_load,
)
from pipeline.identification.drive.friction import genetic_curves, least_squares_curves
from pipeline.identification.drive.genetic_dynamics import genetic_dynamics
from pipeline.identification.drive.instruments import biased_half_width, instrumental, is_better
from pipeline.identification.drive.inverse_dynamics import Dynamics, jacobian
from pipeline.identification.drive.known import DriveKnown
from pipeline.identification.drive.loads import force_constant_by_load, in_newton, load_factor
from pipeline.identification.drive.offset import split_of
from pipeline.identification.drive.records import DriveFitSettings, Recording
from pipeline.identification.drive.regressors import Regressors
from pipeline.identification.drive.segments import (
    FrictionPoint,
    constant_speed_segments,
    friction_points,
)
from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.machine.axis.friction import DirectionFriction, FrictionParameters
from pipeline.submodels.least_squares import Certainty

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RANK = 1e-6
"""Singular values below, over the greatest, of the Jacobian with columns of length one, are 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedDriveFit:
    """A feed drive found from records, D parameters in the order of ``names``.

    Parameters
    ----------
    axis : str
        Its letter.
    command_unit, force_unit : str
        Of the motor's command; of forces, the command's where nobody knows the force constant.
    names, units : tuple of str
        Of the parameters.
    values, low, high : ndarray, shape (D,)
        With the 95 % interval; those of what is not determined have no meaning.
    determined : ndarray of bool, shape (D,)
        Whether the records determine it.
    how, remedy : tuple of str
        Where each value is from; what to record where it is not determined.
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
        How long the motion is behind the command [s].
    condition : float
        Of the Jacobian with columns scaled to length one.
    rank : int
        Of the same.
    correlated : tuple of str
        What ``correlation`` is of.
    correlation : ndarray, shape (S, S)
        Of the parameters that were sought.
    recordings : tuple of str
        That it was found from.
    """

    axis: str
    command_unit: str
    force_unit: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Flags
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
    recordings: Sequence[Recording], axis: str, known: DriveKnown, settings: DriveFitSettings
) -> FeedDriveFit:
    """The feed drive of ``axis``, from the recordings that may be learnt from.

    Parameters
    ----------
    recordings : sequence of Recording
        Those not meant for training are left aside.
    axis : str
        Its letter.
    known : DriveKnown
        What is known of the axes.
    settings : DriveFitSettings
        How it is sought.

    Raises
    ------
    ValueError
        When no training recording shows the axis moving, or their commands have different units.
    """
    training = _training(recordings, axis)
    record = training[0].axes[axis]
    bandwidth = settings.bandwidth_Hz or parallel_bandwidth(training, axis, settings.shortest_s)
    motions, rows, delay = aligned(training, axis, bandwidth)
    points = friction_points(constant_speed_segments(motions, settings.shortest_s))
    found, sure = determined(rows, [one.velocity for one in points], settings.widest)
    constant = None
    if record.force_unit != "N":
        constant = force_constant_by_load(found, sure, settings.widest)
    if constant is not None:
        training = in_newton(training, axis, constant.value)
        record = training[0].axes[axis]
        motions, rows, delay = aligned(training, axis, bandwidth)
        points = friction_points(constant_speed_segments(motions, settings.shortest_s))
        found, sure = determined(rows, [one.velocity for one in points], settings.widest)
    others = at_other_bandwidths(training, axis, bandwidth, delay, found)
    methods, blind = _compared(rows, found, points, record.force_unit, settings)
    factor = None if constant is not None else load_factor(found, sure)
    found, sure, others, how = _chosen(rows, found, sure, others, blind, bandwidth, settings)
    split = split_of(found, known.axis(axis).coulomb)
    told = estimates(found, sure.half_width, sure.correlation, others, split, settings.widest, how)
    told = with_load(told, constant, factor, settings.widest)
    return FeedDriveFit(
        axis=axis, command_unit=record.command_unit, force_unit=record.force_unit,
        names=told.names, units=units(record.force_unit, told.names, record.command_unit),
        values=told.values, low=told.low, high=told.high, determined=told.determined,
        how=told.how, remedy=told.remedy, feed_drive=feed_drive_of(told, record.force_constant),
        points=tuple(points), methods=methods, samples=len(rows.force), delay=delay,
        relative_error_percent=_percent(found.residuals, rows.force),
        bandwidth_Hz=np.nan if bandwidth is None else bandwidth, condition=sure.condition,
        rank=_rank(rows, found), correlation=sure.correlation,
        correlated=tuple(n for n, s in zip(found.names, found.sought, strict=True) if s),
        recordings=tuple(one.name for one in training),
    )  # fmt: skip


def _chosen(
    rows: Regressors,
    found: Dynamics,
    sure: Certainty,
    others: list[Dynamics],
    blind: Dynamics | None,
    bandwidth: float | None,
    settings: DriveFitSettings,
) -> tuple[Dynamics, Certainty, list[Dynamics], str]:
    """The answer of the method asked for, by instruments where these are better; and its name."""
    if settings.method == "genetic" and blind is not None:
        return blind, sure, others, GENETIC
    better = instrumental(rows, found)
    if better is None:
        return found, sure, others, FITTED
    if is_better(better, found, sure.half_width, settings.widest):
        return *replaced(rows, found, sure, better), [], INSTRUMENTAL
    if bandwidth is None:
        sure = replace(sure, half_width=biased_half_width(better, found, sure.half_width))
    return found, sure, others, FITTED


def _training(recordings: Sequence[Recording], axis: str) -> list[Recording]:
    """Recordings to learn from, of one unit."""
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
    """Both methods on both tasks, as far as asked for; and what the genetic algorithm found."""
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


def feed_drive_of(told: Estimates, force_constant: float) -> FeedDriveParameters:
    """The drive for the twin; static friction is never below Coulomb friction.

    Parameters
    ----------
    told : Estimates
        As identified.
    force_constant : float
        Force for one unit of the command [N/A].
    """
    value = dict(zip(told.names, np.maximum(told.values, 0).tolist(), strict=True))
    ways = {
        way: DirectionFriction(
            coulomb=value[f"coulomb_{way}"],
            static=max(value[f"static_{way}"], value[f"coulomb_{way}"]),
            stribeck_velocity=value[f"stribeck_velocity_{way}"],
            viscous=value[f"viscous_{way}"],
        )
        for way in ("positive", "negative")
    }
    return FeedDriveParameters(
        mass=value["mass"], force_constant=force_constant,
        friction=FrictionParameters(**ways), offset=float(told.values[told.names.index("offset")]),
    )  # fmt: skip


def _rmse(found: Dynamics) -> float:
    return float(np.sqrt(found.cost / found.weights.sum()))


def _percent(residuals: Floats, force: Floats) -> float:
    return 100 * float(np.linalg.norm(residuals) / np.linalg.norm(force))


def _rank(rows: Regressors, found: Dynamics) -> int:
    """Directions of the sought parameters that the rows feel."""
    slopes = jacobian(rows, found.values)[:, found.sought]
    length = np.linalg.norm(slopes, axis=0)
    singular = np.linalg.svd(slopes / np.where(length > 0, length, 1.0), compute_uv=False)
    return int(np.count_nonzero(singular > RANK * singular[0]))
