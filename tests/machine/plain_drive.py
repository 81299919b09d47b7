"""One feed axis step by step in plain Python: what the compiled servo drive is held against.

At each sample the servo sees the encoder and sets the command, which holds until the next sample.
The encoder sits on the motor: with backlash the carriage is elsewhere.  Equations are those of
:mod:`pipeline.machine.axis.servo`, :mod:`pipeline.machine.axis.feed_drive` and
:mod:`pipeline.machine.axis.friction`.
"""

from dataclasses import dataclass, field
from math import exp, expm1
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.machine.axis.friction import FrictionParameters
from pipeline.machine.axis.servo import ServoParameters
from pipeline.schema.arrays import Floats
from pipeline.twin.drive import (
    DriveStart,
    check_stability,
    check_steps,
    samples,
)
from tests.twin.axes import DriveParameters


def speed_after(
    v: float, force: float, mass: float, period: float, friction: FrictionParameters
) -> tuple[float, float]:
    """Speed one step on under a held force, and friction's mean over the step.

    Viscous friction is taken at both ends of the step (Crank and Nicolson), the level at the old
    speed; at standstill, and where the step passes it, the level is F_s.  Second order in the step
    but for the Stribeck term, which is of first order.

    Parameters
    ----------
    v : float
        Speed before [m/s].
    force : float
        All that pushes but friction [N].
    mass, period : float
        [kg], [s].
    friction : FrictionParameters
        Both directions.

    Returns
    -------
    v_next : float
        [m/s]; 0 while ``force`` is not above F_s at standstill.
    mean : float
        Force against positive motion [N]: M (v_next - v) / period = force - mean.
    """
    before = friction.positive if v > 0 else friction.negative
    free = v + period / mass * (force - 0.5 * before.viscous * v)
    after = friction.positive if free > 0 else friction.negative
    share = exp(-((v / before.stribeck_velocity) ** 2)) if v * free > 0 else 1.0
    level = after.coulomb + (after.static - after.coulomb) * share
    slip = max(abs(free) - period / mass * level, 0.0)
    slip /= 1.0 + 0.5 * period / mass * after.viscous
    v_next = slip if free > 0 else -slip
    return v_next, force - mass * (v_next - v) / period


def screw_step(
    x: float, v: float, command: float, load: float, period: float, drive: FeedDriveParameters
) -> tuple[float, float, float]:
    """Position and speed one step on under a held command, and friction's mean over the step.

    Position by the trapezoid, so that the balance of energy closes in each step:
    M (v_next^2 - v^2) / 2 = (k A - F_g - F_d - F_f) (x_next - x).

    Parameters
    ----------
    x, v : float
        Before the step [m], [m/s].
    command : float
        A [A].
    load : float
        F_d, against positive motion [N].
    period : float
        Length of the step [s].
    drive : FeedDriveParameters
        The axis.

    Returns
    -------
    x, v, friction : float
        [m], [m/s], [N].
    """
    force = drive.force_constant * command - drive.offset - load
    v_next, friction = speed_after(v, force, drive.mass, period, drive.friction)
    return x + 0.5 * period * (v + v_next), v_next, friction


def carriage_position(carriage: float, x: float, backlash: float) -> float:
    """Position of a carriage that the screw at ``x`` takes along at either end of a gap [m].

    A play operator: the carriage stays where friction holds it until one end of the gap reaches
    it, and has then the screw's speed.  Its shocks and its free flight are not modelled.
    """
    return min(max(carriage, x - 0.5 * backlash), x + 0.5 * backlash)


class ServoState(NamedTuple):
    """State of the loops from sample to sample.

    Parameters
    ----------
    integral : float
        Of the velocity error, up to this sample [m].
    velocity : float
        As the velocity loop saw it last, T_v behind [m/s].
    velocity_ref : float
        As it reached the velocity loop last, T_x behind [m/s].
    """

    integral: float
    velocity: float
    velocity_ref: float


def servo_step(
    reference: tuple[float, float, float],
    x: float,
    v: float,
    state: ServoState,
    period: float,
    servo: ServoParameters,
) -> tuple[float, ServoState]:
    """Command of one sample, and the state for the next one.

    Parameters
    ----------
    reference : tuple of float
        x_ref and its first two derivatives [m], [m/s], [m/s^2].
    x, v : float
        Measured position and speed [m], [m/s].
    state : ServoState
        Left by the sample before.
    period : float
        From sample to sample [s].
    servo : ServoParameters
        The loops.

    Returns
    -------
    command : float
        [A].
    state : ServoState
        Its integral stays while the limit holds and the error would carry it further (conditional
        integration).
    """
    x_ref, forward, ahead = reference
    command_v = servo.loop_gain * (x_ref - x) + servo.velocity_feedforward * forward
    v_ref = state.velocity_ref + approach(servo.position_lag, period) * (
        command_v - state.velocity_ref
    )
    v_fed_back = state.velocity + approach(servo.velocity_lag, period) * (v - state.velocity)
    error = v_ref - v_fed_back
    unlimited = servo.proportional * error + servo.integral * state.integral
    unlimited += servo.acceleration_feedforward * ahead
    command = min(max(unlimited, -servo.current_limit), servo.current_limit)
    growth = 0.0 if (unlimited - command) * error > 0 else period * error
    return command, ServoState(state.integral + growth, v_fed_back, v_ref)


def approach(lag: float, period: float) -> float:
    """Share of a step that a first-order lag [s] has followed after one period [s]; 1 without."""
    return -expm1(-period / lag) if lag > 0 else 1.0


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
    """Commanded position, velocity and acceleration at the servo's samples.

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
