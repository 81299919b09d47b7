"""Synchronous motor and inverter: voltage equations, space-vector modulation.

The permanent-magnet synchronous motor in the rotor's frame, amplitude-invariant dq:

u_d = R i_d + L_d di_d/dt - w_e L_q i_q
u_q = R i_q + L_q di_q/dt + w_e (L_d i_d + phi_f)
T_e = 3/2 p [phi_f i_q + (L_d - L_q) i_d i_q],  w_e = p w

No saturation, no iron loss, sinusoidal flux.  Feed2025 with its misprints put right: there u_q has
the wrong sign, the pole pairs are called poles and phi_f is called w_f.  Power in is copper loss,
change of the magnetic energy and T_e w, to the last digit.

Phase a lies on the alpha axis, the d axis leads it by the electrical angle theta, the q axis leads
d by 90 degrees.  A balanced set of amplitude U has length U in each frame, so that power is
3/2 (u_d i_d + u_q i_q).

A leg of the two-level inverter that is high for the share d of a carrier period, centred in it,
gives d U_dc over the negative rail.  The three shares are
d_x = 1/2 + (u_x - (u_max + u_min) / 2) / U_dc, which splits the zero vectors equally: the
modulation of Holmes and Lipo, Pulse Width Modulation for Power Converters, 2003, section 6.6.  Mean
voltages end at the hexagon of the six active vectors; the circle in it has the radius
U_dc / sqrt(3) (Feed2025).
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged

_SQRT3 = np.sqrt(3.0)


@dataclass(frozen=True, kw_only=True)
class MotorParameters(Ranged, section="motor"):
    """A synchronous motor with magnets."""

    resistance: Positive
    """R of one phase [ohm]."""
    inductance_d: Positive
    inductance_q: Positive
    """L_d, L_q [H]."""
    flux: Positive
    """phi_f, flux of the magnets through one phase, its amplitude [Wb]."""
    pole_pairs: Annotated[int, Range(least=1)]
    """p."""
    inertia: Positive
    """J of the rotor [kg m^2]."""
    damping: NotNegative = 0.0
    """B, viscous [N m s/rad]."""
    coulomb: NotNegative = 0.0
    """Friction torque of the bearings and the cogging that speed does not change [N m]."""

    @property
    def torque_constant(self) -> float:
        """3/2 p phi_f [N m/A], torque of one ampere of i_q, an amplitude; i_d = 0."""
        return 1.5 * self.pole_pairs * self.flux


def force_constant(torque_constant: float, lead: float) -> float:
    """Force constant 2 pi k_t / L [N/A] of a motor of k_t [N m/A] on a screw of lead L [m/rev]."""
    return 2 * np.pi * torque_constant / lead


def current_rates(i_d: Any, i_q: Any, u_d: Any, u_q: Any, speed: Any, motor: Any) -> Any:
    """di_d/dt and di_q/dt [A/s] at currents [A], voltages [V], mechanical ``speed`` [rad/s]."""
    w_e = motor.pole_pairs * speed
    R, L_d, L_q = motor.resistance, motor.inductance_d, motor.inductance_q
    rate_d = (u_d - R * i_d + w_e * L_q * i_q) / L_d
    rate_q = (u_q - R * i_q - w_e * (L_d * i_d + motor.flux)) / L_q
    return rate_d, rate_q


def torque(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Electromagnetic torque T_e [N m] of currents [A]."""
    reluctance = (motor.inductance_d - motor.inductance_q) * i_d
    return 1.5 * motor.pole_pairs * (motor.flux + reluctance) * i_q


def input_power(i_d: Any, i_q: Any, u_d: Any, u_q: Any) -> Any:
    """Electrical power into the motor [W]."""
    return 1.5 * (u_d * i_d + u_q * i_q)


def copper_loss(i_d: Any, i_q: Any, motor: Any) -> Any:
    """Loss in the windings [W]."""
    return 1.5 * motor.resistance * (i_d * i_d + i_q * i_q)


def rotated(x: Any, y: Any, cos: Any, sin: Any) -> tuple[Any, Any]:
    """Vector (x, y) turned by the angle of this cosine and sine.

    With the rotor's angle it leads from dq to the stator's frame, with its negative back.
    """
    return x * cos - y * sin, x * sin + y * cos


@dataclass(frozen=True, kw_only=True)
class InverterParameters(Ranged, section="inverter"):
    """The inverter between the current loops and the motor; dead time and drops are left out."""

    dc_link: Annotated[float, Range(above=0.0, unit="V")]
    """U_dc [V]."""
    switched: bool = False
    """Whether the legs switch, or the mean voltage of a carrier period is held over it."""
    overmodulation: bool = False
    """Whether voltages between the circle and the hexagon are used."""


def limited(alpha: Any, beta: Any, dc_link: Any, overmodulation: bool) -> tuple[Any, Any]:
    """Voltage in the stator's frame within the inverter's limit [V]: its length is cut.

    The limit is the circle in the hexagon of U_dc [V], or with ``overmodulation`` the hexagon.
    """
    if overmodulation:
        half, whole = alpha / 2, _SQRT3 * beta / 2
        a, b, c = alpha, whole - half, -whole - half
        reach = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
    else:
        reach = _SQRT3 * np.sqrt(alpha * alpha + beta * beta)
    share = dc_link / np.maximum(reach, dc_link)
    return alpha * share, beta * share


def duty(alpha: Any, beta: Any, dc_link: Any) -> tuple[Any, Any, Any]:
    """Shares of a carrier period for which the legs a, b, c are high [1].

    ``alpha``, ``beta``: mean voltage in the stator's frame [V] within the hexagon
    (:func:`limited`); ``dc_link`` U_dc [V].
    """
    half, whole = alpha / 2, _SQRT3 * beta / 2
    a, b, c = alpha, whole - half, -whole - half
    middle = (np.maximum(np.maximum(a, b), c) + np.minimum(np.minimum(a, b), c)) / 2
    return (
        0.5 + (a - middle) / dc_link,
        0.5 + (b - middle) / dc_link,
        0.5 + (c - middle) / dc_link,
    )


def leg_voltage(a: Any, b: Any, c: Any, dc_link: Any) -> tuple[Any, Any]:
    """Voltage of three legs in the stator's frame [V].

    Parameters
    ----------
    a, b, c : array_like
        1 for a leg that is high, 0 for low; shares of a period give its mean [1].
    dc_link : float
        U_dc [V].
    """
    return dc_link * (2 * a - b - c) / 3, dc_link * (b - c) / _SQRT3
