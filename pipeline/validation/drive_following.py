"""The closed loop of a drive run from the recorded reference alone, against what was recorded."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.known import AxisConstants
from pipeline.identification.drive.loads import Factor
from pipeline.identification.drive.records import Recording
from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.axis.servo import ServoParameters
from pipeline.twin.drive import DriveStart
from pipeline.twin.drive_file import IdentifiedDrive
from pipeline.twin.drive_population import simulate_traces
from pipeline.twin.drive_stability import check_stability
from pipeline.twin.program_axes import between

Floats = NDArray[np.float64]

LISTED = ("position_gain", "velocity_gain", "integral_gain")
"""Gains that a recording may hold and that scale factors turn into effective ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FollowingComparison:
    """Recorded and modelled following error of one axis, T samples.

    Parameters
    ----------
    measured, modelled, guessed : ndarray, shape (T,)
        Reference less position [m]; guessed from speed over loop gain.
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
    """What the twin makes of the recorded reference (and load); or why it can make nothing.

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
    trace = simulate_traces(
        between(one.reference, substeps), recording.period / substeps,
        drive_row(servo, drive.feed_drive)[np.newaxis], load=load,
        start=_start(one.reference, one.position, one.command, recording.period),
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

    Scale factors and lags stay: they are the servo's, the listed gains the recording's.
    """
    listed = {name: getattr(constants, name) for name in LISTED}
    return replace(servo, **{name: value for name, value in listed.items() if value is not None})


def _start(reference: Floats, position: Floats, command: Floats, period: float) -> DriveStart:
    """The axis as the recording finds it."""
    return DriveStart(
        position=float(position[0]),
        velocity=float(position[1] - position[0]) / period,
        command=float(command[0]),
        reference_velocity=float(reference[1] - reference[0]) / period,
    )
