"""Modes: the receptance at rest and at resonance, and what a mode may be."""

import numpy as np
import pytest

from pipeline.cutting.modes import Mode, frf
from tests.cutting.chatter import X, Y


def test_receptance_at_rest_and_at_resonance() -> None:
    """1 / k at rest, -i / (2 zeta k) at the natural frequency; the other direction stays still."""
    at = frf([X], [0.0, X.natural_frequency_Hz])
    assert at[0, 0, 0] == pytest.approx(1 / X.stiffness, rel=1e-12)
    assert at[1, 0, 0] == pytest.approx(-1j / (2 * X.damping * X.stiffness), rel=1e-12)
    assert not at[:, 1, 1].any() and not at[:, 0, 1].any()


def test_receptance_solves_the_equation_of_motion() -> None:
    """(k - m w^2 + i c w) of the answer is the force."""
    f = np.geomspace(10.0, 5000.0, 50)
    w, c = 2 * np.pi * f, 2 * Y.damping * Y.mass * Y.omega
    force = (Y.stiffness - Y.mass * w**2 + 1j * c * w) * frf([X, Y], f)[:, 1, 1]
    np.testing.assert_allclose(force, 1.0, rtol=1e-12)


def test_stiffness_and_mass_say_each_other() -> None:
    other = Mode(
        direction="x", natural_frequency_Hz=922.0, damping=0.011, stiffness_N_m=X.stiffness
    )
    assert other.mass == pytest.approx(0.03993, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"direction": "z"}, "mode.direction = 'z'"),
        ({"damping": 0.0}, "mode.damping = 0.0 must be above 0 and below 1"),
        ({"damping": 1.0}, "mode.damping = 1.0 must be above 0 and below 1"),
        ({"natural_frequency_Hz": float("nan")}, "natural_frequency_Hz = nan must be above 0"),
        ({"mass_kg": None}, "exactly one"),
        ({"stiffness_N_m": 1e6}, "exactly one"),
        ({"mass_kg": -1.0}, "mode.mass_kg = -1.0 must be above 0"),
    ],
)
def test_a_mode_that_cannot_be(change: dict, message: str) -> None:
    good = {"direction": "x", "natural_frequency_Hz": 922.0, "damping": 0.011, "mass_kg": 0.04}
    with pytest.raises(ValueError, match=message):
        Mode(**(good | change))
