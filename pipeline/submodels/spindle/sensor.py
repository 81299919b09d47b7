"""Resolution of a spindle's temperature sensor, from what it shows."""

import numpy as np

from pipeline.schema.arrays import Floats


def sensor_step(measured: Floats) -> float:
    """Step between the values that a sensor shows [K]: those it shows for 1 % of the time or more.

    Values between them are of the interpolation between two observations.

    Examples
    --------
    >>> sensor_step(np.array([20.0] * 50 + [20.3, 20.7] + [21.0] * 50))
    1.0
    """
    values, count = np.unique(np.round(measured[np.isfinite(measured)], 3), return_counts=True)
    often = values[count >= 0.01 * count.sum()]
    steps = np.diff(often if len(often) > 1 else values)
    return float(round(steps.min(), 3)) if len(steps) else 0.0
