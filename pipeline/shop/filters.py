"""Ramps and lags of signals in time (numba)."""

import numpy as np
from numba import njit


@njit(cache=True)
def slewed(command: np.ndarray, acceleration: float) -> np.ndarray:
    """Speed that follows ``command`` (T,) by at most ``acceleration`` each second, from rest."""
    out = np.empty(command.size)
    now = 0.0
    for i in range(command.size):
        now += min(max(command[i] - now, -acceleration), acceleration)
        out[i] = now
    return out


@njit(cache=True)
def lagged(x: np.ndarray, share: float, start: float) -> np.ndarray:
    """First-order lag of ``x`` (T,): each step closes ``share`` [1] of the distance."""
    out = np.empty(x.size)
    now = start
    for i in range(x.size):
        now += share * (x[i] - now)
        out[i] = now
    return out
