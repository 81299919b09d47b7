"""Runout: what one tooth leaves the next one takes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.tool import Tool
from pipeline.cutting.waveform import basis, torque_basis

MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=0.0)
TURN = 2 * np.pi
SLOT = {"a_p": 2e-3, "phi_st": 0.0, "phi_ex": np.pi}


def turn(samples: int) -> np.ndarray:
    return (np.arange(samples) + 0.5) * (TURN / samples)


def test_one_tooth_has_no_runout() -> None:
    tool = replace(MILL, flutes=1, helix_deg=30.0)
    one = basis(tool, f_z=5e-5, angles=turn(40), **SLOT)
    other = basis(replace(tool, runout_um=50.0, runout_deg=33.0), f_z=5e-5, angles=turn(40), **SLOT)
    assert np.array_equal(one, other)


@settings(max_examples=60, deadline=None)
@given(
    runout=st.floats(0.0, 300.0), angle=st.floats(-180.0, 180.0),
    helix=st.floats(-50.0, 50.0), flutes=st.integers(2, 6),
)  # fmt: skip
def test_a_turn_cuts_what_a_turn_is_fed(runout, angle, helix, flutes) -> None:
    """Sum of all chips is N f_z sin(phi), whichever teeth cut: none of it is lost or cut twice."""
    tool = replace(MILL, flutes=flutes, runout_um=runout, runout_deg=angle, helix_deg=helix)
    # mean torque over R for K_tc: the chips' area of a turn
    torque = torque_basis(tool, f_z=5e-5, angles=turn(1440), slices=32, **SLOT)[:, 0].mean()
    expected = flutes * 5e-5 * 2e-3 * 2 / TURN * tool.radius
    assert torque == pytest.approx(expected, rel=2e-3)  # ends of chips within slices


def test_a_tooth_that_stands_out_far_does_all_the_work() -> None:
    """A chip of N f_z on one tooth, and nothing on the others, helix or not."""
    tool = replace(MILL, runout_um=1000.0, runout_deg=0.0)
    found = basis(tool, f_z=5e-5, angles=turn(360), **SLOT)
    alone = basis(replace(MILL, flutes=1), f_z=4 * 5e-5, angles=turn(360), **SLOT)
    assert np.allclose(found, alone, rtol=0, atol=1e-12 * np.abs(alone).max(axis=(0, 1)))


def test_small_runout_changes_chips_by_the_difference_of_radii() -> None:
    """Tooth 0 at phi = 90 deg, offset towards it: h = f_z + runout (1 - cos 90 deg)."""
    tool = replace(MILL, runout_um=3.0, runout_deg=0.0)
    found = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi / 2])
    assert found[0, 1, 0] / 1e-3 == pytest.approx(5e-5 + 3e-6, rel=1e-12)
    # the tooth behind is a quarter turn from the offset, tooth 0 one farther out before it
    after = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi])
    assert after[0, 1, 0] / 1e-3 == pytest.approx(5e-5 - 3e-6, rel=1e-12)


def test_what_a_tooth_misses_the_next_takes() -> None:
    """N = 4, offset towards tooth 0 by more than the feed: 1 and 2 miss, 3 takes what they left.

    Radii are 1, 0, -1, 0 of the runout.  Tooth 3 would cut f_z + runout over tooth 2, but 1 stood
    as far out two pitches before, and 0 three pitches: min(f_z + r, 2 f_z, 3 f_z - r).
    """
    f_z, r = 5e-5, 60e-6
    tool = replace(MILL, runout_um=r * 1e6)
    chips = [
        basis(tool, f_z=f_z, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi / 2 * (1 + j)])
        for j in range(4)
    ]
    h = [chip[0, 1, 0] / 1e-3 for chip in chips]
    third = min(f_z + r, 2 * f_z, 3 * f_z - r)
    assert np.allclose(h, [4 * f_z - third, 0.0, 0.0, third], rtol=1e-9, atol=1e-15)
    edges = [chip[0, 1, 3] / 1e-3 for chip in chips]
    assert np.allclose(edges, [1, 0, 0, 1], rtol=1e-9, atol=1e-15)


def test_offset_turns_with_the_tool() -> None:
    """Naming the tooth behind the first one instead moves the same forces by a pitch."""
    tool = replace(MILL, helix_deg=25.0, runout_um=8.0, runout_deg=20.0)
    one = basis(tool, f_z=5e-5, angles=turn(48), **SLOT)
    other = basis(
        replace(tool, runout_deg=20.0 + 90.0), f_z=5e-5, angles=turn(48) - TURN / 4, **SLOT
    )
    assert np.allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max(axis=(0, 1)))


def test_forces_change_without_jumps_over_runout() -> None:
    """Fits need it: steps of a nanometre change no edge force by more than a few parts in 1000."""
    tool = replace(MILL, helix_deg=30.0, runout_deg=40.0)
    values = [
        basis(replace(tool, runout_um=20.0 + 1e-3 * k), f_z=3e-5, angles=turn(30), **SLOT)
        for k in range(40)
    ]
    steps = np.abs(np.diff(values, axis=0))[..., 3:].max()
    assert steps <= 5e-3 * np.abs(values[0][..., 3:]).max()


@pytest.mark.parametrize("runout", [3.0, 10.0, 40.0])
@pytest.mark.parametrize("m_c", [0.0, 0.25])
def test_error_of_the_slices(runout: float, m_c: float) -> None:
    """What the docstring of `basis` says of 16 slices over 1.7 rad."""
    tool = replace(MILL, helix_deg=30.0, runout_um=runout, runout_deg=20.0)
    cut = {**SLOT, "f_z": 5e-5, "a_p": 15e-3, "angles": turn(500), "m_c": m_c}
    exact, found = basis(tool, slices=2000, **cut), basis(tool, **cut)
    scale = np.abs(exact).max(axis=(0, 1))
    error = np.abs(found - exact) / scale
    assert error[..., :3].max() < 7e-4
    assert error[..., 3:].max() < 7e-3
    assert np.sqrt((error[..., 3:] ** 2).mean()) < 1e-3
