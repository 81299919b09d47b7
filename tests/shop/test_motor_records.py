"""The simulated motor of an axis: power balance, closed forms, what its record shows."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.schema.si import RPM
from pipeline.shop.drives.motor import (
    FIELD,
    HOLD,
    I_D,
    I_Q,
    RATE,
    SPEED,
    SPEEDS,
    TORQUE,
    U_D,
    U_Q,
    WARMTH,
    _change,
    _machine,
    driven,
    speed_steps,
)
from pipeline.shop.drives.parameters import Drives

from .conftest import shop_parameters

STATES = np.random.default_rng(4).uniform(-1, 1, (200, 7)) * [15, 15, 240, 3.0, 0, 300, 300]


def test_electric_power_is_heat_field_and_work():
    """1.5 (u i) = 1.5 R i^2 + d/dt 1.5 (L_d i_d^2 + L_q' i_q^2)/2 + T w, to rounding."""
    m = _machine(Drives().x)._replace(lost_voltage=0.0, viscous=0.0, coulomb=0.0)
    for i_d, i_q, speed, angle, _, u_d, u_q in STATES.tolist():
        d_d, d_q, d_speed, _, _ = _change(m, (i_d, i_q, speed, angle, 0.0), u_d, u_q, 0.0)
        given = 1.5 * (u_d * i_d + u_q * i_q)
        heat = 1.5 * m.resistance * (i_d**2 + i_q**2)
        slope_q = m.inductance_q * (1 - 3 * m.saturation * i_q**2)
        field = 1.5 * (m.inductance_d * i_d * d_d + slope_q * i_q * d_q)
        work = m.inertia * d_speed * speed
        assert given == pytest.approx(heat + field + work, abs=1e-9 * (abs(given) + 1000))


def test_the_dead_time_takes_power_and_is_gone_without_current():
    m = _machine(Drives().x)
    free = m._replace(lost_voltage=0.0)
    for i_d, i_q, speed, angle, _, u_d, u_q in STATES.tolist():
        x = (i_d, i_q, speed, angle, 0.0)
        with_, without = (_change(k, x, u_d, u_q, 0.0) for k in (m, free))
        lost = 1.5 * (
            i_d * m.inductance_d * (without[0] - with_[0])
            + i_q * m.inductance_q * (1 - 3 * m.saturation * i_q**2) * (without[1] - with_[1])
        )
        phases = [i_d * np.cos(angle - k) - i_q * np.sin(angle - k) for k in (0, 2.0944, -2.0944)]
        spent = sum(m.lost_voltage * p * p / (abs(p) + 0.1) for p in phases)
        assert lost == pytest.approx(spent, rel=1e-4, abs=1e-3)  # 2.0944 for a third of a turn
    still = _change(m, (0.0, 0.0, 0.0, 1.0, 0.0), 5.0, 7.0, 0.0)
    assert still[:2] == pytest.approx((5.0 / m.inductance_d, 7.0 / m.inductance_q))


def test_currents_go_as_another_solver_goes():
    """SciPy's solver with the recorded voltages, period for period, finds the recorded state.

    1e-8 A: of Runge-Kutta steps of 20 us with time constants of 8 ms; without the dead time, whose
    kink at zero current no step of fixed length meets.
    """
    m = _machine(Drives().x)._replace(lost_voltage=0.0)
    part = np.arange(120)
    out = driven(m, np.full(part.size, 900 * RPM), np.where(part > 60, -3.0, 0.0),
                 np.where(part > 90, 5.0, 0.0))  # fmt: skip
    x = np.zeros(5)
    for k in range(part.size):
        assert out[k, [I_D, I_Q, SPEED]] == pytest.approx(x[:3], abs=1e-8)
        load = 5.0 if k > 90 else 0.0
        x = solve_ivp(
            lambda _, y, k=k, load=load: _change(m, tuple(y), *out[k, [U_D, U_Q]], load),
            (0, m.period), x, rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
    assert np.abs(out[:, I_D]).max() > 2


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_at_steady_speed_the_voltages_are_those_of_the_equations(machine):
    """u_q = R i_q + w (L_d i_d + flux) and u_d = R i_d - w L_q i_q, but for the dead time.

    Means of the last tenths before each change; the dead time takes 4/pi of its voltage at most.
    """
    axis = shop_parameters(machine).drives.x
    m, out = _machine(axis), speed_steps(axis)
    spread = []
    for k in range(len(SPEEDS) * len(FIELD)):
        last = int((k + 1) * HOLD / len(FIELD) * RATE) - 2
        u_d, u_q, i_d, i_q, speed, warmth = out[last - 200 : last, : WARMTH + 1].mean(axis=0)
        w, r = m.pole_pairs * speed, m.resistance * (1 + 0.00393 * warmth)
        flux_q = m.inductance_q * i_q * (1 - m.saturation * i_q**2)
        settled = np.ptp(out[last - 200 : last, SPEED]) < 1.0
        if settled:
            spread.append(u_q - r * i_q - w * (m.inductance_d * i_d + m.flux))
            spread.append(u_d - r * i_d + w * flux_q)
    assert len(spread) > 30
    assert np.abs(spread).max() < 4 / np.pi * axis.motor.dead_time_error + 0.1
    assert np.abs(spread).max() > 0.5 * axis.motor.dead_time_error


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_the_motor_is_the_one_of_the_axis(machine):
    """Torque for each ampere without i_d is the axis' torque constant; its limits are kept."""
    axis = shop_parameters(machine).drives.x
    out = speed_steps(axis)
    plain = (np.abs(out[:, I_D]) < 0.02) & (np.abs(out[:, I_Q]) > 3)
    constant = out[plain, TORQUE] / out[plain, I_Q]
    assert constant == pytest.approx(np.full(plain.sum(), axis.motor.torque_constant), rel=1e-3)
    limit = axis.motor.bus_voltage / np.sqrt(3)
    assert np.hypot(out[:, U_D], out[:, U_Q]).max() <= limit * (1 + 1e-9)
    assert 0.2 < out[-1, WARMTH] < 10
    travel = np.cumsum(out[:, SPEED]) / RATE / axis.gear
    assert np.ptp(travel) < 0.6  # m
