"""Spans of time in which a machine was held, and how much of another span they take."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Span = tuple[float, float]


def joined(spans: Sequence[Span]) -> tuple[Span, ...]:
    """Spans without overlap, in order.

    Examples
    --------
    >>> joined([(4.0, 5.0), (1.0, 2.0), (1.5, 3.0)])
    ((1.0, 3.0), (4.0, 5.0))
    """
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return tuple(found)


def stopped_within(stops: Sequence[Span], begin: Floats, end: Floats) -> Floats:
    """How much of the time from ``begin`` to ``end`` lies in ``stops`` [s].

    Parameters
    ----------
    stops : sequence of (float, float)
        In order and without overlap, as :func:`joined` gives them [s].
    begin, end : ndarray, shape (N,)
        [s].
    """
    if not stops:
        return np.zeros_like(begin)
    edges = np.ravel(stops)
    held = np.concatenate([[0.0], np.cumsum(np.diff(edges) * (np.arange(len(edges) - 1) % 2 == 0))])
    within: Floats = np.interp(end, edges, held) - np.interp(begin, edges, held)
    return within
