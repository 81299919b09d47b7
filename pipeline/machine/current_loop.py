"""The two current loops in the rotor's frame: PI, decoupled, tuned by pole-zero cancellation.

With the voltage held over a period h the winding is i+ = a i + b u, a = exp(-R h / L),
b = (1 - a) / R.  The controller u = K e + x, x+ = x + K (1 - a) e has its zero on the winding's
pole; with K = (1 - exp(-w h)) / b the closed loop is one pole at exp(-w h), the sampled lag of
bandwidth w.  What speed induces is fed forward.  Where the inverter cannot give the voltage, the
integral takes the error that it could have answered (Hanus, Kinnaert, Henrotte: Conditioning
technique, Automatica 23, 1987), so that it does not wind up.
"""

from dataclasses import dataclass
from math import exp, expm1, isfinite
from typing import Any


@dataclass(frozen=True, kw_only=True)
class CurrentLoopParameters:
    """Both current loops; they are computed once a carrier period.

    Parameters
    ----------
    bandwidth : float
        w of the closed loop [rad/s].
    period : float
        h, of the loop and of the inverter's carrier [s].

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    bandwidth: float
    period: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("bandwidth", "period"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"current_loop.{name} = {value} must be finite and positive")

    def gains(self, resistance: float, inductance: float) -> tuple[float, float]:
        """Return K [V/A] and K (1 - a) [V/A per period] of a winding [ohm], [H]."""
        fade = -expm1(-resistance * self.period / inductance)
        proportional = -expm1(-self.bandwidth * self.period) * resistance / fade
        return proportional, proportional * fade

    def response(self, periods: Any) -> Any:
        """Return the share of a step of the reference that is reached after whole periods [1]."""
        return 1 - exp(-self.bandwidth * self.period) ** periods


def induced_voltages(i_d: Any, i_q: Any, speed: Any, motor: Any) -> tuple[Any, Any]:
    """Return what speed [rad/s] induces in the two axes [V] at these currents [A]."""
    w_e = motor.pole_pairs * speed
    return -w_e * motor.inductance_q * i_q, w_e * (motor.inductance_d * i_d + motor.flux)
