"""Semi-discretisation: closed form, time integration, order, and the zero-order solution."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.stability.semi_discretisation import MOST_CELLS, settled_limits
from tests.cutting.chatter import (
    DOWN,
    SLOT,
    STEADY,
    TWENTIETH,
    UP,
    X,
    Y,
    depth_limits,
    growth,
    lobes,
    monodromy,
    spectral_radius,
)

SPEEDS = np.linspace(5000, 25000, 21) / 60


def leading(cut, rpm: float, depth: float) -> complex:
    values = np.linalg.eigvals(monodromy([X], cut, rpm / 60, depth, 200))
    return complex(values[np.abs(values).argmax()])


@pytest.mark.parametrize("modes", [[X], [X, Y, replace(X, natural_frequency_Hz=1500.0)]])
def test_both_methods_agree_where_the_matrix_is_constant(modes) -> None:
    """A slot with four flutes: the zero-order solution is exact, and every lobe is compared.

    0.1 % is what two counts of cells within 1 % leave when they are extrapolated; 0.02 % is the
    lobes' own tolerance.
    """
    cut = replace(STEADY, feed_direction=0.5)
    exact = lobes(modes, cut, SPEEDS)
    found = depth_limits(modes, cut, SPEEDS, highest=2 * exact.max())
    np.testing.assert_allclose(found.depth_limit, exact, rtol=1.5e-3)


def test_least_depth_is_its_closed_form() -> None:
    """2 k zeta (1 + zeta) / K, at the speed where the lobes have their minimum."""
    closed = 2 * X.stiffness * X.damping * (1 + X.damping) / STEADY.K_rc
    speeds = np.linspace(7000, 9000, 400) / 60
    at = speeds[lobes([X], STEADY, speeds).argmin()]
    limit = depth_limits([X], STEADY, [at], highest=1e-3).depth_limit
    assert limit[0] == pytest.approx(closed, rel=1e-3)


def test_methods_differ_at_low_immersion_where_flip_lobes_are() -> None:
    """Zero order promises 75 % too much at 14 000 rpm: the multiplier leaves at -1."""
    rpm = 14_000
    limit = depth_limits([X], DOWN, [rpm / 60], highest=10e-3).depth_limit[0]
    assert lobes([X], DOWN, [rpm / 60])[0] > 1.7 * limit
    multiplier = leading(DOWN, rpm, limit)
    assert multiplier.real == pytest.approx(-1.0, abs=0.01) and multiplier.imag == 0.0


@pytest.mark.parametrize(
    ("cut", "low", "high"), [(SLOT, 0.90, 0.98), (DOWN, 1.02, 1.08), (UP, 0.96, 1.0)]
)
def test_how_far_the_zero_order_solution_is_off_at_its_minima(cut, low, high) -> None:
    """Two flutes: the matrix swings by as much as its mean, and yet the minima are within 10 %."""
    speeds = np.linspace(5000, 25000, 161) / 60
    zero = lobes([X], cut, speeds)
    minima = speeds[1:-1][(zero[1:-1] < zero[:-2]) & (zero[1:-1] < zero[2:]) & (zero[1:-1] < 1e-3)]
    exact = depth_limits([X], cut, minima, highest=5e-3).depth_limit
    ratio = lobes([X], cut, minima) / exact
    assert len(minima) >= 3 and low < ratio.min() and ratio.max() < high


@pytest.mark.parametrize(
    ("depth", "converged"), [(0.2e-3, 0.81974), (0.5e-3, 1.07398), (1.0e-3, 1.40647)]
)
def test_multipliers_of_a_slot_at_5000_rpm(depth: float, converged: float) -> None:
    """Values of another discretisation (a matrix exponential each step, delay straight between).

    With 2000 steps there and 800 cells here each is some 1e-4 off.
    """
    values = np.linalg.eigvals(monodromy([X], SLOT, 5000 / 60, depth, 800))
    assert np.abs(values).max() == pytest.approx(converged, abs=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("modes", "cut", "rpm"),
    [
        ([X], DOWN, 9000),
        *(
            pytest.param(modes, cut, rpm, marks=pytest.mark.proof)
            for modes, cut, rpm in (
                ([X], SLOT, 5000), ([X], TWENTIETH, 19_500), ([X, Y], SLOT, 5000),
                ([X, Y], DOWN, 14_000), ([X, Y], replace(UP, flutes=4), 12_000),
            )
        ),
    ],
)  # fmt: skip
def test_vibration_grows_above_and_dies_below(modes, cut, rpm: float) -> None:
    """Runge-Kutta on the delayed equation itself; 1e-3 is the mean's, of vibrations that beat."""
    limit = depth_limits(modes, cut, [rpm / 60], highest=10e-3).depth_limit[0]
    for factor in (0.98, 1.02):
        grown = growth(modes, cut, rpm / 60, factor * limit)
        assert (grown > 1.0) == (factor > 1.0)
        expected = spectral_radius(modes, cut, rpm / 60, factor * limit, 640)
        assert grown == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("modes", "cut", "rpm", "depth"),
    [([X], TWENTIETH, 19_500, 3e-3), ([X, Y], replace(UP, flutes=3), 4000, 1e-3)],
)
def test_the_error_falls_with_the_square_of_the_cell(modes, cut, rpm, depth: float) -> None:
    """60 cells and more: the next power of the cell shifts the order seen by some hundredths."""
    radii = [
        np.abs(np.linalg.eigvals(monodromy(modes, cut, rpm / 60, depth, 60 * 2**i))).max()
        for i in range(4)
    ]
    orders = -np.diff(np.log2(np.abs(np.diff(radii))))
    np.testing.assert_allclose(orders, 2.0, atol=0.05)


def test_the_tolerance_is_kept() -> None:
    """Against limits 25 times finer; the extrapolation leaves less than a fifth of it."""
    speeds = np.array([3000, 7000, 12_000, 19_000]) / 60
    for cut in (SLOT, DOWN):
        coarse = depth_limits([X], cut, speeds, highest=6e-3, tolerance=5e-3)
        fine = depth_limits([X], cut, speeds, highest=6e-3, tolerance=2e-4)
        assert (coarse.error <= 5e-3).all() and (coarse.cells < fine.cells).all()
        np.testing.assert_allclose(coarse.depth_limit, fine.depth_limit, rtol=1e-3)


@settings(deadline=None, max_examples=25)
@given(
    rpm=st.floats(1500, 25_000), depth=st.floats(1e-5, 5e-3), entry=st.floats(0.0, 2.9),
    flutes=st.integers(1, 5), lag=st.sampled_from([0.0, 58.0]),
)  # fmt: skip
def test_krylov_finds_the_leading_eigenvalue(rpm, depth, entry, flutes, lag) -> None:
    """All eigenvalues of the same matrix; close to 1 to what 0.1 % of depth is, else its side."""
    cut = replace(SLOT, entry=entry, flutes=flutes, lag=lag)
    full = np.abs(np.linalg.eigvals(monodromy([X, Y], cut, rpm / 60, depth, 60))).max()
    found = spectral_radius([X, Y], cut, rpm / 60, depth, 60)
    assert (found > 1.0) == (full > 1.0) or abs(full - 1.0) < 1e-4
    if abs(full - 1.0) < 0.05:
        assert found == pytest.approx(full, abs=1e-4)


def test_a_helix_of_whole_pitches_is_a_constant_matrix() -> None:
    """An edge that lags by one pitch over the depth cuts the same at each angle: zero order holds.

    At low immersion, where without helix flip lobes are.
    """
    rpm, zero = 14_000, lobes([X], TWENTIETH, [14_000 / 60])[0]
    twisted = replace(TWENTIETH, lag=TWENTIETH.pitch / zero)
    radii = [spectral_radius([X], twisted, rpm / 60, zero, s) for s in (200, 400)]
    assert (4 * radii[1] - radii[0]) / 3 == pytest.approx(1.0, abs=1e-4)
    assert abs(spectral_radius([X], TWENTIETH, rpm / 60, zero, 400) - 1.0) > 0.02


def test_depth_goes_with_one_over_the_force_and_modes_swap() -> None:
    """The same numbers in another order, but roots are found within 5e-4 of the depth."""
    speeds = [6000 / 60, 13_000 / 60]
    base = depth_limits([X, Y], DOWN, speeds, highest=8e-3).depth_limit
    harder = replace(DOWN, K_tc=2 * DOWN.K_tc, K_rc=2 * DOWN.K_rc)
    half = depth_limits([X, Y], harder, speeds, highest=4e-3).depth_limit
    np.testing.assert_allclose(2 * half, base, rtol=1e-3)
    swapped = [replace(X, direction="y"), replace(Y, direction="x")]
    turned = replace(DOWN, feed_direction=np.pi / 2)
    other = depth_limits(swapped, turned, speeds, highest=8e-3).depth_limit
    np.testing.assert_allclose(other, base, rtol=1e-3)


def test_no_chatter_up_to_the_highest_depth_is_inf() -> None:
    least = lobes([X], STEADY, np.linspace(SPEEDS[0], SPEEDS[-1], 2000)).min()
    found = depth_limits([X], STEADY, SPEEDS[-2:], highest=0.9 * least)
    assert np.isinf(found.depth_limit).all() and (found.error == 0).all()


@pytest.mark.parametrize("n", [1.0, 0.1, 1e-6])
def test_a_speed_so_low_that_cells_run_out_has_no_limit(monkeypatch, n: float) -> None:
    """Before a cell is made: they would take the memory first."""
    monkeypatch.setattr("pipeline.cutting.stability.semi_discretisation.arrays", None)
    found = settled_limits([X], SLOT, np.array([n]), highest=1e-3)
    assert np.isnan(found.depth_limit).all() and 2 * found.cells[0] > MOST_CELLS


def test_a_limit_that_no_cells_settle_says_so() -> None:
    found = settled_limits([X], SLOT, np.array([100.0]), highest=5e-3, tolerance=1e-9)
    assert found.error[0] > 1e-9


def test_no_speeds_have_no_limits() -> None:
    found = depth_limits([X], SLOT, [], highest=1e-3)
    assert (
        found.n.shape == found.depth_limit.shape == found.error.shape == found.cells.shape == (0,)
    )
