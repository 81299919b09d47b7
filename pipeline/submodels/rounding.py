"""Uncertainty of the difference of two predictions' errors by a sensor's resolution.

The error of rounding is the same for as long as the sensor shows one value, and uniform within half
a step from there to there.  So the difference of two mean errors has a standard deviation, and what
lies within 1.96 of it is not decided.
"""

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.verdict import Figures, significant

NORMAL_95 = 1.96
FEWEST_VALUES = 5
"""Different values from which on their steps tell a resolution."""
OFF_GRID = 0.05
"""Greatest distance of a value from a grid, in steps [1]."""


def grid_step(values: Floats) -> float:
    """Smallest step between the values of a recorded signal, where they lie on a grid; else 0.

    A signal whose values lie on no grid has a resolution that its samples do not tell.

    Values as recorded, in any unit; what is not finite is left out.

    Examples
    --------
    >>> round(grid_step(0.25 * np.round(8 * np.sin(np.arange(500.0)))), 9)
    0.25
    >>> grid_step(np.sin(np.arange(500.0)))
    0.0
    """
    known = np.asarray(values, dtype=np.float64).ravel()
    known = np.unique(known[np.isfinite(known)])
    if len(known) < FEWEST_VALUES:
        return 0.0
    steps = np.diff(known)
    steps = steps[steps > 1e-9 * max(float(np.abs(known).max()), float(np.ptp(known)))]
    if not len(steps):
        return 0.0
    near = steps[steps < 1.5 * steps.min()]
    step = float(np.median(near))
    step = float(np.mean(steps / np.maximum(np.round(steps / step), 1)))
    off = np.abs(steps / step - np.round(steps / step))
    return step if float(off.max()) < OFF_GRID else 0.0


def left_open(
    predicted: Floats, other: Floats, measured: Floats, groups: Ints, step: float
) -> Figures:
    """Difference of MAE and of RMSE of two predictions that rounding leaves open.

    Samples (N,) in the order of time within a group (day, recording, tool): a value that is shown
    does not last from one to the next; ``step`` is that of the sensor, in the unit of the quantity.

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
        mae=significant(width(np.sign(off) - np.sign(others_off))),
        rmse=significant(squares / roots if roots > 0 else 0.0),
    )
