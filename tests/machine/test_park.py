"""Park's transforms: round trips, power, and the line-voltage form against the phases."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.park import inverse_park, line_park, park

volts = st.floats(-600, 600)
angles = st.floats(-50, 50)
# rounding of a few operations on numbers up to 600
TINY = 1e-11


@given(volts, volts, angles)
def test_inverse_park_inverts_park(d: float, q: float, theta: float) -> None:
    phases = inverse_park(d, q, theta)
    assert sum(phases) == pytest.approx(0, abs=TINY)
    assert park(*phases, theta) == pytest.approx((d, q), abs=TINY)


@given(volts, volts, volts, angles)
def test_line_voltages_say_the_same_as_phases(a: float, b: float, c: float, theta: float) -> None:
    """Also with a neutral point that floats: three phases without any relation to each other."""
    assert line_park(a - b, b - c, theta) == pytest.approx(park(a, b, c, theta), abs=TINY)


@given(st.floats(0, 600), angles, angles)
def test_an_amplitude_is_a_length(amplitude: float, phase: float, theta: float) -> None:
    """Phases by their definition, cosines 120 degrees apart: d leads from a by theta."""
    a, b, c = (amplitude * np.cos(phase - k * 2 * np.pi / 3) for k in range(3))
    d, q = park(a, b, c, theta)
    expected = amplitude * np.exp(1j * (phase - theta))
    assert (d, q) == pytest.approx((expected.real, expected.imag), abs=TINY)


@given(volts, volts, st.floats(-50, 50), st.floats(-50, 50), angles)
def test_power_is_three_halves_of_the_product(
    u_d: float, u_q: float, i_d: float, i_q: float, theta: float
) -> None:
    u, i = inverse_park(u_d, u_q, theta), inverse_park(i_d, i_q, theta)
    power = sum(x * y for x, y in zip(u, i, strict=True))
    assert power == pytest.approx(1.5 * (u_d * i_d + u_q * i_q), abs=1e-9)
