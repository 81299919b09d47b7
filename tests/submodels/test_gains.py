"""A richer model must win by days."""

import numpy as np
import pytest

from pipeline.submodels.statistics import LEVEL, gains


def test_a_gain_on_every_day_is_one() -> None:
    simple = np.array([4.0, 5.0, 4.5, 6.0])
    assert gains(simple, simple - [1.0, 1.2, 0.9, 1.1])


def test_the_other_way_round_it_is_none() -> None:
    simple = np.array([4.0, 5.0, 4.5, 6.0])
    assert not gains(simple - [1.0, 1.2, 0.9, 1.1], simple)


def test_one_good_day_is_not_enough() -> None:
    assert not gains(np.array([9.0, 1.0, 1.0, 1.0]), np.array([1.0, 1.1, 0.9, 1.1]))


@pytest.mark.parametrize("days", [0, 1, 2])
def test_few_days_show_nothing(days: int) -> None:
    assert not gains(np.full(days, 9.0), np.arange(days) / 100)


def test_equal_or_unknown_errors_show_nothing() -> None:
    assert not gains(np.full(5, 2.0), np.full(5, 2.0))
    assert not gains(np.array([1.0, np.nan, 2.0]), np.array([0.5, 0.5, 0.5]))


def test_by_hand_of_three_days() -> None:
    """Differences 1, 2, 3: t = 2 / (1 / sqrt 3) = 3.46, above 2.92, the 95 % point of t(2)."""
    simple = np.array([5.0, 6.0, 7.0])
    assert gains(simple, simple - [1.0, 2.0, 3.0])
    # 0.5, 2, 3.5: t = 2 / (1.5 / sqrt 3) = 2.31
    assert not gains(simple, simple - [0.5, 2.0, 3.5])


def test_a_model_that_is_no_better_is_kept_at_the_stated_rate() -> None:
    """Of 2000 draws 5 % are 100, with a standard deviation of 10."""
    rng = np.random.default_rng(0)
    kept = sum(gains(*rng.normal(10, 1, (2, 8))) for _ in range(2000))
    assert abs(kept - 2000 * LEVEL) < 50
