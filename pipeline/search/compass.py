"""Compass search around a good start (Kolda, Lewis and Torczon 2003).

Each round evaluates both neighbours of the best individual along each axis at once, then the minima
of the parabolas through each three points, all axes together and halfway.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats, Rows
from pipeline.search.box import Box
from pipeline.search.result import Callback, Cost, Progress, SearchResult

SHORTER = 0.25
"""Share of the step that is left when a round over all axes has improved nothing [1]."""
FARTHEST = 4.0
"""Steps that a parabola may lead to."""


def compass(
    cost: Cost,
    low: ArrayLike,
    high: ArrayLike,
    start: ArrayLike,
    *,
    evaluations: int,
    step: float = 0.1,
    log: ArrayLike | None = None,
    callback: Callback | None = None,
) -> SearchResult:
    """Least cost near ``start`` within a number of evaluations; never above the start's.

    ``cost`` gives costs (P,) of individuals (P, D); one that is not finite counts as the worst.
    ``step`` is that of the first round, as a share of the box, above 0 to 1; ``log`` as in
    :meth:`Box.of`; ``callback`` sees each round and may end it.  Generations of the result are
    rounds. Raises ValueError when bounds, start, counts or the cost's answer do not fit together.

    >>> def cost(x):
    ...     return ((x - [0.2, 0.7]) ** 2).sum(axis=1)
    >>> result = compass(cost, [0, 0], [1, 1], [0.5, 0.5], evaluations=7)
    >>> result.x.round(12).tolist(), result.evaluations
    ([0.2, 0.7], 7)
    """
    if evaluations < 1 or not 0 < step <= 1:
        raise ValueError(
            f"compass.evaluations = {evaluations} must be at least 1, and compass.step = {step} "
            "lie above 0, at most 1"
        )
    box = Box.of(low, high, log)
    progress = Progress(cost=cost, box=box, most=evaluations + 1, callback=callback)
    unit = box.unit(start)
    best = float(progress.evaluate(unit)[0])
    place, turn, idle = unit[0], 0, 0
    free = np.flatnonzero(box.high > box.low)
    while not (stopped := progress.stopped()):
        left = evaluations - progress.evaluations
        many = min(len(free), (left - 1) // 2)
        if many < 1 or step < np.finfo(np.float64).eps:
            stopped = "limit"
            break
        axes = np.roll(free, -turn)[:many]
        polled = _neighbours(place, axes, step)
        costs = progress.evaluate(polled)
        minima = _parabola_minima(place, axes, polled, best, costs, step)[: left - len(polled)]
        polled = np.concatenate([polled, minima])
        costs = np.concatenate([costs, progress.evaluate(minima)])
        turn, idle = turn + many, idle + many
        k = int(costs.argmin())
        if costs[k] < best:
            place, best, idle = polled[k], float(costs[k]), 0
        elif idle >= len(free):
            step, idle = SHORTER * step, 0
    return progress.result(place[None], np.array([best]), stopped)


def _neighbours(place: Floats, axes: Rows, step: float) -> Floats:
    """Below and above along each axis, inside the cube; shape (2 N, D)."""
    polled = np.tile(place, (2 * len(axes), 1))
    each = np.arange(len(axes))
    polled[2 * each, axes] = np.maximum(place[axes] - step, 0.0)
    polled[2 * each + 1, axes] = np.minimum(place[axes] + step, 1.0)
    return polled


def _parabola_minima(
    place: Floats, axes: Rows, polled: Floats, best: float, costs: Floats, step: float
) -> Floats:
    """Points with all axes at the minimum of their parabolas, and halfway there; shape (2, D)."""
    each = np.arange(len(axes))
    x = np.stack([polled[2 * each, axes], place[axes], polled[2 * each + 1, axes]])
    f = np.stack([costs[0::2], np.full(len(axes), best), costs[1::2]])
    lowest = x[f.argmin(axis=0), each]
    with np.errstate(all="ignore"):
        left, right = (f[1] - f[0]) / (x[1] - x[0]), (f[2] - f[1]) / (x[2] - x[1])
        bent = (right - left) / (x[2] - x[0])
        vertex = 0.5 * (x[0] + x[1]) - 0.5 * left / bent
    valley = np.isfinite(vertex) & (bent > 0)
    reach = np.clip(vertex, x[1] - FARTHEST * step, x[1] + FARTHEST * step)
    target = np.where(valley, np.clip(reach, 0.0, 1.0), lowest)
    full, half = place.copy(), place.copy()
    full[axes] = target
    half[axes] = 0.5 * (place[axes] + target)
    return np.stack([full, half])
