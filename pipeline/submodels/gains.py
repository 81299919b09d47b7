"""Whether a richer model earns its keep on days that it did not see."""

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.05
"""Chance of keeping a richer model that is no better [1]."""


def gains(simple: NDArray[np.float64], rich: NDArray[np.float64]) -> bool:
    """Whether ``rich`` has significantly lower squared errors than ``simple``, day by day.

    A paired one-sided t-test over days: samples within a day hang together, days hardly do.  With
    fewer than three days nothing is significant and the simpler model stays.

    Parameters
    ----------
    simple, rich : ndarray, shape (days,)
        Mean squared errors of the same days, none of them learnt from.
    """
    from scipy.stats import ttest_rel

    if len(simple) < 3 or np.allclose(simple, rich):
        return False
    return bool(ttest_rel(simple, rich, alternative="greater").pvalue < LEVEL)
