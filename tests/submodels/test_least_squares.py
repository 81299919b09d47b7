"""The clustered covariance against a restatement, and against the textbook's."""

import numpy as np
import pytest
from scipy.stats import t as student

from pipeline.submodels.statistics import uncertainty_of


def problem(n: int, d: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian with columns of very different size, and the residuals at its optimum."""
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(n, d)) * 10.0 ** np.arange(d)
    y = rng.normal(size=n)
    return jacobian, y - jacobian @ np.linalg.lstsq(jacobian, y, rcond=None)[0]


def test_it_is_the_sandwich_written_out_block_by_block() -> None:
    jacobian, residuals = problem(120, 3, 0)
    blocks = np.random.default_rng(1).integers(0, 17, 120)
    bread = np.linalg.inv(jacobian.T @ jacobian)
    meat = np.zeros((3, 3))
    for block in np.unique(blocks):
        score = jacobian[blocks == block].T @ residuals[blocks == block]
        meat += np.outer(score, score)
    n_blocks = len(np.unique(blocks))
    wanted = bread @ meat @ bread * n_blocks / (n_blocks - 3)
    found = uncertainty_of(jacobian, residuals, blocks)
    np.testing.assert_allclose(found.covariance, wanted, rtol=1e-8)
    deviation = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        found.half_width, student.ppf(0.975, n_blocks - 3) * deviation, rtol=1e-8
    )
    np.testing.assert_allclose(
        found.correlation, wanted / np.outer(deviation, deviation), rtol=1e-8
    )


def test_the_order_and_the_names_of_blocks_do_not_matter() -> None:
    jacobian, residuals = problem(60, 2, 2)
    blocks = np.repeat(np.arange(12), 5)
    shuffled = np.random.default_rng(3).permutation(60)
    first = uncertainty_of(jacobian, residuals, blocks)
    second = uncertainty_of(jacobian[shuffled], residuals[shuffled], 7 * blocks[shuffled] + 100)
    np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-10)


def test_of_independent_samples_it_is_the_textbook_covariance() -> None:
    """s^2 (J'J)^-1: at 40 000 samples the two differ by a few of sqrt(2 / N)."""
    jacobian, residuals = problem(40_000, 3, 4)
    textbook = np.linalg.inv(jacobian.T @ jacobian) * (residuals @ residuals) / (40_000 - 3)
    found = uncertainty_of(jacobian, residuals, np.arange(40_000))
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(textbook), rtol=0.04)


def test_repeating_every_sample_does_not_make_it_surer() -> None:
    """The textbook's interval would be narrower by sqrt(10)."""
    jacobian, residuals = problem(200, 2, 5)
    once = uncertainty_of(jacobian, residuals, np.arange(200))
    repeated = uncertainty_of(
        np.repeat(jacobian, 10, axis=0), np.repeat(residuals, 10), np.repeat(np.arange(200), 10)
    )
    np.testing.assert_allclose(once.half_width, repeated.half_width, rtol=1e-9)


def test_the_condition_does_not_depend_on_units() -> None:
    jacobian, residuals = problem(50, 3, 6)
    blocks = np.arange(50)
    scaled = uncertainty_of(jacobian * [1e-6, 1.0, 1e6], residuals, blocks)
    assert scaled.condition == pytest.approx(uncertainty_of(jacobian, residuals, blocks).condition)
    assert scaled.condition >= 1


def test_a_direction_that_nothing_determines_shows() -> None:
    jacobian, _ = problem(50, 2, 7)
    twice = np.column_stack([jacobian[:, 0], jacobian[:, 0], jacobian[:, 1]])
    found = uncertainty_of(twice, np.random.default_rng(8).normal(size=50), np.arange(50))
    assert found.condition > 1e12
    assert (found.half_width[:2] > 1e6 * found.half_width[2]).all()


@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_no_more_blocks_than_parameters_give_no_interval(blocks: int) -> None:
    jacobian, residuals = problem(30, 3, 9)
    found = uncertainty_of(jacobian, residuals, np.arange(30) % blocks)
    assert np.isinf(found.half_width).all()
