"""Modes fitted to a measured response: the limit they decide is that of the tip itself.

Responses are made of known modes, with the noise of a hammer (a share of the response and a share
of its peak) on each line; the true limit is that of time integration with the modes themselves.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.stability.modal_fit import ERROR, fit_modes
from pipeline.cutting.stability.semi_discretisation import least_depth
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, Mode, modal_receptance
from tests.cutting.chatter import DOWN, SLOT, UP, X, integrated_limit, lobes
from tests.cutting.stability.test_decided_limit import ABOVE, BELOW, RANDOM, SAID, Case, drawn

FINE, COARSE = np.arange(50.0, 4000.0, 2.0), np.arange(100.0, 2600.0, 5.0)
CLEAN, NOISY, POOR = (FINE, 0.0, 0.0), (FINE, 0.02, 0.002), (COARSE, 0.05, 0.01)
"""Lines [Hz], noise over the response and over its peak [1]."""


def response(frequency: np.ndarray, *direct: np.ndarray) -> FrequencyResponse:
    """Of direct receptances along x and, where given, y."""
    receptance = np.zeros((len(frequency), 2, 2), dtype=np.complex128)
    for axis, values in enumerate(direct):
        receptance[:, axis, axis] = values
    return FrequencyResponse(frequency_Hz=frequency, receptance=receptance)


def measured(
    modes: Sequence[Mode], frequency: np.ndarray, share: float = 0.0, floor: float = 0.0,
    seed: int = 0,
) -> FrequencyResponse:  # fmt: skip
    """The response of modes with noise."""
    rng = np.random.default_rng(seed)
    receptance = modal_receptance(modes, frequency)
    for axis in range(2):
        direct = receptance[:, axis, axis]
        first, second = rng.normal(0.0, 0.5**0.5, (2, 2, len(frequency)))
        noise = share * (first[0] + 1j * first[1]) * direct
        noise += floor * (second[0] + 1j * second[1]) * np.abs(direct).max()
        receptance[:, axis, axis] += noise
    return FrequencyResponse(frequency_Hz=frequency, receptance=receptance)


def mode(frequency: float, damping: float, stiffness: float, direction: str = "x") -> Mode:
    return Mode(
        direction=direction, natural_frequency_Hz=frequency, damping=damping,  # type: ignore[arg-type]
        stiffness_N_m=stiffness,
    )  # fmt: skip


def ratio(case: Case, kind: tuple[np.ndarray, float, float], seed: int) -> float:
    """Limit that the fitted modes decide over that of time integration of the tip itself.

    Stations are as deep as the least limit of the zero-order solution, or nearly as the true one.
    """
    least = least_depth(case.modes, case.cut)
    true = integrated_limit(case.modes, case.cut, case.rpm / 60, case.decided(4 * least))
    fitted = replace(case, modes=fit_modes([measured(case.modes, *kind, seed=seed)]).modes)
    return fitted.decided(max(0.6 * true, least)) / true


def assert_right(case: Case, kind: tuple, seed: int) -> None:
    found = ratio(case, kind, seed)
    assert 1 - BELOW <= found <= 1 + ABOVE, f"{found:.4f}: {case}"


@pytest.mark.parametrize("kind", [CLEAN, NOISY, POOR], ids=["clean", "noisy", "poor"])
def test_ten_percent_immersion(kind: tuple) -> None:
    """20 000 rpm, where the zero-order solution of the response promises 55 % too much."""
    assert_right(SAID[2], kind, 1)


FEW = [7]
"""Of the cases drawn that are ordinary tests."""


@pytest.mark.parametrize("kind", [CLEAN, NOISY, POOR], ids=["clean", "noisy", "poor"])
@pytest.mark.parametrize("k", [k if k in FEW else pytest.param(k, marks=pytest.mark.proof)
                               for k in range(RANDOM)])  # fmt: skip
def test_any_immersion_teeth_and_modes(k: int, kind: tuple) -> None:
    assert_right(drawn(RANDOM)[k], kind, k)


SIX = [
    mode(120, 0.05, 4e7), mode(600, 0.03, 2e7), mode(1100, 0.025, 4e7), mode(1900, 0.03, 5e7),
    mode(3600, 0.02, 3e7), mode(5200, 0.03, 6e7),
]  # fmt: skip
CLOSE = [mode(700, 0.03, 2e7), mode(740, 0.03, 2e7), mode(900, 0.04, 1e7, "y")]


@pytest.mark.parametrize("modes", [SIX, CLOSE], ids=["six", "close"])
def test_the_modes_of_a_clean_response_are_its_own(modes: list[Mode]) -> None:
    found = fit_modes([measured(modes, np.arange(50.0, 6500.0, 2.0))])
    key = lambda one: (one.direction, one.natural_frequency_Hz)  # noqa: E731
    assert len(found.modes) == len(modes) and found.error < 1e-3 and not found.caution
    for one, other in zip(sorted(found.modes, key=key), sorted(modes, key=key), strict=True):
        assert one.natural_frequency_Hz == pytest.approx(other.natural_frequency_Hz, rel=1e-3)
        assert one.damping == pytest.approx(other.damping, rel=0.01)
        assert one.stiffness == pytest.approx(other.stiffness, rel=0.01)


def test_directions_with_lines_of_their_own_are_fitted_apart() -> None:
    """Joined at the lines of both, straight lines between 5 Hz would cut the peak of 10 Hz."""
    tip = [mode(922, 0.011, 1.3e6), mode(700, 0.03, 2e6, "y")]
    x, y = measured(tip[:1], COARSE), measured(tip[1:], FINE)
    found = fit_modes([x, y]).modes
    assert [one.direction for one in found] == ["x", "y"]
    assert found[0].stiffness == pytest.approx(1.3e6, rel=1e-3)


def test_error_grows_with_noise_and_makes_the_tip_more_compliant() -> None:
    errors = [fit_modes([measured([X], FINE, s, s / 5, seed=3)]).error for s in (0.0, 0.05, 0.3)]
    assert errors[0] < 1e-6 < errors[1] < errors[2] < ERROR
    for seed in range(3):
        found = fit_modes([measured([X], FINE, 0.1, 0.02, seed)])
        stiff = min(one.stiffness * one.damping for one in found.modes)
        assert 0.9 < stiff / (X.stiffness * X.damping) < 1.05


def damped_apart(damper: float) -> np.ndarray:
    """Receptance of two masses, the second damped [N s/m] by itself: its modes are complex."""
    omega = 2 * np.pi * FINE[:, None, None]
    inertia, spring = np.diag([1.0, 0.6]), np.array([[3e7, -1.2e7], [-1.2e7, 2.4e7]])
    dynamic = spring - inertia * omega**2 + 1j * omega * np.diag([150.0, 60.0 + damper])
    values: np.ndarray = np.linalg.inv(dynamic)[:, 1, 1]
    return values


@pytest.mark.parametrize("damper", [20.0, 150.0])
def test_complex_modes_are_on_the_safe_side(damper: float) -> None:
    """Against the zero-order solution of the response itself, as far as the error says."""
    tip = response(FINE, damped_apart(damper))
    found = fit_modes([tip])
    speeds = np.linspace(3000, 20_000, 120) / 60
    for cut in (SLOT, DOWN, UP):
        of_fit, of_response = (lobes(one, cut, speeds) for one in (found.modes, tip))
        over = of_fit / of_response
        assert over.max() < 1.02 and over.min() > 0.96 - 2 * found.error


def test_complex_modes_that_no_mode_explains_are_refused() -> None:
    with pytest.raises(ValueError, match=r"modes are off by \d+ % .* where 10 % are allowed"):
        fit_modes([response(FINE, damped_apart(400.0))])


def test_a_mode_close_above_the_band_is_found_and_said() -> None:
    tip = [mode(922, 0.02, 1e7), mode(2700, 0.02, 2e7)]
    found = fit_modes([measured(tip, COARSE, 0.01, 0.001)])
    assert "modes above 2595 Hz, where the measurement along x ends, have" in found.caution
    above = max(found.modes, key=lambda one: one.natural_frequency_Hz)
    assert above.natural_frequency_Hz == pytest.approx(2700, rel=0.02)
    assert above.stiffness == pytest.approx(2e7, rel=0.1)


def test_stiff_modes_far_beyond_the_band_change_little() -> None:
    """At 10 % immersion: what the band leaves out is a residual term, and nothing is said."""
    kind = (COARSE, 0.02, 0.002)
    tip = (mode(60, 0.05, 1e9, "y"), mode(922, 0.03, 1e7, "y"), mode(6000, 0.02, 3e8, "y"))
    assert not fit_modes([measured(tip, *kind)]).caution
    for rpm in (9000.0, 18_500.0):
        assert_right(Case(rpm, modes=tip), kind, 5)


HUGE = "the tip may give way more than at the modes in the band; measure to a higher frequency"


@pytest.mark.parametrize(
    ("tip", "said"),
    [
        (measured([mode(9000, 0.02, 1e7)], FINE), f"above 3998 Hz.*{HUGE}"),
        (measured([mode(30, 0.02, 1e7)], FINE), "no mode is found from 50 to 3998 Hz"),
        (measured([X], COARSE[:9]), "9 frequencies are too few"),
        (measured([X], FINE, 1.0, 0.5), "along x: .*; measure"),
        (response(FINE, 0 * FINE), "none is measured along the force"),
    ],
)
def test_what_cannot_be_made_out_is_one_sentence(tip: FrequencyResponse, said: str) -> None:
    with pytest.raises(ValueError, match=f"frequency response.*{said}") as caught:
        fit_modes([tip])
    assert "\n" not in str(caught.value)


def test_a_cross_response_counts_as_error_and_is_refused_where_it_is_great() -> None:
    tip = measured([X, mode(922, 0.011, 1.3e6, "y")], FINE)
    for share, fits in ((0.05, True), (0.2, False)):
        tip.receptance[:, 0, 1] = share * tip.receptance[:, 1, 1]
        if fits:
            assert fit_modes([tip]).error == pytest.approx(share, rel=0.05)
            continue
        with pytest.raises(ValueError, match=r"cross receptance is \d+ % of the direct one"):
            fit_modes([tip])
