"""Tools, tool tables, the stiffness of a tool's tip, and sizes that no tool has."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting.tool import Tool, ToolTable, odd_sizes, tip_deflection, tip_stiffness
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


TABLES = sorted((ROOT / "conf/tool").glob("*.yaml"))
WHOLE = Tool(
    kind="flat", diameter_mm=16.0, flutes=3, helix_deg=40.0, flute_length_mm=32.0,
    stickout_mm=50.0, shank_diameter_mm=16.0, runout_um=8.0, flank_wear_um=120.0,
    feed_per_tooth_mm=(0.03, 0.15), cutting_speed_m_min=(60.0, 300.0), top_speed_rpm=18_000.0,
)  # fmt: skip
SOUND = [
    Tool(kind="drill", diameter_mm=6.0, flutes=1, flute_length_mm=300.0, stickout_mm=330.0),
    Tool(kind="flat", diameter_mm=0.2, flutes=2, flute_length_mm=0.4, shank_diameter_mm=4.0,
         stickout_mm=12.0, feed_per_tooth_mm=(0.001, 0.003)),
    Tool(kind="flat", diameter_mm=100.0, flutes=24, flute_length_mm=1.2, stickout_mm=70.0,
         shank_diameter_mm=22.0),
    Tool(kind="flat", role="boring_bar", diameter_mm=32.0, flutes=1, flute_length_mm=4.0,
         stickout_mm=320.0),
    Tool(kind="bull_nose", diameter_mm=50.0, flutes=4, corner_radius_mm=6.0, flute_length_mm=5.5,
         stickout_mm=120.0),
    Tool(kind="flat", diameter_mm=6.0, flutes=4, flute_length_mm=60.0, stickout_mm=80.0),
]  # fmt: skip


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_tools_that_exist_are_not_odd(path: Path) -> None:
    for values in yaml.safe_load(path.read_text())["tools"].values():
        assert odd_sizes(Tool(**values)) == ()


@pytest.mark.parametrize("tool", [WHOLE, *SOUND])
def test_gun_drills_micro_tools_and_saws_are_not_odd(tool: Tool) -> None:
    assert odd_sizes(tool) == ()


@pytest.mark.parametrize(
    ("field", "value", "unit"),
    [
        ("diameter_mm", 0.016, "metre"),
        ("diameter_mm", 0.63, None),  # inch: 0.63 mm is a size, its flutes do not go with it
        ("flute_length_mm", 0.032, "metre"),
        ("flute_length_mm", 1.26, "inch"),
        ("stickout_mm", 1.97, "inch"),
        ("shank_diameter_mm", 0.63, "inch"),
        ("helix_deg", 0.698, "radian"),
        ("runout_um", 0.008, "mm"),
        ("flank_wear_um", 0.12, "mm"),
        ("feed_per_tooth_mm", (0.001, 0.006), "inch"),
        ("cutting_speed_m_min", (0.5, 1.0), "m/s"),
    ],
)
def test_a_value_in_another_unit_is_named(field: str, value: Any, unit: str | None) -> None:
    odd = odd_sizes(replace(WHOLE, **{field: value}))
    assert odd
    if unit is None:
        assert {one.beside for one in odd} == {field}
    else:
        assert [one.field for one in odd] == [field]
        assert unit in odd[0].units and f"{unit}" in odd[0].remedy and field in odd[0].remedy


def test_a_whole_tool_in_inch_is_odd() -> None:
    sizes = {"diameter_mm": 0.5, "flute_length_mm": 1.0, "stickout_mm": 1.5}
    odd = odd_sizes(replace(WHOLE, **sizes, shank_diameter_mm=0.5, feed_per_tooth_mm=None))
    assert {one.field for one in odd} == {"stickout_mm", "shank_diameter_mm"}
    assert all("inch" in one.units for one in odd)
