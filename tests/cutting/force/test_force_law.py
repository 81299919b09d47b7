"""Chip, force law and closed forms: textbook numbers and limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.mean_force import cutting_arcs
from tests.cutting.closed_forms import (
    chip_of_motion,
    edge_forces,
    immersion,
    in_plane_forces,
    kienzle_force,
    mean_kienzle_force,
    mean_thickness,
    slot_peak_load,
    swept_angle,
    thickness,
    width,
)

D = 0.01


@given(st.floats(0.0, 1.0))
def test_tooth_sweeps_the_radial_depth(share: float) -> None:
    """Between the angles of entry and exit the edge's distance across the feed changes by a_e."""
    for side in ("up", "down"):
        phi_st, phi_ex = immersion(share * D, D, side)
        across = D / 2 * (np.cos(phi_st) - np.cos(phi_ex))
        assert across == pytest.approx(share * D, abs=1e-12)  # of acos near its ends


@given(st.floats(1e-6, 1.0))
def test_mean_thickness_is_the_mean_over_the_arc(share: float) -> None:
    phi_st, phi_ex = immersion(share * D, D, "up")
    whole, _ = quad(lambda phi: float(thickness(1e-4, phi)), float(phi_st), float(phi_ex))
    mean = mean_thickness(1e-4, share * D, D)
    assert mean == pytest.approx(whole / float(phi_ex - phi_st), rel=1e-6)  # of 1 - cos at 1e-6


def test_chips_of_a_period_have_the_volume_that_is_fed() -> None:
    """Sum of b h R d phi over the arc is a_p a_e f_z: material is neither lost nor cut twice."""
    a_e, a_p, f_z, kappa = 0.3 * D, 2e-3, 1e-4, 1.0
    phi = np.linspace(*immersion(a_e, D, "down"), 100_001)
    area = width(a_p, kappa=kappa) * thickness(f_z, phi, kappa=kappa)
    assert np.trapezoid(area, phi) * D / 2 == pytest.approx(a_p * a_e * f_z, rel=1e-9)


@pytest.mark.parametrize(("share", "thick"), [(0.05, 0.2255), (0.1, 0.3218), (1.0, np.pi / 2)])
def test_misprint_overstates_a_slot_and_understates_a_shallow_cut(share, thick) -> None:
    """Printed, h = f_z a_e / D: phi_s / 2 of the true mean; force to the power 0.75 of that."""
    ratio = share / mean_thickness(1.0, share * D, D)
    assert ratio == pytest.approx(thick, rel=1e-3)  # of four digits
    force = kienzle_force(700.0, 0.25, 1e-3, share) / kienzle_force(
        700.0, 0.25, 1e-3, mean_thickness(1.0, share * D, D)
    )
    assert force == pytest.approx((swept_angle(share * D, D) / 2) ** 0.75, rel=1e-12)
    if share != 0.1:  # the ends of what the docstring says
        assert round(float(force), 2) == {0.05: 0.33, 1.0: 1.4}[share]


@given(st.floats(-20.0, 20.0), st.floats(0.0, 2 * np.pi))
def test_cutting_arcs_hold_what_of_an_arc_has_a_chip(phi_st: float, apart: float) -> None:
    """The chip over the arcs is that over the whole, wherever in the turns it lies."""
    begin, end = cutting_arcs(phi_st, phi_st + apart)
    phi = phi_st + (np.arange(4000) + 0.5) * (apart / 4000)
    whole = np.maximum(np.sin(phi), 0).sum() * apart / 4000
    # the middle rule errs by a step squared where the chip begins
    assert (np.cos(begin) - np.cos(end)).sum() == pytest.approx(whole, abs=5e-6)
    assert (begin >= 0).all() and (end <= np.pi).all() and (end >= begin).all()


def test_no_depth_has_no_chip() -> None:
    assert mean_thickness(1e-4, 0.0, D) == 0.0
    assert thickness(1e-4, -0.5) == 0.0


def test_units_of_tables() -> None:
    """2000 N/mm^2 and 30 N/mm on a chip of 0.1 mm: 200 + 30 N for each millimetre."""
    law = ForceLaw.linear(K_tc=2000.0, K_rc=1000.0, K_ac=500.0, K_te=30.0, K_re=20.0, K_ae=10.0)
    assert np.allclose(edge_forces(law, 1e-4) * 1e-3, [230.0, 120.0, 60.0])


def test_no_chip_no_force() -> None:
    law = ForceLaw.linear(K_tc=2000.0, K_rc=1000.0, K_te=30.0)
    assert not edge_forces(law, [0.0, -1e-5]).any()
    assert edge_forces(law, 1e-12)[0] == pytest.approx(30e3)  # edges rub on any chip


@given(st.floats(0.0, 0.6), st.floats(100.0, 4000.0), st.floats(1e-6, 1e-3))
def test_specific_force_falls_with_the_exponent(m_c: float, k_c11: float, h: float) -> None:
    """Twice the chip takes 2^(1 - m_c) the force, and 1 mm takes k_c1.1."""
    law = ForceLaw.kienzle(k_c11=k_c11, m_c=m_c, radial=0.3)
    one, two = edge_forces(law, [h, 2 * h])[0]
    assert two / one == pytest.approx(2 ** (1 - m_c), rel=1e-12)
    assert edge_forces(law, 1e-3)[0] == pytest.approx(k_c11 * 1e3, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"K_tc": float("nan"), "K_rc": 0.0},
            r"force_law\.K_tc = nan must be finite",
        ),
        (
            {"K_tc": 1e9, "K_rc": 0.0, "m_c": 1.0},
            r"force_law\.m_c = 1\.0 must lie from 0",
        ),
        ({"K_tc": -1.0, "K_rc": 0.0}, r"force_law\.K_tc = -1\.0 must be finite and at least 0"),
        ({"K_tc": -1e9, "K_rc": 0.0, "K_te": 1.0}, r"force_law\.K_tc = -1000000000\.0 must be"),
        (
            {"K_tc": 1e9, "K_rc": 0.0, "K_te": -1.0},
            r"force_law\.K_te = -1\.0 must be finite and",
        ),
        ({"K_tc": 0.0, "K_rc": 1e9}, "K_tc and force_law.K_te are both 0"),
    ],
)
def test_impossible_laws_are_named(values: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ForceLaw(**values)


K_T, K_E = 1.23e9, 0.5  # A6061, Sim2023
SIX_MM = 6e-3
THETA = np.linspace(0, 2 * np.pi, 3601)


@pytest.mark.parametrize("flutes", [1, 2])
def test_peak_in_a_slot(flutes: int) -> None:
    forces = in_plane_forces(THETA, flutes=flutes, f_z=5e-5, d=5e-4, K_t=K_T, K_e=K_E)
    peak = np.hypot(*forces.T).max()
    # sin(phi) is 1 on a grid of 0.1 degrees
    assert peak == pytest.approx(float(slot_peak_load(K_T, K_E, 5e-4, 5e-5)), rel=1e-12)
    assert peak == pytest.approx(34.38, abs=5e-3)


def test_four_teeth_in_a_slot_pull_steadily() -> None:
    """sin^2 and sin cos of teeth a quarter turn apart add up to constants (Altintas 2012, 2.7)."""
    forces = in_plane_forces(THETA, flutes=4, f_z=5e-5, d=5e-4, K_t=K_T, K_e=K_E)
    expected = K_T * 5e-4 * 5e-5 * np.array([-K_E, 1.0])
    assert np.allclose(forces, expected, rtol=1e-12, atol=0)


def test_angles_may_have_any_shape() -> None:
    cut = {"flutes": 2, "f_z": 5e-5, "d": 5e-4, "K_t": K_T, "K_e": K_E}
    row = in_plane_forces([0.3, 1.2], **cut)
    assert np.array_equal(in_plane_forces(1.2, **cut), row[1])
    assert np.array_equal(in_plane_forces([[0.3], [1.2]], **cut), row[:, None])


def test_arcs_go_past_a_turn() -> None:
    cut = {"flutes": 3, "f_z": 5e-5, "d": 5e-4, "K_t": K_T, "K_e": K_E}
    theta = np.linspace(0, 6.28, 300)
    one = in_plane_forces(theta, phi_st=-0.083, phi_ex=1.517, **cut)
    turned = in_plane_forces(theta, phi_st=2 * np.pi - 0.083, phi_ex=2 * np.pi + 1.517, **cut)
    assert one.any() and np.allclose(one, turned, rtol=0, atol=1e-9)


def test_one_sample_is_not_one_tooth() -> None:
    """The chip is what the axis moves in a tooth period: half the feed, half the force."""
    phi = np.linspace(0.1, 3.0, 7)
    h = chip_of_motion(1e-4, 0.0, phi)
    assert np.allclose(h, thickness(1e-4, phi))
    assert np.allclose(chip_of_motion(0.0, 1e-4, phi), np.maximum(1e-4 * np.cos(phi), 0))


@given(st.floats(0.05, 3.0), st.floats(0.0, 1.0))
def test_mirrored_engagement_mirrors_the_force(width: float, place: float) -> None:
    """phi -> pi - phi with the spindle turning back: without radial force F_x turns its sign."""
    phi_st = place * (np.pi - width)
    phi_ex = phi_st + width
    theta = np.linspace(0, 2 * np.pi, 97)
    given_ = {"flutes": 1, "f_z": 1e-4, "d": 1e-3, "K_t": K_T, "K_e": 0.0}
    one = in_plane_forces(theta, phi_st=phi_st, phi_ex=phi_ex, **given_)
    other = in_plane_forces(
        np.pi - theta, phi_st=np.pi - phi_ex, phi_ex=np.pi - phi_st + 1e-12, **given_
    )
    edge = np.isclose(theta % (2 * np.pi), phi_ex, atol=1e-9)
    edge |= np.isclose(theta % (2 * np.pi), phi_st, atol=1e-9)
    assert np.allclose(one[~edge] * [-1, 1], other[~edge], atol=1e-9 * K_T * 1e-7)


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("m_c", [0.15, 0.25, 0.35])
def test_kienzle_with_the_mean_chip(share: float, m_c: float) -> None:
    """Never below the mean of the forces (the power is concave), and above by 8 to 18 % of m_c."""
    phi_s = float(swept_angle(share * SIX_MM, SIX_MM))
    true, _ = quad(lambda phi: float(kienzle_force(700.0, m_c, 1e-3, 1e-4 * np.sin(phi))), 0, phi_s)
    mean = mean_kienzle_force(
        k_c11=700.0, m_c=m_c, flutes=3, f_z=1e-4, a_p=1e-3, a_e=share * SIX_MM, D=SIX_MM
    )
    ratio = float(mean) / (3 * true / (2 * np.pi))
    assert 1.0 + 0.08 * m_c <= ratio <= 1.0 + 0.18 * m_c


def test_kienzle_is_the_law_of_the_room() -> None:
    law = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4)
    h = np.array([0.0, 1e-5, 1e-4, 1e-3])
    expected = kienzle_force(1500.0, 0.25, 2e-3, h)
    assert np.allclose(edge_forces(law, h)[0] * 2e-3, expected, rtol=1e-12)
    assert np.allclose(edge_forces(law, h)[1] * 2e-3, 0.4 * expected, rtol=1e-12)
