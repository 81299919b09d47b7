"""One feed axis: its servo, sampled, on its mechanics, stepped (Sim2023).

At each sample the servo sees the encoder and sets the command, which holds until the next sample.
The encoder sits on the motor: with backlash the carriage is elsewhere.
"""

from dataclasses import dataclass, field, fields
from math import isfinite

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.machine.axis.feed_drive import FeedDriveParameters, carriage_position, screw_step
from pipeline.machine.axis.servo import ServoParameters, ServoState, servo_step
from pipeline.twin.drive_stability import check_stability

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DriveParameters:
    """One axis.

    Parameters
    ----------
    servo : ServoParameters
        The loops.
    feed_drive : FeedDriveParameters
        The mechanics.
    """

    servo: ServoParameters
    feed_drive: FeedDriveParameters


@dataclass(frozen=True, kw_only=True)
class DriveStart:
    """The axis at the first sample.

    Parameters
    ----------
    position, velocity : float
        At the encoder [m], [m/s].
    command : float
        First command, which the integral is set for [A]; without integral gain it has no meaning.
    reference_velocity : float
        Of the reference before the first sample, for the feed-forward [m/s].

    Raises
    ------
    ValueError
        When a value is not finite.
    """

    position: float
    velocity: float = 0.0
    command: float = 0.0
    reference_velocity: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            if not isfinite(getattr(self, item.name)):
                raise ValueError(f"start.{item.name} = {getattr(self, item.name)} must be finite")


@dataclass(frozen=True, kw_only=True)
class DriveTrace:
    """One axis at T samples; every array has shape (T,).

    Parameters
    ----------
    time : array
        [s], 0 at the first sample.
    reference, position, velocity : array
        Commanded and measured position [m], speed [m/s], both at the encoder.
    command : array
        Set at the sample, holds until the next [A].
    friction : array
        Mean force until the next sample, against positive motion [N].
    carriage : array
        Where the carriage is; ``position`` when there is no backlash [m].
    """

    time: Floats = field(repr=False)
    reference: Floats = field(repr=False)
    position: Floats = field(repr=False)
    velocity: Floats = field(repr=False)
    command: Floats = field(repr=False)
    friction: Floats = field(repr=False)
    carriage: Floats = field(repr=False)

    @property
    def following_error(self) -> Floats:
        """Reference less measured position [m]; shape (T,)."""
        return self.reference - self.position


def at_rest(position: float, drive: DriveParameters) -> DriveStart:
    """The axis standing at ``position`` [m], its command carrying what is always there."""
    return DriveStart(
        position=position, command=drive.feed_drive.offset / drive.feed_drive.force_constant
    )


def simulate_drive(
    reference: ArrayLike,
    period: float,
    drive: DriveParameters,
    *,
    load: ArrayLike | None = None,
    substeps: int = 1,
    servo_substeps: bool = False,
    start: DriveStart | None = None,
) -> DriveTrace:
    """Follow a reference.

    Parameters
    ----------
    reference : (T,) array_like
        Commanded position [m].
    period : float
        From sample to sample [s].
    drive : DriveParameters
        The axis.
    load : (T,) array_like, optional
        Against positive motion, holds until the next sample [N].
    substeps : int
        Steps of the mechanics in one period.
    servo_substeps : bool
        Whether the servo samples at each substep, its reference interpolated linearly: for records
        that are slower than the servo.
    start : DriveStart, optional
        At rest at the first reference by default.

    Returns
    -------
    DriveTrace
        At the T samples of the reference.

    Raises
    ------
    ValueError
        When an input is out of its range, or the loop is unstable at this period.
    """
    x_ref = samples("reference", reference)
    push = np.zeros(len(x_ref)) if load is None else samples("load", load, len(x_ref))
    check_steps(period, substeps)
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    check_stability(drive.servo, drive.feed_drive, period / inner, held)
    begin = at_rest(float(x_ref[0]), drive) if start is None else start
    motion = servo_reference(x_ref, period, inner, begin.reference_velocity)
    rows = _run(motion, period / inner, drive, np.repeat(push, inner), held, begin)
    position, velocity, command, friction, carriage = rows.reshape(len(x_ref), inner, -1).T
    return DriveTrace(
        time=np.arange(len(x_ref)) * np.float64(period), reference=x_ref, position=position[0],
        velocity=velocity[0], command=command[0], friction=friction.mean(axis=0),
        carriage=carriage[0],
    )  # fmt: skip


def _run(
    motion: Floats,
    period: float,
    drive: DriveParameters,
    load: Floats,
    held: int,
    start: DriveStart,
) -> Floats:
    """Position, velocity, command, friction, carriage at the servo's samples; shape (N, 5)."""
    servo, screw = drive.servo, drive.feed_drive
    x, v, carriage = start.position, start.velocity, start.position
    state = first_state(start, motion[0].tolist(), servo)
    rows = []
    for reference, push in zip(motion.tolist(), load.tolist(), strict=True):
        sampled = (x, v, carriage)
        command, state = servo_step(reference, x, v, state, period, servo)
        friction = 0.0
        for _ in range(held):
            x, v, part = screw_step(x, v, command, push, period / held, screw)
            carriage = carriage_position(carriage, x, screw.backlash)
            friction += part / held
        rows.append((*sampled[:2], command, friction, sampled[2]))
    return np.array(rows)


def servo_reference(
    reference: Floats, period: float, inner: int = 1, velocity: float = 0.0
) -> Floats:
    """Position, velocity and acceleration asked for at the servo's samples.

    Parameters
    ----------
    reference : (T,) array
        Positions [m].
    period : float
        Between them [s].
    inner : int
        Servo's samples for each, on straight lines between them; the last position holds.
    velocity : float
        Before the first sample [m/s].

    Returns
    -------
    (T * inner, 3) array
        [m], [m/s], [m/s^2]; derivatives are backward differences at the servo's rate.
    """
    step = period / inner
    ahead = np.append(reference[1:], reference[-1:]) - reference
    x = (reference[:, np.newaxis] + ahead[:, np.newaxis] * (np.arange(inner) / inner)).ravel()
    v = np.diff(x, prepend=x[0] - step * velocity) / step
    a = np.diff(v, prepend=velocity) / step
    return np.stack((x, v, a), axis=1)


def first_state(
    start: DriveStart, reference: tuple[float, float, float], servo: ServoParameters
) -> ServoState:
    """State with which the first command is the one given, the lags settled."""
    x_ref, forward, ahead = reference
    v_ref = servo.loop_gain * (x_ref - start.position) + servo.velocity_feedforward * forward
    rest = start.command - servo.acceleration_feedforward * ahead
    rest -= servo.proportional * (v_ref - start.velocity)
    integral = rest / servo.integral if servo.integral > 0 else 0.0
    return ServoState(integral, start.velocity, v_ref)


def samples(name: str, values: ArrayLike, length: int | None = None) -> Floats:
    """``values`` as finite numbers, shape (T,).

    Raises
    ------
    ValueError
        When they are not, or not as many as ``length``.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not array.size:
        raise ValueError(f"{name} has shape {array.shape}: give one row of at least one sample")
    if length is not None and len(array) != length:
        raise ValueError(f"{name} has {len(array)} samples, the reference {length}: give as many")
    wrong = np.flatnonzero(~np.isfinite(array))
    if wrong.size:
        raise ValueError(f"{name}[{wrong[0]}] = {array[wrong[0]]}: give finite samples")
    return array


def check_steps(period: float, substeps: int) -> None:
    """Refuse a period or a number of substeps that is none.

    Raises
    ------
    ValueError
        With the value.
    """
    if not (isfinite(period) and period > 0):
        raise ValueError(f"period = {period} s must be finite and positive")
    if substeps < 1:
        raise ValueError(f"substeps = {substeps} must be at least 1")
