"""The chip: angles, thickness, Kienzle's mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.cutting import chip
from pipeline.cutting.force import kienzle_force

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


@pytest.mark.parametrize(("share", "thick"), [(0.05, 0.2255), (0.1, 0.3218), (1.0, np.pi / 2)])
def test_misprint_overstates_a_slot_and_understates_a_shallow_cut(share, thick) -> None:
    """Printed, h = f_z a_e / D: phi_s / 2 of the true mean; force to the power 0.75 of that."""
    ratio = share / chip.mean_thickness(1.0, share * D, D)
    assert ratio == pytest.approx(thick, rel=1e-3)  # of four digits
    force = kienzle_force(700.0, 0.25, 1e-3, share) / kienzle_force(
        700.0, 0.25, 1e-3, chip.mean_thickness(1.0, share * D, D)
    )
    assert force == pytest.approx((chip.swept_angle(share * D, D) / 2) ** 0.75, rel=1e-12)
    if share != 0.1:  # the ends of what the docstring says
        assert round(float(force), 2) == {0.05: 0.33, 1.0: 1.4}[share]


@given(st.floats(-20.0, 20.0), st.floats(0.0, 2 * np.pi))
def test_cutting_arcs_hold_what_of_an_arc_has_a_chip(phi_st: float, apart: float) -> None:
    """The chip over the arcs is that over the whole, wherever in the turns it lies."""
    begin, end = chip.cutting_arcs(phi_st, phi_st + apart)
    phi = phi_st + (np.arange(4000) + 0.5) * (apart / 4000)
    whole = np.maximum(np.sin(phi), 0).sum() * apart / 4000
    # the middle rule errs by a step squared where the chip begins
    assert (np.cos(begin) - np.cos(end)).sum() == pytest.approx(whole, abs=5e-6)
    assert (begin >= 0).all() and (end <= np.pi).all() and (end >= begin).all()


def test_no_depth_has_no_chip() -> None:
    assert chip.mean_thickness(1e-4, 0.0, D) == 0.0
    assert chip.thickness(1e-4, -0.5) == 0.0


def test_impossible_depths_are_named() -> None:
    with pytest.raises(ValueError, match=r"a_e = 1\.2 D"):
        chip.immersion(1.2 * D, D, "up")
    with pytest.raises(ValueError, match=r"as wide as the tool, but a_e = 0\.5 D"):
        chip.immersion(0.5 * D, D, "slot")
    for wrong, words in [
        (-2.0, "D = -2 m"),
        (0.0, "D = 0 m"),
        (np.inf, "D = inf"),
        (np.nan, "nan"),
    ]:
        with pytest.raises(ValueError, match=words):
            chip.swept_angle([0.0, -1.0], [D, wrong])
    with pytest.raises(ValueError, match=r"a_e = -0\.1 D"):
        chip.swept_angle(-0.1 * D, D)
    with pytest.raises(ValueError, match="'left' is none of"):
        chip.immersion(0.5 * D, D, "left")
