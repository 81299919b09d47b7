"""Identified drives against recordings: force of the recorded motion, following error of the loop.

The force is rebuilt from the recorded motion; the closed loop of the twin runs the recorded
reference (and load) alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.axis.friction import friction_force
from pipeline.machine.axis.servo import ServoParameters
from pipeline.schema.arrays import Floats
from pipeline.submodels.drive.mechanics.estimates import Factor
from pipeline.submodels.drive.mechanics.identifiability import (
    held_out_load_factor,
    with_force_constant,
)
from pipeline.submodels.drive.mechanics.motion import motion
from pipeline.submodels.drive.records import AxisConstants, Recording
from pipeline.submodels.drive.servo.equation import servo_low_passed
from pipeline.twin.drive import DriveStart, IdentifiedDrive, check_stability
from pipeline.twin.drive_population import simulate_traces
from pipeline.twin.program_axes import between

LEAST = 1.0
"""Least duration of motion in air on which a force is judged [s]."""
DETERMINED = 0.5
"""Relative half width of its interval up to which a load factor is taken from its record [1]."""
LISTED = ("position_gain", "velocity_gain", "integral_gain")
"""Listed gains that a recording may hold; the identified scale factors multiply them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceComparison:
    """Recorded and modelled force of one axis while it moves in air, N rows.

    Parameters
    ----------
    measured, modelled : ndarray, shape (N,)
        In the drive's unit of force.
    direction : ndarray, shape (N,)
        Of motion, -1 or 1.
    time : ndarray, shape (N,)
        Since the recording began [s].
    period : float
        Sampling period of the rows [s].
    """

    measured: Floats = field(repr=False)
    modelled: Floats = field(repr=False)
    direction: Floats = field(repr=False)
    time: Floats = field(repr=False)
    period: float

    @property
    def seconds(self) -> float:
        """Duration of the motion [s]."""
        return len(self.measured) * self.period


def in_unit_of_drive(recording: Recording, axis: str, drive: IdentifiedDrive) -> Recording:
    """The recording with the drive's force constant, where only a load determined it."""
    if drive.force_unit != "N" or recording.axes[axis].constants.force_constant is not None:
        return recording
    return with_force_constant([recording], axis, drive.feed_drive.force_constant)[0]


def factor_of_load(recording: Recording, axis: str, drive: IdentifiedDrive) -> Factor | None:
    """Factor of the recording's load channel, for its direction and unit; None without a load.

    It is the one number that is taken from the recording that is judged, as the recording does not
    name it; 1, against positive motion in newton, where the recording does not determine it.
    """
    if recording.axes[axis].load is None or drive.force_unit != "N":
        return None
    factor = held_out_load_factor(
        recording, axis, drive.feed_drive, drive.bandwidth_Hz, drive.delay
    )
    determined = factor is not None and factor.is_determined(DETERMINED)
    return factor if determined else Factor(value=1, half_width=inf)


def force_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, factor: Factor | None
) -> ForceComparison:
    """Force by M a + F_f(v) + F_g + c F_d, both sides through the filter of the identification."""
    found, screw = motion(recording, axis, drive.bandwidth_Hz, drive.delay), drive.feed_drive
    measured, modelled = found.force, (
        screw.mass * found.acceleration
        + friction_force(found.velocity, screw.friction)
        + screw.offset
    )  # fmt: skip
    if found.load is not None and factor is not None:
        modelled = modelled + factor.value * found.load
    if found.bandwidth is not None:
        both = np.stack((measured, modelled))
        measured, modelled = servo_low_passed(both, found.period, found.bandwidth)
    rows = found.known & found.moving
    return ForceComparison(
        measured=measured[rows], modelled=modelled[rows],
        direction=np.sign(found.velocity[rows]), time=found.time[rows], period=found.period,
    )  # fmt: skip


def constant_level(training: Sequence[ForceComparison]) -> float:
    """Mean force against motion over the training recordings: a guess without a model."""
    total = sum(float(one.measured @ one.direction) for one in training)
    rows = sum(len(one.measured) for one in training)
    return total / rows if rows else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FollowingComparison:
    """Recorded and modelled following error of one axis, T samples.

    Parameters
    ----------
    measured, modelled, guessed : ndarray, shape (T,)
        Reference less position [m]; ``guessed`` is speed over loop gain.
    command : ndarray, shape (T,)
        Modelled [A].
    """

    measured: Floats = field(repr=False)
    modelled: Floats = field(repr=False)
    guessed: Floats = field(repr=False)
    command: Floats = field(repr=False)


def following_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, substeps: int, factor: Factor | None
) -> FollowingComparison | str:
    """Following error of the twin under the recorded reference (and load), or why there is none.

    The servo runs ``substeps`` times in a sample of the recorder, on a smooth curve through the
    samples of its reference.
    """
    one = recording.axes[axis]
    if drive.servo is None:
        return drive.servo_reason or "no servo was identified"
    servo = with_own_gains(drive.servo, one.constants)
    if one.reference is None or one.position is None:
        return "it does not hold both the commanded and the measured position"
    load = None
    if one.load is not None and factor is not None:
        load = np.repeat(factor.value * one.load, substeps)
    try:
        check_stability(servo, drive.feed_drive, recording.period / substeps, 1)
    except ValueError as error:
        return str(error)
    start = DriveStart(
        position=float(one.position[0]),
        velocity=float(one.position[1] - one.position[0]) / recording.period,
        command=float(one.command[0]),
        reference_velocity=float(one.reference[1] - one.reference[0]) / recording.period,
    )
    trace = simulate_traces(
        between(one.reference, substeps), recording.period / substeps,
        drive_row(servo, drive.feed_drive)[np.newaxis], load=load,
        start=start,
    )  # fmt: skip
    feed = np.gradient(one.reference, recording.period)
    share = 1 - servo.velocity_feedforward
    return FollowingComparison(
        measured=one.reference - one.position,
        modelled=one.reference - trace.position[0, ::substeps],
        guessed=share * feed / servo.loop_gain,
        command=trace.command[0, ::substeps],
    )


def with_own_gains(servo: ServoParameters, constants: AxisConstants) -> ServoParameters:
    """The servo with the gains that a recording was taken with, where they are known.

    Scale factors and lags stay: they belong to the servo, the listed gains to the recording.
    """
    listed = {name: getattr(constants, name) for name in LISTED}
    return replace(servo, **{name: value for name, value in listed.items() if value is not None})


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisComparison:
    """One axis in one recording against the twin.

    Parameters
    ----------
    force : ForceComparison
        Of the recorded motion.
    following : FollowingComparison or str
        Of the closed loop; or why there is none.
    factor : Factor or None
        Of the recorded load; None where there is none.
    """

    force: ForceComparison
    following: FollowingComparison | str
    factor: Factor | None


def axis_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, substeps: int
) -> AxisComparison:
    """The recorded force and following error of ``axis`` beside those of the twin.

    Parameters
    ----------
    recording : Recording
        That shows the axis.
    axis : str
        Its letter.
    drive : IdentifiedDrive
        The axis as identified.
    substeps : int
        Samples of the servo in one sample of the recorder [1].
    """
    recording = in_unit_of_drive(recording, axis, drive)
    factor = factor_of_load(recording, axis, drive)
    return AxisComparison(
        force=force_comparison(recording, axis, drive, factor),
        following=following_comparison(recording, axis, drive, substeps, factor),
        factor=factor,
    )


def compared_force(recording: Recording, axis: str, drive: IdentifiedDrive) -> ForceComparison:
    """The force alone, as in :func:`axis_comparison`."""
    recording = in_unit_of_drive(recording, axis, drive)
    return force_comparison(recording, axis, drive, factor_of_load(recording, axis, drive))
