"""The bend of a tool against beam theory."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting.deflection import tip_deflection, tip_stiffness
from pipeline.cutting.tool import Tool

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
