"""Zero-order lobes: closed forms, Altintas' own construction lobe by lobe, and symmetries."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.directional import RegenerativeCut, mean_matrix
from pipeline.cutting.stability.semi_discretisation import eigenvalues
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, Mode, modal_receptance
from pipeline.cutting.tool import Tool
from tests.cutting.chatter import DOWN, SLOT, STEADY, UP, X, Y
from tests.cutting.zero_order import TOLERANCE, lobes, stability_boundary

SPEEDS = np.linspace(2000, 25000, 300) / 60
LEAST = 2 * X.stiffness * X.damping * (1 + X.damping) / STEADY.K_rc
"""Of one mode along x in a steady slot: 2 k zeta (1 + zeta) / K (Tlusty; Altintas 2012, 3.95)."""


def limits(modes, cut, speeds=SPEEDS, **options) -> np.ndarray:
    return lobes(modes, cut, speeds, **options).depth_limit


BOTH = [X, replace(X, direction="y")]
"""The same mode in x and y."""


@pytest.fixture(scope="module")
def of_both() -> np.ndarray:
    return limits(BOTH, DOWN)


@pytest.fixture(scope="module")
def of_down() -> np.ndarray:
    """Limits of the modes in x and y in down-milling."""
    return limits([X, Y], DOWN)


@st.composite
def modes(draw, direction: str) -> Mode:
    return Mode(
        direction=direction, natural_frequency_Hz=draw(st.floats(100.0, 3000.0)),
        damping=draw(st.floats(0.003, 0.1)), stiffness_N_m=draw(st.floats(1e6, 1e8)),
    )  # fmt: skip


@st.composite
def cuts(draw) -> RegenerativeCut:
    entry = draw(st.floats(0.0, 2.8))
    return RegenerativeCut(
        K_tc=1e9, K_rc=draw(st.floats(1e8, 8e8)), flutes=draw(st.integers(1, 6)), entry=entry,
        exit=draw(st.floats(entry + 0.2, 3.14)), feed_direction=draw(st.floats(0.0, 6.28)),
        direction=draw(st.sampled_from([1, -1])),
    )  # fmt: skip


@settings(deadline=None)
@given(zeta=st.floats(1e-4, 0.2), frequency=st.floats(20.0, 8000.0))
def test_least_depth_is_its_closed_form(zeta: float, frequency: float) -> None:
    """Within the tolerance that is stated, never below: a chord lies above Re lambda's peak."""
    mode = Mode(
        direction="x", natural_frequency_Hz=frequency, damping=zeta, stiffness_N_m=X.stiffness
    )
    least = stability_boundary([mode], STEADY, 10.0, 500.0).least_depth
    closed = 2 * X.stiffness * zeta * (1 + zeta) / STEADY.K_rc
    assert 0.0 <= least / closed - 1 <= TOLERANCE


def test_the_minimum_lies_at_its_closed_speed_and_frequency() -> None:
    """w = w_n sqrt(1 + 2 zeta); the phase of 1 - e^(-i w T) there is that of -1 / Phi."""
    ratio = np.sqrt(1 + 2 * X.damping)
    value = -modal_receptance([X], [X.natural_frequency_Hz * ratio])[0, 0, 0]
    for k in range(4):
        wave = 2 * np.arctan2(value.real, -value.imag) + 2 * pi * k
        speed = X.omega * ratio / (STEADY.flutes * wave)
        found = lobes([X], STEADY, [speed])
        assert found.depth_limit[0] == pytest.approx(LEAST, rel=TOLERANCE)
        # flat at the minimum: the frequency is known to the root of the depth's tolerance
        expected = X.natural_frequency_Hz * ratio
        assert found.chatter_frequency[0] == pytest.approx(expected, rel=1e-4)


def constructed(modes, cut, speeds: np.ndarray) -> np.ndarray:
    """Lobe by lobe over the chatter frequency (Altintas 2012, 3.8.1), and their lowest."""
    peaks = [mode.natural_frequency_Hz * (1 + mode.damping * np.linspace(-9, 9, 2001))
             for mode in modes]  # fmt: skip
    frequency = np.unique(np.concatenate([np.linspace(5.0, 4500.0, 20_000), *peaks]))
    oriented = mean_matrix(cut) @ modal_receptance(modes, frequency)
    lowest = np.full(len(speeds), np.inf)
    for values in np.linalg.eigvals(oriented).T:
        capital = -1.0 / values  # his eigenvalue, with N K_t / 4 pi within
        kappa = capital.imag / capital.real
        depth = -0.5 * capital.real * (1 + kappa**2)
        epsilon = np.pi - 2 * np.arctan(kappa)
        joins = (depth[:-1] > 0) & (depth[1:] > 0) & (np.abs(np.diff(epsilon)) < 0.3)
        for k in range(60):
            n = 2 * np.pi * frequency / (cut.flutes * (epsilon + 2 * np.pi * k))
            first = np.searchsorted(speeds, np.minimum(n[:-1], n[1:]))
            last = np.searchsorted(speeds, np.maximum(n[:-1], n[1:]))
            for i in np.flatnonzero(joins & (first < last)):
                between = lowest[first[i] : last[i]]
                np.minimum(between, max(depth[i], depth[i + 1]), out=between)
    return lowest


@pytest.mark.parametrize("cut", [SLOT, UP], ids=["slot", "up"])
def test_lobes_are_those_of_the_construction(cut: RegenerativeCut) -> None:
    """Its frequencies are 0.2 Hz apart or less: the steep flanks are 2 % off there."""
    cut = replace(cut, feed_direction=0.7)
    speeds = np.linspace(3000, 25000, 40) / 60
    expected = constructed([X, Y], cut, speeds)
    np.testing.assert_allclose(limits([X, Y], cut, speeds), expected, rtol=0.02)


@pytest.mark.parametrize("examples", [4, pytest.param(50, marks=pytest.mark.proof)])
def test_the_tolerance_holds(examples: int) -> None:
    """Against one a hundred times finer.

    On a lobe's flank depth moves with the phase many times over: there the limit lies between the
    finer ones at speeds that the phase's tolerance takes it to.
    """
    drawn = given(x=modes("x"), y=modes("y"), cut=cuts())
    settings(deadline=None, max_examples=examples)(drawn(assert_tolerance))()


def assert_tolerance(x: Mode, y: Mode, cut: RegenerativeCut) -> None:
    speeds = np.linspace(3000, 25000, 30) / 60
    fine = {"tolerance": TOLERANCE / 100}
    near = [limits([x, y], cut, speeds * (1 + s * TOLERANCE), **fine) for s in (-2, -1, 0, 1, 2)]
    got = limits([x, y], cut, speeds)
    # far above the minimum Re lambda is a small part of lambda, and its error a larger one of it
    counts = got < 20 * stability_boundary([x, y], cut, speeds[0], speeds[-1]).least_depth
    low, high = np.min(near, axis=0) * (1 - 3 * TOLERANCE), np.max(near, axis=0)
    assert ((got >= low) & (got <= high * (1 + 3 * TOLERANCE)))[counts].all()


def test_a_feed_a_quarter_turn_on_swaps_x_and_y() -> None:
    swapped = [replace(X, direction="y"), replace(Y, direction="x")]
    turned = replace(DOWN, feed_direction=pi / 2)
    np.testing.assert_allclose(limits(swapped, turned), limits([X, Y], DOWN), rtol=1e-9)
    assert not np.allclose(limits([X, Y], turned), limits([X, Y], DOWN), rtol=0.2)


@settings(deadline=None)
@given(angle=st.floats(-7.0, 7.0))
def test_the_same_modes_in_x_and_y_know_no_direction(of_both: np.ndarray, angle: float) -> None:
    """The matrix is turned, its eigenvalues are not: to the rounding of the refinement."""
    turned = limits(BOTH, replace(DOWN, feed_direction=angle))
    np.testing.assert_allclose(turned, of_both, rtol=2 * TOLERANCE)


def test_opposite_feed_and_mirror_are_the_same_cut() -> None:
    forth = replace(DOWN, feed_direction=0.3)
    for other in (
        replace(DOWN, feed_direction=0.3 + pi),
        replace(DOWN, feed_direction=-0.3, direction=-1),
    ):
        np.testing.assert_allclose(limits([X, Y], other), limits([X, Y], forth), rtol=1e-9)


@settings(deadline=None)
@given(factor=st.floats(0.05, 20.0))
def test_depth_goes_with_one_over_the_force(of_down: np.ndarray, factor: float) -> None:
    harder = replace(DOWN, K_tc=DOWN.K_tc * factor, K_rc=DOWN.K_rc * factor)
    np.testing.assert_allclose(limits([X, Y], harder) * factor, of_down, rtol=2 * TOLERANCE)


def test_edge_coefficients_have_no_part() -> None:
    tool = Tool(kind="flat", diameter_mm=20.0, flutes=2)
    sharp = ForceLaw.linear(K_tc=600.0, K_rc=200.0)
    blunt = ForceLaw.linear(K_tc=600.0, K_rc=200.0, K_te=60.0, K_re=90.0)
    one, other = (RegenerativeCut.of(law, tool, entry=0.0, exit=pi) for law in (sharp, blunt))
    np.testing.assert_array_equal(limits([X], one), limits([X], other))


def test_modes_far_apart_do_not_meet() -> None:
    """What the high mode gives way statically is 1 % of the low one's peak, 4 zeta."""
    low = Mode(direction="x", natural_frequency_Hz=300.0, damping=0.003, stiffness_N_m=1e7)
    high = Mode(direction="x", natural_frequency_Hz=6000.0, damping=0.003, stiffness_N_m=1.5e7)
    speeds = np.linspace(2000, 20000, 400) / 60
    together = limits([low, high], SLOT, speeds)
    alone = np.minimum(limits([low], SLOT, speeds), limits([high], SLOT, speeds))
    near = alone < 2 * alone.min()
    assert near.sum() > 100
    np.testing.assert_allclose(together[near], alone[near], rtol=0.03)


def test_lobes_never_lie_below_the_least_depth_and_touch_it() -> None:
    for cut in (SLOT, DOWN, UP):
        least = stability_boundary([X, Y], cut, SPEEDS[0], SPEEDS[-1]).least_depth
        found = limits([X, Y], cut)
        assert least * (1 - 1e-12) <= found.min() <= 1.02 * least


def test_a_receptance_with_cross_terms_is_that_of_turned_modes() -> None:
    """Modes along axes turned by 30 deg have cross terms in the machine's frame.

    Lines of 0.5 Hz are a twentieth of the narrower peak's half width, 10 Hz: straight between, they
    are (1/20)^2 / 8 of the peak off, 0.03 %, and on the flanks of lobes up to ten times that.
    """
    frequency = np.arange(20.0, 4500.0, 0.5)
    c, s = np.cos(pi / 6), np.sin(pi / 6)
    turn = np.array([[c, -s], [s, c]])
    tip = FrequencyResponse(
        frequency_Hz=frequency, receptance=turn @ modal_receptance([X, Y], frequency) @ turn.T
    )
    turned = limits(tip, replace(DOWN, feed_direction=pi / 6))
    np.testing.assert_allclose(turned, limits([X, Y], DOWN), rtol=3e-3)


def test_eigenvalues_are_those_of_the_matrix() -> None:
    response = modal_receptance([X, Y], np.linspace(100, 2000, 40))
    matrix = mean_matrix(replace(DOWN, feed_direction=1.0))
    own = np.sort_complex(eigenvalues(matrix, response))
    np.testing.assert_allclose(
        own, np.sort_complex(np.linalg.eigvals(matrix @ response)), rtol=1e-9
    )


@pytest.mark.parametrize("over", [1.25, 1.35, 1.45])
def test_lobes_of_high_frequencies_count_in_the_pocket(over: float) -> None:
    """Between the first two minima nothing but chatter far above the mode bounds the depth.

    With one mode in a steady slot 1 / (2 Re lambda), at the speed that has this frequency with one
    whole wave; up to 1.5 times the mode none of less waves is there.  The flank is steep: 1e-2 is
    fifty times the lobes' tolerance.
    """
    value = -STEADY.K_rc * modal_receptance([X], [over * X.natural_frequency_Hz])[0, 0, 0]
    wave = 2 * np.arctan2(value.real, -value.imag) + 2 * pi
    speed = over * X.omega / (STEADY.flutes * wave)
    found = lobes([X], STEADY, [speed])
    assert found.chatter_frequency[0] == pytest.approx(over * X.natural_frequency_Hz, rel=1e-3)
    assert found.depth_limit[0] == pytest.approx(1 / (2 * value.real), rel=1e-2)


def test_no_speeds_have_no_limits() -> None:
    found = lobes([X], SLOT, [])
    assert found.n.shape == found.depth_limit.shape == found.chatter_frequency.shape == (0,)


@pytest.mark.parametrize(("slowest", "fastest"), [(0.0, 9.0), (9.0, 8.0), (1.0, np.inf)])
def test_a_boundary_is_of_speeds_above_0(slowest: float, fastest: float) -> None:
    with pytest.raises(ValueError, match="above 0 1/s, the slowest first"):
        stability_boundary([X], SLOT, slowest, fastest)


def test_no_lobe_is_inf() -> None:
    """Where only the part below resonance was measured, a push along x goes with the motion."""
    below = np.arange(50.0, 700.0, 1.0)
    found = lobes(
        FrequencyResponse(frequency_Hz=below, receptance=modal_receptance([X], below)),
        STEADY,
        [99.0],
    )
    assert np.isinf(found.depth_limit).all() and np.isnan(found.chatter_frequency).all()


@pytest.mark.parametrize(
    ("dynamics", "speeds", "options", "message"),
    [
        ([X], [0.0], {}, "n: spindle speeds must be above 0"),
        ([X], [np.nan], {}, "n: spindle speeds must be above 0"),
        ([X], [[9.0], [8.0]], {}, r"n has shape \(2, 1\)"),
        ([], [10.0], {}, "modes: there is none"),
        ([X], [10.0], {"tolerance": 0.0}, "tolerance = 0.0 must be above 0"),
    ],
)
def test_what_lobes_cannot_be_of(dynamics, speeds, options, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        lobes(dynamics, SLOT, speeds, **options)


def test_depth_of_a_slot_with_four_flutes_at_12_000_rpm() -> None:
    cut = RegenerativeCut(K_tc=6e8, K_rc=2e8, flutes=4, entry=0.0, exit=pi)
    assert limits([X], cut, [12_000 / 60])[0] * 1e3 == pytest.approx(2.425, abs=5e-4)
