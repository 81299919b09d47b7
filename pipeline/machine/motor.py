"""The permanent-magnet synchronous motor in the rotor's frame, amplitude-invariant dq.

u_d = R i_d + L_d di_d/dt - w_e L_q i_q
u_q = R i_q + L_q di_q/dt + w_e (L_d i_d + phi_f)
T_e = 3/2 p [phi_f i_q + (L_d - L_q) i_d i_q],  w_e = p w

No saturation, no iron loss, sinusoidal flux.  Feed2025 with its misprints put right: there u_q has
the wrong sign, the pole pairs are called poles and phi_f is called w_f.  Power in is copper loss,
change of the magnetic energy and T_e w, to the last digit.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any


@dataclass(frozen=True, kw_only=True)
class MotorParameters:
    """A synchronous motor with magnets.

    Parameters
    ----------
    resistance : float
        R of one phase [ohm].
    inductance_d, inductance_q : float
        L_d, L_q [H].
    flux : float
        phi_f, flux of the magnets through one phase, its amplitude [Wb].
    pole_pairs : int
        p.
    inertia : float
        J of the rotor [kg m^2].
    damping : float
        B, viscous [N m s/rad].
    coulomb : float
        Friction torque of the bearings and the cogging that speed does not change [N m].

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    resistance: float
    inductance_d: float
    inductance_q: float
    flux: float
    pole_pairs: int
    inertia: float
    damping: float = 0.0
    coulomb: float = 0.0

    def __post_init__(self) -> None:
        for name in ("resistance", "inductance_d", "inductance_q", "flux", "inertia"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"motor.{name} = {value} must be finite and positive")
        for name in ("damping", "coulomb"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise ValueError(f"motor.{name} = {value} must be finite and at least 0")
        if not (isfinite(self.pole_pairs) and self.pole_pairs >= 1 and self.pole_pairs % 1 == 0):
            raise ValueError(f"motor.pole_pairs = {self.pole_pairs} must be a whole number from 1")

    @property
    def torque_constant(self) -> float:
        """3/2 p phi_f [N m/A], torque of one ampere of i_q, an amplitude; i_d = 0."""
        return 1.5 * self.pole_pairs * self.flux


def current_rates(i_d: Any, i_q: Any, u_d: Any, u_q: Any, speed: Any, motor: Any) -> Any:
    """Return di_d/dt and di_q/dt [A/s].

    Parameters
    ----------
    i_d, i_q, u_d, u_q : array_like
        Currents [A] and voltages [V], shapes that broadcast.
    speed : array_like
        Of the rotor [rad/s], mechanical.
    motor : MotorParameters
        Or any other object with its names.
    """
    w_e = motor.pole_pairs * speed
    R, L_d, L_q = motor.resistance, motor.inductance_d, motor.inductance_q
    rate_d = (u_d - R * i_d + w_e * L_q * i_q) / L_d
    rate_q = (u_q - R * i_q - w_e * (L_d * i_d + motor.flux)) / L_q
    return rate_d, rate_q


def torque(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Return the electromagnetic torque T_e [N m] of currents [A]."""
    reluctance = (motor.inductance_d - motor.inductance_q) * i_d
    return 1.5 * motor.pole_pairs * (motor.flux + reluctance) * i_q


def input_power(i_d: Any, i_q: Any, u_d: Any, u_q: Any) -> Any:
    """Return the electrical power into the motor [W]."""
    return 1.5 * (u_d * i_d + u_q * i_q)


def copper_loss(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Return the loss in the windings [W]."""
    return 1.5 * motor.resistance * (i_d * i_d + i_q * i_q)


def magnetic_energy(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Return the energy of the currents' field [J]; that of the magnets does not change."""
    return 0.75 * (motor.inductance_d * i_d * i_d + motor.inductance_q * i_q * i_q)


def steady_voltages(i_d: Any, i_q: Any, speed: Any, motor: Any) -> tuple[Any, Any]:
    """Return u_d and u_q [V] that hold the currents [A] at a speed [rad/s]."""
    w_e = motor.pole_pairs * speed
    u_d = motor.resistance * i_d - w_e * motor.inductance_q * i_q
    u_q = motor.resistance * i_q + w_e * (motor.inductance_d * i_d + motor.flux)
    return u_d, u_q
