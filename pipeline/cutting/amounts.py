"""Amounts that cannot be negative: times, speeds, powers, prices."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def amounts(
    name: str, values: ArrayLike, *, high: float = np.inf, unknown: bool = False
) -> NDArray[np.float64]:
    """Values as an array, after a look at their range.

    Parameters
    ----------
    name : str
        What they are called, for people.
    values : array_like
        Any shape.
    high : float
        Greatest value that is one; infinity itself is none.
    unknown : bool
        Whether NaN is one, for what is not known.

    Raises
    ------
    ValueError
        When one is negative, infinite, above ``high`` or no number.
    """
    found = np.asarray(values, dtype=np.float64)
    good = (found >= 0.0) & (found <= high) & (found < np.inf)
    if unknown:
        good |= np.isnan(found)
    if not good.all():
        upper = "and finite" if high == np.inf else f"at most {high:g}"
        raise ValueError(f"{name} = {found[~good].flat[0]} must be 0 or more, {upper}")
    return found
