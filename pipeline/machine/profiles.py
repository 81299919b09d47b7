"""Closed forms of moves with bounded speed, acceleration and jerk."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.control import Floats


def ramp_time(change: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike) -> Floats:
    """Time to change the speed by ``change``, without acceleration before and after [s].

    Examples
    --------
    >>> ramp_time([0.1, 1.0], 2.0, 20.0).round(4).tolist()
    [0.1414, 0.6]
    """
    v, a, j = np.abs(np.asarray(change, float)), np.asarray(acceleration), np.asarray(jerk)
    time: Floats = np.where(v <= a * a / j, 2 * np.sqrt(v / j), v / a + a / j)
    return time


def rest_to_rest(
    distance: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike = np.inf
) -> Floats:
    """Shortest time from standstill to standstill [s].

    Parameters
    ----------
    distance, speed, acceleration, jerk : array_like, broadcast
        At least 0, and positive [m], [m/s], [m/s^2], [m/s^3]; an infinite jerk makes a trapezoid.

    Examples
    --------
    >>> rest_to_rest([0.01, 1.0], 0.5, 2.0).round(4).tolist()
    [0.1414, 2.25]
    """
    d, v, a, j = (
        np.asarray(value, float) for value in (distance, speed, acceleration, jerk)
    )  # fmt: skip
    # the greatest speed that both ramps fit in: v ramp_time(v) = d
    by_jerk = np.cbrt((d / 2) ** 2 * np.where(np.isfinite(j), j, 0.0))
    blunt = a * a / j
    by_acceleration = (np.sqrt(blunt * blunt + 4 * d * a) - blunt) / 2
    top = np.minimum(v, np.where(by_jerk < blunt, by_jerk, by_acceleration))
    ramp = ramp_time(top, a, j)
    time: Floats = 2 * ramp + (d - top * ramp) / np.where(top > 0, top, 1.0)
    return time
