"""Errors of a prediction against what was measured."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def errors(predicted: Floats, measured: Floats) -> dict[str, float | None]:
    """MAE, RMSE and largest absolute error [K] where both are known; None when nowhere.

    Examples
    --------
    >>> errors(np.array([20.0, 24.0]), np.array([21.0, 21.0]))
    {'mae_K': 2.0, 'rmse_K': 2.2361, 'max_K': 3.0}
    """
    difference = predicted - measured
    difference = difference[np.isfinite(difference)]
    if len(difference) == 0:
        return {"mae_K": None, "rmse_K": None, "max_K": None}
    absolute = np.abs(difference)
    return {
        "mae_K": round(float(absolute.mean()), 4),
        "rmse_K": round(float(np.sqrt(np.mean(difference**2))), 4),
        "max_K": round(float(absolute.max()), 4),
    }
