"""Force law and its mean forces: textbook numbers, quadrature, balances and symmetry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec

from pipeline.cutting.force.force_law import ForceLaw, regressors
from tests.cutting.closed_forms import edge_forces, mean_forces, mean_torque


def test_units_of_tables() -> None:
    """2000 N/mm^2 and 30 N/mm on a chip of 0.1 mm: 200 + 30 N for each millimetre."""
    law = ForceLaw.linear(K_tc=2000.0, K_rc=1000.0, K_ac=500.0, K_te=30.0, K_re=20.0, K_ae=10.0)
    assert np.allclose(edge_forces(law, 1e-4) * 1e-3, [230.0, 120.0, 60.0])


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
        ({"K_tc": float("nan"), "K_rc": 0.0}, r"force_law\.K_tc = nan must be finite"),
        ({"K_tc": 1e9, "K_rc": 0.0, "m_c": 1.0}, r"force_law\.m_c = 1\.0 must lie from 0"),
        ({"K_tc": -1.0, "K_rc": 0.0}, r"force_law\.K_tc = -1\.0 must be finite and at least 0"),
        ({"K_tc": 1e9, "K_rc": 0.0, "K_te": -1.0}, r"force_law\.K_te = -1\.0 must be finite and"),
        ({"K_tc": 0.0, "K_rc": 1e9}, "K_tc and force_law.K_te are both 0"),
    ],
)
def test_impossible_laws_are_named(values: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ForceLaw(**values)


LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
CUT = {"flutes": 3, "f_z": 8e-5, "a_p": 2e-3}
angle = st.floats(0.0, np.pi)


def forces_at(phi: float) -> np.ndarray:
    t, r, a = edge_forces(LAW, CUT["f_z"] * np.sin(phi)) * CUT["a_p"]
    return np.array([-t * np.cos(phi) - r * np.sin(phi), t * np.sin(phi) - r * np.cos(phi), a])


@given(angle, angle)
def test_means_are_those_of_the_forces(one: float, other: float) -> None:
    phi_st, phi_ex = sorted((one, other))
    whole, _ = quad_vec(forces_at, phi_st, phi_ex, epsrel=1e-12)
    found = mean_forces(LAW, phi_st=phi_st, phi_ex=phi_ex, **CUT)
    assert np.allclose(found, 3 * whole / (2 * np.pi), rtol=1e-9, atol=1e-9)


def test_slot_as_altintas_prints_it() -> None:
    """Manufacturing Automation, eq. 2.45: the six coefficients from mean forces in slots."""
    f_z, a_p, flutes = np.array([4e-5, 8e-5, 1.6e-4]), 1.5e-3, 4
    means = mean_forces(LAW, flutes=flutes, f_z=f_z, a_p=a_p, phi_st=0.0, phi_ex=np.pi)
    cutting, edge = np.polynomial.polynomial.polyfit(f_z, means, 1)[::-1]
    na = flutes * a_p
    assert np.allclose(LAW.cutting, [4 * cutting[1] / na, -4 * cutting[0] / na,
                                     np.pi * cutting[2] / na])  # fmt: skip
    assert np.allclose(LAW.edge, [np.pi * edge[1] / na, -np.pi * edge[0] / na, 2 * edge[2] / na])


@given(angle, angle)
def test_up_and_down_milling_mirror(one: float, other: float) -> None:
    """phi -> pi - phi keeps tangential F_y and radial F_x, and turns the signs of the others."""
    phi_st, phi_ex = sorted((one, other))
    up = regressors(phi_st=phi_st, phi_ex=phi_ex, **CUT)
    down = regressors(phi_st=np.pi - phi_ex, phi_ex=np.pi - phi_st, **CUT)
    sign = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, 1]])
    slot = regressors(phi_st=0.0, phi_ex=np.pi, **CUT)
    # rounding of angles near pi, of each coefficient's own size
    near = 1e-12 * np.abs(slot).max(axis=0)
    assert (np.abs(down - np.hstack([sign, sign]) * up) <= near).all()


@given(angle, angle)
def test_power_is_specific_force_times_removal_rate(one: float, other: float) -> None:
    phi_st, phi_ex = sorted((one, other))
    n, R = 50.0, 6e-3
    torque = mean_torque(LAW, phi_st=phi_st, phi_ex=phi_ex, radius=R, **CUT)
    a_e = R * (np.cos(phi_st) - np.cos(phi_ex))
    removal = a_e * CUT["a_p"] * CUT["f_z"] * CUT["flutes"] * n
    rubbed = LAW.K_te * CUT["a_p"] * CUT["flutes"] * n * R * (phi_ex - phi_st)
    assert 2 * np.pi * n * torque == pytest.approx(LAW.K_tc * removal + rubbed, rel=1e-9, abs=1e-9)


def test_arguments_broadcast_and_without_feed_there_is_no_force() -> None:
    exits = np.array([[np.pi], [2.0], [1.0]])
    design = regressors(flutes=2, f_z=[1e-5, 2e-5], a_p=1e-3, phi_st=0.0, phi_ex=exits)
    assert design.shape == (3, 2, 3, 6)
    assert not regressors(flutes=2, f_z=0.0, a_p=1e-3, phi_st=0.0, phi_ex=1.0).any()
