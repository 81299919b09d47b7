"""The directional matrix against the forces written out, and its own symmetries."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.semi_discretisation import (
    RegenerativeCut,
    arrays,
    eigenvalues,
    mean_matrix,
    stiffness,
)
from pipeline.cutting.stability.semi_discretisation_kernel import fill_weights
from pipeline.cutting.stability.tip_dynamics import modal_receptance
from pipeline.cutting.tool import Tool
from tests.cutting.chatter import DOWN, SLOT, STEADY, X, Y, lobes, regenerative_cut
from tests.cutting.closed_forms import basis, edge_forces

angles = st.floats(0.0, 2 * pi)


@st.composite
def cuts(draw) -> RegenerativeCut:
    entry = draw(st.floats(0.0, 3.0))
    return RegenerativeCut(
        K_tc=draw(st.floats(1e8, 3e9)), K_rc=draw(st.floats(-5e8, 2e9)),
        flutes=draw(st.integers(1, 8)), entry=entry, exit=draw(st.floats(entry + 0.05, 3.14)),
        feed_direction=draw(angles), direction=draw(st.sampled_from([1, -1])),
        lag=draw(st.floats(0.0, 300.0)),
    )  # fmt: skip


def summed(cut: RegenerativeCut, psi: np.ndarray, depth: float) -> np.ndarray:
    """A from the force on each tooth and slice of height as it moves, without any integral."""
    heights = (np.arange(100) + 0.5) / 100 * depth
    total = np.zeros((len(psi), 2, 2))
    for tooth in range(cut.flutes):
        phi = np.mod(cut.entry + psi[:, None] + tooth * cut.pitch - cut.lag * heights, 2 * pi)
        g = (phi >= cut.entry) & (phi <= cut.exit)
        out = np.stack([np.sin(phi), np.cos(phi)])  # from the axis to the tooth: grows the chip
        along = np.stack([np.cos(phi), -np.sin(phi)])  # motion of the tooth
        force = -(cut.K_tc * along + cut.K_rc * out) * g
        total += np.einsum("iph,jph->pij", force, out) / len(heights)
    return cut.turned @ total @ cut.turned.T


def integrals(cut: RegenerativeCut, depth: float, cells: int) -> tuple[float, np.ndarray]:
    """Width of the cut [rad], and the integral of A over each of its cells."""
    _, taken, work = arrays([X, Y], cut, cells)
    window = fill_weights(taken, depth, cells, work)
    return window, work.weight


@settings(deadline=None, max_examples=30)
@given(cut=cuts(), depth=st.floats(1e-4, 2e-2))
def test_integrals_of_cells_are_those_of_the_forces(cut: RegenerativeCut, depth: float) -> None:
    """A sum over 100 angles of a cell misses where teeth enter and leave by 1 % of a tooth's."""
    window, found = integrals(cut, depth, 4)
    fine = (np.arange(400) + 0.5) / 400 * window
    direct = summed(cut, fine, depth).reshape(4, 100, 2, 2).mean(axis=1)
    scale = cut.flutes * (cut.K_tc + abs(cut.K_rc))
    np.testing.assert_allclose(found / (window / 4), direct, atol=0.02 * scale)


@settings(deadline=None)
@given(cut=cuts(), depth=st.floats(1e-4, 2e-2))
def test_helix_leaves_the_mean(cut: RegenerativeCut, depth: float) -> None:
    """Rounding of second differences over a small lag is 1e-9 of the matrix at most."""
    whole = integrals(cut, depth, 3)[1].sum(axis=0) / cut.pitch
    scale = cut.flutes * (cut.K_tc + abs(cut.K_rc))
    np.testing.assert_allclose(whole, mean_matrix(cut), atol=1e-8 * scale)


def test_mean_is_the_closed_form_of_altintas() -> None:
    """Altintas 2012, eq. 3.125 with alpha from K_r = K_rc / K_tc, N / 2 pi and K_t / 2."""
    ratio, ends = DOWN.K_rc / DOWN.K_tc, np.array([DOWN.entry, DOWN.exit])
    two = 2 * ends
    alpha = [
        np.diff(np.cos(two) - 2 * ratio * ends + ratio * np.sin(two))[0] / 2,
        np.diff(-np.sin(two) - 2 * ends + ratio * np.cos(two))[0] / 2,
        np.diff(-np.sin(two) + 2 * ends + ratio * np.cos(two))[0] / 2,
        np.diff(-np.cos(two) - 2 * ratio * ends - ratio * np.sin(two))[0] / 2,
    ]
    expected = np.reshape(alpha, (2, 2)) * DOWN.K_tc / 2 * DOWN.flutes / (2 * pi)
    np.testing.assert_allclose(mean_matrix(DOWN), expected, rtol=1e-12)


@settings(deadline=None)
@given(cut=cuts(), turn=angles)
def test_a_turn_of_the_feed_turns_the_matrix(cut: RegenerativeCut, turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    turned = mean_matrix(replace(cut, feed_direction=cut.feed_direction + turn))
    expected = rotation @ mean_matrix(cut) @ rotation.T
    np.testing.assert_allclose(turned, expected, atol=1e-9 * cut.flutes * 1e10)


def test_m4_is_the_mirror_of_m3() -> None:
    mirror = np.diag([1.0, -1.0])
    m3 = replace(DOWN, feed_direction=0.4)
    m4 = replace(DOWN, feed_direction=-0.4, direction=-1)
    np.testing.assert_allclose(mean_matrix(m4), mirror @ mean_matrix(m3) @ mirror, rtol=1e-12)


@settings(deadline=None)
@given(m_c=st.floats(0.0, 0.6), h=st.floats(1e-6, 1e-3))
def test_stiffness_is_the_slope_of_the_law(m_c: float, h: float) -> None:
    """Edge forces are the same on both sides; a central difference is off by (1e-4)^2."""
    law = ForceLaw(K_tc=1e8, K_rc=4e7, K_te=3e4, K_re=2e4, m_c=m_c)
    above, below = edge_forces(law, h * (1 + 1e-4)), edge_forces(law, h * (1 - 1e-4))
    np.testing.assert_allclose(stiffness(law, h), ((above - below) / (2e-4 * h))[:2], rtol=1e-5)


def test_the_cut_of_a_tool() -> None:
    tool = Tool(kind="flat", diameter_mm=20.0, flutes=4, helix_deg=-45.0)
    law = ForceLaw.linear(K_tc=600.0, K_rc=200.0, K_te=30.0)
    cut = regenerative_cut(law, tool, entry=0.0, exit=pi)
    assert cut.lag == pytest.approx(100.0)  # tan 45 deg / 10 mm
    assert replace(cut, lag=0.0) == replace(SLOT, flutes=4)


BALL = Tool(kind="ball", diameter_mm=8.0, flutes=2, helix_deg=30.0)
BULL = replace(BALL, kind="bull_nose", corner_radius_mm=1.5)
DRILL = replace(BALL, kind="drill", point_angle_deg=120.0, helix_deg=0.0)


@pytest.mark.parametrize(
    ("tool", "depth_mm"),
    [(BALL, 0.5), (BALL, 4.0), (BALL, 6.0), (BULL, 0.4), (BULL, 3.0), (DRILL, 1.0), (DRILL, 5.0)],
)
def test_a_step_ahead_adds_the_forces_of_a_feed(tool: Tool, depth_mm: float) -> None:
    """A tool that stands dx ahead cuts the chip of a feed dx: A's first column is the mean force.

    :func:`basis` divides the edge and knows nothing of a mean slope.  128 slices of a corner are
    1e-4 off near the tip, where sin(kappa) goes as a root; 720 angles of the spindle see where
    teeth enter and leave as well as a helix spreads it, or as a straight edge's chip is 0 there.
    """
    a_p, entry = depth_mm * 1e-3, 0.0 if tool is DRILL else 0.9
    law = ForceLaw.linear(K_tc=600.0, K_rc=200.0, K_ac=150.0)
    angles = np.arange(720) * (2 * pi / 720)
    forces = basis(
        tool, f_z=1.0, a_p=a_p, phi_st=entry, phi_ex=pi, angles=angles, slices=128
    )[:, :2, :3].mean(axis=0) @ law.cutting  # fmt: skip
    cut = regenerative_cut(law, tool, entry=entry, exit=pi, heights=(0.0, a_p))
    scale = np.abs(forces).max() / a_p
    np.testing.assert_allclose(mean_matrix(cut)[:, 0], forces / a_p, atol=1e-3 * scale)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"K_tc": 0.0}, "cut.K_tc = 0.0 must be finite and positive"),
        ({"entry": 2.0, "exit": 1.0}, "0 <= entry < exit <= pi"),
        ({"exit": 4.0}, "0 <= entry < exit <= pi"),
    ],
)
def test_a_cut_that_cannot_be(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SLOT, **change)


def test_eigenvalues_are_those_of_the_matrix() -> None:
    response = modal_receptance([X, Y], np.linspace(100, 2000, 40))
    matrix = mean_matrix(replace(DOWN, feed_direction=1.0))
    own = np.sort_complex(eigenvalues(matrix, response))
    np.testing.assert_allclose(
        own, np.sort_complex(np.linalg.eigvals(matrix @ response)), rtol=1e-9
    )


def test_the_minimum_is_its_closed_form_at_its_closed_speed() -> None:
    """2 k zeta (1 + zeta) / K of one mode along x in a steady slot (Tlusty; Altintas 2012, 3.95).

    w = w_n sqrt(1 + 2 zeta); the phase of 1 - e^(-i w T) there is that of -1 / Phi.
    """
    ratio = np.sqrt(1 + 2 * X.damping)
    value = -modal_receptance([X], [X.natural_frequency_Hz * ratio])[0, 0, 0]
    waves = 2 * np.arctan2(value.real, -value.imag) + 2 * pi * np.arange(4)
    found = lobes([X], STEADY, X.omega * ratio / (STEADY.flutes * waves))
    least = 2 * X.stiffness * X.damping * (1 + X.damping) / STEADY.K_rc
    np.testing.assert_allclose(found, least, rtol=2e-4)


def test_depth_of_a_slot_with_four_flutes_at_12_000_rpm() -> None:
    assert lobes([X], STEADY, [12_000 / 60])[0] * 1e3 == pytest.approx(2.425, abs=1e-3)
