"""Filters without delay and derivatives of signals on a uniform grid."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REACH = 0.4
"""Of the Gaussian's memory, in periods of its bandwidth: 3 standard deviations."""


def first_difference(q: Floats, period: float) -> Floats:
    """Derivative by central differences of fourth order; the two samples at each end are held."""
    d: Floats = np.empty_like(q)
    d[2:-2] = (8 * (q[3:-1] - q[1:-3]) - (q[4:] - q[:-4])) / (12 * period)
    d[:2], d[-2:] = d[2], d[-3]
    return d


def second_difference(q: Floats, period: float) -> Floats:
    """Second derivative by central differences of fourth order; the ends are held."""
    d: Floats = np.empty_like(q)
    near, far = q[3:-1] + q[1:-3], q[4:] + q[:-4]
    d[2:-2] = (16 * near - far - 30 * q[2:-2]) / (12 * period**2)
    d[:2], d[-2:] = d[2], d[-3]
    return d


def low_passed(values: Floats, period: float, cut: float | None) -> Floats:
    """Butterworth of order 4 at ``cut`` [Hz], forward and backward."""
    if cut is None:
        return values
    from scipy.signal import butter, sosfiltfilt

    sos = butter(4, cut, fs=1 / period, output="sos")
    smooth: Floats = sosfiltfilt(sos, values, padlen=min(len(values) - 1, int(3 / (cut * period))))
    return smooth


def gaussian(places: NDArray[np.int64], samples: int, period: float, bandwidth: float) -> Any:
    """Gaussian filter of -3 dB at ``bandwidth``, asked for at some samples only.

    Its standard deviation is sqrt(ln 2) / (2 pi bandwidth); it ends ``REACH`` / bandwidth away.

    Parameters
    ----------
    places : ndarray of int, shape (N,)
        Samples that are asked for, at least its reach from both ends.
    samples : int
        T of the signals that it is applied to.
    period, bandwidth : float
        Of the samples [s], of the filter [Hz].

    Returns
    -------
    scipy.sparse.csr_array, shape (N, T)
        What signals of shape (T,) or (T, C) are multiplied by.
    """
    from scipy.sparse import csr_array

    half = reach(period, bandwidth)
    offsets = np.arange(-half, half + 1)
    weights = np.exp(-0.5 * (offsets * period * 2 * np.pi * bandwidth) ** 2 / np.log(2))
    weights /= weights.sum()
    columns = (places[:, None] + offsets).ravel()
    starts = np.arange(len(places) + 1) * len(offsets)
    return csr_array((np.tile(weights, len(places)), columns, starts), shape=(len(places), samples))


def reach(period: float, bandwidth: float) -> int:
    """Samples to each side that the Gaussian filter sees."""
    return int(np.ceil(REACH / (bandwidth * period)))


def white_noise(values: Floats) -> float:
    """Variance of the white noise in a smooth signal: fourth differences, or its resolution."""
    d = np.diff(values, 4)
    steps = np.abs(np.diff(values))
    step = float(np.min(steps[steps > 0], initial=np.inf))
    noise = (1.4826 * float(np.median(np.abs(d)))) ** 2 / 70  # 1 + 16 + 36 + 16 + 1
    return max(noise, step**2 / 12 if np.isfinite(step) else 0.0)
