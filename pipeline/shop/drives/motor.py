"""Axis motor under speed steps (numba): synchronous motor, current loops, inverter, its truth.

u_d = R i_d + λ_d' - w λ_q, u_q = R i_q + λ_q' + w λ_d with λ_d = L_d i_d + φ, torque
1.5 p (λ_d i_q - λ_q i_d), in amplitudes of phase values; λ_q saturates, the winding warms up, and
each phase loses a voltage against its current to the inverter's dead time.  Runge-Kutta of order 4.
"""

from typing import Any, NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.shop.drives.parameters import Axis, AxisMotor

U_D, U_Q, I_D, I_Q, SPEED, WARMTH, TORQUE = range(7)
"""Columns of the result of :func:`driven`: V, V, A, A, rad/s, K, N m."""
COPPER = 0.00393
"""Temperature coefficient of the resistance of copper [1/K]."""
SMALL = 0.1
"""Current at which half of the dead time's voltage is lost [A]."""
RATE = 10000
"""Sampling rate, and the rate of the current loops [Hz]."""
STEPS = 5
"""Steps of the integration in each period of the loops."""
SPEEDS = (300.0, -300.0, 900.0, -900.0, 1500.0, -1500.0, 2200.0, -2200.0, 600.0, -600.0, 0.0)
"""Speeds that are commanded one after the other [rev/min]."""
HOLD = 0.5
"""Time at each commanded speed [s]."""
FIELD = (0.0, -3.0, 2.0)
"""Commanded i_d [A], each for a third of the time of a speed."""
PUSH = 6.0
"""Torque of the load in the second half of every other speed [N m]."""
BANDWIDTH = 2 * np.pi * 500
"""Bandwidth of the current loops [rad/s]."""


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


@compiled_with()
def _dead_time_voltage(m: Machine, i_d: float, i_q: float, angle: float) -> tuple[float, float]:
    """Voltage that the dead time costs, along d and q [V]."""
    c, s = np.cos(angle), np.sin(angle)
    alpha, beta = c * i_d - s * i_q, s * i_d + c * i_q
    half, root = -0.5 * alpha, np.sqrt(0.75) * beta
    a, b, c_ = _phase_loss(m, alpha), _phase_loss(m, half + root), _phase_loss(m, half - root)
    e_alpha, e_beta = (2 * a - b - c_) / 3, (b - c_) / np.sqrt(3.0)
    return c * e_alpha + s * e_beta, c * e_beta - s * e_alpha


@compiled_with()
def _phase_loss(m: Machine, current: float) -> float:
    return m.lost_voltage * current / (abs(current) + SMALL)


@compiled_with()
def _change(
    m: Machine, x: tuple[float, float, float, float, float], u_d: float, u_q: float, load: float
) -> tuple[float, float, float, float, float]:
    """Derivative of i_d, i_q, speed, electrical angle, warmth."""
    i_d, i_q, speed, angle, warmth = x
    electrical = m.pole_pairs * speed
    r = m.resistance * (1 + COPPER * warmth)
    e_d, e_q = _dead_time_voltage(m, i_d, i_q, angle)
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


@compiled_with()
def _moved(
    x: tuple[float, float, float, float, float], k: tuple[float, float, float, float, float],
    h: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    return x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3], x[4] + h * k[4]


@compiled_with()
def _stepped(
    m: Machine, x: tuple[float, float, float, float, float], u_d: float, u_q: float, load: float
) -> tuple[float, float, float, float, float]:
    h = m.period / m.steps
    a = _change(m, x, u_d, u_q, load)
    b = _change(m, _moved(x, a, h / 2), u_d, u_q, load)
    c = _change(m, _moved(x, b, h / 2), u_d, u_q, load)
    d = _change(m, _moved(x, c, h), u_d, u_q, load)
    x = _moved(_moved(x, a, h / 6), b, h / 3)
    return _moved(_moved(x, c, h / 3), d, h / 6)


@compiled_with()
def _voltages(
    m: Machine, error_d: float, error_q: float, held_d: float, held_q: float, speed: float,
    flux_d: float, flux_q: float,
) -> tuple[float, float, bool]:  # fmt: skip
    """Voltages requested by the current loops [V], and whether the inverter must limit them."""
    electrical = m.pole_pairs * speed
    u_d = m.current_gain * m.inductance_d * error_d + held_d - electrical * flux_q
    u_q = m.current_gain * m.inductance_q * error_q + held_q + electrical * flux_d
    size = np.hypot(u_d, u_q)
    if size <= m.limit_voltage:
        return u_d, u_q, False
    return u_d * m.limit_voltage / size, u_q * m.limit_voltage / size, True


@compiled_with()
def driven(
    m: Machine, speed_ref: np.ndarray, current_ref: np.ndarray, load: np.ndarray
) -> np.ndarray:
    """Motion of the motor, shape (T, 7): currents and speed at each tick, voltages from it on.

    Voltages are computed one period ahead, as digital loops do.  ``speed_ref`` [rad/s],
    ``current_ref`` (i_d) [A] and ``load`` [N m] have shape (T,).
    """
    out = np.empty((speed_ref.size, 7))
    x = (0.0, 0.0, 0.0, 0.0, 0.0)
    integral, held_d, held_q, u_d, u_q, cut = 0.0, 0.0, 0.0, 0.0, 0.0, False
    slow = m.current_gain * m.resistance * m.period
    for k in range(speed_ref.size):
        i_d, i_q, speed = x[0], x[1], x[2]
        flux_d, flux_q = m.inductance_d * i_d + m.flux, m.inductance_q * i_q
        torque = 1.5 * m.pole_pairs * (flux_d * i_q - flux_q * i_d)
        out[k] = (u_d, u_q, i_d, i_q, speed, x[4], torque)
        error = speed_ref[k] - speed
        demand = m.speed_gain * error + integral
        target = min(max(demand, -m.limit_current), m.limit_current)
        if demand == target or error * demand < 0:
            integral += m.speed_integral * error * m.period
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


def speed_steps(axis: Axis) -> Floats:
    """Motion of the motor of an axis, columns as of :func:`driven`."""
    part = np.arange(int(HOLD * RATE)) / (HOLD * RATE)
    top = axis.motor.top_speed
    speed = np.concatenate([np.full(part.size, np.clip(v, -top, top)) for v in SPEEDS]) * RPM
    field = np.tile(np.array(FIELD)[np.minimum((part * 3).astype(int), 2)], len(SPEEDS))
    pushed = [np.where(part > 0.5, PUSH * (k % 2), 0.0) for k in range(len(SPEEDS))]
    return driven(_machine(axis), speed, field, np.concatenate(pushed))


def _machine(axis: Axis) -> Machine:
    motor, f = axis.motor, axis.friction
    inertia = axis.inertia + axis.carriage / axis.gear**2
    viscous = axis.motor_viscous + (f.viscous_positive + f.viscous_negative) / 2 / axis.gear**2
    bandwidth = 2 * np.pi * 30
    gain = bandwidth * inertia / motor.torque_constant
    return Machine(
        period=1 / RATE, steps=STEPS, pole_pairs=float(motor.pole_pairs),
        resistance=motor.resistance, inductance_d=motor.inductance_d * 1e-3,
        inductance_q=motor.inductance_q * 1e-3,
        saturation=motor.saturation / motor.saturation_current**2, flux=motor.flux,
        inertia=inertia, viscous=viscous,
        coulomb=(f.coulomb_positive + f.coulomb_negative) / 2 / axis.gear,
        heat_capacity=motor.heat_capacity, cooling=motor.cooling,
        lost_voltage=motor.dead_time_error, limit_voltage=motor.bus_voltage / np.sqrt(3),
        limit_current=motor.saturation_current, current_gain=BANDWIDTH, speed_gain=gain,
        speed_integral=gain * bandwidth / 6,
    )  # fmt: skip


def motor_truth(axis: Axis, out: Floats) -> dict[str, Any]:
    """Truth in SI: mean R and L_q of the record, beside those of a cold motor without current."""
    motor: AxisMotor = axis.motor
    warm = motor.resistance * (1 + COPPER * out[:, WARMTH])
    bend = motor.saturation * (out[:, I_Q] / motor.saturation_current) ** 2
    return {
        "axis": "X",
        "R": float(warm.mean()),
        "L_d": motor.inductance_d * 1e-3,
        "L_q": motor.inductance_q * 1e-3 * float(1 - bend.mean()),
        "flux": motor.flux,
        "torque_constant": motor.torque_constant,
        "pole_pairs": motor.pole_pairs,
        "R_cold": motor.resistance,
        "R_at_end": float(warm[-1]),
        "L_q_without_current": motor.inductance_q * 1e-3,
        "dead_time_voltage": motor.dead_time_error,
    }
