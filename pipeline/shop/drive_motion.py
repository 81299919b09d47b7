"""How a simulated axis moves (numba): cascade, current loop, motor, screw, carriage, guideways.

Two masses m_m x_m'' = F_m - F_s - B x_m' and m_c x_c'' = F_s - F_f - F_g - F_load with the screw's
force F_s between them (Altintas et al. 2011), LuGre friction F_f = σ0 z + σ1 z' + σ2 v with
z' = v - σ0 |v| z / g(v) (Canudas de Wit et al. 1995), σ1 fading as Stribeck's term does
(Olsson 1996).  Semi-implicit Euler, the bristle fully implicit, which is stable at any speed and
has the steady state of the equation.  What depends on the angle of motor and screw is kept for a
tick of the velocity loop.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

MEASURED, CURRENT, MOTOR, MOTOR_SPEED, CARRIAGE, SPEED, FRICTION, BRISTLE, FORCE = range(9)
"""Columns of what :func:`followed` returns: m, A, m, m/s, m, m/s, N, m, N."""


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
    dip: tuple[float, float]
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


@njit(cache=True)
def _screw(m: Mechanics, stretch: float, speed: float) -> float:
    """Force of the screw on the carriage [N]; with backlash its flanks only push."""
    if m.half_backlash == 0.0:
        return m.stiffness * stretch + m.damping * speed
    if stretch > m.half_backlash:
        return max(m.stiffness * (stretch - m.half_backlash) + m.damping * speed, 0.0)
    if stretch < -m.half_backlash:
        return min(m.stiffness * (stretch + m.half_backlash) + m.damping * speed, 0.0)
    return 0.0


@njit(cache=True, error_model="numpy")
def _friction(m: Mechanics, v: float, z: float, pitch: float) -> tuple[float, float]:
    """Force against motion [N] and the bristle [m] after a step; ``pitch`` scales the level."""
    way = 1 if v > 0 else 0
    slow = np.exp(-((v / m.stribeck[way]) ** 2))
    level = (m.coulomb[way] + m.dip[way] * slow) * pitch
    bent = (z + m.step * v) * level / (level + m.step * m.bristle * abs(v))
    damping = m.bristle_damping * slow * (bent - z) * m.frequency
    return m.bristle * bent + damping + m.viscous[way] * v, bent


@njit(cache=True)
def _motor(m: Mechanics, turn: float) -> tuple[float, float]:
    """Force for each ampere [N/A] and force without current [N] at an angle of the motor."""
    tooth = m.cogging_period * turn
    cogging = m.cogging * (np.sin(tooth) + np.sin(2 * tooth + 0.7) / 3)
    return m.force_constant * (1 + m.ripple * np.sin(m.ripple_period * turn)), cogging


@njit(cache=True)
def _limited(c: Loops, error: float, integral: float, ahead: float) -> tuple[float, float]:
    """Current command [A] and the integral after it, which does not wind up at the limit."""
    wanted = c.velocity_gain * error + integral + ahead
    command = min(max(wanted, -c.limit), c.limit)
    if command == wanted or error * wanted < 0:
        integral += c.integral_gain * error * c.velocity_period
    return command, integral


@njit(cache=True)
def _seen(x: float, step: float) -> float:
    return np.floor(x / step + 0.5) * step


@njit(cache=True, error_model="numpy")
def followed(
    m: Mechanics, c: Loops, reference: np.ndarray, load: np.ndarray, extra: np.ndarray,
    noise: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """What an axis does, shape (T, 9), at the ticks of its position loop, from standstill.

    Parameters
    ----------
    m, c : Mechanics, Loops
        The axis.
    reference, load, extra : (T,) arrays
        Commanded position [m], force against positive motion [N], mass on the carriage [kg].
    noise : (T velocity_ticks,) array
        Of the current [A].
    """
    out = np.empty((reference.size, 9))
    x_c = reference[0]
    x_m = x_c + m.weight / m.stiffness + (m.half_backlash if m.weight > 0 else 0.0)
    if c.at_motor:
        x_m, x_c = x_c, x_c - (x_m - x_c)
    v_m, v_c, z, friction, force, filtered = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    push_m, integral = m.step / m.motor_mass, m.weight / m.force_constant
    current, waiting, applied = integral, integral, integral
    before, last, rate = _seen(x_m, c.encoder_step), reference[0], 0.0
    for k in range(reference.size):
        measured = _seen(x_m if c.at_motor else x_c, c.scale_step)
        out[k] = (measured, current, x_m, v_m, x_c, v_c, friction, z, force)
        was, rate = rate, (reference[k] - last) / c.position_period
        last = reference[k]
        wanted = c.position_gain * (reference[k] - measured) + c.velocity_feedforward * rate
        ahead = c.acceleration_feedforward * (rate - was) / c.position_period
        push_c = m.step / (m.carriage + extra[k])
        for n in range(c.velocity_ticks):
            now = _seen(x_m, c.encoder_step)
            filtered += c.filter_share * ((now - before) / c.velocity_period - filtered)
            before, applied = now, waiting
            waiting, integral = _limited(c, wanted - filtered, integral, ahead)
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
