"""Harmonics of the model against closed forms and against time."""

import numpy as np
import pytest

from pipeline.cutting.force.mean_force import regressors
from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.conditions import Conditions
from pipeline.identification.cutting.revolution import wave
from pipeline.identification.cutting.spectrum import (
    Geometry,
    columns,
    tooth_columns,
    transfer,
    turned,
)
from tests.identification.cutting.milling import Truth, milled

SLOT = Conditions(speed=100.0, f_z=1e-4, a_p=3e-3, phi_st=0.0, phi_ex=np.pi, flutes=2)
MILL = Tool(kind="flat", diameter_mm=25.0, flutes=2)


def test_harmonics_of_a_slot_are_those_of_sine_and_cosine():
    """Two straight teeth: F_y of K_tc is a f sin^2, of K_te a |sin|, by their Fourier sums."""
    found = columns(MILL, Geometry(), SLOT, 8)
    a, f = SLOT.a_p, SLOT.f_z
    # steps of a 512th of a revolution: 1 in 1000 of the jump
    assert found[2, 1, 0] == pytest.approx(-a * f / 2, abs=1e-3 * a * f)
    assert found[2, 0, 0] == pytest.approx(1j * a * f / 2, abs=1e-3 * a * f)
    assert found[4, 1, 3] == pytest.approx(-4 * a / (np.pi * 15), abs=1e-3 * a)
    assert np.abs(found[1::2]).max() < 1e-12


@pytest.mark.parametrize("helix", [0.0, 0.5])
def test_means_are_those_of_the_closed_form(helix):
    arc = Conditions(speed=80.0, f_z=6e-5, a_p=2e-3, phi_st=0.9, phi_ex=2.7, flutes=3)
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=3)
    found = columns(tool, Geometry(helix=helix), arc, 3)[0].real
    exact = regressors(flutes=3, f_z=6e-5, a_p=2e-3, phi_st=0.9, phi_ex=2.7)
    step = 2 * np.pi / 256  # of the grid, within which an edge enters and leaves
    bound = 3 * 2e-3 * step / (2 * np.pi) * np.array([6e-5] * 3 + [1.0] * 3)
    assert (np.abs(found - exact) <= bound).all()


def test_runout_and_worn_teeth_are_those_of_a_simulation_in_time():
    truth = Truth(flutes=2, helix=35.0, runout=0.008, runout_angle=0.0, worn=(1.3, 0.7))
    arc = Conditions(speed=100.0, f_z=1e-4, a_p=2e-3, phi_st=0.0, phi_ex=np.pi, flutes=2)
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=2)
    place = Geometry(along=8e-6, helix=np.radians(35.0))
    values = np.concatenate([np.array(truth.cutting) * 1e6, np.array(truth.edge) * 1e3])
    said = columns(tool, place, arc, 45) @ values
    said = said + tooth_columns(tool, place, arc, 45) @ (-0.3 * np.array(truth.edge) * 1e3)
    angles = 0.2 + 2 * np.pi * np.arange(100) / 100
    in_time = milled(truth, rpm=6000, f_z=0.1, a_p=2.0, entry=0.0, leave=np.pi, seconds=0.01,
                     rate=1e4, phase=0.2)  # fmt: skip
    rest = wave(said, angles) - in_time
    # 45 harmonics of edges that enter over 13 degrees; the simulation's 24 slices
    assert np.sqrt((rest**2).mean()) < 0.02 * np.sqrt((in_time**2).mean())


def test_single_teeth_leave_the_mean_of_all_as_it_is():
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=4)
    arc = Conditions(speed=80.0, f_z=6e-5, a_p=2e-3, phi_st=0.0, phi_ex=2.0, flutes=4)
    found = tooth_columns(tool, Geometry(helix=0.5), arc, 12)
    assert found.shape == (13, 3, 9)
    assert np.abs(found[::4]).max() < 1e-15  # those harmonics all teeth share


def test_a_mode_shows_rest_as_it_is_and_resonance_by_its_damping():
    natural, damping = np.array([500.0, 900.0, 2000.0]), np.array([0.05, 0.1, 0.02])
    found = transfer(np.array([0.0, 500.0]), natural, damping)
    assert found[0] == pytest.approx([1, 1, 1])
    assert found[1, 0] == pytest.approx(-1j / (2 * 0.05))


def test_turning_is_a_shift_of_the_angle():
    lines = columns(MILL, Geometry(along=5e-6), SLOT, 20) @ np.ones(6)
    angles = np.linspace(0, 6, 50)
    assert wave(turned(lines, 0.4), angles) == pytest.approx(wave(lines, angles + 0.4))
