"""Table of the searches with a population, by name.

All take ``population`` times ``generations`` evaluations, the first population among them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.search import genetic, result, swarm, whale, wolf
from pipeline.search.result import (
    Callback,
    Cost,
    Evolution,
    Progress,
    SearchResult,
    SearchSettings,
)


@dataclass(frozen=True, kw_only=True)
class RandomSettings(SearchSettings, section="random"):
    """Settings of random search, the baseline of every other search (Bergstra and Bengio 2012)."""

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Individuals drawn evenly from the box, whatever was seen before."""
        while True:
            unit = rng.random(unit.shape)
            yield unit, progress.evaluate(unit)


@dataclass(frozen=True, kw_only=True)
class Method:
    """A search as the table knows it."""

    title: str
    """Name in words."""
    source: str
    """Publication."""
    settings: Callable[..., SearchSettings]
    """Makes its settings from those of :class:`~pipeline.search.result.SearchSettings`."""


METHODS: dict[str, Method] = {
    "genetic": Method(
        title="genetic algorithm", source="Deb and Agrawal 1995; Baker 1987",
        # no place kept for an elite: truncation keeps the best, and children are as many as parents
        settings=partial(genetic.GeneticSettings, elite=0),
    ),
    "whale": Method(
        title="whale optimisation", source="Mirjalili and Lewis 2016",
        settings=whale.WhaleSettings,
    ),
    "swarm": Method(
        title="particle swarm", source="Clerc and Kennedy 2002",
        settings=swarm.SwarmSettings,
    ),
    "wolf": Method(
        title="grey wolves", source="Mirjalili, Mirjalili and Lewis 2014",
        settings=wolf.WolfSettings,
    ),
    "random": Method(
        title="random search", source="Bergstra and Bengio 2012",
        settings=RandomSettings,
    ),
}  # fmt: skip
"""Searches by name."""


def minimise(
    name: str, cost: Cost, low: ArrayLike, high: ArrayLike, *, population: int, generations: int,
    seed: int = 0, log: ArrayLike | None = None, integer: ArrayLike | None = None,
    start: ArrayLike | None = None, callback: Callback | None = None,
) -> SearchResult:  # fmt: skip
    """Least cost within the bounds by the search of that name, see :func:`result.minimise`.

    >>> def cost(x):
    ...     return ((x - 0.3) ** 2).sum(axis=1)
    >>> found = minimise("swarm", cost, [0, 0.3], [1, 1], population=8, generations=20)
    >>> found.evaluations, found.bounds_hit(["rate", "depth"])
    (160, {'depth': 'low'})
    """
    if name not in METHODS:
        raise ValueError(f"search {name!r} is not one of {', '.join(METHODS)}")
    settings = METHODS[name].settings(population=population, generations=generations, seed=seed)
    return result.minimise(
        cost, low, high, settings, log=log, integer=integer, start=start, callback=callback
    )
