"""Another planner, slow and simple: the speed on a fine grid of the path, integrated.

Speed limits are put on the grid's cells and corners, the acceleration is kept from point to point
backwards and forwards, and time is the sum of ds / v.  It shares no code with the planner.
"""

import numpy as np

from tests.machine.random_programs import Bounds


def polyline_time(points: np.ndarray, feed: float, bounds: Bounds, arc: np.ndarray) -> float:
    """Time along a polyline, shape (N, 3) [m], at ``feed`` [m/s]; standstill at both ends.

    Parameters
    ----------
    bounds : Bounds
        Its ``acceleration`` is that along the path [m/s^2].
    arc : (3,) array
        What the jumps at the corners may come to [m/s^2].
    """
    steps = np.diff(points, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    unit = steps / sizes[:, None]
    with np.errstate(divide="ignore"):
        cap = np.minimum(feed, (bounds.speed / np.abs(unit)).min(axis=1))
        acceleration = (bounds.acceleration / np.abs(unit)).min(axis=1)
    corner = np.full(len(points), np.inf)
    for k in range(1, len(unit)):
        change = np.abs(unit[k] - unit[k - 1])
        for i in np.flatnonzero(change > 1e-9):
            corner[k] = min(corner[k], bounds.jump[i] / change[i])
            for block in (k - 1, k):
                by_speed = np.sqrt(arc[i] * sizes[block] / change[i])
                by_time = arc[i] * sizes[block] / bounds.jump[i]
                cap[block] = min(cap[block], max(by_speed, by_time))
    corner[[0, -1]] = 0
    speed, fall, ds = _grid(sizes, cap, corner, acceleration)
    for k in range(len(speed) - 2, -1, -1):
        speed[k] = min(speed[k], np.sqrt(speed[k + 1] ** 2 + 2 * fall[k] * ds[k]))
    for k in range(len(speed) - 1):
        speed[k + 1] = min(speed[k + 1], np.sqrt(speed[k] ** 2 + 2 * fall[k] * ds[k]))
    return float((2 * ds / (speed[1:] + speed[:-1])).sum())


def _grid(sizes, cap, corner, acceleration, cells=400):
    """Speeds at the points of a grid, acceleration and size of its cells."""
    ds = np.repeat(sizes / cells, cells)
    speed = np.empty(len(ds) + 1)
    speed[:-1] = np.repeat(cap, cells)
    speed[-1] = cap[-1]
    joints = np.arange(len(sizes) + 1) * cells
    padded = np.concatenate([[np.inf], cap, [np.inf]])
    speed[joints] = np.minimum(corner, np.minimum(padded[:-1], padded[1:]))
    return speed, np.repeat(acceleration, cells), ds
