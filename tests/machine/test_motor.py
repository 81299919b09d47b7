"""Motor, Park's transforms and modulation: Faraday's law, virtual work, energies, dwell times."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.axis.motor import (
    MotorParameters,
    copper_loss,
    current_rates,
    duty,
    input_power,
    leg_voltage,
    limited,
    torque,
)
from tests.machine.motor_frames import inverse_park, magnetic_energy, park, steady_voltages

SALIENT = MotorParameters(
    resistance=0.4, inductance_d=3e-3, inductance_q=7e-3, flux=0.11, pole_pairs=4, inertia=4e-4
)
amperes = st.floats(-60, 60)
volts = st.floats(-600, 600)
speeds = st.floats(-600, 600)
motors = st.builds(
    MotorParameters,
    resistance=st.floats(0.01, 20),
    inductance_d=st.floats(1e-4, 0.1),
    inductance_q=st.floats(1e-4, 0.1),
    flux=st.floats(1e-3, 2),
    pole_pairs=st.integers(1, 20),
    inertia=st.floats(1e-6, 1),
)
COMPLEX = 1e-30
"""A step along the imaginary axis gives a derivative without cancellation."""


@given(amperes, amperes, volts, volts, speeds, motors)
def test_power_in_is_heat_and_field_and_work(
    i_d: float, i_q: float, u_d: float, u_q: float, speed: float, motor: MotorParameters
) -> None:
    rate_d, rate_q = current_rates(i_d, i_q, u_d, u_q, speed, motor)
    field = 1.5 * (motor.inductance_d * i_d * rate_d + motor.inductance_q * i_q * rate_q)
    parts = (copper_loss(i_d, i_q, motor), field, torque(i_d, i_q, motor) * speed)
    given_power = input_power(i_d, i_q, u_d, u_q)
    # the cross terms cancel; what is left is rounding of the largest of them
    cross = motor.pole_pairs * abs(speed * i_d * i_q) * (motor.inductance_d + motor.inductance_q)
    size = abs(given_power) + sum(map(abs, parts)) + cross
    assert sum(parts) == pytest.approx(given_power, abs=1e-13 * size + 1e-300)


@given(amperes, amperes, volts, volts, speeds, st.floats(-7, 7))
def test_voltage_equations_are_faradays_law_in_the_phases(
    i_d: float, i_q: float, u_d: float, u_q: float, speed: float, theta: float
) -> None:
    """u = R i + d(flux linkage)/dt of each phase, the linkage turned out of the rotor's frame."""
    rate_d, rate_q = current_rates(i_d, i_q, u_d, u_q, speed, SALIENT)
    step = COMPLEX * 1j
    linkage = inverse_park(
        SALIENT.inductance_d * (i_d + rate_d * step) + SALIENT.flux,
        SALIENT.inductance_q * (i_q + rate_q * step),
        theta + SALIENT.pole_pairs * speed * step,
    )
    currents = inverse_park(i_d, i_q, theta)
    voltages = [
        SALIENT.resistance * i + psi.imag / COMPLEX
        for i, psi in zip(currents, linkage, strict=True)
    ]
    # flux linkages times speed reach some 4000 V
    assert voltages == pytest.approx(inverse_park(u_d, u_q, theta), abs=1e-9)


@given(amperes, amperes, st.floats(-7, 7))
def test_torque_is_virtual_work(i_d: float, i_q: float, theta: float) -> None:
    """Derivative of the coenergy by the rotor's angle while the phase currents stay."""
    phases = inverse_park(i_d, i_q, theta)
    turned_d, turned_q = park(*phases, theta + SALIENT.pole_pairs * COMPLEX * 1j)
    coenergy = magnetic_energy(turned_d, turned_q, SALIENT) + 1.5 * SALIENT.flux * turned_d
    # 60 A give some 60 N m
    assert torque(i_d, i_q, SALIENT) == pytest.approx(coenergy.imag / COMPLEX, abs=1e-11)


@given(amperes, amperes, speeds, motors)
def test_steady_voltages_hold_the_currents(
    i_d: float, i_q: float, speed: float, motor: MotorParameters
) -> None:
    rates = current_rates(i_d, i_q, *steady_voltages(i_d, i_q, speed, motor), speed, motor)
    # volts that cancel, over the smallest inductance
    volts_there = 60 * motor.resistance + 600 * motor.pole_pairs * (motor.flux + 60 * 0.2)
    assert rates == pytest.approx((0, 0), abs=1e-14 * volts_there / 1e-4)


def test_a_population_is_the_single_motors() -> None:
    rng = np.random.default_rng(3)
    i_d, i_q, u_d, u_q, speed = rng.normal(0, 50, (5, 3, 4))
    rates = np.array(current_rates(i_d, i_q, u_d, u_q, speed, SALIENT))
    assert rates.shape == (2, 3, 4)
    one = current_rates(i_d[2, 1], i_q[2, 1], u_d[2, 1], u_q[2, 1], speed[2, 1], SALIENT)
    assert np.array_equal(rates[:, 2, 1], one)


angles = st.floats(-50, 50)
# rounding of a few operations on numbers up to 600
TINY = 1e-11


@given(st.floats(0, 600), angles, angles)
def test_an_amplitude_is_a_length(amplitude: float, phase: float, theta: float) -> None:
    """Phases by their definition, cosines 120 degrees apart: d leads from a by theta."""
    a, b, c = (amplitude * np.cos(phase - k * 2 * np.pi / 3) for k in range(3))
    d, q = park(a, b, c, theta)
    expected = amplitude * np.exp(1j * (phase - theta))
    assert (d, q) == pytest.approx((expected.real, expected.imag), abs=TINY)


U = 560.0
CIRCLE = U / np.sqrt(3)
directions = st.floats(-10, 10)


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


@given(st.floats(0, CIRCLE), directions)
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
    turn = np.radians(np.arange(0, 360, 0.5))
    shares = np.array(duty(*vector(CIRCLE, turn), U))
    assert shares.min() == pytest.approx(0, abs=1e-12)
    assert shares.max() == pytest.approx(1, abs=1e-12)
    # the circle touches the hexagon between two active vectors, and crosses it just outside
    touching = np.isclose(shares.max(axis=0), 1, atol=1e-12)
    assert np.degrees(turn[touching]) == pytest.approx([30, 90, 150, 210, 270, 330])
    assert np.max(duty(*vector(1.001 * CIRCLE, np.radians(30)), U)) > 1


@given(st.floats(0, 5 * U), directions, st.booleans())
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
