"""The cascade of a feed axis: P position loop, PI velocity loop (Sim2023).

v_ref = S_pp P_p (x_ref - x) + f_v x_ref'
A     = S_vp V_p (v_ref - v) + S_vi V_i integral(v_ref - v) dt + f_a x_ref'',   |A| <= limit

The velocity loop sees v late: by what differencing the encoder, filters, computing and the current
loop take, together one first-order lag T_v (v' = (velocity - v) / T_v, exact over a servo period);
and v_ref by T_x, where the position loop samples slower and holds.
"""

from dataclasses import dataclass
from math import expm1, inf
from typing import Annotated, NamedTuple

from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class ServoParameters(Ranged, section="servo"):
    """Position and velocity loop of one axis.

    Parameters
    ----------
    position_gain : float
        P_p [1/s].
    velocity_gain : float
        V_p, command for one unit of velocity error [A s/m] ([V s/m] where the command is a
        voltage).
    integral_gain : float
        V_i [A/m].
    position_scale, velocity_scale, integral_scale : float
        S_pp, S_vp, S_vi: factors of the control that the vendor does not publish.
    velocity_feedforward : float
        f_v, share of the reference's velocity that is fed forward; 0 for none, 1 for all.
    acceleration_feedforward : float
        f_a, command for one unit of the reference's acceleration [A s^2/m].
    current_limit : float
        Greatest command [A]; while it holds the integral does not grow towards it.
    velocity_lag : float
        T_v, time constant of the measured velocity that is fed back [s]; 0 for none.
    position_lag : float
        T_x, time constant of v_ref between the position and the velocity loop [s]; 0 for none.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    position_gain: Positive
    velocity_gain: Positive
    integral_gain: NotNegative = 0.0
    position_scale: Positive = 1.0
    velocity_scale: Positive = 1.0
    integral_scale: NotNegative = 1.0
    velocity_feedforward: NotNegative = 0.0
    acceleration_feedforward: NotNegative = 0.0
    current_limit: Annotated[float, Range(above=0.0, finite=False, unit="A")] = inf
    velocity_lag: NotNegative = 0.0
    position_lag: NotNegative = 0.0

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


class ServoState(NamedTuple):
    """State of the loops from sample to sample.

    Parameters
    ----------
    integral : float
        Of the velocity error, up to this sample [m].
    velocity : float
        As the velocity loop saw it last, T_v behind [m/s].
    velocity_ref : float
        As it reached the velocity loop last, T_x behind [m/s].
    """

    integral: float
    velocity: float
    velocity_ref: float


def servo_step(
    reference: tuple[float, float, float],
    x: float,
    v: float,
    state: ServoState,
    period: float,
    servo: ServoParameters,
) -> tuple[float, ServoState]:
    """Command of one sample, and the state for the next one.

    Parameters
    ----------
    reference : tuple of float
        x_ref and its first two derivatives [m], [m/s], [m/s^2].
    x, v : float
        Measured position and speed [m], [m/s].
    state : ServoState
        Left by the sample before.
    period : float
        From sample to sample [s].
    servo : ServoParameters
        The loops.

    Returns
    -------
    command : float
        [A].
    state : ServoState
        Its integral stays while the limit holds and the error would carry it further (conditional
        integration).
    """
    x_ref, forward, ahead = reference
    command_v = servo.loop_gain * (x_ref - x) + servo.velocity_feedforward * forward
    v_ref = state.velocity_ref + approach(servo.position_lag, period) * (
        command_v - state.velocity_ref
    )
    v_fed_back = state.velocity + approach(servo.velocity_lag, period) * (v - state.velocity)
    error = v_ref - v_fed_back
    unlimited = servo.proportional * error + servo.integral * state.integral
    unlimited += servo.acceleration_feedforward * ahead
    command = min(max(unlimited, -servo.current_limit), servo.current_limit)
    growth = 0.0 if (unlimited - command) * error > 0 else period * error
    return command, ServoState(state.integral + growth, v_fed_back, v_ref)


def approach(lag: float, period: float) -> float:
    """Share of a step that a first-order lag [s] has followed after one period [s]; 1 without."""
    return -expm1(-period / lag) if lag > 0 else 1.0
