"""Instrumental variables: the commanded motion in place of the measured one where noise biases.

Noise in speed and acceleration makes least squares too small (errors in variables).  The motion of
the reference is free of it and goes with the true motion, so that Z' W (F - X theta) = 0 has no
such bias (Janot, Vandanjon and Gautier 2014).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.intervals import block_numbers
from pipeline.identification.drive.inverse_dynamics import LOGS, Dynamics
from pipeline.identification.drive.regressors import Regressors

Floats = NDArray[np.float64]

WEAKEST = 1e-3
"""Least singular value of Z' X with columns of length one that still tells anything."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Instrumental:
    """What instruments say of the parameters that were sought linearly.

    Parameters
    ----------
    index : ndarray of int, shape (L,)
        Their places in the vector of parameters.
    values, half_width : ndarray, shape (L,)
        With half of the 95 % interval.
    """

    index: NDArray[np.int64]
    values: Floats
    half_width: Floats


def instrumental(rows: Regressors, found: Dynamics) -> Instrumental | None:
    """Parameters by the reference's motion, v_s as in ``found``.

    None without a reference, or where it hardly goes with the motion.
    """
    if rows.instruments is None:
        return None
    linear = np.flatnonzero(found.sought & ~np.isin(found.names, LOGS))
    k = len(rows.names)
    dips = rows.dip_columns(found.values[k + 2 :])
    motion = np.hstack([rows.linear, dips])[:, linear]
    known = np.hstack([rows.instruments, dips])[:, linear]
    lengths = np.linalg.norm(motion, axis=0), np.linalg.norm(known, axis=0)
    if min(lengths[0].min(), lengths[1].min()) == 0:
        return None
    motion, known = motion / lengths[0], known / lengths[1]
    cross = known.T @ (found.weights[:, None] * motion)
    if np.linalg.svd(cross, compute_uv=False)[-1] < WEAKEST:
        return None
    inverse = np.linalg.inv(cross)
    scaled = inverse @ (known.T @ (found.weights * rows.force))
    residuals = found.weights * (rows.force - motion @ scaled)
    blocks = block_numbers(rows, residuals, len(linear))
    sums = np.zeros((int(blocks.max()) + 1, len(linear)))
    np.add.at(sums, blocks, known * residuals[:, None])
    freedom = len(sums) - len(linear)
    if freedom < 1:
        return None
    from scipy.stats import t as student

    covariance = inverse @ (sums.T @ sums) @ inverse.T * (len(sums) / freedom)
    half_width = student.ppf(0.975, freedom) * np.sqrt(np.diag(covariance))
    return Instrumental(
        index=linear, values=scaled / lengths[0], half_width=half_width / lengths[0]
    )


def is_better(
    by_instruments: Instrumental, found: Dynamics, half_width: Floats, widest: float
) -> bool:
    """Whether least squares is biased and instruments tell more: mass counts, which noise bends.

    Parameters
    ----------
    by_instruments : Instrumental
        Of the same rows.
    found : Dynamics
        By least squares.
    half_width : ndarray, shape (S,)
        Of the parameters that were sought.
    widest : float
        Half an interval that is wider, as a share, is no determination [1].
    """
    place = found.names.index("mass")
    if place not in by_instruments.index:
        return False
    at = int(np.flatnonzero(by_instruments.index == place)[0])
    value, half = float(by_instruments.values[at]), float(by_instruments.half_width[at])
    least = float(half_width[int(np.count_nonzero(found.sought[:place]))])
    return value > 0 and half <= widest * value and abs(value - found.values[place]) > least + half


def biased_half_width(by_instruments: Instrumental, found: Dynamics, half_width: Floats) -> Floats:
    """Half widths that reach over what instruments say, for records that no filter saw; (S,).

    Without a filter the noise of speed and acceleration bends least squares by an unknown amount;
    the distance to the unbiased answer, and how sure that is, bound it.
    """
    half = np.zeros(len(found.values))
    half[found.sought] = half_width
    at = by_instruments.index
    away = np.abs(by_instruments.values - found.values[at]) + by_instruments.half_width
    half[at] = np.maximum(half[at], away)
    return half[found.sought]
