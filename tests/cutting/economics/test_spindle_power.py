"""Power of a spindle over its speed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.spindle_power import (
    SpindleDrive,
    available_power,
    cutting_power,
    motor_power,
    no_load_power,
)

DRIVE = SpindleDrive(
    rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0, efficiency=0.85,
    minimum_speed_rpm=300.0, no_load_W=(100.0, 4.0, 0.05),
)  # fmt: skip


def test_power_rises_with_speed_up_to_the_base_speed_and_stays() -> None:
    assert available_power(5.0, DRIVE) == pytest.approx(11e3 * 5 / 25)
    assert available_power(25.0, DRIVE) == available_power(130.0, DRIVE) == 11e3
    assert np.isnan(available_power(134.0, DRIVE))


@given(st.floats(0.0, 50.0), st.floats(5.0, 130.0))
def test_the_motor_gives_the_cut_and_the_turning_without_it(torque: float, n: float) -> None:
    given_ = DRIVE.efficiency * motor_power(torque, n, DRIVE)
    cut, none = cutting_power(torque, n), no_load_power(n, DRIVE)
    assert given_ == pytest.approx(float(cut + none), rel=1e-12)


def test_no_load_power_is_its_polynomial() -> None:
    assert no_load_power(20.0, DRIVE) == 100 + 4 * 20 + 0.05 * 400
    assert no_load_power(-20.0, DRIVE) == no_load_power(20.0, DRIVE)


def test_power_of_a_worked_example() -> None:
    """10 N m at 1200 rpm: 1256.64 W cut, 200 W to turn, 85 % of 1713.69 W at the shaft."""
    assert cutting_power(10.0, 20.0) == pytest.approx(1256.637, abs=1e-3)
    assert motor_power(10.0, 20.0, DRIVE) == pytest.approx(1713.691, abs=1e-3)


def test_turning_never_gives_power_whatever_its_polynomial() -> None:
    falling = replace(DRIVE, no_load_W=(100.0, -10.0))
    assert no_load_power([5.0, 20.0], falling).tolist() == [50.0, 0.0]


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
