"""Closed forms of cutting forces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting import chip, force
from pipeline.cutting.force_law import ForceLaw, edge_forces

K_T, K_E = 1.23e9, 0.5  # A6061, Sim2023
D = 6e-3
THETA = np.linspace(0, 2 * np.pi, 3601)


@pytest.mark.parametrize("flutes", [1, 2])
def test_peak_in_a_slot(flutes: int) -> None:
    forces = force.in_plane_forces(THETA, flutes=flutes, f_z=5e-5, d=5e-4, K_t=K_T, K_e=K_E)
    peak = force.cutting_load(forces).max()
    # sin(phi) is 1 on a grid of 0.1 degrees
    assert peak == pytest.approx(float(force.slot_peak_load(K_T, K_E, 5e-4, 5e-5)), rel=1e-12)


def test_four_teeth_in_a_slot_pull_steadily() -> None:
    """sin^2 and sin cos of teeth a quarter turn apart add up to constants (Altintas 2012, 2.7)."""
    forces = force.in_plane_forces(THETA, flutes=4, f_z=5e-5, d=5e-4, K_t=K_T, K_e=K_E)
    expected = K_T * 5e-4 * 5e-5 * np.array([-K_E, 1.0])
    assert np.allclose(forces, expected, rtol=1e-12, atol=0)


def test_angles_may_have_any_shape() -> None:
    cut = {"flutes": 2, "f_z": 5e-5, "d": 5e-4, "K_t": K_T, "K_e": K_E}
    row = force.in_plane_forces([0.3, 1.2], **cut)
    assert np.array_equal(force.in_plane_forces(1.2, **cut), row[1])
    assert np.array_equal(force.in_plane_forces([[0.3], [1.2]], **cut), row[:, None])


def test_arcs_go_past_a_turn() -> None:
    cut = {"flutes": 3, "f_z": 5e-5, "d": 5e-4, "K_t": K_T, "K_e": K_E}
    theta = np.linspace(0, 6.28, 300)
    one = force.in_plane_forces(theta, phi_st=-0.083, phi_ex=1.517, **cut)
    turned = force.in_plane_forces(theta, phi_st=2 * np.pi - 0.083, phi_ex=2 * np.pi + 1.517, **cut)
    assert one.any() and np.allclose(one, turned, rtol=0, atol=1e-9)


def test_what_has_no_force_is_named() -> None:
    cut = {"f_z": 5e-5, "d": 5e-4, "K_t": K_T, "K_e": K_E}
    for flutes in (0, -2, 2.5, np.inf):
        with pytest.raises(ValueError, match=f"flutes = {flutes} must be a whole number"):
            force.in_plane_forces(THETA, flutes=flutes, **cut)
    for forces, shape in [(1.0, r"\(\)"), ([[1.0], [2.0]], r"\(2, 1\)")]:
        with pytest.raises(ValueError, match=f"forces have shape {shape}"):
            force.cutting_load(forces)


def test_one_sample_is_not_one_tooth() -> None:
    """The chip is what the axis moves in a tooth period: half the feed, half the force."""
    phi = np.linspace(0.1, 3.0, 7)
    h = force.chip_of_motion(1e-4, 0.0, phi)
    assert np.allclose(h, chip.thickness(1e-4, phi))
    assert np.allclose(force.chip_of_motion(0.0, 1e-4, phi), np.maximum(1e-4 * np.cos(phi), 0))


@given(st.floats(0.05, 3.0), st.floats(0.0, 1.0))
def test_mirrored_engagement_mirrors_the_force(width: float, place: float) -> None:
    """phi -> pi - phi with the spindle turning back: without radial force F_x turns its sign."""
    phi_st = place * (np.pi - width)
    phi_ex = phi_st + width
    theta = np.linspace(0, 2 * np.pi, 97)
    given_ = {"flutes": 1, "f_z": 1e-4, "d": 1e-3, "K_t": K_T, "K_e": 0.0}
    one = force.in_plane_forces(theta, phi_st=phi_st, phi_ex=phi_ex, **given_)
    other = force.in_plane_forces(
        np.pi - theta, phi_st=np.pi - phi_ex, phi_ex=np.pi - phi_st + 1e-12, **given_
    )
    edge = np.isclose(theta % (2 * np.pi), phi_ex, atol=1e-9)
    edge |= np.isclose(theta % (2 * np.pi), phi_st, atol=1e-9)
    assert np.allclose(one[~edge] * [-1, 1], other[~edge], atol=1e-9 * K_T * 1e-7)


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("m_c", [0.15, 0.25, 0.35])
def test_kienzle_with_the_mean_chip(share: float, m_c: float) -> None:
    """Never below the mean of the forces (the power is concave), and above by 8 to 18 % of m_c."""
    phi_s = float(chip.swept_angle(share * D, D))
    true, _ = quad(
        lambda phi: float(force.kienzle_force(700.0, m_c, 1e-3, 1e-4 * np.sin(phi))), 0, phi_s
    )
    mean = force.mean_kienzle_force(
        k_c11=700.0, m_c=m_c, flutes=3, f_z=1e-4, a_p=1e-3, a_e=share * D, D=D
    )
    ratio = float(mean) / (3 * true / (2 * np.pi))
    assert 1.0 + 0.08 * m_c <= ratio <= 1.0 + 0.18 * m_c


def test_kienzle_is_the_law_of_the_room() -> None:
    law = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4)
    h = np.array([0.0, 1e-5, 1e-4, 1e-3])
    expected = force.kienzle_force(1500.0, 0.25, 2e-3, h)
    assert np.allclose(edge_forces(law, h)[0] * 2e-3, expected, rtol=1e-12)
    assert np.allclose(edge_forces(law, h)[1] * 2e-3, 0.4 * expected, rtol=1e-12)
