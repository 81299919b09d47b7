"""Park's transforms and steady voltages: what the equations of the motor are held against."""

from typing import Any

import numpy as np

from pipeline.machine.axis.motor import rotated

_SQRT3 = np.sqrt(3.0)


def magnetic_energy(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Return the energy of the currents' field [J]; that of the magnets does not change."""
    return 0.75 * (motor.inductance_d * i_d * i_d + motor.inductance_q * i_q * i_q)


def steady_voltages(i_d: Any, i_q: Any, speed: Any, motor: Any) -> tuple[Any, Any]:
    """Return u_d and u_q [V] that hold the currents [A] at a speed [rad/s]."""
    w_e = motor.pole_pairs * speed
    u_d = motor.resistance * i_d - w_e * motor.inductance_q * i_q
    u_q = motor.resistance * i_q + w_e * (motor.inductance_d * i_d + motor.flux)
    return u_d, u_q


def park(a: Any, b: Any, c: Any, theta: Any) -> tuple[Any, Any]:
    """d and q of three phase quantities at the electrical angle of the rotor [rad]."""
    alpha, beta = (2 * a - b - c) / 3, (b - c) / _SQRT3
    return rotated(alpha, beta, np.cos(theta), -np.sin(theta))


def inverse_park(d: Any, q: Any, theta: Any) -> tuple[Any, Any, Any]:
    """The three phases of d and q; their sum is zero."""
    alpha, beta = rotated(d, q, np.cos(theta), np.sin(theta))
    return alpha, (_SQRT3 * beta - alpha) / 2, (-_SQRT3 * beta - alpha) / 2
