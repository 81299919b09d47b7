"""The zero-order lobes that other limits are held against: closed forms, eigenvalues, a number."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from pipeline.cutting.stability.semi_discretisation import eigenvalues, mean_matrix
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, modal_receptance
from tests.cutting.chatter import DOWN, STEADY, X, Y
from tests.cutting.zero_order import lobes

LEAST = 2 * X.stiffness * X.damping * (1 + X.damping) / STEADY.K_rc
"""Of one mode along x in a steady slot: 2 k zeta (1 + zeta) / K (Tlusty; Altintas 2012, 3.95)."""


def test_the_minimum_is_its_closed_form_at_its_closed_speed() -> None:
    """w = w_n sqrt(1 + 2 zeta); the phase of 1 - e^(-i w T) there is that of -1 / Phi."""
    ratio = np.sqrt(1 + 2 * X.damping)
    value = -modal_receptance([X], [X.natural_frequency_Hz * ratio])[0, 0, 0]
    waves = 2 * np.arctan2(value.real, -value.imag) + 2 * pi * np.arange(4)
    found = lobes([X], STEADY, X.omega * ratio / (STEADY.flutes * waves))
    np.testing.assert_allclose(found, LEAST, rtol=2e-4)


@pytest.mark.parametrize("over", [1.25, 1.45])
def test_lobes_of_high_frequencies_count_in_the_pocket(over: float) -> None:
    """Between the first two minima nothing but chatter far above the mode bounds the depth.

    With one mode in a steady slot 1 / (2 Re lambda), at the speed that has this frequency with one
    whole wave; up to 1.5 times the mode none of less waves is there.
    """
    value = -STEADY.K_rc * modal_receptance([X], [over * X.natural_frequency_Hz])[0, 0, 0]
    wave = 2 * np.arctan2(value.real, -value.imag) + 2 * pi
    found = lobes([X], STEADY, [over * X.omega / (STEADY.flutes * wave)])
    assert found[0] == pytest.approx(1 / (2 * value.real), rel=1e-2)


def test_depth_of_a_slot_with_four_flutes_at_12_000_rpm() -> None:
    assert lobes([X], STEADY, [12_000 / 60])[0] * 1e3 == pytest.approx(2.425, abs=1e-3)


def test_a_receptance_with_cross_terms_is_that_of_turned_modes() -> None:
    """Modes along axes turned by 30 deg have cross terms in the machine's frame.

    Lines of 0.5 Hz are a twentieth of the narrower peak's half width, 10 Hz: straight between, they
    are (1/20)^2 / 8 of the peak off, 0.03 %, and on the flanks of lobes up to ten times that.
    """
    frequency, speeds = np.arange(20.0, 4500.0, 0.5), np.linspace(2000, 25000, 300) / 60
    c, s = np.cos(pi / 6), np.sin(pi / 6)
    turn = np.array([[c, -s], [s, c]])
    tip = FrequencyResponse(
        frequency_Hz=frequency, receptance=turn @ modal_receptance([X, Y], frequency) @ turn.T
    )
    turned = lobes(tip, replace(DOWN, feed_direction=pi / 6), speeds)
    np.testing.assert_allclose(turned, lobes([X, Y], DOWN, speeds), rtol=3e-3)


def test_eigenvalues_are_those_of_the_matrix() -> None:
    response = modal_receptance([X, Y], np.linspace(100, 2000, 40))
    matrix = mean_matrix(replace(DOWN, feed_direction=1.0))
    own = np.sort_complex(eigenvalues(matrix, response))
    np.testing.assert_allclose(
        own, np.sort_complex(np.linalg.eigvals(matrix @ response)), rtol=1e-9
    )
