"""Identified drives against recordings: force of the recorded motion, following error of the loop.

The force is rebuilt from the recorded motion; the closed loop of the twin runs the recorded
reference (and load) alone.

The 90 % intervals of an axis' force and following error are conformal over training recordings.
Each recording is predicted by a drive that was identified from the others.  Where these do not
determine what all together do (a single recording moves the axis at all speeds), it is predicted by
the drive that it helped to identify: of some ten parameters and tens of thousands of samples,
little is its own.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import (
    DriveStart,
    ServoParameters,
    drive_row,
    friction_force,
)
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import FOLLOWING, FORCE, DriveAxis
from pipeline.schema.model import Band, significant
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands, splits
from pipeline.submodels.drive.disturbance import Disturbance, disturbance_of
from pipeline.submodels.drive.entry_fits import shifted
from pipeline.submodels.drive.identifiability import with_force_constant
from pipeline.submodels.drive.motion import motion
from pipeline.submodels.drive.records import AxisConstants, DriveFitSettings, Recording, of_axis
from pipeline.submodels.drive.servo_equation import servo_low_passed
from pipeline.submodels.statistics import Factor
from pipeline.twin.drive import IdentifiedDrive, check_stability, identified_drive
from pipeline.twin.program_axes import between

LEAST = 1.0
"""Least duration of motion in air on which a force is judged [s]."""
LISTED = ("position_gain", "velocity_gain", "integral_gain")
"""Listed gains that a recording may hold; the identified scale factors multiply them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceComparison:
    """Recorded and modelled force of one axis while it moves in air, N rows."""

    measured: Floats = field(repr=False)
    modelled: Floats = field(repr=False)
    """Force of model and recording, in the drive's unit; shape (N,)."""
    direction: Floats = field(repr=False)
    """Direction of motion, -1 or 1; shape (N,)."""
    time: Floats = field(repr=False)
    """Time since the recording began [s]; shape (N,)."""
    period: float
    """Sampling period of the rows [s]."""

    @property
    def seconds(self) -> float:
        """Duration of the motion [s]."""
        return len(self.measured) * self.period


def in_unit_of_drive(recording: Recording, axis: str, drive: IdentifiedDrive) -> Recording:
    """The recording with the drive's force constant, where only a load determined it."""
    if drive.force_unit != "N" or recording.axes[axis].constants.force_constant is not None:
        return recording
    return with_force_constant([recording], axis, drive.feed_drive.force_constant)[0]


def force_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, entering: Disturbance | None
) -> ForceComparison:
    """Force by M a + F_f(v) + F_g + c F_d, both sides through the filter of the identification."""
    screw, force = drive.feed_drive, _force_of(entering)
    if force is not None and entering is not None:
        recording = _delayed(recording, axis, entering.delay)
    found = motion(recording, axis, drive.bandwidth_Hz, drive.delay)
    measured, modelled = found.force, (
        screw.mass * found.acceleration
        + friction_force(found.velocity, screw.friction)
        + screw.offset
    )  # fmt: skip
    if found.load is not None and force is not None:
        modelled = modelled + force.value * found.load
    if found.bandwidth is not None:
        both = np.stack((measured, modelled))
        measured, modelled = servo_low_passed(both, found.period, found.bandwidth)
    rows = found.known & found.moving
    return ForceComparison(
        measured=measured[rows], modelled=modelled[rows],
        direction=np.sign(found.velocity[rows]), time=found.time[rows], period=found.period,
    )  # fmt: skip


def constant_level(training: Sequence[ForceComparison]) -> float:
    """Mean force against motion over the training recordings, the baseline."""
    total = sum(float(one.measured @ one.direction) for one in training)
    rows = sum(len(one.measured) for one in training)
    return total / rows if rows else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FollowingComparison:
    """Recorded and modelled following error of one axis, T samples."""

    measured: Floats = field(repr=False)
    modelled: Floats = field(repr=False)
    guessed: Floats = field(repr=False)
    """Reference less position [m]; ``guessed`` is speed over loop gain; shape (T,)."""
    command: Floats = field(repr=False)
    """Modelled [A]; shape (T,)."""


def following_comparison(
    recording: Recording,
    axis: str,
    drive: IdentifiedDrive,
    substeps: int,
    entering: Disturbance | None,
) -> FollowingComparison | str:
    """Following error of the twin under recorded reference and disturbance, or why there is none.

    The servo runs ``substeps`` times in a sample of the recorder, on a smooth curve through the
    samples of its reference.
    """
    one = recording.axes[axis]
    if drive.servo is None:
        return drive.servo_reason or "no servo was identified"
    servo = with_own_gains(drive.servo, one.constants)
    if one.reference is None or one.position is None:
        return "it does not hold both the commanded and the measured position"
    fine = recording.period / substeps
    try:
        check_stability(servo, drive.feed_drive, fine, 1)
    except ValueError as error:
        return str(error)
    start = DriveStart(
        position=float(one.position[0]),
        velocity=float(one.position[1] - one.position[0]) / recording.period,
        command=float(one.command[0]),
        reference_velocity=float(one.reference[1] - one.reference[0]) / recording.period,
    )
    added = _added(one.load, entering, servo, fine, substeps)
    trace = simulate(
        between(one.reference, substeps) + added.reference, fine,
        drive_row(servo, drive.feed_drive)[np.newaxis],
        load=np.zeros(len(one.reference) * substeps)
        + (added.load - drive.feed_drive.force_constant * added.command),
        start=start,
    )  # fmt: skip
    feed = np.gradient(one.reference, recording.period)
    share = 1 - servo.velocity_feedforward
    return FollowingComparison(
        measured=one.reference - one.position,
        modelled=one.reference - trace.position[0, ::substeps],
        guessed=share * feed / servo.loop_gain,
        command=(trace.command[0] + added.command)[::substeps],
    )


class _Added(NamedTuple):
    """Contribution of a disturbance to reference [m], command and load; shape (T * substeps,)."""

    reference: Floats
    command: Floats
    load: Floats


def _added(
    channel: Floats | None, entering: Disturbance | None, servo: ServoParameters, fine: float,
    substeps: int,
) -> _Added:  # fmt: skip
    """Contribution of a disturbance where it enters; nothing where that is not determined.

    The loops are linear between their limits.  What enters at the speed command or the command of
    the motor therefore adds its own command to that of the feedback.  The servo reads a sample and
    holds it.  A force acts all the time: it lies on straight lines through its samples, as its
    delay was identified on, and each step of the mechanics gets that of its middle.
    """
    none = np.zeros(1)
    if channel is None or entering is None or entering.factor is None:
        return _Added(none, none, none)
    value, late = entering.factor.value, entering.delay / fine
    if entering.entry == "force":
        steps = np.arange(len(channel) * substeps)
        push = np.interp((steps + 0.5 - late) / substeps, np.arange(len(channel)), channel)
        return _Added(none, none, value * push)
    pushed = value * shifted(np.repeat(channel, substeps), late)
    nothing = np.zeros(len(pushed))
    if entering.entry == "reference":
        return _Added(pushed, nothing, nothing)
    if entering.entry == "speed":
        pushed = servo.proportional * pushed + servo.integral * fine * np.cumsum(pushed)
    return _Added(nothing, pushed, nothing)


def with_own_gains(servo: ServoParameters, constants: AxisConstants) -> ServoParameters:
    """Servo with the gains of a recording, where they are listed.

    Scale factors and lags stay: they belong to the servo, the listed gains to the recording.
    """
    listed = {name: getattr(constants, name) for name in LISTED}
    return replace(servo, **{name: value for name, value in listed.items() if value is not None})


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisComparison:
    """Axis in a recording against the twin."""

    force: ForceComparison
    """Force of the recorded motion."""
    following: FollowingComparison | str
    """Following of the closed loop; or why there is none."""
    disturbance: Disturbance | None
    """Disturbance of the recorded channel; None where there is none."""


def axis_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, substeps: int
) -> AxisComparison:
    """Force and following error of ``axis`` beside the twin's, ``substeps`` of it per sample."""
    recording = in_unit_of_drive(recording, axis, drive)
    entering = entering_disturbance(recording, axis, drive)
    return AxisComparison(
        force=force_comparison(recording, axis, drive, entering),
        following=following_comparison(recording, axis, drive, substeps, entering),
        disturbance=entering,
    )


def entering_disturbance(
    recording: Recording, axis: str, drive: IdentifiedDrive
) -> Disturbance | None:
    """Entry of a recording's disturbance; entry, factor and delay alone come from test data."""
    if drive.servo is not None:
        servo = with_own_gains(drive.servo, recording.axes[axis].constants)
        drive = replace(drive, servo=servo)
    return disturbance_of(recording, axis, drive)


def compared_force(recording: Recording, axis: str, drive: IdentifiedDrive) -> ForceComparison:
    """The force alone, as in :func:`axis_comparison`."""
    recording = in_unit_of_drive(recording, axis, drive)
    return force_comparison(recording, axis, drive, entering_disturbance(recording, axis, drive))


def _force_of(entering: Disturbance | None) -> Factor | None:
    return entering.factor if entering is not None and entering.entry == "force" else None


def _delayed(recording: Recording, axis: str, delay: float) -> Recording:
    """The recording with its disturbance ``delay`` [s] later."""
    one = recording.axes[axis]
    if one.load is None or delay == 0:
        return recording
    late = replace(one, load=shifted(one.load, delay / recording.period))
    return replace(recording, axes={**recording.axes, axis: late})


Again = Callable[[str, list[Recording]], DriveAxis | None]


def with_intervals(
    axes: Mapping[str, DriveAxis],
    recordings: Sequence[Recording],
    again: Again,
    settings: DriveFitSettings,
) -> dict[str, DriveAxis]:
    """The axes with the half widths of their force and following error.

    Without those where fewer than two training recordings move an axis.

    ``again`` gives an axis by its letter as some recordings tell it; None where they determine less
    of it.
    """
    tasks = []
    for letter, axis in axes.items():
        shown = {one.name: one for one in of_axis(recordings, letter) if one.trained}
        tasks += [
            (letter, axis, [shown[one] for one in fitted], [shown[one] for one in left])
            for fitted, left in splits(list(shown), settings.folds)
        ]
    parts = mapped(partial(_left_over, again=again, substeps=settings.substeps), tasks)
    errors: dict[tuple[str, str], list[Residuals]] = {}
    for (letter, *_), found in zip(tasks, parts, strict=True):
        for quantity, error in found:
            errors.setdefault((letter, quantity), []).append(error)
    return {
        letter: replace(axis, intervals={
            quantity: _rounded(bands(Residuals.joined(each))[ALL_REGIMES])
            for (of, quantity), each in errors.items() if of == letter and len(each) > 1
        })
        for letter, axis in axes.items()
    }  # fmt: skip


def _left_over(
    fold: tuple[str, DriveAxis, list[Recording], list[Recording]], again: Again, substeps: int
) -> list[tuple[str, Residuals]]:
    """Errors of force and following error of an axis in the recordings left out of a fold."""
    letter, axis, fitted, left = fold
    drive = identified_drive(again(letter, fitted) or axis)
    return [
        (quantity, _residuals(error, one.name))
        for one in left
        for quantity, error in _judged_errors(one, letter, drive, substeps)
    ]


def _judged_errors(
    recording: Recording, letter: str, drive: IdentifiedDrive, substeps: int
) -> Iterator[tuple[str, Floats]]:
    """Measured less predicted force [N or the command's unit] and following error [um]."""
    compared = axis_comparison(recording, letter, drive, substeps)
    force, following = compared.force, compared.following
    if force.seconds >= LEAST:
        yield FORCE, force.measured - force.modelled
        if not isinstance(following, str):
            yield FOLLOWING, 1e6 * (following.measured - following.modelled)


def _residuals(error: Floats, group: str) -> Residuals:
    count = len(error)
    return Residuals(
        error=error, regime=np.full(count, ALL_REGIMES), group=np.full(count, group),
        t=np.zeros(count),
    )  # fmt: skip


def _rounded(band: Band) -> Band:
    return replace(band, lower=significant(band.lower, 4), upper=significant(band.upper, 4))
