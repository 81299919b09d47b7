"""Linear least squares whose regressors are measured with noise, twice.

Ordinary least squares takes noise in the regressors for excitation: where the record excites
nothing it answers with small parameters and narrow intervals.  Here the regressors are made from
the even samples and from the odd ones; noise of the samples is in one only, what both hold is
signal.  Each serves as the other's instrument (two-stage least squares), and what the halves do
not agree on is not determined: a single regressor, or a combination of several.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.submodels.least_squares import Certainty, certainty

Floats = NDArray[np.float64]
_ROUNDING = 1e-9  # of the greatest singular value
AGREEMENT = 0.5
"""Correlation of the halves below which there is more noise than signal."""
_TAKES_PART = 0.01  # in a combination, of its greatest member


@dataclass(frozen=True, kw_only=True)
class SplitFit:
    """Parameters and how well two halves determine them.

    Parameters
    ----------
    values : ndarray, shape (D,)
        0 where the regressor is not excited.
    half_width : ndarray, shape (D,)
        Of the 95 % interval; infinite for what is not excited, or interchangeable.
    excited : ndarray of bool, shape (D,)
        Whether the halves agree on the regressor.
    interchangeable : ndarray of bool, shape (D,)
        Whether it takes part in a combination of excited regressors that they do not agree on.
    condition : float
        Of the excited regressors, each scaled to length one.
    correlation : ndarray, shape (D, D)
        Of the parameters; 0 beside the diagonal for those that are not excited.
    rms : float
        Of the residuals, in the unit of what is fitted.
    """

    values: Floats
    half_width: Floats
    excited: NDArray[np.bool_]
    interchangeable: NDArray[np.bool_]
    condition: float
    correlation: Floats
    rms: float


def split_fit(regressors: Floats, y: Floats, blocks: NDArray[np.int64]) -> SplitFit:
    """Fit y = regressors @ values by two-stage least squares, each half the other's instrument.

    Parameters
    ----------
    regressors : ndarray, shape (2, N, D)
        From either half of the samples.
    y : ndarray, shape (N,)
        What they explain.
    blocks : ndarray of int, shape (N,)
        Within which residuals hang together.
    """
    # by chance the halves of pure noise agree by about 1 / sqrt(blocks)
    least = min(max(AGREEMENT, 4.0 / np.sqrt(len(np.unique(blocks)))), 0.99)
    lengths = np.sqrt((regressors**2).sum(axis=1))
    products = (regressors[0] * regressors[1]).sum(axis=0)
    excited = (products > least * lengths[0] * lengths[1]) & (products > 0)
    many = len(excited)
    values, half_width = np.zeros(many), np.full(many, np.inf)
    interchangeable, correlation = np.zeros(many, bool), np.eye(many)
    if not excited.any():
        rms = float(np.sqrt(np.mean(y**2)))
        return SplitFit(
            values=values, half_width=half_width, excited=excited,
            interchangeable=interchangeable, condition=np.inf, correlation=correlation, rms=rms,
        )  # fmt: skip
    scale = np.sqrt(products[excited])
    halves = regressors[:, :, excited] / scale
    found, sure, rms = _two_stage(halves, y, blocks)
    free = _free(halves, least)
    values[excited] = found / scale
    half_width[excited] = np.where(free, np.inf, sure.half_width / scale)
    interchangeable[excited] = free
    correlation[np.ix_(excited, excited)] = sure.correlation
    return SplitFit(
        values=values, half_width=half_width, excited=excited, interchangeable=interchangeable,
        condition=sure.condition, correlation=correlation, rms=rms,
    )  # fmt: skip


def _two_stage(
    halves: Floats, y: Floats, blocks: NDArray[np.int64]
) -> tuple[Floats, Certainty, float]:
    both = np.concatenate([halves[0], halves[1]])
    swapped = np.concatenate([halves[1], halves[0]])
    twice = np.concatenate([y, y])
    # what the other half predicts of each regressor
    stage = swapped @ np.linalg.lstsq(swapped, both, rcond=_ROUNDING)[0]
    found = np.linalg.lstsq(stage, twice, rcond=_ROUNDING)[0]
    residuals = twice - both @ found
    sure = certainty(stage, residuals, np.concatenate([blocks, blocks]))
    return found, sure, float(np.sqrt(np.mean(residuals**2)))


def _free(halves: Floats, least: float) -> NDArray[np.bool_]:
    """Which regressors take part in a combination that the halves do not agree on; shape (D,).

    Combinations are those of canonical correlation: with both halves' regressors made orthonormal
    together, the eigenvectors of what the one half shares with the other.
    """
    both = np.concatenate([halves[0], halves[1]])
    _, singular, right = np.linalg.svd(np.linalg.qr(both, mode="r"), full_matrices=True)
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    seen = singular > _ROUNDING * singular[0]
    orthonormal = right[seen].T / singular[seen]
    first, second = halves[0] @ orthonormal, halves[1] @ orthonormal
    shared = first.T @ second
    agreement, ways = np.linalg.eigh(shared + shared.T)
    open_ways = [right[~seen].T, orthonormal @ ways[:, agreement < least]]
    combinations = np.abs(np.concatenate(open_ways, axis=1))
    takes_part: NDArray[np.bool_] = (combinations > _TAKES_PART * combinations.max(axis=0)).any(1)
    return takes_part
