"""Thrust of drills with their chisel edge, beside the tool makers' formula and published shares."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.cutting.economics.material import Material
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import (
    chisel_engaged,
    chisel_length,
    chisel_rake,
    chisel_thrust,
    load_table,
)
from pipeline.cutting.tool import Tool
from pipeline.parameters import structure
from tests.cutting.force.test_load_table import arc, blocks

ROOT = Path(__file__).parents[3]
MATERIALS = sorted((ROOT / "conf/material").glob("*.yaml"))


def drill(diameter: float, point: float, **values: Any) -> Tool:
    return Tool(
        kind="drill", diameter_mm=diameter, flutes=2, point_angle_deg=point, **values
    )  # fmt: skip


def thrust(tool: Tool, law: ForceLaw, f_z: float, lower: float = 0.0) -> float:
    lows, highs = arc(0.0, 7.0, 2 * tool.diameter)
    profile = (np.maximum(lows, lower), highs)
    table = load_table(blocks([profile], slope=[-1.0]), [tool], [law], 2 * f_z)
    return float(table.loads([f_z]).axial[0])


@pytest.mark.parametrize("path", MATERIALS, ids=lambda path: path.stem)
def test_thrust_is_near_that_of_the_tool_makers_formula(path: Path) -> None:
    """F_f = 0.5 k_c (D / 2) f_n sin(p / 2), k_c = k_c1.1 h^-m_c; 15 % cover its rounded factor."""
    values = yaml.safe_load(path.read_text()) | {"radial": 0.3, "axial": 0.0, "coefficients": None}
    material = structure({"file": values}, "file", Material)
    law = material.force_law(measured=False)
    for diameter, point in ((3.0, 118.0), (8.0, 140.0), (16.0, 118.0)):
        tool, sine = drill(diameter, point), float(np.sin(np.radians(point / 2)))
        feed = 0.015 * diameter  # [mm/rev]
        k_c = material.k_c11 * (feed / 2 * sine) ** -material.m_c
        formula = 0.5 * k_c * diameter / 2 * feed * sine
        assert thrust(tool, law, feed / 2e3) == pytest.approx(formula, rel=0.15)


def test_the_share_of_the_chisel_edge_is_as_published() -> None:
    tool, law = drill(8.0, 118.0), ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.3)
    lips = law.K_rc * (6e-5 * np.sin(np.radians(59))) ** 0.75 * 2 * tool.radius
    chisel = chisel_thrust(tool, law) * 6e-5**0.75
    whole = thrust(tool, law, 6e-5)
    assert whole == pytest.approx(float(lips) + chisel, rel=5e-3)  # a chord of u over the nodes
    below = lips * chisel_length(tool) / tool.diameter
    assert 0.4 < (chisel + below) / whole < 0.7


def test_over_a_hole_the_chisel_edge_cuts_nothing() -> None:
    tool = drill(8.0, 118.0)
    height = chisel_length(tool) / 2 / np.tan(np.radians(59))
    highs = np.full((1, 8), 0.02)
    assert chisel_engaged(tool, np.full((1, 8), 1.01 * height), highs)[0] == 0.0
    assert chisel_engaged(tool, np.zeros((1, 8)), highs)[0] == 1.0
    assert chisel_engaged(tool, np.full((1, 8), height / 2), highs)[0] == pytest.approx(0.5)


def test_a_pointed_drill_has_a_steeper_chisel_edge_than_lips() -> None:
    assert -90 < chisel_rake(drill(8.0, 140.0)) < chisel_rake(drill(8.0, 90.0)) < -30
    assert chisel_length(drill(8.0, 118.0, role="tap")) == 0.0
    assert chisel_length(Tool(kind="flat", diameter_mm=8.0, flutes=4)) == 0.0
