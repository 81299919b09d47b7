"""Loads that the cut puts on tool and spindle, block by block."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MEAN, RMS, TORQUE = 1, 2, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockLoads:
    """Loads while blocks cut; 0 in air.

    Over a block, peaks are the greatest of its stations and means are weighted by the way that
    each stands for, as its time is at one feed; the part of a block in air does not count.

    Parameters
    ----------
    peak, mean, rms : ndarray, shape (..., B)
        Of the load across the tool's axis, sqrt(F_x^2 + F_y^2), over a turn [N].
    axial : ndarray, shape (..., B)
        Peak of |F_z| [N].
    torque, peak_torque : ndarray, shape (..., B)
        Mean and peak of the torque that the cut takes [N m].
    """

    peak: Floats
    mean: Floats
    rms: Floats
    axial: Floats
    torque: Floats
    peak_torque: Floats


def of_blocks(values: Floats, block: NDArray[np.int32], length: Floats, blocks: int) -> Floats:
    """Loads of blocks out of those of their stations.

    Parameters
    ----------
    values : ndarray, shape (N, K, 6)
        Of each station, in the order of :class:`BlockLoads`.
    block : ndarray of int32, shape (N,)
        Block of each station.
    length : ndarray, shape (N,)
        Way in the material that each stands for [m].
    blocks : int
        B.

    Returns
    -------
    ndarray, shape (6, B, K)
        0 for blocks without a station.
    """
    out = np.zeros((6, blocks, values.shape[1]))
    if not len(block):
        return out
    order = np.argsort(block, kind="stable")
    at = block[order]
    first = np.flatnonzero(np.diff(at, prepend=-1))
    whole = np.bincount(block, weights=length, minlength=blocks)[at]
    share = np.divide(length[order], whole, out=np.zeros(len(at)), where=whole > 0)[:, None]
    for quantity in range(6):
        one, to = values[order, :, quantity], out[quantity]
        if quantity in (MEAN, TORQUE):
            to[at[first]] = np.add.reduceat(share * one, first)
        elif quantity == RMS:
            to[at[first]] = np.sqrt(np.add.reduceat(share * one**2, first))
        else:
            to[at[first]] = np.maximum.reduceat(one, first)
    return out
