"""The mechanics of a feed drive: balance of energy, order, play."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.axis.drive_parameters import (
    DirectionFriction,
    FeedDriveParameters,
    FrictionParameters,
)
from pipeline.machine.axis.motor import force_constant
from tests.machine.steps import screw_step

ONE = DirectionFriction(coulomb=60.0, static=90.0, stribeck_velocity=0.01, viscous=200.0)
NONE = DirectionFriction(coulomb=0.0, static=0.0)
VISCOUS = DirectionFriction(coulomb=40.0, static=40.0, viscous=800.0)


def axis(one: DirectionFriction = ONE, **values: float) -> FeedDriveParameters:
    return FeedDriveParameters(
        mass=150.0,
        force_constant=300.0,
        friction=FrictionParameters(positive=one, negative=one),
        **values,
    )


def test_force_constant_is_the_power_balance_of_the_screw() -> None:
    """Motor's power k_t A omega is the carriage's F v, with v = omega L / 2 pi."""
    k_t, lead, omega = 0.7, 0.01, 40.0
    assert force_constant(k_t, lead) * omega * lead / (2 * pi) == pytest.approx(k_t * omega)


@given(
    st.floats(-0.5, 0.5), st.floats(-3, 3), st.floats(-200, 200), st.floats(-300, 300),
    st.floats(1e-5, 2e-3),
)  # fmt: skip
def test_energy_balance_closes_in_each_step(
    v: float, command: float, load: float, offset: float, period: float
) -> None:
    drive = axis(offset=offset)
    x, after, friction = screw_step(0.0, v, command, load, period, drive)
    work = (300.0 * command - offset - load - friction) * x
    gained = 0.5 * 150.0 * (after**2 - v**2)
    assert work == pytest.approx(gained, abs=1e-12 * (1 + 75 * v**2 + abs(300 * command * x)))


@given(st.floats(-0.5, 0.5), st.floats(-3, 3), st.floats(1e-5, 2e-3))
def test_friction_takes_energy_in_each_step_that_keeps_its_direction(
    v: float, command: float, period: float
) -> None:
    x, after, friction = screw_step(0.0, v, command, 0.0, period, axis())
    if v * after > 0:
        assert friction * x > 0


def test_without_friction_the_step_is_exact() -> None:
    x, v, friction = screw_step(0.01, 0.2, 1.5, 30.0, 0.1, axis(NONE, offset=20.0))
    a = (300 * 1.5 - 30 - 20) / 150
    assert v == pytest.approx(0.2 + a * 0.1, rel=1e-14)
    assert x == pytest.approx(0.01 + 0.2 * 0.1 + 0.5 * a * 0.1**2, rel=1e-14)
    assert friction == pytest.approx(0.0, abs=1e-10)


def test_position_is_of_second_order_in_smooth_motion() -> None:
    """Against the closed form of M v' = F - mu v with F = 300 * 2 - 40 N, mu = 800 N s/m."""
    end, rate, top = 0.2, 800 / 150, 560 / 800
    exact = top * end + (0.1 - top) / rate * (1 - np.exp(-rate * end))

    def error(steps: int) -> float:
        x, v = 0.0, 0.1
        for _ in range(steps):
            x, v, _ = screw_step(x, v, 2.0, 0.0, end / steps, axis(VISCOUS))
        return abs(x - exact)

    orders = np.log2([error(10) / error(20), error(20) / error(40)])
    assert orders == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("offset", [89.9, -89.9])
def test_vertical_axis_without_command_stands_while_friction_holds_it(offset: float) -> None:
    x, v = 0.3, 0.0
    for _ in range(1000):
        x, v, friction = screw_step(x, v, 0.0, 0.0, 1e-3, axis(offset=offset))
    assert (x, v, friction) == (0.3, 0.0, -offset)


def test_vertical_axis_falls_when_its_offset_is_greater() -> None:
    _, v, _ = screw_step(0.0, 0.0, 0.0, 0.0, 1e-3, axis(offset=90.1))
    assert v < 0
