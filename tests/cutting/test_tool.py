"""Tools, tool tables, and the stiffness of a tool's tip."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting.tool import Tool, ToolTable, tip_deflection, tip_stiffness
from pipeline.parameters import ParametersError, structure
from pipeline.shop.control.part_programs import TOOLS

ROOT = Path(__file__).parents[2]


def table(name: str) -> ToolTable:
    values = yaml.safe_load((ROOT / f"conf/tool/{name}.yaml").read_text())
    return structure({"tool": {name: values}}, f"tool.{name}", ToolTable)


def test_the_shop_floors_table_has_the_tools_of_its_part_programs() -> None:
    found = table("shop")
    assert {(t.number, t.name, t.diameter) for t in TOOLS} == {
        (number, tool.name, tool.diameter_mm) for number, tool in found.tools.items()
    }
    for tool in found.tools.values():
        assert (tool.kind == "drill") == ("DRILL" in tool.name)
        assert tool.flute_length_mm is not None and tool.stickout_mm is not None
        assert tool.flute_length_mm <= tool.stickout_mm


def test_the_end_mill_of_sim2023() -> None:
    tool = table("sim2023").tools[1]
    assert (tool.diameter_mm, tool.flutes, tool.helix_deg) == (6.0, 2, 0.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"tools": {}}, "the tool table is empty"),
        ({"tools": {-1: {"kind": "flat", "diameter_mm": 6, "flutes": 2}}}, "no tool number"),
        ({"tools": {1: {"kind": "flat", "diameter_mm": -6, "flutes": 2}}}, "diameter_mm = -6.0"),
        ({"tools": {1: {"kind": "flat", "diameter": 6, "flutes": 2}}}, "diameter"),
        ({"tools": {"one": {"kind": "flat", "diameter_mm": 6, "flutes": 2}}}, "'one' is no whole"),
        ({"tools": [1, 2]}, "tool"),
        ({}, "required field missing"),
    ],
)
def test_what_is_no_table_is_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ParametersError, match=words):
        structure({"tool": values}, "tool", ToolTable)


MADE_FOR = {"kind": "flat", "diameter_mm": 6, "flutes": 2}


def test_what_a_maker_allows_is_read_as_pairs() -> None:
    spans = {"feed_per_tooth_mm": [0.02, 0.05], "cutting_speed_m_min": [80, 150.5]}
    values = {"tools": {3: MADE_FOR | spans | {"top_speed_rpm": 20000}}}
    tool = structure({"tool": values}, "tool", ToolTable).tools[3]
    assert tool.feed_per_tooth_mm == (0.02, 0.05)
    assert tool.cutting_speed_m_min == (80.0, 150.5)
    assert tool.top_speed_rpm == 20000.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"feed_per_tooth_mm": [0.05, 0.02]}, r"feed_per_tooth_mm = \[0.05, 0.02\].*least first"),
        ({"feed_per_tooth_mm": [0.05]}, "feed_per_tooth_mm.*two numbers"),
        ({"feed_per_tooth_mm": [0.0, 0.0]}, "greatest above 0"),
        ({"feed_per_tooth_mm": [-0.01, 0.1]}, "from 0 to 10"),
        ({"cutting_speed_m_min": [100.0, float("nan")]}, "cutting_speed_m_min"),
        ({"cutting_speed_m_min": [100.0, 1e6]}, "from 0 to 10000"),
        ({"top_speed_rpm": 0.0}, "top_speed_rpm = 0.0 must lie from 1 to 1e\\+06"),
    ],
)
def test_what_a_maker_cannot_mean_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ParametersError, match=words):
        structure({"tool": {"tools": {3: MADE_FOR | change}}}, "tool", ToolTable)


MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, stickout_mm=40.0, flute_length_mm=22.0)


def test_cantilever() -> None:
    """F l^3 / (3 E I) of 0.8 D where all of it is fluted: 100 N bend 10 mm by 18 um over 40."""
    tool = replace(MILL, flute_length_mm=None)
    inertia = np.pi * 0.008**4 / 64
    assert tip_deflection(tool, 100.0) == pytest.approx(100 * 0.04**3 / (3 * 600e9 * inertia))
    assert tip_deflection(tool, 100.0) == pytest.approx(17.7e-6, rel=0.01)


@given(
    flute=st.floats(0.1, 60.0), shank=st.floats(3.0, 20.0), diameter=st.floats(1.0, 20.0),
)  # fmt: skip
def test_stepped_beam_has_the_bend_of_its_strain_energy(flute, shank, diameter) -> None:
    """Castigliano: the integral of M^2 / (F E I) with M = F x from the tip."""
    tool = replace(MILL, flute_length_mm=flute, shank_diameter_mm=shank, diameter_mm=diameter)

    def give(x: float) -> float:
        d = 0.8 * diameter if x < flute * 1e-3 else shank
        return x**2 / (600e9 * np.pi * (d * 1e-3) ** 4 / 64)

    border = [flute * 1e-3] if flute < 40 else None
    whole, _ = quad(give, 0, 0.04, points=border, epsrel=1e-12)
    assert 1 / tip_stiffness(tool) == pytest.approx(whole, rel=1e-9)


def test_steel_gives_more_than_carbide_and_forces_scale() -> None:
    soft = replace(MILL, youngs_modulus_GPa=210.0)
    forces = np.array([[0.0, 10.0], [20.0, -10.0]])
    assert np.allclose(tip_deflection(soft, forces), 600 / 210 * tip_deflection(MILL, forces))
    assert np.allclose(tip_deflection(MILL, 2 * forces), 2 * tip_deflection(MILL, forces))


def test_without_stickout_it_is_not_known() -> None:
    assert np.isnan(tip_deflection(replace(MILL, stickout_mm=None), [1.0, 2.0])).all()
