"""Table of the searches with a population, so that one can be chosen by its name.

All take the same budget: ``population`` times ``generations`` evaluations, the first population
among them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from numpy.typing import ArrayLike

from pipeline.search import genetic, random_search, swarm, whale, wolf
from pipeline.search.result import Callback, Cost, SearchResult, SearchSettings


@dataclass(frozen=True, kw_only=True)
class Method:
    """A search as the table knows it."""

    title: str
    """Name in words."""
    source: str
    """Where it was published."""
    settings: Callable[..., SearchSettings]
    """Makes its settings from those of :class:`~pipeline.search.result.SearchSettings`."""
    minimise: Callable[..., SearchResult]
    """The search, with the interface of :func:`pipeline.search.genetic.minimise`."""


METHODS: dict[str, Method] = {
    "genetic": Method(
        title="genetic algorithm", source="Deb and Agrawal 1995; Baker 1987",
        # no place kept for an elite: truncation keeps the best, and children are as many as parents
        settings=partial(genetic.GeneticSettings, elite=0), minimise=genetic.minimise,
    ),
    "whale": Method(
        title="whale optimisation", source="Mirjalili and Lewis 2016",
        settings=whale.WhaleSettings, minimise=whale.minimise,
    ),
    "swarm": Method(
        title="particle swarm", source="Clerc and Kennedy 2002",
        settings=swarm.SwarmSettings, minimise=swarm.minimise,
    ),
    "wolf": Method(
        title="grey wolves", source="Mirjalili, Mirjalili and Lewis 2014",
        settings=wolf.WolfSettings, minimise=wolf.minimise,
    ),
    "random": Method(
        title="random search", source="Bergstra and Bengio 2012",
        settings=random_search.RandomSettings, minimise=random_search.minimise,
    ),
}  # fmt: skip
"""Searches by name."""


def minimise(
    name: str,
    cost: Cost,
    low: ArrayLike,
    high: ArrayLike,
    *,
    population: int,
    generations: int,
    seed: int = 0,
    log: ArrayLike | None = None,
    integer: ArrayLike | None = None,
    start: ArrayLike | None = None,
    callback: Callback | None = None,
) -> SearchResult:
    """Least cost within the bounds by the search of that name, with its default settings.

    Parameters
    ----------
    name : str
        ``genetic``, ``whale``, ``swarm``, ``wolf`` or ``random``.
    cost, low, high, log, integer, start, callback
        As in :func:`pipeline.search.genetic.minimise`.
    population, generations, seed : int
        Budget, and seed of the random numbers.

    Raises
    ------
    ValueError
        When there is no search of that name, or the rest does not fit together.

    Examples
    --------
    >>> def cost(x):
    ...     return ((x - 0.3) ** 2).sum(axis=1)
    >>> result = minimise("swarm", cost, [0, 0.3], [1, 1], population=8, generations=20)
    >>> result.evaluations, result.bounds_hit(["rate", "depth"])
    (160, {'depth': 'low'})
    """
    if name not in METHODS:
        raise ValueError(f"search {name!r} is not one of {', '.join(METHODS)}")
    method = METHODS[name]
    settings = method.settings(population=population, generations=generations, seed=seed)
    return method.minimise(
        cost, low, high, settings, log=log, integer=integer, start=start, callback=callback
    )
