"""Half width of a loop gain from nearly collinear delays, against a restatement."""

import numpy as np
import pytest
from scipy.linalg import solve_triangular
from scipy.stats import t as student

from pipeline.submodels.drive.loop_gain import TAPS, _half_width
from pipeline.submodels.statistics import block_numbers


def test_the_half_width_of_the_sum_is_not_lost_in_rounding() -> None:
    """A smooth speed at many delays determines the sum of the weights, and hardly any of them.

    Restated without a covariance: the sum is c' y with c = Q R^-T g of the columns Q R, and its
    variance that of c' r by blocks.
    """
    rng, smooth = np.random.default_rng(0), np.hanning(500)
    rows = np.arange(200, 9000, 4)
    places = rows[:, None] - 2 * np.arange(TAPS)
    speeds = [np.convolve(rng.normal(size=9500), smooth, "valid")[places] for _ in range(2)]
    columns, stretch = np.hstack(speeds), np.zeros(len(rows), dtype=np.int64)
    residuals = np.convolve(rng.normal(size=len(rows) + 19), np.ones(20), "valid")
    assert np.linalg.cond(columns) > 1e6
    q, r = np.linalg.qr(columns)
    c = q @ solve_triangular(r, np.repeat([1.0, 0.0], TAPS), trans="T")
    sums = np.bincount(block_numbers(residuals, stretch, 2 * TAPS), weights=c * residuals)
    many = len(sums)
    deviation = np.sqrt((sums**2).sum() * many / (many - 2 * TAPS))
    wanted = student.ppf(0.975, many - 2 * TAPS) * deviation
    assert _half_width(columns, residuals, stretch) == pytest.approx(wanted, rel=1e-4)
