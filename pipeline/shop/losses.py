"""Where the spindle's heat comes from: bearing friction, motor losses, windage (numba).

Imported only by what runs the network: numba is heavy to load.
"""

import math

from numba import njit


@njit(cache=True)
def viscosity(temperature: float, slope: float, intercept: float) -> float:
    """Kinematic viscosity of the lubricant [mm2/s], thinner when warm.

    ``lg lg(nu + 0.7) = intercept - slope lg T`` with T in kelvin.  ``temperature`` [degC].
    Source: ASTM D341 (Walther's equation).
    """
    return 10.0 ** (10.0 ** (intercept - slope * math.log10(temperature + 273.15))) - 0.7


def viscosity_line(nu_40: float, nu_100: float) -> tuple[float, float]:
    """Slope and intercept [1] of :func:`viscosity` from its values at 40 and 100 degC [mm2/s]."""
    y_40, y_100 = (math.log10(math.log10(nu + 0.7)) for nu in (nu_40, nu_100))
    slope = (y_40 - y_100) / (math.log10(373.15) - math.log10(313.15))
    return slope, y_40 + slope * math.log10(313.15)


@njit(cache=True)
def friction_torque(
    speed: float, nu: float, load: float, d_m: float, f0: float, capacity: float
) -> float:
    """Friction torque of one angular contact bearing [N m].

    ``M0 = 1e-7 f0 (nu n)^(2/3) d_m^3`` [N mm, d_m in mm] where ``nu n >= 2000``, else its value
    there (lubricant), and ``M1 = 0.001 (P/C0)^0.33 P d_m`` (load).  ``speed`` [rev/min], ``nu``
    [mm2/s], ``load`` and ``capacity`` [N], ``d_m`` [m].
    Source: Palmgren, in Harris, Rolling Bearing Analysis, 5th ed., eqs. 10.8 to 10.12.
    """
    m_0 = 0.1 * f0 * max(nu * speed, 2000.0) ** (2.0 / 3.0) * d_m**3
    m_1 = 0.001 * (load / capacity) ** 0.33 * load * d_m
    return m_0 + m_1


@njit(cache=True)
def flux(speed: float, base_speed: float) -> float:
    """Flux of the motor against its rated flux [1]: weakened as 1/n above the base speed."""
    return 1.0 if speed <= base_speed else base_speed / speed


@njit(cache=True)
def copper_share(phi: float, current: float, magnetising: float) -> float:
    """Stator copper loss against the rated one [1] at flux ``phi`` and torque current ``current``.

    Magnetising and torque currents stand at right angles, so their squares add.
    """
    return (magnetising * phi) ** 2 + (1.0 - magnetising**2) * current**2


@njit(cache=True)
def iron_loss(phi: float, ratio: float, hysteresis: float, eddy: float) -> float:
    """Iron loss [W] at speed ratio ``ratio = n / base speed``: hysteresis and eddy currents."""
    return phi**2 * (hysteresis * ratio + eddy * ratio**2)
