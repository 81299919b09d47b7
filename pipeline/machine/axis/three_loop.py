"""Simulation of a feed axis down to its currents, and its trace (Feed2025).

Position P with feed-forward, speed PI or fuzzy PI, currents PI, space-vector modulation (mean or
switched), synchronous motor, shaft that twists, guideway with Stribeck friction.  A step of the
mechanics is in :mod:`pipeline.machine.axis.drive_train`, the loops in
:mod:`pipeline.machine.axis.three_loop_kernel`; here their parameters come together.
"""

from dataclasses import asdict, dataclass
from math import isinf

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.axis import drive_train
from pipeline.machine.axis import three_loop_kernel as kernel
from pipeline.machine.axis.drive_parameters import DirectionFriction, samples
from pipeline.machine.axis.loops import FuzzyParameters, PositionLoopParameters
from pipeline.machine.axis.three_loop_axis import ThreeLoopParameters, check_steps
from pipeline.schema.arrays import Floats

_NO_RULES = FuzzyParameters(error_scale=0.0, change_scale=0.0)
_OPEN = PositionLoopParameters(gain=1.0)
_LONGEST = 1e9
"""Greatest number of periods of the current loops between two samples."""


@dataclass(frozen=True, kw_only=True)
class ThreeLoopTrace:
    """Simulated axis at T samples; every array but the last has shape (T,)."""

    time: Floats
    """Time [s]."""
    reference: Floats
    """Position [m] or speed [rad/s], whichever was followed."""
    position: Floats
    motor_position: Floats
    """Carriage, and motor's angle times L / 2 pi [m]."""
    speed: Floats
    load_speed: Floats
    """Speed of the motor, and of the load about its shaft [rad/s]."""
    i_d: Floats
    i_q: Floats
    """[A]."""
    u_d: Floats
    u_q: Floats
    """Mean over the period of the current loops that ends there [V]."""
    torque: Floats
    """T_e [N m]."""
    friction: Floats
    """Friction of the guideway, against positive motion [N]; for rigid shafts that stand, with the
    motor's."""
    proportional: Floats
    integral: Floats
    """K_p [N m s/rad] and K_i [N m/rad] of the speed loop in the period that ends there."""
    states: Floats
    """Columns of :mod:`pipeline.machine.axis.three_loop_kernel`, energies [J] among them; shape
    (T, COLUMNS)."""


def follow_position(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    *,
    load: ArrayLike = 0.0,
    steps: int = 5,
) -> ThreeLoopTrace:
    """Axis under position control, from rest at the first reference.

    ValueError when an input does not fit, or the drive runs away.

    Parameters
    ----------
    reference : array_like, shape (T,)
        Positions [m], straight between samples.
    period : float
        Sampling period [s], a whole multiple of the current loops' period.
    drive : ThreeLoopParameters
        The axis.
    load : array_like, shape (T,) or ()
        Force on the carriage against positive motion [N], held from sample to sample.
    steps : int
        Steps of the integrator in one period of the current loops.
    """
    if drive.position_loop is None:
        raise ValueError("drive.position_loop is missing: give one, or follow speeds")
    return _follow(reference, period, drive, load, steps, position=True)


def follow_speed(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    *,
    load: ArrayLike = 0.0,
    steps: int = 5,
) -> ThreeLoopTrace:
    """Motor under speed control, from rest, the position loop open.

    ``reference`` are motor speeds [rad/s], held from sample to sample; all else, and errors, as in
    :func:`follow_position`.
    """
    return _follow(reference, period, drive, load, steps, position=False)


def _follow(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    load: ArrayLike,
    steps: int,
    *,
    position: bool,
) -> ThreeLoopTrace:
    target = samples("reference", reference)
    force = samples("load", np.full(target.size, load) if np.ndim(load) == 0 else load, target.size)
    clock = drive.current_loop.period
    check_steps(drive, steps)
    ratio = drive.transmission.ratio
    y = np.zeros(drive_train.STATES)
    if position:
        y[drive_train.TH_M] = y[drive_train.TH_L] = target[0] / ratio
    out = np.empty((target.size, kernel.COLUMNS))
    reached = kernel.follow(
        target, force * ratio, _periods(period, clock), _winding(drive), shafts(drive),
        _settings(drive, steps, position), y, np.zeros(kernel.MEMORY),
        np.zeros((drive_train.WORK_ROWS, drive_train.STATES)), out,
    )  # fmt: skip
    if reached < target.size or not np.isfinite(out).all():
        raise ValueError(
            f"the drive runs away at {reached * period:.4g} s: lower the gains of the position or "
            "speed loop, or the load"
        )
    return _trace(target, period, drive, out)


def _periods(period: float, clock: float) -> int:
    many = round(period / clock) if 0 < period < _LONGEST * clock else 0
    if many < 1 or abs(many * clock - period) > 1e-9 * period:
        raise ValueError(
            f"period = {period} s must be a whole multiple of current_loop.period = {clock} s, "
            f"less than {_LONGEST:g} of it"
        )
    return many


def _trace(
    reference: Floats, period: float, drive: ThreeLoopParameters, out: Floats
) -> ThreeLoopTrace:
    ratio = drive.transmission.ratio
    return ThreeLoopTrace(
        time=period * np.arange(reference.size, dtype=np.float64), reference=reference,
        position=ratio * out[:, drive_train.TH_L], motor_position=ratio * out[:, drive_train.TH_M],
        speed=out[:, drive_train.W_M], load_speed=out[:, drive_train.W_L],
        i_d=out[:, drive_train.I_D], i_q=out[:, drive_train.I_Q], u_d=out[:, kernel.U_D],
        u_q=out[:, kernel.U_Q], torque=out[:, kernel.TORQUE],
        friction=out[:, kernel.FRICTION] / ratio, proportional=out[:, kernel.GAIN_P],
        integral=out[:, kernel.GAIN_I], states=out,
    )  # fmt: skip


def _winding(drive: ThreeLoopParameters) -> drive_train.Winding:
    names = drive_train.Winding._fields
    return drive_train.Winding(*(float(getattr(drive.motor, name)) for name in names))


def shafts(drive: ThreeLoopParameters) -> drive_train.Shafts:
    """Parameters of the speeds; the guideway's friction about the screw."""
    motor, transmission, r = drive.motor, drive.transmission, drive.transmission.ratio
    rigid = isinf(transmission.stiffness)
    return drive_train.Shafts(
        motor_inertia=float(motor.inertia),
        motor_damping=float(motor.damping),
        motor_coulomb=float(motor.coulomb),
        load_inertia=float(transmission.load_inertia),
        load_damping=float(transmission.load_damping),
        stiffness=0.0 if rigid else float(transmission.stiffness),
        internal_damping=float(transmission.internal_damping),
        rigid=rigid,
        positive=_about_screw(drive.friction.positive, r),
        negative=_about_screw(drive.friction.negative, r),
    )


def _about_screw(friction: DirectionFriction, ratio: float) -> drive_train.Direction:
    return drive_train.Direction(
        coulomb=friction.coulomb * ratio,
        static=friction.static * ratio,
        stribeck=friction.stribeck_velocity / ratio,
        viscous=friction.viscous * ratio**2,
    )


def _settings(drive: ThreeLoopParameters, steps: int, position: bool) -> kernel.Loops:
    motor, current, speed = drive.motor, drive.current_loop, drive.speed_loop
    outer = drive.position_loop or _OPEN
    gain_d, integral_d = current.gains(motor.resistance, motor.inductance_d)
    gain_q, integral_q = current.gains(motor.resistance, motor.inductance_q)
    rules = asdict(speed.fuzzy or _NO_RULES)
    return kernel.Loops(
        period=float(current.period), steps=int(steps),
        gain_d=gain_d, integral_d=integral_d, gain_q=gain_q, integral_q=integral_q,
        torque_constant=float(motor.torque_constant), torque_limit=float(speed.torque_limit),
        proportional=float(speed.proportional), integral=float(speed.integral),
        fuzzy=speed.fuzzy is not None, **{name: float(rule) for name, rule in rules.items()},
        speed_every=int(speed.every), position=position, gain=float(outer.gain),
        feedforward=float(outer.velocity_feedforward), motor_encoder=bool(outer.motor_encoder),
        position_every=int(outer.every), ratio=float(drive.transmission.ratio),
        dc_link=float(drive.inverter.dc_link), switched=bool(drive.inverter.switched),
        overmodulation=bool(drive.inverter.overmodulation),
    )  # fmt: skip
