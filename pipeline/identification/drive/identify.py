"""All drives of a machine from its recordings: mechanics, servo, mass over time, motor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.fit import FeedDriveFit, identify_feed_drive
from pipeline.identification.drive.known import DriveKnown
from pipeline.identification.drive.modulating import ModulatingSettings
from pipeline.identification.drive.motion import motion
from pipeline.identification.drive.motor import MotorFit, MotorFitSettings, identify_motor
from pipeline.identification.drive.records import DriveRecords, MotorRecords, Recording
from pipeline.identification.drive.servo import ServoFit, identify_servo
from pipeline.identification.drive.settings import DriveFitSettings
from pipeline.machine.axis.friction import friction_force

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class MassTrace:
    """Mass of one axis over one recording, as it was known while the recording ran.

    Parameters
    ----------
    recording, unit : str
        Where, and of ``value``.
    time, value, half_width : ndarray, shape (K,)
        [s], and mass with half of its 95 % interval.
    """

    recording: str
    unit: str
    time: Floats
    value: Floats
    half_width: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivesFound:
    """What the recordings of a machine say of its drives.

    Parameters
    ----------
    feed_drives, servos, masses : mapping by the axis' letter
        What was found of each axis; axes without are missing.
    open_axes : mapping of str to str
        Axes of which nothing was found, and why.
    motor : MotorFit or None
        Of the axis ``motor_axis``.
    motor_axis : str
        Letter; "" without recordings of a motor.
    motor_reason : str
        Why there is no motor.
    recordings : tuple of Recording
        All of them.
    """

    feed_drives: Mapping[str, FeedDriveFit]
    servos: Mapping[str, ServoFit] = field(default_factory=dict)
    masses: Mapping[str, MassTrace] = field(default_factory=dict)
    open_axes: Mapping[str, str] = field(default_factory=dict)
    motor: MotorFit | None = None
    motor_axis: str = ""
    motor_reason: str = ""
    recordings: tuple[Recording, ...] = ()


def identify_drives(
    recordings: Sequence[Recording],
    records: DriveRecords,
    known: DriveKnown,
    settings: DriveFitSettings,
) -> DrivesFound:
    """Everything the recordings determine of a machine's drives.

    Raises
    ------
    ValueError
        When they determine nothing of any axis.
    """
    drives: dict[str, FeedDriveFit] = {}
    servos: dict[str, ServoFit] = {}
    masses: dict[str, MassTrace] = {}
    missing: dict[str, str] = {}
    training = [one for one in recordings if one.trained]
    for axis in records.axes:
        try:
            drives[axis] = identify_feed_drive(training, axis, known, settings)
        except ValueError as error:
            missing[axis] = _reason(recordings, axis, str(error))
            continue
        servos[axis] = identify_servo(training, axis, settings)
        if (trace := mass_trace(training, axis, drives[axis])) is not None:
            masses[axis] = trace
    if not drives:
        raise ValueError(
            "no drive can be identified: " + "; ".join(f"{a}: {why}" for a, why in missing.items())
        )
    motor, reason = _motor(recordings, records.motor, settings.widest)
    return DrivesFound(
        feed_drives=drives, servos=servos, masses=masses, open_axes=missing, motor=motor,
        motor_axis=records.motor.axis if records.motor else "", motor_reason=reason,
        recordings=tuple(recordings),
    )  # fmt: skip


def _reason(recordings: Sequence[Recording], axis: str, otherwise: str) -> str:
    """Why nothing is known of an axis: what its training recordings lack, if they all lack it."""
    training = [one for one in recordings if one.trained and not one.motor]
    reasons = {one.lacking[axis] for one in training if axis in one.lacking}
    silent = training and all(axis in one.lacking for one in training)
    return "; ".join(sorted(reasons)) if silent else otherwise


MEMORY = 0.99
"""Forgetting of each update: the last hundred count."""
SHOWN = 200


def mass_trace(recordings: Sequence[Recording], axis: str, found: FeedDriveFit) -> MassTrace | None:
    """Mass while the most vigorous of the recordings ran, friction of the fit taken from the force.

    None where the fit knows no mass, the records come too slowly, or no recording shows one.
    """
    if not (found.determined[0] and np.isfinite(found.bandwidth_Hz)):
        return None
    from pipeline.identification.drive.recursive import RecursiveSettings, recursive_mass

    shown = [one for one in recordings if axis in one.axes]
    moved = [motion(one, axis, found.bandwidth_Hz, found.delay) for one in shown]
    best = max(moved, key=lambda one: float(np.mean(one.acceleration[one.known] ** 2)))
    drive = found.feed_drive
    force = best.force - friction_force(best.velocity, drive.friction) - drive.offset
    middle = 0.5 * (force + np.append(force[1:], force[-1]))  # the mean until the next sample
    clear = best.known & best.moving
    settings = RecursiveSettings(
        forgetting=MEMORY, inertia=float(drive.mass) / 2, window=1,
        speed_scale=float(np.abs(best.velocity).max()),
        torque_scale=float(np.abs(middle[clear]).max()),
    )  # fmt: skip
    trace = recursive_mass(
        np.where(clear, best.velocity, np.nan), np.where(clear, middle, np.nan), best.period,
        settings,
    )  # fmt: skip
    told = np.flatnonzero(np.isfinite(trace.inertia) & np.isfinite(trace.deviation))
    if not len(told):
        return None
    chosen = np.unique(told[np.linspace(0, len(told) - 1, min(SHOWN, len(told))).astype(int)])
    return MassTrace(
        recording=best.recording, unit=found.units[0], time=best.time[chosen],
        value=trace.inertia[chosen], half_width=1.96 * trace.deviation[chosen],
    )  # fmt: skip


def _motor(
    recordings: Sequence[Recording], records: MotorRecords | None, widest: float
) -> tuple[MotorFit | None, str]:
    """The motor of the longest recording of one, or why there is none."""
    if records is None:
        return None, ""
    shown = [one for one in recordings if one.motor]
    if not shown:
        return None, f"no recording fits drive_records.motor.recordings = {records.recordings!r}"
    longest = max(shown, key=lambda one: one.samples)
    signals = longest.motor
    try:
        motor = identify_motor(
            signals["u_d"], signals["u_q"], signals["i_d"], signals["i_q"],
            records.pole_pairs * signals["speed"], longest.period,
            MotorFitSettings(widest=widest, modulating=ModulatingSettings(held=records.held)),
        )  # fmt: skip
    except ValueError as error:
        return None, f"{longest.name}: {error}"
    return motor, ""
