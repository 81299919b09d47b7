"""Lagged temperatures and their rates: features of a deformation that follows its heat slowly.

The lag of a quantity x with time constant tau is the answer of tau y' = x - y, an exponential
moving average, exact for an x that runs straight from sample to sample at whatever distances
(Eckner 2012: Algorithms for unevenly spaced time series, EMA with linear interpolation).  The rate
is that over a window which ends now.  Both use no value that is younger than the sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class LaggedFeatures:
    """Columns of features at each sample.

    Parameters
    ----------
    values : ndarray, shape (T, F)
        Temperatures and their lags in the unit of the temperatures, rates in that over s, ambient
        and its lags likewise, speed [rad/s], its square and the lags of that [rad^2/s^2].
    names : tuple of str
        Of the columns: ``T1``, ``T1 lag 600 s``, ``T1 rate 300 s``, ``ambient``, ``speed``,
        ``speed^2``.
    """

    values: Floats
    names: tuple[str, ...]


def lag(time_s: ArrayLike, values: ArrayLike, constant_s: float) -> Floats:
    """Answer of ``constant_s`` y' = x - y that rests at the first sample, shape (T, ...).

    Parameters
    ----------
    time_s : array_like, shape (T,)
        Ascending, at any distances [s].
    values : array_like, shape (T, ...)
        x, in any unit.
    constant_s : float
        Time constant tau [s].

    Raises
    ------
    ValueError
        When the constant is not positive, the times do not ascend, or a value is not finite.

    Examples
    --------
    A ramp is followed at a distance of one time constant:

    >>> lag([0.0, 10.0, 500.0], [0.0, 10.0, 500.0], 20.0).round(6).tolist()
    [0.0, 2.130613, 480.0]
    """
    time, x = _checked(time_s, values, "values")
    _check_constant(constant_s, "lag")
    step = np.diff(time) / constant_s
    decay = np.exp(-step)
    # weights of the older and the younger end of a straight step; they add up to 1 - decay
    younger = np.where(step > 1e-4, 1 + np.expm1(-step) / step, step / 2 - step**2 / 6)
    older = 1 - decay - younger
    ends = (..., *(np.newaxis,) * (x.ndim - 1))
    drive = older[ends] * x[:-1] + younger[ends] * x[1:]
    answer = np.empty_like(x)
    answer[0] = x[0]
    for k in range(len(step)):
        answer[k + 1] = decay[k] * answer[k] + drive[k]
    return answer


def rate(time_s: ArrayLike, values: ArrayLike, window_s: float) -> Floats:
    """Mean rate over the window that ends at each sample, shape (T, ...) [unit of the values / s].

    Before the record the quantity counts as constant: its first value.

    Raises
    ------
    ValueError
        As :func:`lag`.

    Examples
    --------
    >>> rate([0.0, 10.0, 20.0, 30.0], [0.0, 0.0, 4.0, 4.0], 20.0).tolist()
    [0.0, 0.0, 0.2, 0.2]
    """
    time, x = _checked(time_s, values, "values")
    _check_constant(window_s, "rate")
    columns = x.reshape(len(x), -1)
    before = np.stack([np.interp(time - window_s, time, c) for c in columns.T], axis=-1)
    change: Floats = (x - before.reshape(x.shape)) / window_s
    return change


def lagged_features(
    time_s: ArrayLike,
    temperatures: ArrayLike,
    *,
    lags_s: Sequence[float] = (),
    rates_s: Sequence[float] = (),
    ambient: ArrayLike | None = None,
    speed_rad_s: ArrayLike | None = None,
) -> LaggedFeatures:
    """Temperatures, ambient, speed and its square, with their lags and rates.

    Parameters
    ----------
    time_s : array_like, shape (T,)
        Ascending, at any distances [s].
    temperatures : array_like, shape (T, N)
        Of sensors or of groups, in degC or K.
    lags_s, rates_s : sequence of float
        Time constants of the lags and lengths of the windows [s].
    ambient, speed_rad_s : array_like, shape (T,), optional
        Ambient temperature and spindle speed [rad/s], where there are.

    Raises
    ------
    ValueError
        When a constant is not positive, the times do not ascend, or a value is not finite.
    """
    time, measured = _checked(time_s, temperatures, "temperatures")
    if measured.ndim != 2:
        raise ValueError(f"temperatures of shape {measured.shape} must be T times x N columns")
    slow = {f"T{i + 1}": measured[:, i] for i in range(measured.shape[1])}
    found = dict(slow)
    if ambient is not None:
        found["ambient"] = slow["ambient"] = _checked(time, ambient, "ambient")[1]
    if speed_rad_s is not None:
        speed = _checked(time, speed_rad_s, "speed_rad_s")[1]
        found["speed"], found["speed^2"] = speed, speed**2
        slow["speed^2"] = speed**2
    sources = np.stack(list(slow.values()), axis=-1)
    for constant in lags_s:
        columns = lag(time, sources, constant)
        found |= {f"{n} lag {constant:g} s": c for n, c in zip(slow, columns.T, strict=True)}
    for window in rates_s:
        columns = rate(time, measured, window)
        found |= {f"T{i + 1} rate {window:g} s": c for i, c in enumerate(columns.T)}
    return LaggedFeatures(values=np.stack(list(found.values()), axis=-1), names=tuple(found))


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


def _check_constant(value: float, name: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} of {value} s must be finite and positive")
