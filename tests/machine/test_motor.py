"""The motor in dq against Faraday's law in its three phases, virtual work, and its energies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.motor import (
    MotorParameters,
    copper_loss,
    current_rates,
    input_power,
    magnetic_energy,
    steady_voltages,
    torque,
)
from pipeline.machine.park import inverse_park, park

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


def test_field_energy_is_what_the_rates_integrate_to() -> None:
    i_d, i_q = 3.0, -5.0
    rate_d, rate_q = current_rates(i_d, i_q, 40.0, 90.0, 100.0, SALIENT)
    step = COMPLEX * 1j
    after = magnetic_energy(i_d + rate_d * step, i_q + rate_q * step, SALIENT)
    by_rates = 1.5 * (SALIENT.inductance_d * i_d * rate_d + SALIENT.inductance_q * i_q * rate_q)
    assert after.imag / COMPLEX == pytest.approx(by_rates, rel=1e-14)


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


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("resistance", 0.0),
        ("inductance_d", -1e-3),
        ("inductance_q", float("nan")),
        ("flux", float("inf")),
        ("pole_pairs", 2.5),
        ("pole_pairs", 0),
        ("pole_pairs", float("nan")),
        ("inertia", 0.0),
        ("damping", -1.0),
        ("coulomb", float("nan")),
    ],
)
def test_values_out_of_range_are_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"motor\.{name} = {value}"):
        replace(SALIENT, **{name: value})
