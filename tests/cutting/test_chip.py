"""The chip: angles, thickness, Kienzle's mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting import chip

D = 0.01


def test_immersions_of_half_the_diameter() -> None:
    quarter = np.pi / 2
    assert np.allclose(chip.immersion(D / 2, D, "up"), [0, quarter], atol=1e-15)
    assert np.allclose(chip.immersion(D / 2, D, "down"), [quarter, np.pi], atol=1e-15)
    assert np.allclose(chip.immersion(D, D, "slot"), [0, np.pi], atol=1e-15)
    assert np.allclose(
        chip.immersion(D / 2, D, "centred"), np.pi / 2 + np.array([-1, 1]) * np.pi / 6
    )


@given(st.floats(0.0, 1.0))
def test_tooth_sweeps_the_radial_depth(share: float) -> None:
    """Between the angles of entry and exit the edge's distance across the feed changes by a_e."""
    for side in ("up", "down", "centred"):
        phi_st, phi_ex = chip.immersion(share * D, D, side)
        across = D / 2 * (np.cos(phi_st) - np.cos(phi_ex))
        assert across == pytest.approx(share * D, abs=1e-12)  # of acos near its ends


@given(st.floats(1e-6, 1.0))
def test_mean_thickness_is_the_mean_over_the_arc(share: float) -> None:
    phi_st, phi_ex = chip.immersion(share * D, D, "up")
    whole, _ = quad(lambda phi: float(chip.thickness(1e-4, phi)), float(phi_st), float(phi_ex))
    mean = chip.mean_thickness(1e-4, share * D, D)
    assert mean == pytest.approx(whole / float(phi_ex - phi_st), rel=1e-6)  # of 1 - cos at 1e-6


def test_chips_of_a_period_have_the_volume_that_is_fed() -> None:
    """Sum of b h R d phi over the arc is a_p a_e f_z: material is neither lost nor cut twice."""
    a_e, a_p, f_z, kappa = 0.3 * D, 2e-3, 1e-4, 1.0
    phi = np.linspace(*chip.immersion(a_e, D, "down"), 100_001)
    area = chip.width(a_p, kappa=kappa) * chip.thickness(f_z, phi, kappa=kappa)
    assert np.trapezoid(area, phi) * D / 2 == pytest.approx(a_p * a_e * f_z, rel=1e-9)


def test_misprint_understates_a_slot_and_overstates_a_shallow_cut() -> None:
    """REFERENCE 5: as printed, h = f_z a_e / D gives 0.33 to 1.40 times the force."""
    wrong = 0.1 / chip.mean_thickness(1.0, 0.1 * D, D)
    slot = 1.0 / chip.mean_thickness(1.0, D, D)
    assert wrong < 0.4 and slot == pytest.approx(np.pi / 2)


def test_no_depth_has_no_chip() -> None:
    assert chip.mean_thickness(1e-4, 0.0, D) == 0.0
    assert chip.thickness(1e-4, -0.5) == 0.0


def test_impossible_depths_are_named() -> None:
    with pytest.raises(ValueError, match=r"a_e = 1\.2 D"):
        chip.immersion(1.2 * D, D, "up")
    with pytest.raises(ValueError, match="as wide as the tool"):
        chip.immersion(0.5 * D, D, "slot")
    with pytest.raises(ValueError, match="'left' is none of"):
        chip.immersion(0.5 * D, D, "left")
