"""Electricity: power times time, part by part."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.energy import EnergyParameters, energy, spindle_supply
from pipeline.cutting.spindle_power import SpindleDrive

MILL = EnergyParameters(base_load_kW=1.2, drives_kW=0.6, coolant_kW=1.5)


def test_an_hour_of_everything_takes_the_sum_of_its_powers() -> None:
    found = energy(MILL, times=[1800.0, 1800.0], spindle_W=[3000.0, 5000.0], coolant=1.0)
    assert float(found.spindle.sum()) == pytest.approx(4.0)
    assert float(found.total) == pytest.approx(4.0 + 1.2 + 0.6 + 1.5)


def test_a_machine_that_waits_takes_its_base_load() -> None:
    found = energy(MILL, times=[3600.0], spindle_W=0.0, moving=0.0)
    assert float(found.total) == pytest.approx(1.2)


def drive(efficiency: float, motor_efficiency: float) -> SpindleDrive:
    return SpindleDrive(
        rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0, efficiency=efficiency,
        motor_efficiency=motor_efficiency,
    )  # fmt: skip


@given(st.floats(0.0, 1e4), st.floats(0.0, 1e3), st.floats(0.3, 1.0), st.floats(0.3, 1.0))
def test_power_in_is_power_out_and_losses(
    cutting: float, no_load: float, eta: float, motor: float
) -> None:
    """Losses of the motor from the supply, then those of the way to the tool from its shaft."""
    supply = float(spindle_supply(cutting, no_load, drive(eta, motor)))
    shaft = supply - (1 - motor) * supply
    losses = (1 - motor) * supply + (1 - eta) * shaft
    assert supply == pytest.approx(cutting + no_load + losses, rel=1e-12, abs=1e-12)


def test_a_motor_that_nobody_measured_is_taken_for_a_usual_one() -> None:
    usual = SpindleDrive(rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0)
    assert float(spindle_supply(900.0, 0.0, usual)) == pytest.approx(1000.0)


@pytest.mark.parametrize("bad", [-100.0, np.nan, np.inf])
def test_powers_that_are_none_are_refused(bad: float) -> None:
    for name, pair in (("cutting", (bad, 1.0)), ("no_load", (1.0, bad))):
        with pytest.raises(ValueError, match=f"{name} = {bad} must be 0 or more, and finite"):
            spindle_supply(*pair, drive(0.9, 0.9))


def test_a_population_is_each_of_its_members() -> None:
    random = np.random.default_rng(2)
    times, power = random.uniform(0, 9, (4, 12)), random.uniform(0, 8000, (4, 12))
    moving = random.uniform(0, 1, 12)
    together = energy(MILL, times=times, spindle_W=power, moving=moving)
    assert together.block.shape == (4, 12)
    for row in range(4):
        one = energy(MILL, times=times[row], spindle_W=power[row], moving=moving)
        np.testing.assert_allclose(together.block[row], one.block, rtol=1e-14)


def test_what_is_no_power_or_share_is_refused() -> None:
    with pytest.raises(ValueError, match=r"energy\.base_load_kW = -1\.0 is out of its range"):
        EnergyParameters(base_load_kW=-1.0)
    with pytest.raises(ValueError, match=r"moving = 1\.5 must be 0 or more, at most 1"):
        energy(MILL, times=[1.0], spindle_W=0.0, moving=1.5)
    with pytest.raises(ValueError, match="spindle_W = nan"):
        energy(MILL, times=[1.0], spindle_W=np.nan)
    with pytest.raises(ValueError, match="times = inf must be 0 or more, and finite"):
        energy(MILL, times=[np.inf], spindle_W=0.0)
