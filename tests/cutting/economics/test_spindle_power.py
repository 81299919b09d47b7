"""Power and torque of a spindle over its speed, and force out of power."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.spindle_power import (
    SpindleDrive,
    available_power,
    available_torque,
    cutting_power,
    motor_power,
    no_load_power,
    tangential_force,
)

DRIVE = SpindleDrive(
    rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0, efficiency=0.85,
    minimum_speed_rpm=300.0, no_load_W=(100.0, 4.0, 0.05),
)  # fmt: skip


@given(st.floats(0.01, 8000 / 60))
def test_power_is_torque_times_speed(n: float) -> None:
    power = 2 * np.pi * n * available_torque(n, DRIVE)
    assert available_power(n, DRIVE) == pytest.approx(power, rel=1e-12)


def test_torque_is_constant_below_and_power_above_the_base_speed() -> None:
    assert available_torque(1.0, DRIVE) == available_torque(25.0, DRIVE)
    assert available_torque(25.0, DRIVE) == pytest.approx(11e3 / (2 * np.pi * 25))
    assert available_power(25.0, DRIVE) == available_power(130.0, DRIVE) == 11e3
    assert np.isnan(available_power(134.0, DRIVE)) and np.isnan(available_torque(134.0, DRIVE))


def test_no_load_power_is_its_polynomial() -> None:
    assert no_load_power(20.0, DRIVE) == 100 + 4 * 20 + 0.05 * 400
    assert no_load_power(-20.0, DRIVE) == no_load_power(20.0, DRIVE)


@given(st.floats(0.0, 50.0), st.floats(5.0, 130.0), st.floats(1e-3, 0.1))
def test_force_comes_back_from_the_power_that_it_takes(torque: float, n: float, D: float) -> None:
    force = tangential_force(motor_power(torque, n, DRIVE), n, D, DRIVE)
    assert force == pytest.approx(2 * torque / D, rel=1e-9, abs=1e-6 / D)
    assert cutting_power(torque, n) == pytest.approx(float(force) * np.pi * D * n, abs=1e-6)


def test_power_and_force_of_a_worked_example() -> None:
    """10 N m at 1200 rpm: 1256.64 W cut, 100 + 80 + 20 W to turn, 85 % of 1713.69 W at the shaft.

    A mill of 20 mm then runs at 75.398 m/min; 1000 N at 10 mm are those 10 N m.
    """
    assert cutting_power(10.0, 20.0) == pytest.approx(1256.637, abs=1e-3)
    assert motor_power(10.0, 20.0, DRIVE) == pytest.approx(1713.691, abs=1e-3)
    assert tangential_force(1713.691, 20.0, 0.02, DRIVE) == pytest.approx(1000.0, abs=1e-3)


def test_turning_never_gives_power_whatever_its_polynomial() -> None:
    falling = replace(DRIVE, no_load_W=(100.0, -10.0))
    assert no_load_power([5.0, 20.0], falling).tolist() == [50.0, 0.0]


@pytest.mark.parametrize("D", [0.0, -0.01, np.nan, np.inf])
def test_a_tool_without_a_diameter_has_no_force(D: float) -> None:
    with pytest.raises(ValueError, match=f"D = {D} of the tool must be positive and finite"):
        tangential_force(500.0, 20.0, [0.01, D], DRIVE)


def test_near_standstill_there_is_no_force_to_tell() -> None:
    """As printed it is P / v_c, which grows without bound."""
    n = np.array([0.0, 1e-9, 4.9, 5.0])
    force = tangential_force(500.0, n, 0.01, DRIVE)
    assert np.isnan(force).tolist() == [True, True, True, False]
    assert np.array_equal(force[3], tangential_force(500.0, -5.0, 0.01, DRIVE))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rated_power_kW": 0.0}, r"rated_power_kW = 0\.0 must be finite and positive"),
        ({"efficiency": 1.2}, r"efficiency = 1\.2 must lie above 0 and at most 1"),
        ({"motor_efficiency": 1.2}, r"motor_efficiency = 1\.2 must lie above 0 and at most 1"),
        ({"motor_efficiency": 0.0}, r"motor_efficiency = 0\.0 must lie above 0"),
        ({"minimum_speed_rpm": 9000.0}, "minimum_speed_rpm = 9000 must be at most top_speed_rpm"),
        ({"no_load_W": ()}, r"no_load_W is empty: write \[0\.0\]"),
        ({"base_speed_rpm": 9000.0}, "base_speed_rpm = 9000 must be at most top_speed_rpm = 8000"),
        ({"no_load_W": (1.0, np.inf)}, "no_load_W = inf must be finite"),
    ],
)
def test_impossible_drives_are_named(change: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(DRIVE, **change)
