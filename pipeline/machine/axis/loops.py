"""Loops of a three-loop drive: current, speed (PI or fuzzy PI) and position (Feed2025).

Current loops in the rotor's frame: PI, decoupled, tuned by pole-zero cancellation.  With the
voltage held over a period h the winding is i+ = a i + b u, a = exp(-R h / L), b = (1 - a) / R.  The
controller u = K e + x, x+ = x + K (1 - a) e has its zero on the winding's pole; with
K = (1 - exp(-w h)) / b the closed loop is one pole at exp(-w h), the sampled lag of bandwidth w.
The voltages induced by speed are fed forward.  Where the inverter cannot give the voltage, the
integral takes the error that it could have answered (Hanus, Kinnaert, Henrotte: Conditioning
technique, Automatica 23, 1987), so that it does not wind up.

Speed loop: PI on the motor's speed, its output a torque with a limit,
T* = K_p e + integral(K_i e) dt, |T*| <= limit.  While the limit holds the integral does not grow
towards it (conditional integration), so that the torque leaves the limit at |e| = (limit - x) / K_p
and not only when the error changes its sign.  The gain is part of the integral x, so that gains
that change give no jump.

Fuzzy rules move the gains of the speed loop.  Speed error E and its change EC, scaled to [-10, 10],
each belong to two neighbours of seven triangular sets NB ... PB.  A rule holds as much as the
lesser of its two ("min"), and the increment of a gain is the mean of the rules' outputs weighted
with that.  The tables are the classical ones of fuzzy tuning.  They are nearly odd in (E, EC),
where rules that treat both directions of motion alike would be even: a gain that rises with speed
upwards falls with speed downwards.

Position loop: a gain on the position error, and feed-forward,
w_ref = (K_v (x_ref - x) + f_v x_ref') 2 pi / L.
"""

from dataclasses import dataclass
from math import expm1
from typing import Annotated, Any

import numpy as np

from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged

_Every = Annotated[int, Range(least=1)]
_Span = Annotated[float, Range(least=0.0, below=1.0)]


@dataclass(frozen=True, kw_only=True)
class CurrentLoopParameters(Ranged, section="current_loop"):
    """Both current loops; they are computed once a carrier period."""

    bandwidth: Positive
    """w of the closed loop [rad/s]."""
    period: Positive = 1e-4
    """h, of the loop and of the inverter's carrier [s]."""

    def gains(self, resistance: float, inductance: float) -> tuple[float, float]:
        """K [V/A] and K (1 - a) [V/A per period] of a winding [ohm], [H]."""
        fade = -expm1(-resistance * self.period / inductance)
        proportional = -expm1(-self.bandwidth * self.period) * resistance / fade
        return proportional, proportional * fade


def induced_voltages(i_d: Any, i_q: Any, speed: Any, motor: Any) -> tuple[Any, Any]:
    """Voltages [V] induced in d and q by speed [rad/s] at these currents [A]."""
    w_e = motor.pole_pairs * speed
    return -w_e * motor.inductance_q * i_q, w_e * (motor.inductance_d * i_d + motor.flux)


SETS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")
"""Negative big ... positive big: centres -10 ... 10 of an input, -1 ... 1 of an increment."""


def _rules(text: str) -> np.ndarray:
    """Increments [1]; a row for each set of E, a column for each of EC."""
    return np.array([[SETS.index(word) for word in row.split()] for row in text.split("/")]) / 3 - 1


PROPORTIONAL = _rules(
    "PB PB PM PM PS ZO ZO / PB PB PM PS PS ZO NS / PM PM PM PS ZO NS NS / PM PM PS ZO NS NM NM /"
    "PS PS ZO NS NS NM NM / PS ZO NS NM NM NM NB / ZO ZO NM NM NM NB NB"
)
INTEGRAL = _rules(
    "NB NB NM NM NS ZO ZO / NB NB NM NS NS ZO ZO / NB NM NS NS ZO PS PS / NM NM NS ZO PS PM PM /"
    "NM NS ZO PS PS PM PB / ZO ZO PS PS PM PB PB / ZO ZO PS PM PM PB PB"
)


@dataclass(frozen=True, kw_only=True)
class FuzzyParameters(Ranged, section="fuzzy"):
    """Scales of the rules.  K = K_middle (1 + span times increment), increments in [-1, 1]."""

    error_scale: NotNegative
    """E for one unit of speed error [s/rad]."""
    change_scale: NotNegative
    """EC for one unit of its rate of change [s^2/rad]."""
    proportional_span: _Span = 0.6
    integral_span: _Span = 0.5
    """Greatest change of a gain as a share of its middle [1], below 1, else a gain can vanish; the
    defaults give [0.2, 0.8] about 0.5 and [20, 60] about 40."""


def increments(error: float, change: float) -> tuple[float, float]:
    """Increments of K_p and K_i as shares of their spans [1].

    Parameters
    ----------
    error, change : float
        E and EC [1]; limited to [-10, 10].

    Examples
    --------
    The start of a step up: the greatest error, which falls fast, leaves both gains as they are.

    >>> [round(float(x), 12) for x in increments(10.0, -10.0)]
    [0.0, 0.0]
    """
    x, y = 0.3 * (error + 10.0), 0.3 * (change + 10.0)
    # what is no number counts as the lower end, so that the tables are never left
    x = min(x, 6.0) if x > 0.0 else 0.0
    y = min(y, 6.0) if y > 0.0 else 0.0
    row, column = min(int(x), 5), min(int(y), 5)
    a, b = x - row, y - column
    weight = (min(1 - a, 1 - b), min(1 - a, b), min(a, 1 - b), min(a, b))
    total, proportional, integral = 0.0, 0.0, 0.0
    for k in range(4):
        i, j = row + k // 2, column + k % 2
        total += weight[k]
        proportional += weight[k] * PROPORTIONAL[i, j]
        integral += weight[k] * INTEGRAL[i, j]
    return proportional / total, integral / total


@dataclass(frozen=True, kw_only=True)
class SpeedLoopParameters(Ranged, section="speed_loop"):
    """Parameters of a speed loop."""

    torque_limit: Positive
    """Greatest torque that is commanded [N m]."""
    proportional: Positive = 0.5
    """K_p [N m s/rad]; with ``fuzzy`` the middle of its range."""
    integral: NotNegative = 40.0
    """K_i [N m/rad]; with ``fuzzy`` the middle of its range."""
    fuzzy: FuzzyParameters | None = None
    """Rules that move both gains; none for a PI with fixed gains."""
    every: _Every = 1
    """Periods of the current loop for one of the speed loop."""


@dataclass(frozen=True, kw_only=True)
class PositionLoopParameters(Ranged, section="position_loop"):
    """Parameters of a position loop."""

    gain: Annotated[float, Range(above=0.0, unit="1/s")]
    """K_v [1/s]; at a constant feed v without feed-forward the error is v / K_v."""
    velocity_feedforward: NotNegative = 0.0
    """f_v, share of the reference's velocity that is fed forward; 0 for none, 1 for all."""
    motor_encoder: bool = False
    """Whether the position is the motor's, L / 2 pi times its angle, or the carriage scale's."""
    every: _Every = 10
    """Periods of the current loop for one of the position loop."""
