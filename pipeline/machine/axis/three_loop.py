"""Feed axis down to its currents, compiled: position, speed and current loops on a drive train.

Position P with feed-forward, speed PI or fuzzy PI, currents PI, space-vector modulation (mean or
switched), synchronous motor, shaft that twists, guideway with Stribeck friction (Feed2025).  A step
of the mechanics is in :mod:`pipeline.machine.axis.drive_train`.  Each period of the current loops:
position loop and speed loop when it is their turn, both current loops, modulation, and the drive
train under the voltage that comes of it.  Loops read angles, speed and currents exactly at the
period's start, and act at once; the voltage's frame is turned on by half a period, so that its mean
lies in the commanded direction.

The catalogue axis is put together for comparisons where no machine is at hand.
Motor: 2 kW, 3000 rev/min, 6.36 N m, at most 19.1 N m, 0.544 N m/A (of an effective ampere),
3.19e-4 kg m^2, inertia time constant 0.62 ms, inductive time constant 8.3 ms (Yaskawa Sigma-II
User's Manual, section 8.1.4, SGMSH-20A).  From them phi_f = k_t / (sqrt(2) 3/2 p),
R = tau_m 3/2 (p phi_f)^2 / J and L = tau_e R, with p = 4, which the manual does not name.
Inverter on 200 V mains, rectified.  Screw of 40 mm and 0.97 m with a lead of 10 mm, table of
300 kg: 0.0030 kg m^2 about the motor in all, as Feed2025 has it.  Stiffnesses are those of a
bellows coupling, of the screw's core (34 mm) in torsion, and of a preloaded nut with bearings at
both ends; damping of the twist gives 3 % of critical at the resonance of 247 Hz.
"""

from dataclasses import asdict, dataclass
from functools import partial
from math import ceil, cos, isfinite, isinf, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels import compiled
from pipeline.machine.axis import drive_train
from pipeline.machine.axis.drive_parameters import samples
from pipeline.machine.axis.drive_train import I_D, I_Q, STATES, TH_L, TH_M, W_L, W_M
from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    FuzzyParameters,
    PositionLoopParameters,
    SpeedLoopParameters,
    increments,
    induced_voltages,
)
from pipeline.machine.axis.motor import (
    InverterParameters,
    MotorParameters,
    duty,
    leg_voltage,
    limited,
    rotated,
    torque,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import DirectionFriction, FrictionParameters

_LONGEST_STEP = 0.5
"""Greatest product of a step and a rate of the drive.  The classical method of order four is stable
to 2.8; at a half a free swing loses a per mille of its amplitude in three periods."""


@dataclass(frozen=True, kw_only=True)
class ThreeLoopParameters:
    """Parts of one feed axis."""

    motor: MotorParameters
    """Synchronous motor."""
    inverter: InverterParameters
    """Inverter that feeds it."""
    transmission: drive_train.TransmissionParameters
    """Drive train from the motor's shaft to the carriage."""
    friction: FrictionParameters
    """Friction of the guideway, at the carriage."""
    current_loop: CurrentLoopParameters
    """Innermost loops, whose period is the clock of all."""
    speed_loop: SpeedLoopParameters
    """PI or fuzzy PI."""
    position_loop: PositionLoopParameters | None = None
    """Outermost loop; it may be left out where only speeds are followed."""


def check_steps(drive: ThreeLoopParameters, steps: int) -> None:
    """Refuse steps that are too long for the drive's windings or its shaft."""
    if not (isfinite(steps) and steps >= 1 and steps % 1 == 0):
        raise ValueError(f"steps = {steps} must be a whole number from 1")
    rates = _rates(drive)
    fastest = max(rates, key=lambda name: rates[name])
    needed = ceil(rates[fastest] * drive.current_loop.period / _LONGEST_STEP)
    if steps < needed:
        raise ValueError(
            f"steps = {steps} are too few for {fastest} of {rates[fastest]:.4g} 1/s: "
            f"take {needed} or more"
        )


def _rates(drive: ThreeLoopParameters) -> dict[str, float]:
    """Fastest rates [1/s] of the drive's own motion, by their cause."""
    motor, transmission = drive.motor, drive.transmission
    viscous = max(drive.friction.positive.viscous, drive.friction.negative.viscous)
    drag = transmission.load_damping + viscous * transmission.ratio**2
    inductance = min(motor.inductance_d, motor.inductance_q)
    rates = {"the winding's rate R / L": motor.resistance / inductance}
    if isinf(transmission.stiffness):
        inertia = motor.inertia + transmission.load_inertia
        return rates | {"the damping's rate": (motor.damping + drag) / inertia}
    twist = transmission.internal_damping * (1 / motor.inertia + 1 / transmission.load_inertia)
    load_inertia, stiffness = transmission.load_inertia, transmission.stiffness
    return rates | {
        "the shaft's resonance": drive_train.resonance(motor.inertia, load_inertia, stiffness),
        "the damping's rate": max(motor.damping / motor.inertia, drag / load_inertia, twist),
    }


TORQUE, FRICTION, U_D, U_Q, GAIN_P, GAIN_I = range(STATES, STATES + 6)
"""T_e and the guideway's friction [N m]; of the last period mean voltages [V], K_p and K_i."""
COLUMNS = STATES + 6
"""Columns of a sample: the state, and those above."""
MEMORY = 11
"""Quantities that the loops keep from period to period."""
_X_D, _X_Q, _X_W, _ERROR, _W_REF, _I_REF, _KP, _KI, _UD, _UQ, _STARTED = range(MEMORY)
_FASTEST = 1e6
"""Speed [rad/s] that no motor reaches: beyond it the drive runs away."""


class Loops(NamedTuple):
    """Settings of the loops; see the parameters of each for its meaning."""

    period: float
    steps: int
    gain_d: float
    integral_d: float
    gain_q: float
    integral_q: float
    torque_constant: float
    torque_limit: float
    proportional: float
    integral: float
    fuzzy: bool
    error_scale: float
    change_scale: float
    proportional_span: float
    integral_span: float
    speed_every: int
    position: bool
    gain: float
    feedforward: float
    motor_encoder: bool
    position_every: int
    ratio: float
    dc_link: float
    switched: bool
    overmodulation: bool


_torque = compiled(torque)
_rotated = compiled(rotated)
_induced = compiled(induced_voltages)
_increments = compiled(increments)
_limited = compiled(limited)
_duty = compiled(duty)
_leg_voltage = compiled(leg_voltage)


@compiled
def _follow_loops(reference, load, periods, winding, shafts, loops, y, memory, work, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (T, COLUMNS); the sample from which the drive runs away, or T.

    ``reference`` holds positions [m] or speeds [rad/s] and ``load`` torques against positive motion
    [N m], both of shape (T,); ``periods`` are those of the current loops between two samples.
    ``y`` of shape (STATES,) is the state, ``memory`` of (MEMORY,) zeros; ``work`` has shape
    (WORK_ROWS, STATES).
    """
    T = reference.shape[0]
    done = 0
    for k in range(T):
        _record(y, load[k], winding, shafts, memory, out[k])
        if k == T - 1:
            break
        rise = (reference[k + 1] - reference[k]) / periods
        for c in range(periods):
            if not abs(y[W_M]) < _FASTEST:
                return k
            if not loops.position:
                memory[_W_REF] = reference[k]
            elif done % loops.position_every == 0:
                _position_loop(reference[k] + c * rise, rise / loops.period, y, memory, loops)
            if done % loops.speed_every == 0:
                _speed_loop(y, memory, loops)
            alpha, beta = _current_loops(y, memory, winding, loops)
            if loops.switched:
                _switch(y, alpha, beta, load[k], winding, shafts, loops, work)
            else:
                for _ in range(loops.steps):
                    h = loops.period / loops.steps
                    drive_train.advance(y, h, alpha, beta, load[k], winding, shafts, work)
            done += 1
    return T


@compiled
def _position_loop(reference, velocity, y, memory, loops):  # type: ignore[no-untyped-def]
    angle = y[TH_M] if loops.motor_encoder else y[TH_L]
    v = loops.gain * (reference - loops.ratio * angle) + loops.feedforward * velocity
    memory[_W_REF] = v / loops.ratio


@compiled
def _speed_loop(y, memory, loops):  # type: ignore[no-untyped-def]
    h = loops.period * loops.speed_every
    error = memory[_W_REF] - y[W_M]
    k_p, k_i = loops.proportional, loops.integral
    if loops.fuzzy:
        change = (error - memory[_ERROR]) / h if memory[_STARTED] > 0.0 else 0.0
        p, i = _increments(loops.error_scale * error, loops.change_scale * change)
        k_p *= 1.0 + loops.proportional_span * p
        k_i *= 1.0 + loops.integral_span * i
    commanded = k_p * error + memory[_X_W]
    limited_torque = min(max(commanded, -loops.torque_limit), loops.torque_limit)
    if commanded == limited_torque or error * commanded < 0.0:
        memory[_X_W] += k_i * h * error
    memory[_I_REF] = limited_torque / loops.torque_constant
    memory[_ERROR], memory[_STARTED] = error, 1.0
    memory[_KP], memory[_KI] = k_p, k_i


@compiled
def _current_loops(y, memory, winding, loops):  # type: ignore[no-untyped-def]
    """Voltage in the stator's frame for the period to come [V]."""
    error_d, error_q = -y[I_D], memory[_I_REF] - y[I_Q]
    induced_d, induced_q = _induced(y[I_D], y[I_Q], y[W_M], winding)
    u_d = loops.gain_d * error_d + memory[_X_D] + induced_d
    u_q = loops.gain_q * error_q + memory[_X_Q] + induced_q
    angle = winding.pole_pairs * (y[TH_M] + 0.5 * loops.period * y[W_M])
    c, s = cos(angle), sin(angle)
    alpha, beta = _rotated(u_d, u_q, c, s)
    alpha, beta = _limited(alpha, beta, loops.dc_link, loops.overmodulation)
    given_d, given_q = _rotated(alpha, beta, c, -s)
    memory[_X_D] += loops.integral_d * (error_d + (given_d - u_d) / loops.gain_d)
    memory[_X_Q] += loops.integral_q * (error_q + (given_q - u_q) / loops.gain_q)
    memory[_UD], memory[_UQ] = given_d, given_q
    return alpha, beta


@compiled
def _switch(y, alpha, beta, load, winding, shafts, loops, work):  # type: ignore[no-untyped-def]
    """A carrier period with its six edges, each where it falls."""
    h = loops.period
    a, b, c = _duty(alpha, beta, loops.dc_link)
    t_a, t_b, t_c = 0.5 * h * (1.0 - a), 0.5 * h * (1.0 - b), 0.5 * h * (1.0 - c)
    first, last = min(t_a, t_b, t_c), max(t_a, t_b, t_c)
    middle = t_a + t_b + t_c - first - last
    begin = 0.0
    for end in (first, middle, last, h - last, h - middle, h - first, h):
        length = end - begin
        if length > 0.0:
            at = begin + 0.5 * length
            on_a = 1.0 if t_a < at < h - t_a else 0.0
            on_b = 1.0 if t_b < at < h - t_b else 0.0
            on_c = 1.0 if t_c < at < h - t_c else 0.0
            u, v = _leg_voltage(on_a, on_b, on_c, loops.dc_link)
            steps = ceil(length / h * loops.steps)
            for _ in range(steps):
                drive_train.advance(y, length / steps, u, v, load, winding, shafts, work)
            begin = end


@compiled
def _record(y, load, winding, shafts, memory, out):  # type: ignore[no-untyped-def]
    for j in range(STATES):
        out[j] = y[j]
    out[TORQUE] = _torque(y[I_D], y[I_Q], winding)
    _, mode = drive_train.modes(y, load, winding, shafts)
    if mode != 0.0:
        out[FRICTION] = drive_train.sliding_friction(mode, y[W_L], shafts)
    else:
        # at standstill friction balances the torque; the motor's bearings take their share first
        out[FRICTION] = drive_train.holding_torques(y, load, winding, shafts)[1]
    out[U_D], out[U_Q] = memory[_UD], memory[_UQ]
    out[GAIN_P], out[GAIN_I] = memory[_KP], memory[_KI]


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
    """Columns of :mod:`pipeline.machine.axis.three_loop`, energies [J] among them; shape
    (T, COLUMNS)."""


def _follow(
    reference: ArrayLike, period: float, drive: ThreeLoopParameters, *, position: bool,
    load: ArrayLike = 0.0, steps: int = 5,
) -> ThreeLoopTrace:  # fmt: skip
    """Axis from rest under position control, or its motor under speed control.

    ``reference`` (T,) are positions [m], straight between samples, from which the first one is the
    start, or motor speeds [rad/s], held; ``period`` [s] is a whole multiple of the current loops'.
    ``load`` (T,) or () is the force on the carriage against positive motion [N], held; ``steps``
    are those of the integrator in one period of the current loops.  ValueError when an input does
    not fit, or the drive runs away.
    """
    if position and drive.position_loop is None:
        raise ValueError("drive.position_loop is missing: give one, or follow speeds")
    target = samples("reference", reference)
    force = samples("load", np.full(target.size, load) if np.ndim(load) == 0 else load, target.size)
    clock = drive.current_loop.period
    check_steps(drive, steps)
    ratio = drive.transmission.ratio
    y = np.zeros(drive_train.STATES)
    if position:
        y[drive_train.TH_M] = y[drive_train.TH_L] = target[0] / ratio
    out = np.empty((target.size, COLUMNS))
    reached = _follow_loops(
        target, force * ratio, _periods(period, clock), _winding(drive), shafts(drive),
        _settings(drive, steps, position), y, np.zeros(MEMORY),
        np.zeros((drive_train.WORK_ROWS, drive_train.STATES)), out,
    )  # fmt: skip
    if reached < target.size or not np.isfinite(out).all():
        raise ValueError(
            f"the drive runs away at {reached * period:.4g} s: lower the gains of the position or "
            "speed loop, or the load"
        )
    return _trace(target, period, drive, out)


follow_position = partial(_follow, position=True)
"""Axis under position control, see :func:`_follow`."""
follow_speed = partial(_follow, position=False)
"""Motor under speed control, the position loop open, see :func:`_follow`."""


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
        i_d=out[:, drive_train.I_D], i_q=out[:, drive_train.I_Q], u_d=out[:, U_D],
        u_q=out[:, U_Q], torque=out[:, TORQUE],
        friction=out[:, FRICTION] / ratio, proportional=out[:, GAIN_P],
        integral=out[:, GAIN_I], states=out,
    )  # fmt: skip


def _winding(drive: ThreeLoopParameters) -> drive_train.Winding:
    names = drive_train.Winding._fields
    return drive_train.Winding(*(float(getattr(drive.motor, name)) for name in names))


def shafts(drive: ThreeLoopParameters) -> drive_train.Shafts:
    """Parameters of the speeds; the guideway's friction about the screw."""
    motor, transmission, r = drive.motor, drive.transmission, drive.transmission.ratio
    rigid = isinf(transmission.stiffness)
    return drive_train.Shafts(
        motor_inertia=float(motor.inertia), motor_damping=float(motor.damping),
        motor_coulomb=float(motor.coulomb), load_inertia=float(transmission.load_inertia),
        load_damping=float(transmission.load_damping),
        stiffness=0.0 if rigid else float(transmission.stiffness),
        internal_damping=float(transmission.internal_damping), rigid=rigid,
        positive=_about_screw(drive.friction.positive, r),
        negative=_about_screw(drive.friction.negative, r),
    )  # fmt: skip


def _about_screw(friction: DirectionFriction, ratio: float) -> drive_train.Direction:
    return drive_train.Direction(
        coulomb=friction.coulomb * ratio, static=friction.static * ratio,
        stribeck=friction.stribeck_velocity / ratio, viscous=friction.viscous * ratio**2,
    )  # fmt: skip


def _settings(drive: ThreeLoopParameters, steps: int, position: bool) -> Loops:
    motor, current, speed = drive.motor, drive.current_loop, drive.speed_loop
    outer = drive.position_loop or _OPEN
    gain_d, integral_d = current.gains(motor.resistance, motor.inductance_d)
    gain_q, integral_q = current.gains(motor.resistance, motor.inductance_q)
    rules = asdict(speed.fuzzy or _NO_RULES)
    return Loops(
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


def servo_motor() -> MotorParameters:
    """Motor, from the figures of its catalogue.

    >>> round(servo_motor().torque_constant * 12.7 * 2**0.5, 2)
    6.91
    """
    pole_pairs, inertia = 4, 3.19e-4
    flux = 0.544 / (sqrt(2) * 1.5 * pole_pairs)
    resistance = 0.62e-3 * 1.5 * (pole_pairs * flux) ** 2 / inertia
    inductance = 8.3e-3 * resistance
    return MotorParameters(
        resistance=resistance, inductance_d=inductance, inductance_q=inductance, flux=flux,
        pole_pairs=pole_pairs, inertia=inertia, damping=1e-4, coulomb=0.1,
    )  # fmt: skip


TWIST = {
    "coupling_stiffness": 2e4, "screw_stiffness": 1.1e4, "axial_stiffness": 3e8,
    "internal_damping": 0.03,
}  # fmt: skip
"""Stiffnesses and damping of the catalogue axis' drive train, in SI."""


def servo_axis(*, rigid: bool = False) -> ThreeLoopParameters:
    """Axis with the speed loop's gains at the middle of Feed2025's ranges."""
    guideway = DirectionFriction(coulomb=150, static=220, stribeck_velocity=0.005, viscous=800)
    return ThreeLoopParameters(
        motor=servo_motor(),
        inverter=InverterParameters(dc_link=200 * sqrt(2)),
        transmission=drive_train.TransmissionParameters(
            lead=0.01, mass=300, screw_inertia=1.921e-3, **({} if rigid else TWIST)
        ),
        friction=FrictionParameters(positive=guideway, negative=guideway),
        current_loop=CurrentLoopParameters(bandwidth=2 * pi * 500),
        speed_loop=SpeedLoopParameters(torque_limit=19.1, proportional=0.5, integral=40),
        position_loop=PositionLoopParameters(gain=40),
    )
