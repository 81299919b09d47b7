"""Features of temperature sensors: groups that warm alike, and lagged temperatures.

Fuzzy c-means (Bezdek: Pattern Recognition with Fuzzy Objective Function Algorithms, 1981) minimises

    J = sum_i sum_c u_ic^2 |x_i - v_c|^2,    sum_c u_ic = 1,

in alternation: u_ic = 1 / sum_k (d_ic / d_ik)^2, and v_c the mean of the points by u_ic^2.

Applied to the sensors of a spindle, each a point whose coordinates are its course in time, the
centre of a cluster is itself a course: the mean temperature of its group.  So a group's temperature
is a fixed weighted mean of the sensors, which needs no clustering when serving.

The lag of a quantity x with time constant tau is the answer of tau y' = x - y, an exponential
moving average, exact for an x that runs straight from sample to sample at whatever distances
(Eckner 2012: Algorithms for unevenly spaced time series, EMA with linear interpolation).  It uses
no value that is younger than the sample: a feature of a deformation that follows its heat slowly.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats

TOLERANCE = 1e-9
"""Move of the centres at which the iteration ends, as a share of the root mean square distance of
the points from their mean [1]."""
ITERATIONS = 1000
"""Greatest number of iterations [1]."""
STARTS = 10
"""Draws of initial centres [1]."""


def fuzzy_c_means(points: ArrayLike, clusters: int, *, seed: int = 0) -> tuple[Floats, Floats]:
    """Centres, shape (C, D), of points, and the membership of each point in each, (N, C).

    J has several minima: of those that ``STARTS`` starts lead to, it is the least. ``points`` (N,
    D) are finite, in one unit; ``seed`` draws the initial centres by k-means++ (Arthur,
    Vassilvitskii 2007). ValueError when the points lie in fewer places than there are clusters.

    Examples
    --------
    >>> centres, _ = fuzzy_c_means([[0.0], [0.1], [5.0], [5.1]], 2)
    >>> np.sort(centres[:, 0]).round(2).tolist()
    [0.05, 5.05]
    """
    x, rng = np.asarray(points, float), np.random.default_rng(seed)
    found = [_at_rest(x, _spread_points(x, clusters, rng)) for _ in range(STARTS)]
    centres = min(found, key=lambda one: objective(x, one))
    return centres, memberships(x, centres)


def objective(x: Floats, centres: Floats) -> float:
    """J of points (N, D) with their best memberships in clusters."""
    square = ((x[:, None] - centres) ** 2).sum(axis=2)
    return float((memberships(x, centres) ** 2 * square).sum())


def _at_rest(x: Floats, centres: Floats) -> Floats:
    """Centres that the iteration from some others ends at."""
    least = TOLERANCE * float(np.sqrt(x.var(axis=0).sum()))
    for _ in range(ITERATIONS):
        weights = memberships(x, centres) ** 2
        moved = (weights.T @ x) / weights.sum(axis=0)[:, None]
        still = np.abs(moved - centres).max() <= least
        centres = moved
        if still:
            break
    return centres


def memberships(x: Floats, centres: Floats) -> Floats:
    """Membership of each point (N, D) in each cluster [1], (N, C); rows add up to 1.

    A point on a centre belongs to it alone, or to the centres that coincide there alike.
    """
    square = ((x[:, None] - centres) ** 2).sum(axis=2)
    nearest = square.min(axis=1, keepdims=True)
    on_centre = square == 0
    near = np.where(nearest > 0, nearest / np.where(on_centre, 1.0, square), on_centre)
    return near / near.sum(axis=1, keepdims=True)


def _spread_points(x: Floats, clusters: int, rng: np.random.Generator) -> Floats:
    """Initial centres of k-means++: each a point, drawn by its squared distance from the others."""
    chosen = [int(rng.integers(len(x)))]
    nearest = np.full(len(x), np.inf)
    while len(chosen) < clusters:
        gap = x - x[chosen[-1]]
        nearest = np.minimum(nearest, np.einsum("nd,nd->n", gap, gap))
        reach = np.cumsum(nearest)
        if reach[-1] == 0:
            raise ValueError(
                f"points lie in {len(chosen)} places for {clusters} clusters: take fewer clusters"
            )
        drawn = int(np.searchsorted(reach, rng.uniform(0, reach[-1]), side="right"))
        chosen.append(min(drawn, int(np.flatnonzero(nearest)[-1])))
    return x[chosen]


def sensor_groups(temperatures: ArrayLike, groups: int = 3, *, seed: int = 0) -> Floats:
    """Weight of each sensor in the temperature of each group, shape (C, N); rows add up to 1.

    Groups are in the order of their mean place, front to rear as the sensors. Each sensor's course
    is centred, which removes a constant offset, but keeps its amplitude: sensors of different
    temperature rise are in different groups. ``temperatures`` (T, N) are training samples [degC] or
    [K] without a gap; ``seed`` is that of the clustering. ValueError when there are fewer sensors
    than groups or fewer than two samples, or the sensors' courses are too few different ones.

    Examples
    --------
    >>> t = np.linspace(0, 1, 50)[:, None]
    >>> found = sensor_groups(20 + t * [9.0, 9.1, 4.0, 4.1, 1.0, 1.1])
    >>> found.argmax(axis=0).tolist()
    [0, 0, 1, 1, 2, 2]
    """
    measured = np.asarray(temperatures, float)
    if measured.shape[1] < groups or len(measured) < 2:
        raise ValueError(
            f"{len(measured)} samples of {measured.shape[1]} sensors for {groups} groups: give "
            "two samples and as many sensors as groups at least"
        )
    # the courses in coordinates of their own span, at most N of them: distances stay
    triangle = np.linalg.qr(measured - measured.mean(axis=0), mode="r") / np.sqrt(len(measured))
    weights = fuzzy_c_means(triangle.T, groups, seed=seed)[1].T ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    places = weights @ np.arange(measured.shape[1])
    return weights[np.argsort(places, kind="stable")]


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
