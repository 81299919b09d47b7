"""Motion of a feed axis (numba): cascade, current loop, motor, screw, carriage, guideways.

Two masses m_m x_m'' = F_m - F_s - B x_m' and m_c x_c'' = F_s - F_f - F_g - F_load with the screw's
force F_s between them (Altintas et al. 2011), LuGre friction F_f = σ0 z + σ1 z' + σ2 v with
z' = v - σ0 |v| z / g(v) (Canudas de Wit et al. 1995), σ1 fading as Stribeck's term does
(Olsson 1996).  Semi-implicit Euler, the bristle fully implicit, which is stable at any speed and
has the steady state of the equation.  What depends on the angle of motor and screw is kept for a
tick of the velocity loop.  Catalogue values of an axis become constants in SI.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.shop.drives.parameters import INTEGRATION, Axis
from pipeline.shop.parameters import Random

RIPPLE_PERIOD = 6
"""Periods of the torque ripple in each electrical period of the motor."""


class Mechanics(NamedTuple):
    """Constants of screw, carriage and guideways in SI."""

    step: float
    frequency: float  # of the steps
    motor_mass: float
    carriage: float
    stiffness: float
    damping: float
    half_backlash: float
    motor_viscous: float
    weight: float
    gear: float
    force_constant: float
    cogging: float  # N
    cogging_period: float
    ripple: float
    ripple_period: float
    coulomb: tuple[float, float]  # of negative, of positive motion
    stribeck_amplitude: tuple[float, float]
    stribeck: tuple[float, float]
    viscous: tuple[float, float]
    bristle: float
    bristle_damping: float
    pitch_ripple: float


class Loops(NamedTuple):
    """Constants of the cascade in SI."""

    position_period: float
    velocity_period: float
    velocity_ticks: int  # in a tick of the position loop
    steps: int  # in a tick of the velocity loop
    position_gain: float
    velocity_gain: float
    integral_gain: float
    velocity_feedforward: float
    acceleration_feedforward: float
    limit: float
    at_motor: bool
    scale_step: float
    encoder_step: float
    filter_share: float
    current_share: float


@compiled_with()
def _screw(m: Mechanics, stretch: float, speed: float) -> float:
    """Force of the screw on the carriage [N]; with backlash its flanks only push."""
    if m.half_backlash == 0.0:
        return m.stiffness * stretch + m.damping * speed
    if stretch > m.half_backlash:
        return max(m.stiffness * (stretch - m.half_backlash) + m.damping * speed, 0.0)
    if stretch < -m.half_backlash:
        return min(m.stiffness * (stretch + m.half_backlash) + m.damping * speed, 0.0)
    return 0.0


@compiled_with(error_model="numpy")
def _friction(m: Mechanics, v: float, z: float, pitch: float) -> tuple[float, float]:
    """Force against motion [N] and the bristle [m] after a step; ``pitch`` scales the level."""
    side = 1 if v > 0 else 0
    slow = np.exp(-((v / m.stribeck[side]) ** 2))
    level = (m.coulomb[side] + m.stribeck_amplitude[side] * slow) * pitch
    bent = (z + m.step * v) * level / (level + m.step * m.bristle * abs(v))
    damping = m.bristle_damping * slow * (bent - z) * m.frequency
    return m.bristle * bent + damping + m.viscous[side] * v, bent


@compiled_with()
def _motor(m: Mechanics, turn: float) -> tuple[float, float]:
    """Force for each ampere [N/A] and force without current [N] at an angle of the motor."""
    tooth = m.cogging_period * turn
    cogging = m.cogging * (np.sin(tooth) + np.sin(2 * tooth + 0.7) / 3)
    return m.force_constant * (1 + m.ripple * np.sin(m.ripple_period * turn)), cogging


@compiled_with()
def _limited(c: Loops, error: float, integral: float, ahead: float) -> tuple[float, float]:
    """Current command [A] and the integral after it, which does not wind up at the limit."""
    demand = c.velocity_gain * error + integral + ahead
    command = min(max(demand, -c.limit), c.limit)
    if command == demand or error * demand < 0:
        integral += c.integral_gain * error * c.velocity_period
    return command, integral


@compiled_with()
def _encoder(x: float, step: float) -> float:
    return np.floor(x / step + 0.5) * step


@compiled_with(nogil=True, error_model="numpy")
def followed(
    m: Mechanics, c: Loops, reference: np.ndarray, load: np.ndarray, extra: np.ndarray,
    noise: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Motion of an axis, shape (T, 9), at the ticks of its position loop, from standstill.

    Columns are the fields of :class:`Followed`; ``reference`` [m], ``load`` against positive motion
    [N] and mass ``extra`` [kg] (T,), current ``noise`` [A] (T velocity_ticks,).
    """
    out = np.empty((reference.size, 9))
    x_c = reference[0]
    x_m = x_c + m.weight / m.stiffness + (m.half_backlash if m.weight > 0 else 0.0)
    if c.at_motor:
        x_m, x_c = x_c, x_c - (x_m - x_c)
    v_m, v_c, z, friction, force, filtered = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    push_m, integral = m.step / m.motor_mass, m.weight / m.force_constant
    current, waiting, applied = integral, integral, integral
    before, last, rate = _encoder(x_m, c.encoder_step), reference[0], 0.0
    for k in range(reference.size):
        measured = _encoder(x_m if c.at_motor else x_c, c.scale_step)
        out[k] = (measured, current, x_m, v_m, x_c, v_c, friction, z, force)
        was, rate = rate, (reference[k] - last) / c.position_period
        last = reference[k]
        velocity = c.position_gain * (reference[k] - measured) + c.velocity_feedforward * rate
        ahead = c.acceleration_feedforward * (rate - was) / c.position_period
        push_c = m.step / (m.carriage + extra[k])
        for n in range(c.velocity_ticks):
            now = _encoder(x_m, c.encoder_step)
            filtered += c.filter_share * ((now - before) / c.velocity_period - filtered)
            before, applied = now, waiting
            waiting, integral = _limited(c, velocity - filtered, integral, ahead)
            target = applied + noise[k * c.velocity_ticks + n]
            constant, cogging = _motor(m, m.gear * x_m)
            pitch = 1 + m.pitch_ripple * np.sin(m.gear * x_c)
            for _ in range(c.steps):
                current += c.current_share * (target - current)
                force = constant * current + cogging
                screw = _screw(m, x_m - x_c, v_m - v_c)
                friction, z = _friction(m, v_c, z, pitch)
                v_m += push_m * (force - screw - m.motor_viscous * v_m)
                v_c += push_c * (screw - friction - m.weight - load[k])
                x_m += m.step * v_m
                x_c += m.step * v_c
    return out


@dataclass(frozen=True, kw_only=True)
class Followed:
    """An axis at the ticks of its position loop; arrays of shape (T,) in SI."""

    measured: Floats
    """Position that closes the loop [m]."""
    current: Floats
    """Current that makes torque [A]."""
    motor: Floats
    motor_speed: Floats
    carriage: Floats
    speed: Floats
    """True positions [m] and speeds [m/s]; the motor's by the screw's lead."""
    friction: Floats
    bristle: Floats
    force: Floats
    """Friction of the guideways [N], deflection before sliding [m], force of the motor [N]."""


def follow(
    axis: Axis, reference: Floats, random: Random, load: Floats | None = None,
    extra: Floats | None = None, injected: Floats | None = None,
) -> Followed:  # fmt: skip
    """Motion of an axis that follows its commands ``reference`` (T,) [m], from standstill.

    ``load`` (T,) acts against positive motion [N], ``extra`` (T,) lies on the carriage [kg];
    ``injected`` (T,) is added to the command of the current loop, to excite the axis [A].
    """
    nothing: Floats = np.zeros(reference.size)
    ticks = axis.cascade.velocity_frequency // axis.cascade.position_frequency
    noise = random.standard_normal(reference.size * ticks) * axis.motor.current_noise
    if injected is not None:
        noise += np.repeat(injected, ticks)
    out = followed(
        _mechanics(axis), _loops(axis), reference, nothing if load is None else load,
        nothing if extra is None else extra, noise,
    )  # fmt: skip
    return Followed(**dict(zip(Followed.__dataclass_fields__, out.T, strict=True)))


def _mechanics(axis: Axis) -> Mechanics:
    f, motor = axis.friction, axis.motor
    return Mechanics(
        step=1 / INTEGRATION, frequency=float(INTEGRATION), motor_mass=axis.motor_mass,
        carriage=axis.carriage, stiffness=axis.stiffness * 1e6, damping=axis.damping * 1e3,
        half_backlash=axis.backlash * 1e-6 / 2, motor_viscous=axis.motor_viscous * axis.gear**2,
        weight=axis.weight, gear=axis.gear, force_constant=axis.force_constant,
        cogging=motor.cogging * axis.gear, cogging_period=float(motor.cogging_period),
        ripple=motor.torque_ripple, ripple_period=float(RIPPLE_PERIOD * motor.pole_pairs),
        coulomb=(f.coulomb_negative, f.coulomb_positive),
        stribeck_amplitude=(
            f.static_negative - f.coulomb_negative, f.static_positive - f.coulomb_positive,
        ),
        stribeck=(f.stribeck_velocity_negative * 1e-3, f.stribeck_velocity_positive * 1e-3),
        viscous=(f.viscous_negative, f.viscous_positive), bristle=f.bristle_stiffness * 1e6,
        bristle_damping=f.bristle_damping * 1e3, pitch_ripple=f.pitch_ripple,
    )  # fmt: skip


def _loops(axis: Axis) -> Loops:
    c = axis.cascade
    period = 1 / c.velocity_frequency
    return Loops(
        position_period=1 / c.position_frequency, velocity_period=period,
        velocity_ticks=c.velocity_frequency // c.position_frequency,
        steps=INTEGRATION // c.velocity_frequency,
        position_gain=c.position_scale * c.position_gain,
        velocity_gain=c.velocity_scale * c.velocity_gain,
        integral_gain=c.integral_scale * c.integral_gain,
        velocity_feedforward=c.velocity_feedforward,
        acceleration_feedforward=c.acceleration_feedforward, limit=c.current_limit,
        at_motor=c.feedback == "motor", scale_step=c.scale_step * 1e-6,
        encoder_step=axis.lead * 1e-3 / c.steps_per_turn,
        filter_share=float(-np.expm1(-period * 1e3 / c.velocity_filter)),
        current_share=float(-np.expm1(-1e3 / INTEGRATION / axis.motor.current_lag)),
    )  # fmt: skip


def truth(axis: Axis) -> dict[str, float]:
    """Parameters that a fit of one mass with Stribeck friction should recover, in SI.

    Friction is the steady state of LuGre's equation; the bearings of motor and screw count to it.
    Where a scale at the carriage closes the loop the motor is ahead of it by the screw's twist
    k A / K: of the velocity loop's gains a carriage shows S / (1 + S_vi V_i k / K).
    """
    f, c = axis.friction, axis.cascade
    ahead = c.integral_scale * c.integral_gain * axis.force_constant / (axis.stiffness * 1e6)
    shown = 1.0 if c.feedback == "motor" else 1 / (1 + ahead)
    bearings = axis.motor_viscous * axis.gear**2
    sides = ("positive", "negative")
    return {
        "mass": axis.carriage + axis.motor_mass,
        **{f"coulomb_{s}": getattr(f, f"coulomb_{s}") for s in sides},
        **{f"static_{s}": getattr(f, f"static_{s}") for s in sides},
        **{f"stribeck_velocity_{s}": getattr(f, f"stribeck_velocity_{s}") * 1e-3 for s in sides},
        **{f"viscous_{s}": getattr(f, f"viscous_{s}") + bearings for s in sides},
        "offset": axis.weight,
        "backlash": axis.backlash * 1e-6,
        "shaft_stiffness": axis.stiffness * 1e6,
        "shaft_damping": axis.damping * 1e3,
        "motor_mass": axis.motor_mass,
        "motor_inertia": axis.inertia,
        "load_mass": axis.carriage,
        "force_constant": axis.force_constant,
        "position_scale": c.position_scale,
        "velocity_scale": shown * c.velocity_scale,
        "integral_scale": shown * c.integral_scale,
        "velocity_feedforward": c.velocity_feedforward,
        "acceleration_feedforward": c.acceleration_feedforward,
    }


def hidden(axis: Axis) -> dict[str, float]:
    """Parameters beyond any model of one mass, in SI, and what records show in their place.

    Motion shows only sums of Coulomb friction and a constant force: a fit with equal friction in
    both directions recovers ``coulomb_if_equal`` and ``offset_if_equal``.
    """
    f = axis.friction
    return {
        "coulomb_if_equal": (f.coulomb_positive + f.coulomb_negative) / 2,
        "offset_if_equal": axis.weight + (f.coulomb_positive - f.coulomb_negative) / 2,
        "carriage": axis.carriage,
        "motor_mass": axis.motor_mass,
        "stiffness": axis.stiffness * 1e6,
        "bristle_stiffness": f.bristle_stiffness * 1e6,
        "bristle_damping": f.bristle_damping * 1e3,
        "motor_viscous": axis.motor_viscous * axis.gear**2,
        "cogging": axis.motor.cogging * axis.gear,
        "loop_gain": axis.cascade.position_scale * axis.cascade.position_gain,
        "velocity_scale_at_motor": axis.cascade.velocity_scale,
        "integral_scale_at_motor": axis.cascade.integral_scale,
    }
