"""Plausibility of a tool table's sizes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.cutting.tool import Tool, odd_sizes

ROOT = Path(__file__).parents[2]
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
