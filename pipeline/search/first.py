"""The population that a search begins with."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.search.box import Box

Floats = NDArray[np.float64]


def first_population(
    box: Box, many: int, start: ArrayLike | None, rng: np.random.Generator, *, setting: str
) -> Floats:
    """``start``, then a Latin hypercube, in the unit cube; shape (many, D).

    Parameters
    ----------
    box : Box
        What is searched.
    many : int
        Individuals.
    start : array_like, shape (K, D), optional
        Those that are given, in the parameters' units.
    rng : numpy.random.Generator
        Source of chance.
    setting : str
        Name under which the user set ``many``, for the message.

    Raises
    ------
    ValueError
        When there are more of ``start`` than places, or one lies outside the box.
    """
    given = np.empty((0, len(box))) if start is None else box.unit(start)
    if len(given) > many:
        raise ValueError(
            f"start has {len(given)} individuals, more than the population of {many}: "
            f"give fewer, or raise {setting}"
        )
    free = many - len(given)
    strata = rng.permuted(np.tile(np.arange(free), (len(box), 1)), axis=1).T
    return np.concatenate([given, (strata + rng.random((free, len(box)))) / max(free, 1)])
