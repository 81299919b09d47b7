"""Friction's step against closed forms, and stick-slip against an integrator that finds events."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pipeline.machine.axis.drive_parameters import (
    DirectionFriction,
    FrictionParameters,
    friction_force,
)
from tests.machine.steps import speed_after

MASS, DT = 150.0, 1e-3
UP = DirectionFriction(coulomb=60.0, static=90.0, stribeck_velocity=0.01, viscous=200.0)
DOWN = DirectionFriction(coulomb=50.0, static=80.0, stribeck_velocity=0.02, viscous=400.0)
BOTH = FrictionParameters(positive=UP, negative=DOWN)


def same(**values: float) -> FrictionParameters:
    one = DirectionFriction(**values)
    return FrictionParameters(positive=one, negative=one)


@given(st.floats(-80, 90), st.floats(1e-6, 1.0))
def test_below_the_breakaway_level_nothing_moves(force: float, period: float) -> None:
    v, held = speed_after(0.0, force, MASS, period, BOTH)
    assert v == 0.0
    assert held == force


@pytest.mark.parametrize("force, sign", [(90.001, 1), (-80.001, -1)])
def test_above_the_breakaway_level_it_moves(force: float, sign: int) -> None:
    v, _ = speed_after(0.0, force, MASS, DT, BOTH)
    assert v * sign > 0


@given(st.floats(1e-5, 1.0), st.sampled_from([1, -1]))
def test_steady_speed_is_kept_by_the_force_of_the_curve(speed: float, sign: int) -> None:
    """The step's fixed point is Stribeck's curve, in each direction with its own set."""
    one = UP if sign > 0 else DOWN
    dip = (one.static - one.coulomb) * np.exp(-((speed / one.stribeck_velocity) ** 2))
    force = sign * (one.coulomb + dip + one.viscous * speed)
    assert friction_force(sign * speed, BOTH) == pytest.approx(force, rel=1e-14)
    v, mean = speed_after(sign * speed, force, MASS, DT, BOTH)
    # rounding: force and speed cancel against each other once
    assert v == pytest.approx(sign * speed, rel=1e-12)
    assert mean == pytest.approx(force, rel=1e-9)


def test_coulomb_friction_stops_after_the_time_and_way_of_constant_deceleration() -> None:
    friction, v, x, t = same(coulomb=60.0, static=60.0), 0.1003, 0.0, 0.0
    while v > 0:
        last, (v, _) = v, speed_after(v, 0.0, MASS, DT, friction)
        x, t = x + 0.5 * DT * (last + v), t + DT
    assert t - DT < MASS * 0.1003 / 60 <= t
    # the trapezoid is wrong in the step that stops only, by less than a dt^2 / 2
    assert x == pytest.approx(MASS * 0.1003**2 / (2 * 60), abs=60 / MASS * DT**2 / 2)
    assert speed_after(0.0, 0.0, MASS, DT, friction) == (0.0, 0.0)


def test_viscous_friction_is_of_second_order() -> None:
    friction = same(coulomb=0.0, static=0.0, viscous=1500.0)

    def error(steps: int) -> float:
        v = 0.1
        for _ in range(steps):
            v, _ = speed_after(v, 0.0, MASS, 0.1 / steps, friction)
        return abs(v - 0.1 * np.exp(-1500 / MASS * 0.1))

    orders = np.log2([error(10) / error(20), error(20) / error(40)])
    assert orders == pytest.approx(2.0, abs=0.02)


def test_dip_is_of_first_order() -> None:
    friction = same(coulomb=60.0, static=90.0, stribeck_velocity=0.05)

    def speed(steps: int) -> float:
        v = 0.01
        for _ in range(steps):
            v, _ = speed_after(v, 200.0, MASS, 0.1 / steps, friction)
        return v

    exact = speed(20_000)
    orders = np.log2(abs(speed(50) - exact) / abs(speed(100) - exact))
    assert orders == pytest.approx(1.0, abs=0.05)


def test_speed_is_never_turned_round_by_friction_alone() -> None:
    """However long the step."""
    for v in (1e-9, 1e-3, 1.0):
        for sign in (1, -1):
            after, _ = speed_after(sign * v, 0.0, MASS, 0.4, BOTH)
            assert 0 <= after * sign < v


def stick_and_slip(period: float, K: float, belt: float, end: float) -> np.ndarray:
    """Durations of the mass that a spring pulls along: slip, stick, slip, stick ..."""
    friction = same(coulomb=60.0, static=90.0, stribeck_velocity=0.02)
    x, v, moving, changes = -90 / K, 0.0, False, [0.0]
    for k in range(round(end / period)):
        # the spring's force in the middle of the step
        force = K * (belt * (k + 0.5) * period - x - 0.5 * period * v)
        last, (v, _) = v, speed_after(v, force, MASS, period, friction)
        x += 0.5 * period * (last + v)
        if (v != 0) != moving:
            moving = v != 0
            changes.append(k * period)
    return np.diff(changes)


def exact_stick_and_slip(K: float, belt: float) -> tuple[float, float]:
    def slip(t: float, s: np.ndarray) -> list[float]:
        level = 60 + 30 * np.exp(-((s[1] / 0.02) ** 2))
        return [s[1], (K * (belt * t - s[0]) - level) / MASS]

    def stops(t: float, s: np.ndarray) -> float:
        return s[1] if t > 1e-3 else 1.0

    stops.terminal, stops.direction = True, -1
    found = solve_ivp(
        slip, (0, 10), [-90 / K, 1e-9], events=stops, rtol=1e-11, atol=1e-14, method="DOP853"
    )
    t, x = found.t[-1], found.y[0, -1]
    return t, (90 - K * (belt * t - x)) / (K * belt)


@pytest.mark.parametrize("period", [1e-3, 2e-4, 2e-5])
def test_stick_slip_has_the_durations_of_the_exact_motion(period: float) -> None:
    K, belt = 4e4, 0.002
    slip, stick = exact_stick_and_slip(K, belt)
    # the first is the wait for the first start
    found = stick_and_slip(period, K, belt, 2.0)[1:]
    assert len(found) >= 7
    # both ends of a duration are known to a period; 335 ms and 65 ms
    assert found[::2] == pytest.approx(slip, abs=2 * period)
    assert found[1::2] == pytest.approx(stick, abs=2 * period)


@pytest.mark.parametrize(
    "values, said",
    [
        ({"coulomb": 2.0, "static": 1.0}, "friction.static = 1.0 N must not be below coulomb"),
    ],
)
def test_parameters_out_of_range_are_refused(values: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        DirectionFriction(**values)
