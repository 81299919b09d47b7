"""Lagged temperatures: features of a deformation that follows its heat slowly.

The lag of a quantity x with time constant tau is the answer of tau y' = x - y, an exponential
moving average, exact for an x that runs straight from sample to sample at whatever distances
(Eckner 2012: Algorithms for unevenly spaced time series, EMA with linear interpolation).  It uses
no value that is younger than the sample.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats


def lag(time_s: ArrayLike, values: ArrayLike, constant_s: float) -> Floats:
    """Answer of ``constant_s`` y' = x - y that rests at the first sample, shape (T, ...).

    ValueError when the constant is not positive, the times do not ascend, or a value is not finite.

    Parameters
    ----------
    time_s : array_like, shape (T,)
        Ascending, at any distances [s].
    values : array_like, shape (T, ...)
        x, in any unit.
    constant_s : float
        Time constant tau [s].

    Examples
    --------
    A ramp is followed at a distance of one time constant:

    >>> lag([0.0, 10.0, 500.0], [0.0, 10.0, 500.0], 20.0).round(6).tolist()
    [0.0, 2.130613, 480.0]
    """
    from pipeline.thermal.recursion import follow

    time, x = _checked(time_s, values, "values")
    if not (np.isfinite(constant_s) and constant_s > 0):
        raise ValueError(f"lag of {constant_s} s must be finite and positive")
    step = np.diff(time) / constant_s
    decay = np.exp(-step)
    # weights of the older and the younger end of a straight step; they add up to 1 - decay
    younger = np.where(step > 1e-4, 1 + np.expm1(-step) / step, step / 2 - step**2 / 6)
    older = 1 - decay - younger
    ends = (..., *(np.newaxis,) * (x.ndim - 1))
    drive = older[ends] * x[:-1] + younger[ends] * x[1:]
    answer = np.empty((len(x), x[0].size))
    answer[0] = x[0].ravel()
    follow(decay, np.ascontiguousarray(drive).reshape(len(step), x[0].size), answer)
    return answer.reshape(x.shape)


def _checked(time_s: ArrayLike, values: ArrayLike, name: str) -> tuple[Floats, Floats]:
    time, x = np.asarray(time_s, float), np.asarray(values, float)
    if time.ndim != 1 or len(time) == 0 or len(x) != len(time):
        raise ValueError(f"{name} of shape {x.shape} must have a row for each of {time.size} times")
    if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        k = int(np.argmin(np.concatenate([[True], np.diff(time) > 0]) & np.isfinite(time)))
        raise ValueError(
            f"time_s[{k}] = {time[k]} s must be finite and later than the sample before it: sort "
            "the record and drop what stands in it twice"
        )
    if not np.isfinite(x).all():
        row, *rest = (int(i) for i in np.argwhere(~np.isfinite(x))[0])
        place = ", ".join(str(i) for i in (row, *rest))
        raise ValueError(
            f"{name}[{place}] = {x[(row, *rest)]} at {time[row]:g} s must be finite: fill the gap, "
            "leave the column out, or split the record there"
        )
    return time, x
