"""Classes of stations that chatter alike, and the cuts that stand for each.

Where a station's arc, its direction of feed and its radial coefficient lie between two marks of a
scale, the depth limit is looked at for both marks of each.  One mark alone, be it that of more
material, will not do: what the teeth of an arc do to the tool cancels in part, so that a wider arc
may allow many times the depth of the true one.
"""

from itertools import product
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.immersions import Immersions

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
SHARES = 32
"""Marks of the radial coefficient in one tangential one."""
_SLACK = 1e-6
"""Of a step: what lies on a mark stays there."""

Corner = tuple[float, float, float, int]
"""Entry, exit, direction of feed [rad], and marks of the radial coefficient above the tool's."""


def classes(stations: Immersions, radial: Floats, step: float) -> Indices:
    """Class of each station: what it has in common with those judged by the same cuts.

    Parameters
    ----------
    stations : Immersions
        N of them.
    radial : ndarray, shape (N, 2)
        Least and greatest radial coefficient less that of the tool's side, over the tangential one.
    step : float
        Between two marks of an arc's ends [rad]; those of the feed are half as far apart.

    Returns
    -------
    ndarray, shape (N, 10)
        Tool, spindle, then the marks below and above entry, exit, feed and radial coefficient.
    """
    feed = np.mod(stations.feed_direction, pi)  # the opposite feed is the same
    return np.column_stack([
        stations.tool,
        stations.direction,
        _below(stations.entry, step),
        _above(np.minimum(stations.entry + stations.bin, pi), step),
        _below(np.maximum(stations.exit - stations.bin, 0.0), step),
        _above(stations.exit, step),
        _below(feed, step / 2),
        _above(feed, step / 2),
        _below(radial[:, 0], 1 / SHARES),
        _above(radial[:, 1], 1 / SHARES),
    ]).astype(np.int64)  # fmt: skip


def corners(marks: list[int], step: float) -> list[Corner]:
    """The cuts that stand for a class, from its columns after tool and spindle."""
    entries, exits, feeds, shares = (sorted(set(marks[k : k + 2])) for k in (0, 2, 4, 6))
    whole = round(2 * pi / step) if abs(2 * pi / step - round(2 * pi / step)) < _SLACK else 0
    found = [
        (entry, exit, feed * step / 2, share)
        for entry, exit in _arcs(entries, exits, step)
        for feed, share in product((f % whole if whole else f for f in feeds), shares)
    ]
    return list(dict.fromkeys(found))


def _arcs(entries: list[int], exits: list[int], step: float) -> list[tuple[float, float]]:
    """Arcs from each entry to each exit."""
    turned = [(a * step, min(b * step, pi)) for a, b in product(entries, exits)]
    return [(entry, exit) for entry, exit in turned if exit - entry > _SLACK * step]


def _below(value: ArrayLike, step: float) -> Floats:
    mark: Floats = np.floor(np.asarray(value) / step + _SLACK)
    return mark


def _above(value: ArrayLike, step: float) -> Floats:
    mark: Floats = np.ceil(np.asarray(value) / step - _SLACK)
    return mark
