"""Cost: the formula of Sim2023 against the sum over blocks, tools and populations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.cost import CostRates, life_price, part_cost
from pipeline.cutting.tool import Tool

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
    assert float(cost.machine) == pytest.approx(315.0)


def test_tools_and_blocks_are_two_ways_to_the_same_total() -> None:
    random = np.random.default_rng(1)
    shape = (5, 40)
    cost = part_cost(
        RATES, times=random.uniform(0, 20, shape), wear=random.uniform(0, 0.1, shape),
        life_prices=random.uniform(0, 5e4, 40), energy_kWh=random.uniform(0, 0.1, shape),
    )  # fmt: skip
    tool = random.integers(0, 3, 40)
    by_tool = cost.by_tool(tool, 3)
    assert by_tool.shape == (5, 3)
    np.testing.assert_allclose(by_tool.sum(axis=-1), cost.total, rtol=1e-12)
    np.testing.assert_allclose(by_tool[:, 1], cost.block[:, tool == 1].sum(axis=1), rtol=1e-12)


def test_a_life_that_is_not_known_makes_no_total_but_the_rest_is_told() -> None:
    cost = part_cost(RATES, times=[10.0, 10.0], wear=[0.1, np.nan], life_prices=[100.0, 100.0])
    assert np.isnan(cost.total)
    assert float(cost.machine) == pytest.approx(20 * 12160 / 3600)
    known, unknown = cost.by_tool([0, 1], 2)
    assert np.isfinite(known) and np.isnan(unknown)


def test_a_tool_of_several_edges_costs_its_part_for_each_life() -> None:
    assert life_price(Tool(kind="flat", diameter_mm=50, flutes=5, price=90.0, edges=2)) == 45.0


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        ([0, 1, 0], r"tool has the shape \(3,\), there are 2 blocks"),
        (0, r"tool has the shape \(\), there are 2 blocks"),
        ([0, 2], "tool 2 of a block is none of 2 tools: their indices are 0 to 1"),
        ([-1, 0], "tool -1 of a block is none of 2 tools"),
    ],
)
def test_blocks_without_a_tool_do_not_lose_their_cost(tool: object, words: str) -> None:
    cost = part_cost(RATES, times=[10.0, 20.0], wear=0.0, life_prices=0.0)
    with pytest.raises(ValueError, match=words):
        cost.by_tool(tool, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["times", "wear", "life_prices", "energy_kWh"])
@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_what_is_no_amount_has_no_cost(name: str, bad: float) -> None:
    given_ = {"times": 1.0, "wear": 0.1, "life_prices": 1.0, "energy_kWh": 1.0, name: [bad]}
    if name == "wear" and np.isnan(bad):
        assert np.isnan(part_cost(RATES, **given_).total)  # a life that is not known
        return
    with pytest.raises(ValueError, match=f"{name} = {bad} must be 0 or more, and finite"):
        part_cost(RATES, **given_)


def test_values_below_zero_are_refused() -> None:
    with pytest.raises(ValueError, match=r"cost\.labour_per_h = -1\.0 is out of its range"):
        CostRates(currency="EUR", labour_per_h=-1.0)
    with pytest.raises(ValueError, match=r"cost\.energy_per_kWh = nan"):
        CostRates(currency="EUR", labour_per_h=1.0, energy_per_kWh=float("nan"))
    with pytest.raises(ValueError, match=r"times = -3\.0 must be 0 or more"):
        part_cost(RATES, times=[-3.0], wear=[0.0], life_prices=0.0)
