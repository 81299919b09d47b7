"""Each operator of the genetic algorithm against the distribution that it stands for.

The seeds are fixed: a significance of 1e-3 is the chance that a right operator had failed when the
test was written, not that it fails today.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from pipeline.search.operators import (
    adaptive_rates,
    blend,
    exponential,
    polynomial,
    ranked,
    simulated_binary,
    stochastic_universal,
    tournament,
    windowed,
)

MANY = 20_000


def crossed(shape: tuple[int, int]) -> np.ndarray:
    return np.ones(shape, bool)


def spread_cdf(beta: np.ndarray, eta: float) -> np.ndarray:
    """Integral of Deb and Agrawal's density."""
    return np.where(beta < 1, 0.5 * beta ** (eta + 1), 1 - 0.5 / beta ** (eta + 1))


@pytest.mark.parametrize("eta", [0.0, 2.0, 15.0])
def test_spread_factors_of_simulated_binary_crossover_have_their_density(eta: float) -> None:
    first, second = np.full((MANY, 1), 0.45), np.full((MANY, 1), 0.5)
    a, b = simulated_binary(first, second, crossed(first.shape), eta, np.random.default_rng(1))
    beta = (np.abs(a - b) / 0.05).ravel()
    most = 0.475 / 0.025  # the lower wall
    inside = stats.kstest(beta, lambda x: spread_cdf(x, eta) / spread_cdf(np.array(most), eta))
    assert inside.pvalue > 1e-3
    assert beta.max() <= most * (1 + 1e-12)


def test_children_of_simulated_binary_crossover_keep_their_parents_middle() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.random((2, 500, 7))
    a, b = simulated_binary(first, second, crossed(first.shape), 3.0, rng)
    np.testing.assert_allclose(a + b, first + second, atol=4e-16)


def test_a_child_is_as_often_near_the_one_parent_as_near_the_other() -> None:
    first, second = np.full((MANY, 1), 0.4), np.full((MANY, 1), 0.6)
    a, _ = simulated_binary(first, second, crossed(first.shape), 15.0, np.random.default_rng(3))
    assert stats.binomtest(int((a < 0.5).sum()), MANY).pvalue > 1e-3


def test_blended_children_are_even_over_the_widened_interval() -> None:
    first, second = np.full((MANY, 1), 0.4), np.full((MANY, 1), 0.6)
    children = blend(first, second, crossed(first.shape), 0.5, np.random.default_rng(4))
    assert stats.kstest(children.ravel(), stats.uniform(0.3, 0.4).cdf).pvalue > 1e-3
    near_wall = blend(first - 0.4, second, crossed(first.shape), 0.5, np.random.default_rng(5))
    assert stats.kstest(near_wall.ravel(), stats.uniform(0.0, 0.9).cdf).pvalue > 1e-3


@pytest.mark.parametrize("cross", ["sbx", "blend"])
def test_genes_that_do_not_cross_are_their_parents_bits(cross: str) -> None:
    rng = np.random.default_rng(6)
    first, second = rng.random((2, 300, 5))
    mask = rng.random(first.shape) < 0.5
    one = simulated_binary if cross == "sbx" else blend
    a, b = one(first, second, mask, 2.0, rng)
    assert (a[~mask] == first[~mask]).all() and (b[~mask] == second[~mask]).all()
    assert (a[mask] != first[mask]).all() and (b[mask] != second[mask]).all()


@pytest.mark.parametrize("eta", [1.0, 20.0])
def test_steps_of_polynomial_mutation_have_their_moments(eta: float) -> None:
    """Of density (eta + 1) / 2 (1 - |d|)^eta; at 0.5 what the walls cut off is 2^-(eta + 1)."""
    low = 1 - 0.5 ** (eta + 1)

    def moment(k: int) -> float:
        return stats.beta(1, eta + 1).expect(lambda d: d**k, ub=0.5) / low

    step = polynomial(np.full(10 * MANY, 0.5), eta, np.random.default_rng(7)) - 0.5
    for k in (1, 2, 4):
        found = np.abs(step) ** k
        assert abs(found.mean() - moment(k)) < 4 * found.std() / np.sqrt(len(found))
    assert abs(step.mean()) < 4 * step.std() / np.sqrt(len(step))


def test_steps_of_polynomial_mutation_have_their_distribution_at_a_wall() -> None:
    eta, x = 5.0, 0.05
    moved = polynomial(np.full(MANY, x), eta, np.random.default_rng(8))
    down = x - moved[moved < x]
    assert stats.binomtest(len(down), MANY).pvalue > 1e-3
    inside = stats.beta(1, eta + 1)
    assert stats.kstest(down, lambda d: inside.cdf(d) / inside.cdf(x)).pvalue > 1e-3


@given(
    x=st.floats(0, 1),
    y=st.floats(0, 1),
    eta=st.floats(0, 100),
    seed=st.integers(0, 1000),
)
def test_no_operator_leaves_the_cube(x: float, y: float, eta: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = np.full((50, 1), x), np.full((50, 1), y)
    for genes in (
        simulated_binary(first, second, crossed(first.shape), eta, rng),
        blend(first, second, crossed(first.shape), eta, rng),
        polynomial(first, eta, rng),
    ):
        assert ((genes >= 0) & (genes <= 1)).all()


@given(
    fitness=st.lists(st.floats(0, 1e6), min_size=1, max_size=40).filter(lambda f: sum(f) > 1e-3),
    draws=st.integers(1, 60),
    seed=st.integers(0, 1000),
)
def test_stochastic_universal_selection_rounds_each_expectation(
    fitness: list[float], draws: int, seed: int
) -> None:
    """Up or down, exactly; where it is whole but for rounding, its neighbours are as good."""
    f = np.array(fitness)
    counts = np.bincount(
        stochastic_universal(f, draws, np.random.default_rng(seed)), minlength=len(f)
    )
    expected = draws * f / f.sum()
    assert counts.sum() == draws
    assert (counts >= np.floor(expected - 1e-9)).all()
    assert (counts <= np.ceil(expected + 1e-9)).all()
    assert (counts[f == 0] == 0).all()


def test_stochastic_universal_selection_has_no_bias() -> None:
    """The mean count over many spins is the expectation; one spin is off by less than one."""
    f = np.random.default_rng(9).random(12)
    spins = 4000
    rng = np.random.default_rng(10)
    total = sum(np.bincount(stochastic_universal(f, 7, rng), minlength=12) for _ in range(spins))
    expected = 7 * f / f.sum()
    assert np.abs(total / spins - expected).max() < 4 * 0.5 / np.sqrt(spins)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_tournaments_press_as_the_least_of_some_draws(size: int) -> None:
    many, draws = 20, 100_000
    counts = np.bincount(tournament(many, draws, size, np.random.default_rng(11)), minlength=many)
    place = np.arange(many)
    chance = ((many - place) / many) ** size - ((many - place - 1) / many) ** size
    possible = chance * draws > 5
    assert possible.sum() >= 10
    assert stats.chisquare(
        np.append(counts[possible], counts[~possible].sum() + 1e-9),
        np.append(chance[possible], chance[~possible].sum() + 1e-14) * draws,
        sum_check=False,
    ).pvalue > 1e-3  # fmt: skip


def test_ranked_fitness_presses_as_it_says() -> None:
    assert ranked(11, 1.8)[[0, 5, 10]] == pytest.approx([1.8, 1.0, 0.2])
    assert ranked(1) == pytest.approx([1.0])


def test_exponential_fitness_is_the_formula() -> None:
    costs = np.array([1.0, 2.0, 4.0, np.inf])
    sigma = np.std([1.0, 2.0, 4.0])
    wanted = [1, np.exp(-1 / (0.5 * sigma)), np.exp(-3 / (0.5 * sigma)), 0]
    np.testing.assert_allclose(exponential(costs, 0.5), wanted, rtol=1e-12)


def test_windowed_fitness_counts_from_the_worst() -> None:
    fitness = windowed(np.array([1.0, 2.0, 4.0, np.inf]))
    np.testing.assert_allclose(fitness / fitness[0], [1, 2 / 3, 0, 0])


@pytest.mark.parametrize("form", [exponential, windowed])
@pytest.mark.parametrize(
    "costs",
    [[np.inf, np.inf], [3.0, 3.0, 3.0], [3.0, np.inf], [-1e308, 1e308], [0.0, 5e-324, np.inf]],
)
def test_fitness_of_costs_that_say_little_is_still_fitness(form, costs: list[float]) -> None:
    fitness = form(np.array(costs))
    assert np.isfinite(fitness).all() and (fitness >= 0).all() and fitness.sum() > 0


def test_adaptive_rates_are_the_formula() -> None:
    """k (f_max - f') / (f_max - f_mean) from the mean up, k below it."""
    fitness = np.array([10.0, 8.0, 5.0, 1.0])  # mean 6
    np.testing.assert_allclose(adaptive_rates(fitness, fitness, 0.8), [0, 0.4, 0.8, 0.8])
    np.testing.assert_allclose(adaptive_rates(fitness, fitness[:2], 0.5), [0, 0.25])
    np.testing.assert_allclose(adaptive_rates(np.ones(4), np.ones(2), 0.8), [0.8, 0.8])


def test_adaptive_rates_do_not_depend_on_the_cost_s_unit() -> None:
    fitness = np.random.default_rng(12).random(30)
    once = adaptive_rates(fitness, fitness, 1.0)
    np.testing.assert_allclose(adaptive_rates(1e6 * fitness - 7e6, 1e6 * fitness - 7e6, 1.0), once)
