"""A simulated axis motor under speed steps (numba): synchronous motor, current loops, inverter.

u_d = R i_d + λ_d' - w λ_q, u_q = R i_q + λ_q' + w λ_d with λ_d = L_d i_d + φ, torque
1.5 p (λ_d i_q - λ_q i_d), in amplitudes of phase values; λ_q saturates, the winding warms up, and
each phase loses a voltage against its current to the inverter's dead time.  Runge-Kutta of order 4.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

U_D, U_Q, I_D, I_Q, SPEED, WARMTH, TORQUE = range(7)
"""Columns of what :func:`driven` returns: V, V, A, A, rad/s, K, N m."""
COPPER = 0.00393
"""Resistance per kelvin [1/K]."""
SMALL = 0.1
"""Current at which half of the dead time's voltage is lost [A]."""


class Machine(NamedTuple):
    """Constants of motor, load and loops in SI."""

    period: float  # of the loops
    steps: int  # of the integration in a period
    pole_pairs: float
    resistance: float
    inductance_d: float
    inductance_q: float
    saturation: float  # 1/A2
    flux: float
    inertia: float
    viscous: float
    coulomb: float
    heat_capacity: float
    cooling: float
    lost_voltage: float
    limit_voltage: float
    limit_current: float
    current_gain: float  # rad/s, of both loops
    speed_gain: float  # N m s/rad over the torque constant [A s/rad]
    speed_integral: float


@njit(cache=True)
def _lost(m: Machine, i_d: float, i_q: float, angle: float) -> tuple[float, float]:
    """Voltage that the dead time costs, along d and q [V]."""
    c, s = np.cos(angle), np.sin(angle)
    alpha, beta = c * i_d - s * i_q, s * i_d + c * i_q
    half, root = -0.5 * alpha, np.sqrt(0.75) * beta
    a, b, c_ = _toll(m, alpha), _toll(m, half + root), _toll(m, half - root)
    e_alpha, e_beta = (2 * a - b - c_) / 3, (b - c_) / np.sqrt(3.0)
    return c * e_alpha + s * e_beta, c * e_beta - s * e_alpha


@njit(cache=True)
def _toll(m: Machine, current: float) -> float:
    return m.lost_voltage * current / (abs(current) + SMALL)


@njit(cache=True)
def _change(
    m: Machine, x: tuple[float, float, float, float, float], u_d: float, u_q: float, load: float
) -> tuple[float, float, float, float, float]:
    """Derivative of i_d, i_q, speed, electrical angle, warmth."""
    i_d, i_q, speed, angle, warmth = x
    electrical = m.pole_pairs * speed
    r = m.resistance * (1 + COPPER * warmth)
    e_d, e_q = _lost(m, i_d, i_q, angle)
    bend = m.saturation * i_q * i_q
    flux_d = m.inductance_d * i_d + m.flux
    flux_q = m.inductance_q * i_q * (1 - bend)
    torque = 1.5 * m.pole_pairs * (flux_d * i_q - flux_q * i_d)
    braking = m.viscous * speed + m.coulomb * np.tanh(speed / 0.5)
    return (
        (u_d - e_d - r * i_d + electrical * flux_q) / m.inductance_d,
        (u_q - e_q - r * i_q - electrical * flux_d) / (m.inductance_q * (1 - 3 * bend)),
        (torque - braking - load) / m.inertia,
        electrical,
        (1.5 * r * (i_d * i_d + i_q * i_q) - m.cooling * warmth) / m.heat_capacity,
    )


@njit(cache=True)
def _moved(
    x: tuple[float, float, float, float, float], k: tuple[float, float, float, float, float],
    h: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    return x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3], x[4] + h * k[4]


@njit(cache=True)
def _stepped(
    m: Machine, x: tuple[float, float, float, float, float], u_d: float, u_q: float, load: float
) -> tuple[float, float, float, float, float]:
    """State after one step of Runge and Kutta."""
    h = m.period / m.steps
    a = _change(m, x, u_d, u_q, load)
    b = _change(m, _moved(x, a, h / 2), u_d, u_q, load)
    c = _change(m, _moved(x, b, h / 2), u_d, u_q, load)
    d = _change(m, _moved(x, c, h), u_d, u_q, load)
    x = _moved(_moved(x, a, h / 6), b, h / 3)
    return _moved(_moved(x, c, h / 3), d, h / 6)


@njit(cache=True)
def _voltages(
    m: Machine, error_d: float, error_q: float, held_d: float, held_q: float, speed: float,
    flux_d: float, flux_q: float,
) -> tuple[float, float, bool]:  # fmt: skip
    """Voltages that the current loops ask for [V], and whether the inverter must cut them."""
    electrical = m.pole_pairs * speed
    u_d = m.current_gain * m.inductance_d * error_d + held_d - electrical * flux_q
    u_q = m.current_gain * m.inductance_q * error_q + held_q + electrical * flux_d
    size = np.hypot(u_d, u_q)
    if size <= m.limit_voltage:
        return u_d, u_q, False
    return u_d * m.limit_voltage / size, u_q * m.limit_voltage / size, True


@njit(cache=True)
def driven(
    m: Machine, speed_ref: np.ndarray, current_ref: np.ndarray, load: np.ndarray
) -> np.ndarray:
    """What the motor does, shape (T, 7): currents and speed at each tick, voltages from it on.

    Voltages are computed one period ahead, as digital loops do; integrals rest while the current
    or the voltage is at its limit.

    Parameters
    ----------
    m : Machine
        Motor, inverter, loops.
    speed_ref, current_ref, load : (T,) arrays
        Commanded speed [rad/s] and i_d [A], torque of the load [N m].
    """
    out = np.empty((speed_ref.size, 7))
    x = (0.0, 0.0, 0.0, 0.0, 0.0)
    drawn, held_d, held_q, u_d, u_q, cut = 0.0, 0.0, 0.0, 0.0, 0.0, False
    slow = m.current_gain * m.resistance * m.period
    for k in range(speed_ref.size):
        i_d, i_q, speed = x[0], x[1], x[2]
        flux_d, flux_q = m.inductance_d * i_d + m.flux, m.inductance_q * i_q
        torque = 1.5 * m.pole_pairs * (flux_d * i_q - flux_q * i_d)
        out[k] = (u_d, u_q, i_d, i_q, speed, x[4], torque)
        error = speed_ref[k] - speed
        wanted = m.speed_gain * error + drawn
        target = min(max(wanted, -m.limit_current), m.limit_current)
        if wanted == target or error * wanted < 0:
            drawn += m.speed_integral * error * m.period
        error_d, error_q = current_ref[k] - i_d, target - i_q
        if not cut:
            held_d += slow * error_d
            held_q += slow * error_q
        ahead_d, ahead_q, cut = _voltages(
            m, error_d, error_q, held_d, held_q, speed, flux_d, flux_q
        )
        for _ in range(m.steps):
            x = _stepped(m, x, u_d, u_q, load[k])
        u_d, u_q = ahead_d, ahead_q
    return out
