"""Collapse of a generator is found, a sound one is left alone; features add up."""

import numpy as np
import pytest

from pipeline.nets.diversity import band_edges, band_power, collapse, features
from tests.nets.wear_signals import windows

X, CONDITIONS = windows(200)
PLACE = CONDITIONS["wear"][:, None] / 100.0
OTHERS, _ = windows(200, seed=1)


def sound() -> np.ndarray:
    """Other windows of the same wears and cuts."""
    rng = np.random.default_rng(3)
    return X * rng.uniform(0.95, 1.05, (len(X), 1, 1)) + rng.normal(0, 1.0, X.shape)


def test_a_sound_generator_has_no_fault() -> None:
    assert collapse(X, sound(), PLACE, [1.0, 0.8]).reasons == ()


def test_one_window_for_all_conditions_is_a_collapse() -> None:
    found = collapse(X, np.broadcast_to(X[:1], X.shape), PLACE)
    assert found.within == found.between == 0.0
    assert "the generator has collapsed" in found.reasons[0]


def test_one_window_for_each_condition_is_a_collapse() -> None:
    """Samples follow the wear, and are the same wherever it is."""
    t = np.arange(X.shape[2])
    tone = np.sin(2 * np.pi * 4 * t / X.shape[2])
    made = (20.0 + CONDITIONS["wear"])[:, None, None] * tone
    made = np.concatenate([made, 0.05 * made], axis=1)
    found = collapse(X, made, PLACE)
    assert any("at the same conditions" in one for one in found.reasons)


def test_a_loss_that_vanished_is_said() -> None:
    found = collapse(X, sound(), PLACE, [1.0, 0.5, 0.001])
    assert found.saturated
    assert "learns nothing more" in found.reasons[0]


def test_too_few_windows_show_nothing() -> None:
    with pytest.raises(ValueError, match="2 windows show no spread"):
        collapse(X[:2], X[:2], PLACE[:2])


@pytest.mark.parametrize("length", [16, 50, 64, 501])
def test_bands_add_up_to_the_mean_square(length: int) -> None:
    x = np.random.default_rng(0).normal(size=(3, 2, length))
    x -= x.mean(axis=2, keepdims=True)
    assert np.allclose(band_power(x).sum(axis=2), (x**2).mean(axis=2))
    assert band_edges(length)[-1] == length // 2 + 1


def test_features_do_not_depend_on_the_phase() -> None:
    assert np.allclose(features(np.roll(X, 9, axis=2)), features(X))
