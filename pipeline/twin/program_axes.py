"""Following error and motor command of the axes along a program, in air or under a load.

The control's positions, sampled at its interpolation period, are each axis' reference.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES
from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.control.interpolate import Trace, trace
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Floats
from pipeline.schema.outside import widest
from pipeline.twin.drive import IdentifiedDrive, speed_of
from pipeline.twin.drive_population import simulate_traces

MOST = 20_000_000
"""Positions that are held at once."""
SUBSTEPS = 4
"""Samples of the servo in one interpolation period: velocity loops run that much faster."""


class Residual(Protocol):
    """What the twin leaves over of the following error of an axis."""

    def __call__(
        self, letter: str, reference: Floats, modelled_error: Floats, modelled_command: Floats,
        period: float,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Measured less modelled error, and half of its 90 % interval.

        Parameters
        ----------
        letter : str
            Of the axis.
        reference : (T,) array
            The command that is driven [m].
        modelled_error, modelled_command : (T,) arrays
            Of the twin along it [m], [A] or [V].
        period : float
            From sample to sample [s].

        Returns
        -------
        residual, half_width : (T,) arrays
            [m].
        """


@dataclass(frozen=True, kw_only=True)
class AxisFollowing:
    """One axis along a program, T positions.

    Parameters
    ----------
    time : (T,) array
        [s].
    error : (T,) array
        Commanded less actual position [m]; with ``residual`` where there is one.
    command : (T,) array
        Of the motor [``command_unit``].
    row : (T,) array of int32
        Row of ``Moves`` that the control is in.
    command_unit : str
        A or V.
    residual : (T,) array or None
        Part of ``error`` that the drives' model leaves over [m]; None where none was asked for.
    half_width : (T,) array or None
        Of the 90 % interval of ``error`` [m]; None where it is not known.
    """

    time: Floats = field(repr=False)
    error: Floats = field(repr=False)
    command: Floats = field(repr=False)
    row: npt.NDArray[np.int32] = field(repr=False)
    command_unit: str
    residual: Floats | None = field(repr=False, default=None)
    half_width: Floats | None = field(repr=False, default=None)

    @property
    def rms_error(self) -> float:
        """Root mean square of ``error`` [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst(self) -> int:
        """Where the error is greatest, an index."""
        return int(np.argmax(np.abs(self.error)))


def follow_program(
    plan: Plan, drives: Mapping[str, IdentifiedDrive], residual: Residual | None = None
) -> dict[str, AxisFollowing]:
    """Linear axes of ``drives`` that move in a program, in air.

    Parameters
    ----------
    plan : Plan
        Of the control.
    drives : mapping of str to IdentifiedDrive
        By the axis' letter; those without a servo are left out.
    residual : Residual, optional
        What the drives' model leaves over; by default their model is all there is.

    Raises
    ------
    ValueError
        When the program is too long to be held, or a drive is unstable.
    """
    return follow_in_air(commanded_positions(plan), drives, residual)


def commanded_positions(plan: Plan) -> Trace:
    """Positions that the control commands, at its interpolation period.

    Raises
    ------
    ValueError
        When there are too many to be held.
    """
    period = plan.path.control.interpolation_period
    if plan.total > MOST * period:
        raise ValueError(
            f"{plan.total:.0f} s at {period} s are more than {MOST} positions: simulate a shorter "
            "program, or raise control.interpolation_period"
        )
    return trace(plan)


def follow_in_air(
    commanded: Trace, drives: Mapping[str, IdentifiedDrive], residual: Residual | None = None
) -> dict[str, AxisFollowing]:
    """Linear axes with a servo that move along commanded positions, by letter."""
    return {letter: followed(letter, drives[letter], commanded, residual=residual)
            for letter in moved_axes(commanded, drives)}  # fmt: skip


def moved_axes(commanded: Trace, drives: Mapping[str, IdentifiedDrive]) -> list[str]:
    """Letters of the linear axes with a servo that move along commanded positions."""
    return [
        letter for letter, drive in drives.items()
        if drive.servo is not None
        and letter in "XYZ"
        and np.ptp(commanded.position[:, AXES.index(letter)]) > 0
    ]  # fmt: skip


def followed(
    letter: str, drive: IdentifiedDrive, commanded: Trace, load: Floats | None = None,
    substeps: int = SUBSTEPS, residual: Residual | None = None,
) -> AxisFollowing:  # fmt: skip
    """One axis along its reference, from rest.

    Parameters
    ----------
    letter : str
        Of the axis.
    drive : IdentifiedDrive
        With a servo.
    commanded : Trace
        T samples of a plan.
    load : (T * substeps,) array, optional
        Against positive motion [N].
    substeps : int
        Samples of the servo in one of the trace.
    residual : Residual, optional
        Added to the error of the model; it gets what the model says under this load.

    Raises
    ------
    ValueError
        When the drive has no servo, or is unstable.
    """
    reference = commanded.position[:, AXES.index(letter)]
    period = float(commanded.time[1] - commanded.time[0])
    position, command = driven(letter, drive, reference, period, load=load, substeps=substeps)
    modelled = AxisFollowing(
        time=commanded.time, error=reference - position, command=command,
        row=commanded.row, command_unit=drive.command_unit,
    )  # fmt: skip
    if residual is None:
        return replace(modelled, half_width=_half_width(letter, drive, reference, period))
    left, half_width = residual(letter, reference, modelled.error, command, period)
    known = not np.isnan(half_width).any()
    return with_residual(modelled, left, half_width if known else None)


def _half_width(
    letter: str, drive: IdentifiedDrive, reference: Floats, period: float
) -> Floats | None:
    """Of the drive's own 90 % interval [m], wider beyond the speeds that it was learnt at."""
    if drive.following_half_width is None:
        return None
    factor = 1.0
    if drive.speeds is not None:
        here = speed_of(letter, float(np.abs(np.gradient(reference, period)).max()))
        factor = widest(here, {name: drive.speeds for name in here})
    return np.full(len(reference), factor * drive.following_half_width)


def with_residual(
    modelled: AxisFollowing, residual: Floats, half_width: Floats | None
) -> AxisFollowing:
    """An axis whose error is that of the model and a residual, (T,) [m], with its interval."""
    return replace(
        modelled, error=modelled.error + residual, residual=residual, half_width=half_width
    )


def driven(
    letter: str, drive: IdentifiedDrive, reference: Floats, period: float, *,
    load: Floats | None = None, substeps: int = SUBSTEPS,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Where an axis is and what its motor is commanded along a reference, from rest.

    Parameters
    ----------
    letter : str
        Of the axis.
    drive : IdentifiedDrive
        With a servo.
    reference : (T,) array
        Commanded position [m].
    period : float
        From sample to sample [s].
    load : (T * substeps,) array, optional
        Against positive motion [N].
    substeps : int
        Samples of the servo in a period.

    Returns
    -------
    position, command : (T,) arrays
        [m], [``command_unit``].

    Raises
    ------
    ValueError
        When the drive has no servo, or is unstable.
    """
    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    row, fine = drive_row(drive.servo, drive.feed_drive), between(reference, substeps)
    step = period / substeps
    if drive.presliding_stiffness is None:
        traces = simulate_traces(fine, step, row[np.newaxis], load=load)
        position, command = traces.position[0], traces.command[0]
    else:
        position, command, _ = _presliding(
            drive, drive.presliding_stiffness, row, fine, load=load, step=step
        )
    if not np.isfinite(position).all():
        raise ValueError(f"the drive of axis {letter} is unstable: identify it again")
    return position[::substeps], command[::substeps]


def driven_by_fuzzy(
    letter: str, drive: IdentifiedDrive, reference: Floats, period: float, *,
    substeps: int = SUBSTEPS,
) -> Floats:  # fmt: skip
    """Where an axis would be with a fuzzy PI speed loop in place of its PI, from rest, (T,) [m].

    The gains that were identified are the middles of both ranges.  The inputs' scales are not
    published (Feed2025): here the greatest speed error of the PI along the same command, and the
    greatest change of it, are the ends of the sets.

    Parameters
    ----------
    letter, drive, reference, period, substeps
        As of :func:`driven`.

    Raises
    ------
    ValueError
        When the drive has no servo, or is unstable.
    """
    from pipeline.machine.axis.presliding import fuzzy_rules

    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    row, fine = drive_row(drive.servo, drive.feed_drive), between(reference, substeps)
    step = period / substeps
    # friction that sticks exactly is a spring as stiff as the step can follow
    stiffness = drive.presliding_stiffness or 0.1 * drive.feed_drive.mass / step**2
    _, _, greatest = _presliding(drive, stiffness, row, fine, step=step)
    rules = fuzzy_rules(*greatest)
    position, _, _ = _presliding(drive, stiffness, row, fine, step=step, rules=rules)
    if not np.isfinite(position).all():
        raise ValueError(f"the drive of axis {letter} is unstable under a fuzzy speed loop")
    return position[::substeps]


def _presliding(
    drive: IdentifiedDrive, stiffness: float, row: Floats, fine: Floats, *, step: float,
    load: Floats | None = None, rules: tuple[float, ...] | None = None,
) -> tuple[Floats, Floats, tuple[float, float]]:  # fmt: skip
    """Position, command, and greatest speed error and change of it, at the servo's samples."""
    from pipeline.machine.axis.presliding import PLAIN, presliding_trace

    push = np.zeros(len(fine)) if load is None else load
    position, command = np.empty(len(fine)), np.empty(len(fine))
    loss = 0.0 if drive.presliding_time is None else 1.0 / drive.presliding_time
    greatest = presliding_trace(
        fine, push, row, (stiffness, loss), step, position, command, rules or PLAIN
    )
    return position, command, greatest


def between(values: Floats, substeps: int) -> Floats:
    """Values at ``substeps`` places a sample on a smooth curve; the last one holds.

    On straight lines the acceleration that is fed forward would be a row of spikes.

    Parameters
    ----------
    values : (T,) array
        Samples.
    substeps : int
        Places.

    Returns
    -------
    (T * substeps,) array
    """
    from scipy.interpolate import CubicSpline

    if substeps == 1 or len(values) < 2:
        return np.repeat(values, substeps)
    places = np.minimum(np.arange(len(values) * substeps) / substeps, len(values) - 1.0)
    found: Floats = CubicSpline(np.arange(len(values)), values)(places)
    return found
