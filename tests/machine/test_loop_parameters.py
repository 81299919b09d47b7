"""The three loops' parameters: gains by pole and zero, and values that are refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.current_loop import CurrentLoopParameters
from pipeline.machine.position_loop import PositionLoopParameters
from pipeline.machine.speed_loop import SpeedLoopParameters

LOOPS = {
    "current_loop": (CurrentLoopParameters, {"bandwidth": 3000.0}),
    "speed_loop": (SpeedLoopParameters, {"torque_limit": 19.1}),
    "position_loop": (PositionLoopParameters, {"gain": 40.0}),
}


@given(st.floats(0.01, 20), st.floats(1e-4, 0.1), st.floats(10, 2e4), st.floats(1e-5, 1e-3))
def test_current_gains_cancel_the_winding_s_pole(
    R: float, L: float, bandwidth: float, period: float
) -> None:
    """The sampled winding i+ = a i + b u under the sampled PI, both as polynomials in z."""
    loop = CurrentLoopParameters(bandwidth=bandwidth, period=period)
    proportional, integral = loop.gains(R, L)
    a, b = np.exp(-R * period / L), -np.expm1(-R * period / L) / R
    # (z - 1)(z - a) + b (K z - K + K_i): roots are the cancelled pole and the asked one
    poles = np.roots(
        np.polyadd([1, -1 - a, a], b * np.array([proportional, integral - proportional]))
    )
    expected = sorted([a, np.exp(-bandwidth * period)])
    # two roots that nearly meet are known to the root of rounding
    assert sorted(poles.real) == pytest.approx(expected, abs=1e-7)
    assert proportional == pytest.approx(integral / (1 - a), rel=1e-6)


def test_short_periods_give_the_continuous_gains() -> None:
    """w L and w R h, as with a controller in continuous time."""
    proportional, integral = CurrentLoopParameters(bandwidth=3000.0, period=1e-9).gains(0.2, 2e-3)
    assert (proportional, integral) == pytest.approx((6.0, 600e-9), rel=1e-5)


@pytest.mark.parametrize(
    ("loop", "name", "value"),
    [
        ("current_loop", "bandwidth", 0.0),
        ("current_loop", "period", float("nan")),
        ("speed_loop", "torque_limit", float("inf")),
        ("speed_loop", "proportional", 0.0),
        ("speed_loop", "integral", -1.0),
        ("speed_loop", "every", 1.5),
        ("speed_loop", "every", float("nan")),
        ("position_loop", "gain", -40.0),
        ("position_loop", "velocity_feedforward", float("nan")),
        ("position_loop", "every", 0),
    ],
)
def test_values_out_of_range_are_named(loop: str, name: str, value: float) -> None:
    kind, values = LOOPS[loop]
    with pytest.raises(ValueError, match=rf"{loop}\.{name} = {value}"):
        kind(**values | {name: value})
