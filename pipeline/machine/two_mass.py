"""A motor and its load on a shaft that twists: coupling, screw and nut in series.

J_m th_m'' + C_m th_m' + K (th_m - th_l) + D (th_m' - th_l') = T_e - T_fm
J_l th_l'' + C_l th_l' + K (th_l - th_m) + D (th_l' - th_m') = -T_l

J_l = J_s + (L / 2 pi)^2 M and 1/K = 1/K_a + 1/K_s + 1/((L / 2 pi)^2 K_g): Feed2025, whose Eq. 12
counts J_m twice.  T_l holds friction and load of the carriage times L / 2 pi.  With K infinite both
are one mass.
"""

from dataclasses import dataclass
from math import inf, isfinite, pi, sqrt
from typing import Any


@dataclass(frozen=True, kw_only=True)
class TransmissionParameters:
    """What stands between the motor's shaft and the carriage, and the carriage.

    Parameters
    ----------
    lead : float
        L, way of the carriage for one turn of the screw [m/rev].
    mass : float
        M of all that moves along [kg].
    screw_inertia : float
        J_s [kg m^2].
    coupling_stiffness, screw_stiffness : float
        K_a, K_s, torsion [N m/rad]; infinite for rigid.
    axial_stiffness : float
        K_g of nut, bearings and screw along the axis [N/m]; infinite for rigid.
    load_damping : float
        C_l, viscous, about the load's shaft [N m s/rad].
    internal_damping : float
        D of the twist [N m s/rad]; not in Feed2025, where it is 0.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    lead: float
    mass: float
    screw_inertia: float = 0.0
    coupling_stiffness: float = inf
    screw_stiffness: float = inf
    axial_stiffness: float = inf
    load_damping: float = 0.0
    internal_damping: float = 0.0

    def __post_init__(self) -> None:
        for name in ("lead", "mass"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"transmission.{name} = {value} must be finite and positive")
        for name in ("screw_inertia", "load_damping", "internal_damping"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise ValueError(f"transmission.{name} = {value} must be finite and at least 0")
        for name in ("coupling_stiffness", "screw_stiffness", "axial_stiffness"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"transmission.{name} = {getattr(self, name)} must be positive; "
                    "leave it out for a rigid part"
                )

    @property
    def ratio(self) -> float:
        """L / 2 pi [m/rad], way of the carriage for one radian of the screw."""
        return self.lead / (2 * pi)

    @property
    def load_inertia(self) -> float:
        """J_l = J_s + (L / 2 pi)^2 M [kg m^2]."""
        return self.screw_inertia + self.ratio**2 * self.mass

    @property
    def stiffness(self) -> float:
        """K about the screw [N m/rad]; infinite when all three parts are rigid."""
        parts = (
            self.coupling_stiffness,
            self.screw_stiffness,
            self.ratio**2 * self.axial_stiffness,
        )
        compliance = sum(1 / k for k in parts)
        return 1 / compliance if compliance > 0 else inf


def twist_torque(angle: Any, speed: Any, stiffness: Any, damping: Any) -> Any:
    """Return the torque that the motor gives to the load through the shaft [N m].

    Parameters
    ----------
    angle, speed : array_like
        Of the motor less those of the load [rad], [rad/s].
    stiffness, damping : float
        K [N m/rad], D [N m s/rad].
    """
    return stiffness * angle + damping * speed


def antiresonance(load_inertia: float, stiffness: float) -> float:
    """Return sqrt(K / J_l) [rad/s]: the load swings against a motor that is held."""
    return sqrt(stiffness / load_inertia)


def resonance(motor_inertia: float, load_inertia: float, stiffness: float) -> float:
    """Return sqrt(K (1/J_m + 1/J_l)) [rad/s]: both swing against each other.

    >>> round(resonance(3.19e-4, 2.68e-3, 650.0))
    1510
    """
    return sqrt(stiffness * (1 / motor_inertia + 1 / load_inertia))
