"""What the steps of a sensor leave open of the difference between two predictions' errors.

The error of rounding is the same for as long as the sensor shows one value, and uniform within half
a step from there to there.  So the difference of two mean errors has a standard deviation, and what
lies within 1.96 of it is not decided.
"""

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.verdict import Figures

NORMAL_95 = 1.96


def left_open(
    predicted: Floats, other: Floats, measured: Floats, groups: Ints, step: float
) -> Figures:
    """Difference of MAE and of RMSE of two predictions that rounding leaves open.

    Parameters
    ----------
    predicted, other, measured : ndarray, shape (N,)
        In the order of time within a group.
    groups : ndarray of int, shape (N,)
        Day, recording or tool; a value that is shown does not last from one to the next.
    step : float
        Of the sensor, in the unit of the quantity.

    Examples
    --------
    One value shown all day says of two constant predictions next to nothing:

    >>> day = np.full(100, 21.0)
    >>> left_open(day + 0.3, day - 0.2, day, np.zeros(100, dtype=int), 1.0).mae
    1.13161
    """
    if not len(measured):
        return Figures()
    shown = np.round(measured / step)
    new = (np.diff(shown, prepend=shown[0]) != 0) | (np.diff(groups, prepend=groups[0]) != 0)
    dwell = np.cumsum(new)
    off, others_off = predicted - measured, other - measured

    def width(weight: Floats) -> float:
        sums = np.bincount(dwell, weights=weight)
        return NORMAL_95 * step / np.sqrt(12) * float(np.sqrt((sums**2).sum())) / len(weight)

    roots = float(np.sqrt(np.mean(off**2)) + np.sqrt(np.mean(others_off**2)))
    squares = width(2 * (predicted - other))
    return Figures(
        mae=float(f"{width(np.sign(off) - np.sign(others_off)):.6g}"),
        rmse=float(f"{squares / roots if roots > 0 else 0.0:.6g}"),
    )
