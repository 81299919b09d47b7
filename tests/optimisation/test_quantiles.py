"""Quantiles and tails of few draws against the distributions that they are of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, norm

from pipeline.optimisation.certainty.quantiles import (
    aimed_share,
    clopper_pearson,
    quantiles,
    share_above,
)


def lognormal(many: int, spread: float = 0.1):
    """At equal shares, where the k-th of n draws is expected, k / (n + 1)."""
    return np.exp(spread * norm.ppf((np.arange(many) + 1) / (many + 1)))


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0, 2.5, 3.0, 4.0])
def test_quantiles_of_a_lognormal_go_on_beyond_its_draws(level: float):
    """512 of them end at 3.1 deviations."""
    found = quantiles(lognormal(512)[None, None], level)
    assert found[0, 0] == pytest.approx(np.exp(0.1 * level), rel=5e-3)


@given(many=st.integers(8, 200), level=st.floats(-3, 6), seed=st.integers(0, 1000))
def test_a_higher_level_is_never_less(many: int, level: float, seed: int):
    ordered = np.sort(np.random.default_rng(seed).random((2, many)), axis=1)
    # where draws end and the tail begins it goes on from the same value
    assert (quantiles(ordered, level + 1e-3) >= quantiles(ordered, level) - 1e-12).all()
    assert np.isfinite(quantiles(ordered, level)).all()


def test_constants_are_their_quantiles():
    assert quantiles(np.full((1, 16), 3.0), 5.0) == pytest.approx(3.0)
    assert quantiles(np.zeros((1, 16)), 5.0) == pytest.approx(0.0)


@pytest.mark.parametrize("share", [0.3, 0.02, 1e-3])
def test_the_share_above_a_limit_is_that_of_the_distribution(share: float):
    found = share_above(lognormal(1024), np.exp(0.1 * norm.ppf(1 - share)))
    # Blom's places lie between k / (n + 1) and the medians: a hundredth of a deviation
    assert found == pytest.approx(share, rel=0.1)


def test_a_share_is_never_less_than_what_is_counted():
    """Two far outliers are no lognormal's tail, but they are there."""
    ordered = np.sort(np.concatenate([lognormal(1022), [5.0, 5.0]]))
    assert share_above(ordered, 4.9) >= 2 / 1024
    assert share_above(np.zeros(100), 1.0) == 0.0


@pytest.mark.parametrize("share", [0.3, 0.05, 0.01, 0.002])
def test_a_share_that_was_aimed_at_is_rarely_that_of_a_greater_probability(share: float):
    """1 sample in 20; random ones err more than Sobol's, and counts are of whole draws."""
    random, limit = np.random.default_rng(1), np.exp(0.1 * norm.ppf(1 - share))
    samples = np.exp(0.1 * np.sort(random.standard_normal((400, 512)), axis=1))
    aimed = aimed_share(share, 512)
    found = np.array([share_above(one, limit) for one in samples])
    assert 0 < aimed < share
    assert (found <= aimed).mean() < 0.1


@given(many=st.integers(1, 2000), part=st.floats(0, 1))
def test_an_interval_is_where_the_count_is_not_unlikely(many: int, part: float):
    """At each end what was counted, or more extreme, has a probability of 2.5 %."""
    passed = round(part * many)
    low, high = clopper_pearson(passed, many)
    assert low <= passed / many <= high
    if passed > 0:
        assert binom.sf(passed - 1, many, low) == pytest.approx(0.025, rel=1e-6)
    if passed < many:
        assert binom.cdf(passed, many, high) == pytest.approx(0.025, rel=1e-6)
