"""Forces over the angle of the spindle: closed forms, means, balances, a plain restatement."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from tests.cutting.closed_forms import (
    basis,
    in_plane_forces,
    mean_forces,
    mean_torque,
    plain_forces,
    torque_basis,
    waveform,
)

LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0)
TURN = 2 * np.pi


def turn(samples: int) -> np.ndarray:
    """Angles at the middles of equal steps."""
    return (np.arange(samples) + 0.5) * (TURN / samples)


def test_without_helix_it_is_the_closed_form() -> None:
    tool = replace(MILL, helix_deg=0.0)
    law = ForceLaw.linear(K_tc=800.0, K_rc=400.0)
    found = waveform(law, tool, f_z=5e-5, a_p=2e-3, phi_st=0.4, phi_ex=2.0, angles=turn(720))
    expected = in_plane_forces(
        turn(720), flutes=4, f_z=5e-5, d=2e-3, K_t=8e8, K_e=0.5, phi_st=0.4, phi_ex=2.0
    )
    assert np.allclose(found[:, :2], expected, rtol=0, atol=1e-12 * expected.max())


@settings(max_examples=60, deadline=None)
@given(
    helix=st.floats(-60.0, 60.0),
    flutes=st.integers(1, 7),
    arc=st.tuples(st.floats(0.0, np.pi), st.floats(0.05, np.pi)),
    a_p=st.floats(1e-4, 2e-2),
)
def test_mean_is_that_of_altintas(helix, flutes, arc, a_p) -> None:
    """Whatever the helix is; 2880 angles leave what entry and exit jump by between two of them."""
    tool = replace(MILL, helix_deg=helix, flutes=flutes)
    phi_st = arc[0]
    phi_ex = min(phi_st + arc[1], np.pi)
    cut = {"f_z": 5e-5, "a_p": a_p, "phi_st": phi_st, "phi_ex": phi_ex}
    found = waveform(LAW, tool, angles=turn(2880), **cut).mean(axis=0)
    expected = mean_forces(LAW, flutes=flutes, **cut)
    largest = flutes * a_p * (8e8 * 5e-5 + 2e4)  # of all teeth together
    assert np.abs(found - expected).max() <= largest / 2880


@pytest.mark.parametrize("helix", [20.0, 45.0])
def test_mean_converges_to_that_of_altintas(helix: float) -> None:
    """Within a part in 10^6 once the angles are close; forces are continuous with a helix."""
    cut = {"f_z": 5e-5, "a_p": 7e-3, "phi_st": 0.3, "phi_ex": 1.9}
    tool = replace(MILL, helix_deg=helix)
    found = waveform(LAW, tool, angles=turn(20_000), **cut).mean(axis=0)
    assert np.allclose(found, mean_forces(LAW, flutes=4, **cut), rtol=1e-6, atol=0)
    torque = torque_basis(tool, angles=turn(20_000), **cut) @ np.r_[LAW.cutting, LAW.edge]
    expected = mean_torque(LAW, flutes=4, radius=tool.radius, **cut)
    assert torque.mean() == pytest.approx(float(expected), rel=1e-6)


def test_left_hand_helix_mirrors() -> None:
    """phi -> pi - phi with the helix turned round: tangential F_y and radial F_x stay."""
    cut = {"f_z": 5e-5, "a_p": 4e-3}
    one = basis(MILL, phi_st=0.3, phi_ex=1.2, angles=turn(90), **cut)
    mirror = {"phi_st": np.pi - 1.2, "phi_ex": np.pi - 0.3, "angles": np.pi - turn(90)}
    other = basis(replace(MILL, helix_deg=-30.0), **cut, **mirror)
    sign = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, 1]])
    scale = np.abs(one).max(axis=(0, 1))
    assert np.allclose(one * np.hstack([sign, sign]) / scale, other / scale, atol=1e-12)


def test_slices_converge_with_the_fourth_order() -> None:
    cut = {"f_z": 5e-5, "a_p": 9e-3, "phi_st": 0.2, "phi_ex": 2.8, "angles": turn(40)}
    exact = basis(MILL, slices=200, **cut)
    errors = [np.abs(basis(MILL, slices=n, **cut) - exact).max() for n in (2, 4, 8)]
    assert np.log2(errors[0] / errors[1]) > 3.5
    assert np.log2(errors[1] / errors[2]) > 3.5


def test_long_edges_go_round_more_than_once() -> None:
    """With a helix of 70 degrees and 30 mm of depth the edge covers 2.6 turns."""
    tool = replace(MILL, helix_deg=70.0, flutes=1)
    cut = {"f_z": 5e-5, "a_p": 3e-2, "phi_st": 0.3, "phi_ex": 1.2}
    found = waveform(LAW, tool, angles=turn(60), slices=40, **cut)
    expected = plain_forces(LAW, tool, 5e-5, 0.0, 3e-2, between(0.3, 1.2), turn(60), discs=40_000)
    # discs at the border of the arc are in it or not: a few of 40 000
    assert np.abs(found - expected[:, :3]).max() <= 3e-4 * np.abs(expected).max()


def between(phi_st: float, phi_ex: float):
    return lambda phi, z: (phi >= phi_st) & (phi < phi_ex)


@pytest.mark.parametrize("kind", ["flat", "bull_nose", "ball"])
@pytest.mark.parametrize("runout", [0.0, 12.0])
@pytest.mark.parametrize("m_c", [0.0, 0.3])
def test_plain_restatement(kind: str, runout: float, m_c: float) -> None:
    tool = replace(
        MILL, kind=kind, runout_um=runout, runout_deg=70.0, flutes=3,
        corner_radius_mm=2.0 if kind == "bull_nose" else 0.0,
    )  # fmt: skip
    law = replace(LAW, m_c=m_c, K_tc=8e8 * 5e-5**m_c)
    cut = {"f_z": 3e-5, "a_p": 6e-3, "phi_st": 0.4, "phi_ex": 2.6, "angles": turn(45)}
    found = waveform(law, tool, **cut)
    plain = plain_forces(law, tool, 3e-5, 0.0, 6e-3, between(0.4, 2.6), turn(45))[:, :3]
    # one of 2000 discs more or less in the arc; with runout where a chip ends within a slice
    near = 4e-3 if runout else 4e-4
    assert np.abs(found - plain).max() <= near * np.abs(plain).max()


def test_ball_in_a_slot_takes_the_force_of_its_depth() -> None:
    """Without helix, b h = dz f_z sin(phi) whatever kappa is: F_y = K_tc f_z a_p at the front."""
    ball = Tool(kind="ball", diameter_mm=8.0, flutes=1)
    found = basis(ball, f_z=5e-5, a_p=3e-3, phi_st=0, phi_ex=np.pi, angles=[np.pi / 2])
    assert found[0, 1, 0] == pytest.approx(5e-5 * 3e-3, rel=1e-9)
    arc = 4e-3 * np.arccos(1 - 3 / 4)  # length of its edge in the material
    assert found[0, 1, 3] == pytest.approx(arc, rel=1e-9)
    # the thrust is along the axis: R (1 - cos^2) / 2 of the chip, downwards from the spindle
    kappa = np.arccos(1 - 3 / 4)
    assert found[0, 2, 1] == pytest.approx(-5e-5 * 4e-3 * np.sin(kappa) ** 2 / 2, rel=1e-6)


def test_no_chip_no_force() -> None:
    cut = {"a_p": 1e-3, "phi_st": 0.0, "phi_ex": 1.0, "angles": turn(8)}
    assert not basis(MILL, f_z=0.0, **cut).any()
    assert not basis(MILL, f_z=-1e-5, **cut).any()
    assert not basis(MILL, f_z=1e-5, **cut | {"a_p": 0.0}).any()


@pytest.mark.parametrize(
    ("lag", "m_c", "near"),
    [(1.0, 0.0, 1e-7), (4.0, 0.0, 6e-6), (0.8, 0.25, 2.5e-5), (4.0, 0.25, 1.7e-4)],
)
def test_error_of_the_slices(lag: float, m_c: float, near: float) -> None:
    """What the docstring of `basis` says of 16 slices."""
    a_p = lag * MILL.radius / np.tan(MILL.helix)
    error = 0.0
    for phi_st, phi_ex in ((0.0, np.pi), (0.5, 2.0)):
        cut = {"f_z": 5e-5, "a_p": a_p, "phi_st": phi_st, "phi_ex": phi_ex, "angles": turn(400),
               "m_c": m_c}  # fmt: skip
        exact, found = basis(MILL, slices=1000, **cut), basis(MILL, **cut)
        error = max(error, (np.abs(found - exact) / np.abs(exact).max(axis=(0, 1))).max())
    assert error < near
