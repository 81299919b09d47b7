"""Clustered covariance against a restatement and the textbook's; gains by days; recorded steps."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from pipeline.submodels.contract import Target
from pipeline.submodels.judge import _shortfall, scores_of
from pipeline.submodels.scoring import ALL, STEP
from pipeline.submodels.statistics import LEVEL, gains, grid_step, uncertainty_of


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


def test_instruments_give_the_sandwich_of_instrumental_variables() -> None:
    """(Z'X)^-1 (sum_b Z_b' r_b r_b' Z_b) (X'Z)^-1, with the regressors as Z predicts them."""
    x, _ = problem(120, 3, 10)
    z = x + np.random.default_rng(11).normal(size=x.shape) * 10.0 ** np.arange(3)
    blocks = np.repeat(np.arange(20), 6)
    residuals = np.random.default_rng(12).normal(size=120)
    bread = np.linalg.inv(z.T @ x)
    sums = np.array([z[blocks == k].T @ residuals[blocks == k] for k in range(20)])
    found = uncertainty_of(z @ np.linalg.lstsq(z, x)[0], residuals, blocks)
    np.testing.assert_allclose(
        found.covariance, bread @ sums.T @ sums @ bread.T * 20 / 17, rtol=1e-8
    )


def test_half_widths_are_at_least_those_of_independent_residuals() -> None:
    """2 s sqrt(diag (J'J)^-1), where the blocks see no scatter."""
    jacobian, residuals = problem(60, 3, 13)
    blocks = np.arange(60) // 5
    least = 0.6 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    alone = uncertainty_of(jacobian, 0 * residuals, blocks, noise=0.3).half_width
    np.testing.assert_allclose(alone, least, rtol=1e-8)
    both = uncertainty_of(jacobian, residuals, blocks, noise=0.3).half_width
    by_blocks = uncertainty_of(jacobian, residuals, blocks).half_width
    np.testing.assert_allclose(both, np.maximum(by_blocks, least), rtol=1e-8)


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


def test_a_gain_is_one_of_every_day_and_of_one_direction() -> None:
    simple = np.array([4.0, 5.0, 4.5, 6.0])
    assert gains(simple, simple - [1.0, 1.2, 0.9, 1.1])
    assert not gains(simple - [1.0, 1.2, 0.9, 1.1], simple)
    assert not gains(np.array([9.0, 1.0, 1.0, 1.0]), np.array([1.0, 1.1, 0.9, 1.1]))


def test_few_days_and_equal_or_unknown_errors_show_nothing() -> None:
    assert not any(gains(np.full(days, 9.0), np.arange(days) / 100) for days in range(3))
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


@given(st.floats(1e-7, 10.0), st.integers(0, 100))
def test_the_step_of_a_rounded_signal_is_found(step: float, seed: int) -> None:
    signal = 40 * step * np.sin(0.01 * np.arange(2000)) + step * seed
    assert grid_step(step * np.round(signal / step)) == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_a_signal_without_steps_has_none(seed: int) -> None:
    assert grid_step(np.random.default_rng(seed).normal(size=500)) == 0.0
    assert grid_step(np.full(50, 3.0)) == grid_step(np.array([np.nan])) == 0.0


@pytest.mark.parametrize(("by", "column"), [("column", True), ("values", False)])
def test_a_difference_within_the_steps_is_not_decided(by: str, column: bool) -> None:
    """Two predictions that differ by far less than the steps: decided without, open with them."""
    random = np.random.default_rng(1)
    truth = 0.5 * np.sin(0.05 * np.arange(4000))
    measured = 0.1 * np.round(truth / 0.1)
    alike = [truth + random.normal(0, 0.05, 4000) for _ in range(2)]
    base, predicted = sorted(alike, key=lambda one: float(np.abs(one - measured).mean()))
    frame = pd.DataFrame({
        "quantity": "error", "regime": "", "measured": measured, "predicted": predicted,
        "baseline_persistence": base, "low": np.nan, "high": np.nan, "scored": True, "case": "a",
        "group": "a", "role": "held_out",
    })  # fmt: skip
    if column:
        frame = frame.assign(measured=measured + 1e-3 * random.normal(size=4000), step=0.1)
    target = Target(
        quantity="error", unit="um", baselines=("persistence",), must_beat=("persistence",)
    )
    assert not column or STEP in frame
    (score,) = (s for s in scores_of(frame, target, "held_out", set(), 5) if s.group == ALL)
    worse, unsure = _shortfall(score, "persistence", target)
    assert not worse and "the sensor's steps leave" in unsure[0]
    (score,) = (
        s for s in scores_of(frame.assign(step=0.0), target, "held_out", set(), 5) if s.group == ALL
    )
    assert _shortfall(score, "persistence", target)[0]
    far = frame.assign(baseline_persistence=measured)
    (score,) = (s for s in scores_of(far, target, "held_out", set(), 5) if s.group == ALL)
    assert _shortfall(score, "persistence", target)[0]
