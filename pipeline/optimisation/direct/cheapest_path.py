"""The cheapest way through stages of states: dynamic programming (Viterbi 1967)."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


def cheapest_path(values: Floats, change: Floats, kind: Rows, word: Floats) -> Rows:
    """States of A stages that cost least together.

    Parameters
    ----------
    values : ndarray, shape (A, K)
        Of each state at each stage; infinite where it is not allowed.
    change : ndarray, shape (C, K, K)
        Of going from one state (first) to another, by kind of change.
    kind : ndarray of intp, shape (A,)
        Kind of the change that leads to each stage.
    word : ndarray, shape (A,)
        What any change there costs beside.

    Returns
    -------
    ndarray of intp, shape (A,)
        The lowest states, and the earliest changes, of those that cost the same; infinite in all
        states of a stage, all are given as 0.
    """
    stages, states = values.shape
    before = np.tile(np.arange(states), (stages, 1))
    best = values[0]
    for stage in range(1, stages):
        way = best[:, None] + change[kind[stage]]
        cheapest = way.argmin(axis=0)
        moved = way[cheapest, np.arange(states)] + word[stage]
        before[stage] = np.where(moved < best, cheapest, before[stage])
        best = np.minimum(moved, best) + values[stage]
    path = np.zeros(stages, dtype=np.intp)
    path[-1] = best.argmin()
    for stage in range(stages - 1, 0, -1):
        path[stage - 1] = before[stage, path[stage]]
    return path
