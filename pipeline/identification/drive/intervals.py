"""How sure the inverse dynamics are: 95 % intervals that know what they left out.

Residuals of a record hang together; :func:`~pipeline.submodels.least_squares.certainty` takes
them block by block, each block ``BLOCK`` times as long as their autocorrelation reaches.  What a
model leaves out (cogs, twist, bristles) does not scatter from block to block: it moves the
parameters when the bandwidth of the filter changes, and that change widens the interval.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.inverse_dynamics import Dynamics, jacobian
from pipeline.identification.drive.places import pushes, scores_covariance
from pipeline.identification.drive.regressors import Regressors
from pipeline.submodels.least_squares import Certainty, certainty

Floats = NDArray[np.float64]

BLOCK = 8.0
FEWEST = 3
"""Blocks for each parameter that there should be, if need be at the cost of their length."""


def correlation_rows(residuals: Floats, stretch: NDArray[np.int64]) -> float:
    """Integrated autocorrelation of residuals, in rows; at least 1.

    Parameters
    ----------
    residuals : ndarray, shape (N,)
        In the order of time within a stretch.
    stretch : ndarray of int, shape (N,)
        Pairs of rows count within one stretch only.
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


def block_numbers(rows: Regressors, residuals: Floats, parameters: int) -> NDArray[np.int64]:
    """Block of each row; shape (N,)."""
    many = len(residuals)
    length = BLOCK * correlation_rows(residuals, rows.stretch)
    length = max(min(length, many / (FEWEST * parameters)), 1.0)
    numbers: NDArray[np.int64] = (np.arange(many) / length).astype(np.int64)
    return numbers


def dynamics_certainty(rows: Regressors, found: Dynamics) -> Certainty:
    """Certainty of the parameters that were sought, in their order."""
    weights = np.sqrt(found.weights)
    slopes = jacobian(rows, found.values)[:, found.sought] * weights[:, None]
    residuals = found.residuals * weights
    blocks = block_numbers(rows, residuals, int(found.sought.sum()))
    sure = certainty(slopes, residuals, blocks)
    # clustered residuals know nothing of a direction in which few blocks say anything
    least = np.maximum(sure.half_width, _textbook(slopes, residuals))
    added, quantile = _by_place(rows, found, slopes * weights[:, None])
    covariance = sure.covariance + added
    widened = np.hypot(least, quantile * np.sqrt(np.diag(added)))
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
    return replace(
        sure, covariance=covariance, half_width=widened,
        correlation=covariance / np.outer(deviation, deviation),
    )  # fmt: skip


def _by_place(rows: Regressors, found: Dynamics, slopes: Floats) -> tuple[Floats, float]:
    """Covariance that pushes by the place add, shape (S, S), and the quantile that goes with it."""
    seen = pushes(rows, found.residuals, found.value("mass"))
    size = slopes.shape[1]
    if seen is None:
        return np.zeros((size, size)), 0.0
    used = jacobian(rows, found.values)[:, found.sought]
    scale = np.linalg.norm(used, axis=0)
    scale[scale == 0] = 1.0
    information = (used / scale).T @ (slopes / scale)
    inverse = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
    middle = scores_covariance(rows, slopes / scale, seen)
    added: Floats = inverse @ middle @ inverse / np.outer(scale, scale)
    return added, seen.quantile


def _textbook(slopes: Floats, residuals: Floats) -> Floats:
    """Half of the 95 % interval if residuals were independent; shape (S,)."""
    length = np.linalg.norm(slopes, axis=0)
    length = np.where(length > 0, length, 1.0)
    _, singular, right = np.linalg.svd(slopes / length, full_matrices=False)
    spread = np.sqrt(((right / np.maximum(singular, 1e-12)[:, None]) ** 2).sum(axis=0))
    noise = float(np.std(residuals))
    half_width: Floats = 2 * noise * spread / length
    return half_width
