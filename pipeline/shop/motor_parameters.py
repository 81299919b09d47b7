"""The synchronous motor of a simulated axis with its inverter.

Sources of the orders of magnitude: catalogues of motors of 8 to 22 N m (Fanuc α, Siemens 1FK7,
Bosch Rexroth MS2N): 0.3 to 1 ohm, 3 to 8 mH a phase; cogging below 1 % of the stall torque.  Dead
time of 2 us at 10 kHz and 560 V costs 11 V, of which compensation leaves some per cent.
"""

from dataclasses import dataclass

from pipeline.shop.ranges import Ranged, quantity


@dataclass(frozen=True, kw_only=True)
class AxisMotor(Ranged):
    """Synchronous motor with magnets on its rotor; currents are amplitudes of a phase.

    Parameters
    ----------
    resistance : float
        Of a phase at 20 degC.
    inductance_d, inductance_q : float
        Without current across.
    saturation : float
        Share that L_q loses at ``saturation_current``; grows with its square.
    current_lag, current_noise : float
        Of the closed current loop: time constant, standard deviation.
    cogging, cogging_period : float, int
        Amplitude of the torque without current, and its periods a turn (a third of it at twice
        that).
    torque_ripple : float
        Share of the torque, six periods in each electrical one.
    heat_capacity, cooling : float
        Of the winding.
    bus_voltage, dead_time_error : float
        Of the inverter: voltage between its rails, what a phase loses against its current.
    top_speed : float
        Of the axis' rapid, about.
    """

    torque_constant: float = quantity(1.26, "N m/A", 0.01, 20)
    pole_pairs: int = quantity(4, "1", 1, 50)
    resistance: float = quantity(0.62, "ohm", 1e-3, 100)
    inductance_d: float = quantity(5.1, "mH", 0.01, 500)
    inductance_q: float = quantity(5.9, "mH", 0.01, 500)
    saturation: float = quantity(0.03, "1", 0, 0.3)
    saturation_current: float = quantity(20.0, "A", 0.1, 1e3)
    current_lag: float = quantity(0.18, "ms", 0.01, 5)
    current_noise: float = quantity(0.02, "A", 0, 1)
    cogging: float = quantity(0.06, "N m", 0, 10)
    cogging_period: int = quantity(72, "1", 1, 1000)
    torque_ripple: float = quantity(0.006, "1", 0, 0.2)
    heat_capacity: float = quantity(420.0, "J/K", 1, 1e6)
    cooling: float = quantity(9.0, "W/K", 0, 1e4)
    bus_voltage: float = quantity(560.0, "V", 10, 2e3)
    dead_time_error: float = quantity(0.5, "V", 0, 50)

    top_speed: float = quantity(2250.0, "rev/min", 100, 2e4)

    @property
    def flux(self) -> float:
        """Of the magnets [V s]: T = 1.5 p flux i_q."""
        return self.torque_constant / (1.5 * self.pole_pairs)
