"""Electricity and cost of a part, block by block."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.cost import (
    CostRates,
    EnergyParameters,
    energy,
    life_price,
    part_cost,
    spindle_supply,
)
from pipeline.cutting.economics.spindle_power import (
    SpindleDrive,
    available_power,
    cutting_power,
    motor_power,
    no_load_power,
)
from pipeline.cutting.tool import Tool

MILL = EnergyParameters(base_load_kW=1.2, drives_kW=0.6, coolant_kW=1.5)


def test_an_hour_of_everything_takes_the_sum_of_its_powers() -> None:
    found = energy(MILL, times=[1800.0, 1800.0], spindle_W=[3000.0, 5000.0], coolant=1.0)
    assert float(found.spindle.sum()) == pytest.approx(4.0)
    assert float(found.total) == pytest.approx(4.0 + 1.2 + 0.6 + 1.5)


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


RATES = CostRates(
    currency="KRW", labour_per_h=9160.0, machine_per_h=3000.0, energy_per_kWh=105.0,
    tool_change_min=2.0,
)  # fmt: skip

amounts = st.floats(0.0, 1e4)


@given(amounts, st.floats(1.0, 1e5), amounts, st.floats(0.0, 1e5), st.floats(0.0, 60.0))
def test_one_block_costs_what_sim2023_writes(
    T_p: float, T_l: float, P_t: float, per_h: float, T_c_min: float
) -> None:
    """C_p = (T_p/T_l) P_t + (T_p + T_c T_p/T_l)(E_p + C_d), restated."""
    rates = CostRates(currency="EUR", labour_per_h=per_h, tool_change_min=T_c_min)
    cost = part_cost(rates, times=[T_p], wear=[T_p / T_l], life_prices=P_t)
    tool = (T_p / T_l) * P_t
    machine = (T_p + 60 * T_c_min * T_p / T_l) * per_h / 3600
    assert float(cost.total) == pytest.approx(tool + machine, rel=1e-12, abs=1e-12)


def test_electricity_is_counted_by_the_kWh() -> None:
    cost = part_cost(RATES, times=[0.0, 0.0], wear=0.0, life_prices=0.0, energy_kWh=[2.0, 1.0])
    assert float(cost.total) == pytest.approx(315.0)


def test_a_life_that_is_not_known_makes_no_total_but_the_rest_is_known() -> None:
    cost = part_cost(RATES, times=[10.0, 10.0], wear=[0.1, np.nan], life_prices=[100.0, 100.0])
    assert np.isnan(cost.total)
    assert float(cost.time.sum()) == pytest.approx(20 * 12160 / 3600)
    assert np.isnan(cost.block).tolist() == [False, True]


def test_a_tool_of_several_edges_costs_its_part_for_each_life() -> None:
    assert life_price(Tool(kind="flat", diameter_mm=50, flutes=5, price=90.0, edges=2)) == 45.0


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
