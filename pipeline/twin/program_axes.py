"""Following error and motor command of the axes along a program, in air or under a load.

The control's positions, sampled at its interpolation period, are each axis' reference.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES
from pipeline.machine.axis.drive import STATES, STICKS, fuzzy_rules, simulate
from pipeline.machine.axis.drive_parameters import drive_row
from pipeline.machine.control.interpolate import Trace, trace, traces
from pipeline.machine.control.parameters import LINEAR
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Floats
from pipeline.schema.verdict import widest
from pipeline.twin.drive import IdentifiedDrive, speed_of
from pipeline.twin.preflight import extents

MOST = 20_000_000
"""Positions that are held at once."""
PART = 1 << 18
"""Positions of a part, where a program is followed in parts."""
NEIGHBOURS = 24
"""Samples beside a part that its curve runs through: each takes a factor 0.27 of what differs."""
SUBSTEPS = 4
"""Samples of the servo in one interpolation period: velocity loops run that much faster."""


class Residual(Protocol):
    """Part of an axis' following error that the twin leaves over."""

    def __call__(
        self, letter: str, reference: Floats, modelled_error: Floats, modelled_command: Floats,
        period: float,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Measured less modelled error, and half of its 90 % interval, (T,) each [m].

        ``reference`` (T,) is the command that is driven [m], with what the twin makes of it: error
        [m] and command [A] or [V]; ``period`` [s].
        """


@dataclass(frozen=True, kw_only=True)
class AxisFollowing:
    """One axis along a program, T positions."""

    time: Floats = field(repr=False)
    """Time [s]."""
    error: Floats = field(repr=False)
    """Commanded less actual position [m]; with ``residual`` where there is one."""
    command: Floats = field(repr=False)
    """Command of the motor [``command_unit``]."""
    row: npt.NDArray[np.int32] = field(repr=False)
    """Row of ``Moves`` that the control is in."""
    command_unit: str
    """Unit of the command, A or V."""
    residual: Floats | None = field(repr=False, default=None)
    """Part of ``error`` that the drives' model leaves over [m]; None without a residual."""
    half_width: Floats | None = field(repr=False, default=None)
    """Half width of the 90 % interval of ``error`` [m]; None where it is not known."""

    @property
    def rms_error(self) -> float:
        """Root mean square of ``error`` [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst(self) -> int:
        """Index of the greatest error."""
        return int(np.argmax(np.abs(self.error)))


def follow_program(
    plan: Plan, drives: Mapping[str, IdentifiedDrive], residual: Residual | None = None
) -> dict[str, AxisFollowing]:
    """Linear axes of ``drives`` with a servo that move in a program, in air.

    Raises ValueError when the program is too long to be held, or a drive is unstable.
    """
    return follow_in_air(commanded_positions(plan), drives, residual)


@dataclass(frozen=True, kw_only=True)
class AxisFigures:
    """Figures of an axis along a program."""

    max_error: float
    rms_error: float
    """Greatest and root mean square of commanded less actual position [m]."""
    worst_row: int
    """Row of ``Moves`` in which the error is greatest."""
    max_command: float
    """Greatest command of the motor [``command_unit``]."""
    command_unit: str
    """Unit of the command, A or V."""
    half_width: float | None
    """Greatest half width of the 90 % interval of the error [m]; None where it is not known."""

    @classmethod
    def of(cls, axis: AxisFollowing) -> "AxisFigures":
        """Those of an axis that was followed as a whole."""
        return cls(
            max_error=float(np.abs(axis.error).max()), rms_error=axis.rms_error,
            worst_row=int(axis.row[axis.worst]), max_command=float(np.abs(axis.command).max()),
            command_unit=axis.command_unit,
            half_width=None if axis.half_width is None else float(axis.half_width.max()),
        )  # fmt: skip


def program_figures(
    plan: Plan, drives: Mapping[str, IdentifiedDrive], residual: Residual | None = None
) -> dict[str, AxisFigures]:
    """Figures of the axes of :func:`follow_program`, of a program of any length.

    Positions are made and followed in parts, but for a ``residual``, which sees them all.  Raises
    ValueError when a drive is unstable, or the program is too long for a residual.
    """
    if residual is not None:
        followed = follow_program(plan, drives, residual)
        return {letter: AxisFigures.of(axis) for letter, axis in followed.items()}
    low, _ = extents(plan.path.moves)
    moved = {
        letter: _Parts(letter, drive, plan.path.control.interpolation_period)
        for letter, drive in drives.items()
        if drive.servo is not None
        and letter in LINEAR
        and np.isfinite(low[:, AXES.index(letter)]).any()
    }
    for part, before, after in _with_neighbours(plan) if moved else ():
        for axis in moved.values():
            axis.follow(part, before, after)
    return {letter: axis.figures for letter, axis in moved.items()}


def _with_neighbours(plan: Plan) -> Iterator[tuple[Trace, Floats, Floats]]:
    """Parts of a trace with the positions of :data:`NEIGHBOURS` samples before and after each."""
    none = np.empty((0, len(AXES)))
    parts = traces(plan, samples=PART)
    before, here = none, next(parts)
    for after in parts:
        yield here, before, after.position[:NEIGHBOURS]
        before, here = here.position[-NEIGHBOURS:], after
    yield here, before, none


class _Parts:
    """An axis that follows its reference part by part, and its figures until then."""

    def __init__(self, letter: str, drive: IdentifiedDrive, period: float) -> None:
        self.letter, self.drive, self.period = letter, drive, period
        self.state = np.full(STATES, np.nan)
        self.samples, self.row = 0, 0
        self.greatest = self.squares = self.command = self.speed = 0.0

    def follow(self, part: Trace, before: Floats, after: Floats) -> None:
        """Follow the next part; the curve between samples runs through their neighbours too."""
        column = AXES.index(self.letter)
        near = np.concatenate([before, part.position, after])[:, column]
        here = slice(len(before), len(before) + len(part))
        fine = between(near, SUBSTEPS)[SUBSTEPS * here.start : SUBSTEPS * here.stop]
        position, command = _driven_fine(
            self.letter, self.drive, fine, self.period / SUBSTEPS, state=self.state
        )
        error = np.abs(near[here] - position[::SUBSTEPS])
        worst = int(error.argmax())
        if error[worst] > self.greatest:
            self.greatest, self.row = float(error[worst]), int(part.row[worst])
        self.squares += float((error**2).sum())
        self.samples += len(part)
        self.command = max(self.command, float(np.abs(command[::SUBSTEPS]).max()))
        if len(near) > 1:
            speed = np.abs(np.gradient(near, self.period))[here]
            self.speed = max(self.speed, float(speed.max()))

    @property
    def figures(self) -> AxisFigures:
        return AxisFigures(
            max_error=self.greatest, rms_error=float(np.sqrt(self.squares / self.samples)),
            worst_row=self.row, max_command=self.command, command_unit=self.drive.command_unit,
            half_width=_half_width_at(self.letter, self.drive, self.speed),
        )  # fmt: skip


def commanded_positions(plan: Plan) -> Trace:
    """Positions that the control commands, at its interpolation period.

    Raises ValueError when there are too many to be held.
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

    ``load`` (T * substeps,) acts against positive motion [N], ``substeps`` being samples of the
    servo in one of the T of ``commanded``; ``residual`` is added to the error of the model.  Raises
    ValueError when the drive has no servo, or is unstable.
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
    """Half-width of the drive's 90 % interval [m], wider beyond its training speeds."""
    width = _half_width_at(letter, drive, float(np.abs(np.gradient(reference, period)).max()))
    return None if width is None else np.full(len(reference), width)


def _half_width_at(letter: str, drive: IdentifiedDrive, speed: float) -> float | None:
    """The same [m] of an axis that reaches a ``speed`` [m/s]."""
    if drive.following_half_width is None:
        return None
    factor = 1.0
    if drive.speeds is not None:
        here = speed_of(letter, speed)
        factor = widest(here, {name: drive.speeds for name in here})
    return factor * drive.following_half_width


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
    """Position [m] and motor command of an axis along a reference (T,) [m], from rest; (T,) each.

    ``period`` [s] is that of the reference, ``load`` (T * substeps,) acts against positive motion
    [N].  Raises ValueError when the drive has no servo, or is unstable.
    """
    fine = between(reference, substeps)
    position, command = _driven_fine(letter, drive, fine, period / substeps, load=load)
    return position[::substeps], command[::substeps]


def _driven_fine(
    letter: str, drive: IdentifiedDrive, fine: Floats, step: float, *,
    load: Floats | None = None, state: Floats | None = None,
) -> tuple[Floats, Floats]:  # fmt: skip
    """:func:`driven` at the samples of the servo; from where ``state`` is, if it is given."""
    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    row = drive_row(drive.servo, drive.feed_drive)[np.newaxis]
    spring = _spring(drive, drive.presliding_stiffness)
    found = simulate(fine, step, row, load=load, spring=spring, state=state)
    position, command = found.position[0], found.command[0]
    if not np.isfinite(position).all():
        raise ValueError(f"the drive of axis {letter} is unstable: identify it again")
    return position, command


def driven_by_fuzzy(
    letter: str, drive: IdentifiedDrive, reference: Floats, period: float, *,
    substeps: int = SUBSTEPS,
) -> Floats:  # fmt: skip
    """Position (T,) [m] of an axis with a fuzzy PI speed loop in place of its PI, from rest.

    The identified gains are the middles of both ranges.  The inputs' scales are not published
    (Feed2025): here the greatest speed error of the PI along the same command, and its greatest
    change. Arguments and errors are those of :func:`driven`.
    """
    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    row = drive_row(drive.servo, drive.feed_drive)[np.newaxis]
    fine, step = between(reference, substeps), period / substeps
    # friction that sticks exactly is a spring as stiff as the step can follow
    stiffness = drive.presliding_stiffness or 0.1 * drive.feed_drive.mass / step**2
    spring = _spring(drive, stiffness)
    rules = fuzzy_rules(*simulate(fine, step, row, spring=spring).greatest[0].tolist())
    position = simulate(fine, step, row, spring=spring, rules=rules).position[0]
    if not np.isfinite(position).all():
        raise ValueError(f"the drive of axis {letter} is unstable under a fuzzy speed loop")
    return position[::substeps]


def _spring(drive: IdentifiedDrive, stiffness: float | None) -> tuple[float, float]:
    """Stiffness of friction before it slides [N/m], and the rate of its loss [1/s]."""
    if stiffness is None:
        return STICKS
    return stiffness, 0.0 if drive.presliding_time is None else 1.0 / drive.presliding_time


def between(values: Floats, substeps: int) -> Floats:
    """Values (T,) at ``substeps`` places a sample on a smooth curve, (T * substeps,).

    On straight lines the acceleration that is fed forward would be a row of spikes.
    """
    from scipy.interpolate import CubicSpline

    if substeps == 1 or len(values) < 2:
        return np.repeat(values, substeps)
    places = np.minimum(np.arange(len(values) * substeps) / substeps, len(values) - 1.0)
    return CubicSpline(np.arange(len(values)), values)(places)
