"""Statistics of fits: clustered covariance, jackknife, gains over days, rounding of sensors.

The error of rounding is the same for as long as a sensor shows one value, and uniform within half
a step from there to there.  So the difference of two mean errors has a standard deviation, and what
lies within 1.96 of it is not decided.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.predictions import AGAIN
from pipeline.schema.verdict import Figures, significant

BLOCK = 8.0
"""Length of a block of residuals over their autocorrelation length [1]."""
FEWEST = 3
"""Least number of blocks for each parameter [1], if need be at the cost of their length."""


NORMAL_95 = 1.96
"""Half of a 95 % interval of a normal distribution over its standard deviation [1]."""
DRAWN = 8
"""Ensembles that are drawn from the members of one [1]."""


def drawn_again(members: Floats) -> dict[str, Floats]:
    """Means of the members of an ensemble (M, N), drawn with replacement, (N,) each, by column.

    They differ as the means of as many networks or trees of other seeds would; of a single member
    nothing is known.
    """
    many = len(members)
    drawn = np.random.default_rng(0).integers(0, many, (DRAWN if many > 1 else 0, many))
    return {f"{AGAIN}{k}": members[rows].mean(axis=0) for k, rows in enumerate(drawn)}


def student_quantile(freedom: float, share: float = 0.975) -> float:
    """Quantile of Student's t [1]: half of a 95 % interval over the standard deviation."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, share))


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Uncertainty of the parameters of a fit."""

    covariance: Floats
    """Covariance of the parameters, robust against residuals that hang together within a block;
    shape (D, D)."""
    half_width: Floats
    """Half of the 95 % interval; infinite without more blocks than parameters; shape (D,)."""
    condition: float
    """Condition number of the Jacobian with columns scaled to length one."""
    correlation: Floats
    """Correlation of the parameters; shape (D, D)."""


@dataclass(frozen=True, kw_only=True)
class Factor:
    """Factor with half of its 95 % interval; ``zero`` is the reading of a load channel at rest."""

    value: float
    half_width: float
    zero: float = 0.0

    def is_determined(self, widest: float) -> bool:
        """Whether its relative half width is at most ``widest`` [1]."""
        return self.value != 0 and self.half_width <= widest * abs(self.value)


def uncertainty_of(
    jacobian: Floats, residuals: Floats, blocks: NDArray[np.int64], noise: float = 0.0
) -> Uncertainty:
    """Uncertainty of a least-squares optimum from its Jacobian, residuals and blocks.

    The residuals of a fitted recording hang together over minutes to hours, so that the textbook
    covariance s^2 (J'J)^-1 is far too narrow.  This one is clustered: H^-1 (sum_b g_b g_b') H^-1
    with g_b = J_b' r_b over blocks (Liang and Zeger 1986), scaled by B / (B - D), with Student's t
    of B - D degrees of freedom.  It underestimates the variance in a direction that only few blocks
    excite: where two parameters do the same to these, the residuals have no part along their
    difference.  So half widths are at least those of independent residuals of standard deviation
    ``noise``.

    ``jacobian`` (N, D) of the ``residuals`` (N,) at the optimum, of instrumental variables the
    regressors as their instruments predict them (two-stage least squares); ``blocks`` (N,) number
    the block of each.
    """
    n_blocks, n = len(np.unique(blocks)), jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    _, singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"), full_matrices=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")
    inverse = (right.T / np.maximum(singular, max(1e-12 * singular[0], 1e-12)) ** 2) @ right
    scores = scaled * residuals[:, None]
    order = np.argsort(blocks, kind="stable")
    starts = np.flatnonzero(np.diff(blocks[order], prepend=blocks[order][0] - 1))
    sums = np.add.reduceat(scores[order], starts, axis=0)
    # B blocks span at most B - 1 directions at an optimum: without more than D of them the middle
    # of the sandwich knows nothing of some direction, and would call it certain
    enough = n_blocks > n
    freedom = max(n_blocks - n, 1)
    covariance = inverse @ (sums.T @ sums) @ inverse * (n_blocks / freedom)
    covariance /= np.outer(scale, scale)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
    safe = np.where(deviation > 0, deviation, 1.0)
    half_width = student_quantile(freedom) * deviation if enough else np.full(n, np.inf)
    return Uncertainty(
        covariance=covariance,
        half_width=np.maximum(half_width, 2 * noise * np.sqrt(np.diag(inverse)) / scale),
        condition=condition,
        correlation=covariance / np.outer(safe, safe),
    )


def correlation_rows(residuals: Floats, stretch: Ints) -> float:
    """Integrated autocorrelation of residuals, in rows; at least 1.

    ``residuals`` (N,) in the order of time within a ``stretch`` (N,) without a gap; only pairs
    within one stretch count.
    """
    centred = residuals - residuals.mean()
    power = float(np.mean(centred**2))
    if power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, len(residuals) // 4):
        same = stretch[lag:] == stretch[:-lag]
        if np.count_nonzero(same) < 10:
            break
        share = float(np.mean((centred[lag:] * centred[:-lag])[same])) / power
        if share < 0.05:
            break
        total += 2 * share
    return total


def block_numbers(residuals: Floats, stretch: Ints, parameters: int) -> Ints:
    """Block of each row, from its stretch without a gap; shape (N,)."""
    many = len(residuals)
    length = BLOCK * correlation_rows(residuals, stretch)
    length = max(min(length, many / (FEWEST * parameters)), 1.0)
    return (np.arange(many) / length).astype(np.int64)


def jackknife_half_width(left: Floats) -> Floats:
    """Half of the 95 % interval by the jackknife over K left-out groups, shape (...).

    ``left`` (K, ...) are the estimates without each group in turn; the variance is
    (K - 1) / K sum_k (left_k - mean)^2 (Quenouille 1956, Tukey 1958), with Student's t of K - 1
    degrees of freedom.  It is infinite for a single group.

    Examples
    --------
    Of a mean it is the interval of the textbook, t s / sqrt(K):

    >>> values = np.array([0.9, 1.0, 1.1, 1.0])
    >>> round(float(jackknife_half_width((values.sum() - values) / 3)), 4)
    0.1299
    """
    if len(left) < 2:
        return np.full(left.shape[1:], np.inf)
    half: Floats = student_quantile(len(left) - 1) * np.sqrt((len(left) - 1) * left.var(axis=0))
    return half


def spread_of(values: Floats) -> float:
    """Half of the 95 % interval of one more value like these: Student's t times their deviation.

    ``values`` (K,) are of K trainings that differ by their seeds, at least two.

    Examples
    --------
    >>> round(spread_of(np.array([0.9, 1.0, 1.1, 1.0])), 4)
    0.2598
    """
    return significant(student_quantile(len(values) - 1) * float(np.std(values, ddof=1)))


def rank_correlation(one: ArrayLike, other: ArrayLike) -> float:
    """Spearman's coefficient of N pairs [1], ties at their mean rank; neither is constant.

    Examples
    --------
    >>> round(rank_correlation([1.0, 2.0, 2.0, 4.0], [3.0, 5.0, 6.0, 9.0]), 4)
    0.9487
    """
    first, second = (pd.Series(np.asarray(v)).rank().to_numpy(float) for v in (one, other))
    return float(np.corrcoef(first, second)[1, 0])


LEVEL = 0.05
"""Chance of keeping a richer model that is no better [1]."""


def auc(probability: NDArray[np.float64], truth: NDArray[np.float64]) -> float | None:
    """Area under the ROC curve [1]; None with one class only.

    The probability of a class (N,), and whether it is that one: ``truth`` above a half.

    Examples
    --------
    >>> auc(np.array([0.1, 0.4, 0.35, 0.8]), np.array([0.0, 0.0, 1.0, 1.0]))
    0.75
    """
    from sklearn.metrics import roc_auc_score

    one = truth > 0.5
    return float(roc_auc_score(one, probability)) if len(np.unique(one)) > 1 else None


def gains(
    simple: NDArray[np.float64], rich: NDArray[np.float64], level: float = LEVEL, fewest: int = 3
) -> bool:
    """Whether ``rich`` has significantly lower squared errors than ``simple``, day by day.

    A paired one-sided t-test over days: samples within a day hang together, days hardly do.  With
    fewer than ``fewest`` days nothing is significant and the simpler model stays.

    Both (days,) are mean squared errors of the same days, none of them learnt from. ``level`` is
    the chance of keeping a richer model that is no better [1]; ``fewest`` days are asked for, two
    or more; of two, both have to gain nearly the same.
    """
    if len(simple) < fewest or np.allclose(simple, rich):
        return False
    gain, many = simple - rich, len(simple)
    needed = student_quantile(many - 1, 1 - level) * gain.std(ddof=1) / np.sqrt(many)
    return bool(gain.mean() > needed)


FEWEST_VALUES = 5
"""Different values from which on their steps tell a resolution."""
OFF_GRID = 0.05
"""Greatest distance of a value from a grid, in steps [1]."""


def grid_step(values: Floats) -> float:
    """Smallest step between the values of a recorded signal, where they lie on a grid; else 0.

    A signal whose values lie on no grid has a resolution that its samples do not tell.

    Values as recorded, in any unit; what is not finite is left out.

    Examples
    --------
    >>> round(grid_step(0.25 * np.round(8 * np.sin(np.arange(500.0)))), 9)
    0.25
    >>> grid_step(np.sin(np.arange(500.0)))
    0.0
    """
    known = np.asarray(values, dtype=np.float64).ravel()
    known = np.unique(known[np.isfinite(known)])
    if len(known) < FEWEST_VALUES:
        return 0.0
    steps = np.diff(known)
    steps = steps[steps > 1e-9 * max(float(np.abs(known).max()), float(np.ptp(known)))]
    if not len(steps):
        return 0.0
    near = steps[steps < 1.5 * steps.min()]
    step = float(np.median(near))
    step = float(np.mean(steps / np.maximum(np.round(steps / step), 1)))
    off = np.abs(steps / step - np.round(steps / step))
    return step if float(off.max()) < OFF_GRID else 0.0


def left_open(
    predicted: Floats, other: Floats, measured: Floats, groups: Ints, step: float
) -> Figures:
    """Difference of MAE and of RMSE of two predictions that rounding leaves open.

    Samples (N,) in the order of time within a group (day, recording, tool): a value that is shown
    does not last from one to the next; ``step`` is that of the sensor, in the unit of the quantity.

    Examples
    --------
    One value shown all day says of two constant predictions next to nothing:

    >>> day = np.full(100, 21.0)
    >>> left_open(day + 0.3, day - 0.2, day, np.zeros(100, dtype=int), 1.0).mae
    1.13161
    """
    if not len(measured):
        return Figures()
    shown = np.round(measured / step)
    new = (np.diff(shown, prepend=shown[0]) != 0) | (np.diff(groups, prepend=groups[0]) != 0)
    dwell = np.cumsum(new)
    off, others_off = predicted - measured, other - measured

    def width(weight: Floats) -> float:
        sums = np.bincount(dwell, weights=weight)
        return NORMAL_95 * step / np.sqrt(12) * float(np.sqrt((sums**2).sum())) / len(weight)

    roots = float(np.sqrt(np.mean(off**2)) + np.sqrt(np.mean(others_off**2)))
    squares = width(2 * (predicted - other))
    return Figures(
        mae=significant(width(np.sign(off) - np.sign(others_off))),
        rmse=significant(squares / roots if roots > 0 else 0.0),
    )
