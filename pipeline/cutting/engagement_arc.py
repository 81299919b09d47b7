"""The arc of engagement that people speak of: where a tooth enters the material, and leaves it."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def engaged_arc(depth: NDArray[np.floating]) -> tuple[Floats, Floats]:
    """Entry and exit of the longest engaged arc.

    Parameters
    ----------
    depth : ndarray, shape (N, F)
        Height engaged at angles (k + 1/2) 2 pi / F, mean over the angle's width [m].

    Returns
    -------
    ndarray, shape (N,)
        Entry phi_st, 0 to 2 pi [rad]; NaN where nothing is engaged.
    ndarray, shape (N,)
        Exit phi_ex, above the entry by at most 2 pi [rad].

    Notes
    -----
    The first and the last angle of an arc are engaged in part: by as much of their width, seen
    along the feed, as their depth is of their neighbour's.

    Examples
    --------
    >>> begin, end = engaged_arc(np.array([[2.0, 2.0, 1.0, 0, 0, 0, 0, 0]]))
    >>> np.degrees(end - begin).round(2)
    array([110.7])
    """
    many, bins = depth.shape
    on = depth > 0
    run, longest, last = (np.zeros(many, np.int64) for _ in range(3))
    for k in range(2 * bins):
        run = np.where(on[:, k % bins], run + 1, 0)
        better = np.minimum(run, bins) > longest
        longest[better], last[better] = run[better], k
    row, first = np.arange(many), last - longest + 1
    inner = longest > 1
    begin = _within(first % bins, _missing(depth, row, first, first + inner), bins)
    end = _within(last % bins, 1 - _missing(depth, row, last, last - inner), bins)
    end += np.where(end < begin, 2 * np.pi, 0.0)
    none, full = longest == 0, longest == bins
    entry = np.where(none, np.nan, np.where(full, 0.0, begin))
    return entry, np.where(none, np.nan, np.where(full, 2 * np.pi, end))


def _within(at: Indices, share: Floats, bins: int) -> Floats:
    """Angle within the width of angle ``at`` with a share of it, seen along the feed, before it."""
    width = 2 * np.pi / bins
    begin, end = np.cos(at * width), np.cos((at + 1) * width)
    front = np.arccos(np.clip(begin + share * (end - begin), -1, 1))
    angle: Floats = np.where(at * width < np.pi, front, 2 * np.pi - front)
    return angle


def _missing(depth: NDArray[np.floating], row: Indices, at: Indices, beside: Indices) -> Floats:
    """Part of an angle's width that is not engaged [1]."""
    bins = depth.shape[1]
    here, there = depth[row, at % bins], depth[row, beside % bins]
    share = np.divide(here, there, out=np.ones(len(row)), where=there > 0)
    missing: Floats = 1 - np.minimum(share, 1.0)
    return missing
