"""Modulation: means over a period, the classical dwell times, and where it ends."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.svpwm import InverterParameters, duty, leg_voltage, limited

U = 560.0
CIRCLE = U / np.sqrt(3)
angles = st.floats(-10, 10)


def vector(length: float, angle: float) -> tuple[float, float]:
    return length * np.cos(angle), length * np.sin(angle)


def mean_of_switching(shares: tuple[float, float, float]) -> tuple[float, float]:
    """Mean voltage of centred pulses, interval by interval between their edges."""
    edges = sorted({0.0, 1.0, *[(1 - d) / 2 for d in shares], *[(1 + d) / 2 for d in shares]})
    total = np.zeros(2)
    for low, high in pairwise(edges):
        middle = (low + high) / 2
        on = [1.0 if (1 - d) / 2 < middle < (1 + d) / 2 else 0.0 for d in shares]
        total += (high - low) * np.array(leg_voltage(*on, U))
    return tuple(total)


@given(st.floats(0, CIRCLE), angles)
def test_the_mean_over_a_period_is_what_was_asked(length: float, angle: float) -> None:
    asked = vector(length, angle)
    # six products of U with rounded shares
    assert mean_of_switching(duty(*asked, U)) == pytest.approx(asked, abs=1e-12 * U)


def dwell_times(length: float, angle: float) -> tuple[list[int], list[int], float, float]:
    """Both active vectors beside an angle in [0, 2 pi), and the shares they are on for.

    The textbook's form: T_1 = sqrt(3) |u| / U sin(60 deg - a), T_2 = sqrt(3) |u| / U sin a.
    """
    vectors = [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1]]
    sector = int(angle // (np.pi / 3)) % 6
    a = angle - sector * np.pi / 3
    scale = np.sqrt(3) * length / U
    first, second = scale * np.sin(np.pi / 3 - a), scale * np.sin(a)
    return vectors[sector], vectors[(sector + 1) % 6], first, second


@pytest.mark.parametrize("share", [0.2, 0.9, 1.0])
def test_shares_are_those_of_the_dwell_times(share: float) -> None:
    """Every degree and both sides of every sector's boundary; the zero vectors split equally."""
    boundaries = np.arange(6) * np.pi / 3
    for angle in (*np.radians(np.arange(360)), *boundaries + 1e-9, *(boundaries - 1e-9) % 6.28):
        one, two, first, second = dwell_times(share * CIRCLE, angle)
        rest = (1 - first - second) / 2
        expected = [rest + first * a + second * b for a, b in zip(one, two, strict=True)]
        assert duty(*vector(share * CIRCLE, angle), U) == pytest.approx(expected, abs=1e-12)


def test_the_linear_range_ends_at_the_circle_in_the_hexagon() -> None:
    assert InverterParameters(dc_link=U).linear_limit == pytest.approx(CIRCLE, rel=1e-15)
    turn = np.radians(np.arange(0, 360, 0.5))
    shares = np.array(duty(*vector(CIRCLE, turn), U))
    assert shares.min() == pytest.approx(0, abs=1e-12)
    assert shares.max() == pytest.approx(1, abs=1e-12)
    # the circle touches the hexagon between two active vectors, and crosses it just outside
    touching = np.isclose(shares.max(axis=0), 1, atol=1e-12)
    assert np.degrees(turn[touching]) == pytest.approx([30, 90, 150, 210, 270, 330])
    assert np.max(duty(*vector(1.001 * CIRCLE, np.radians(30)), U)) > 1


@given(st.floats(0, 5 * U), angles, st.booleans())
def test_a_limited_voltage_keeps_its_direction_and_can_be_given(
    length: float, angle: float, overmodulation: bool
) -> None:
    alpha, beta = vector(length, angle)
    a, b = limited(alpha, beta, U, overmodulation)
    assert a * beta - b * alpha == pytest.approx(0, abs=1e-12 * U * (length + 1))
    assert a * alpha + b * beta >= 0
    shares = duty(a, b, U)
    assert min(shares) >= -1e-12 and max(shares) <= 1 + 1e-12
    again = limited(a, b, U, overmodulation)
    assert again == pytest.approx((a, b), abs=1e-12 * U)
    if not overmodulation:
        assert np.hypot(a, b) == pytest.approx(min(length, CIRCLE), abs=1e-12 * U)


def test_overmodulation_reaches_the_active_vectors() -> None:
    for k in range(6):
        corner = limited(*vector(2 * U, k * np.pi / 3), U, True)
        assert corner == pytest.approx(vector(2 * U / 3, k * np.pi / 3), abs=1e-12 * U)
        side = limited(*vector(2 * U, np.pi / 6 + k * np.pi / 3), U, True)
        assert np.hypot(*side) == pytest.approx(CIRCLE, rel=1e-12)


@pytest.mark.parametrize("value", [0.0, -560.0, float("nan"), float("inf")])
def test_a_dc_link_out_of_range_is_named(value: float) -> None:
    with pytest.raises(ValueError, match=rf"inverter\.dc_link = {value} V"):
        InverterParameters(dc_link=value)
