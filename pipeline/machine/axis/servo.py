"""The cascade of a feed axis: P position loop, PI velocity loop (Sim2023).

v_ref = S_pp P_p (x_ref - x) + f_v x_ref'
A     = S_vp V_p (v_ref - v) + S_vi V_i integral(v_ref - v) dt + f_a x_ref'',   |A| <= limit

The velocity loop sees v late: by what differencing the encoder, filters, computing and the current
loop take, together one first-order lag T_v (v' = (velocity - v) / T_v, exact over a servo period);
and v_ref by T_x, where the position loop samples slower and holds.
"""

from dataclasses import dataclass
from math import inf
from typing import Annotated

from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class ServoParameters(Ranged, section="servo"):
    """Position and velocity loop of one axis.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    position_gain: Positive
    """P_p [1/s]."""
    velocity_gain: Positive
    """V_p, command for one unit of velocity error [A s/m] ([V s/m] where the command is a
    voltage)."""
    integral_gain: NotNegative = 0.0
    """V_i [A/m]."""
    position_scale: Positive = 1.0
    velocity_scale: Positive = 1.0
    integral_scale: NotNegative = 1.0
    """S_pp, S_vp, S_vi: factors of the control that the vendor does not publish."""
    velocity_feedforward: NotNegative = 0.0
    """f_v, share of the reference's velocity that is fed forward; 0 for none, 1 for all."""
    acceleration_feedforward: NotNegative = 0.0
    """f_a, command for one unit of the reference's acceleration [A s^2/m]."""
    current_limit: Annotated[float, Range(above=0.0, finite=False, unit="A")] = inf
    """Greatest command [A]; while it holds the integral does not grow towards it."""
    velocity_lag: NotNegative = 0.0
    """T_v, time constant of the measured velocity that is fed back [s]; 0 for none."""
    position_lag: NotNegative = 0.0
    """T_x, time constant of v_ref between the position and the velocity loop [s]; 0 for none."""

    @property
    def loop_gain(self) -> float:
        """S_pp P_p [1/s]: at a constant feed v without feed-forward the error is v over it."""
        return self.position_scale * self.position_gain

    @property
    def proportional(self) -> float:
        """S_vp V_p [A s/m]."""
        return self.velocity_scale * self.velocity_gain

    @property
    def integral(self) -> float:
        """S_vi V_i [A/m]."""
        return self.integral_scale * self.integral_gain
