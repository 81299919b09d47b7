"""A genetic algorithm over real numbers, all individuals of a generation at once.

Selection, crossover and mutation are functions of arrays in :mod:`pipeline.search.selection`,
:mod:`~pipeline.search.crossover` and :mod:`~pipeline.search.mutation`;
:mod:`~pipeline.search.breeding` puts them together.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.search.box import Box
from pipeline.search.breeding import offspring
from pipeline.search.first import first_population
from pipeline.search.genetic_settings import GeneticSettings
from pipeline.search.result import Callback, Cost, Course, Ending, SearchResult

__all__ = ["GeneticSettings", "SearchResult", "minimise"]

Floats = NDArray[np.float64]


def minimise(
    cost: Cost,
    low: ArrayLike,
    high: ArrayLike,
    settings: GeneticSettings,
    *,
    log: ArrayLike | None = None,
    start: ArrayLike | None = None,
    callback: Callback | None = None,
) -> SearchResult:
    """The least cost that the genetic algorithm finds within the bounds.

    Parameters
    ----------
    cost : callable
        Costs, shape (P,), of individuals, shape (P, D); one that is not finite counts as the worst.
    low, high : array_like, shape (D,)
        Bounds, in the parameters' units; no individual leaves them.
    settings : GeneticSettings
        How it searches.
    log : array_like of bool, optional
        Which parameters are searched on a logarithmic scale, shape (D,), or one answer for all.
    start : array_like, shape (K, D), optional
        Individuals of the first population; the others fill the box evenly (Latin hypercube).
    callback : callable, optional
        Called after each generation with its number, the best individual and its cost; True ends
        the search.

    Raises
    ------
    ValueError
        When bounds, start or the cost's answer do not fit together.

    Examples
    --------
    >>> def cost(x):
    ...     return (x[:, 0] - 3.0) ** 2 + (np.log10(x[:, 1]) + 4.0) ** 2
    >>> found = minimise(cost, [0, 1e-6], [10, 1], GeneticSettings(), log=[False, True])
    >>> bool(abs(found.x[0] - 3) < 0.01), bool(abs(found.x[1] - 1e-4) < 1e-6), found.evaluations
    (True, True, 6301)
    """
    box = Box.of(low, high, log)
    course = Course(cost=cost, box=box)
    ending = Ending(
        generations=settings.generations, limit=settings.limit, stall=settings.stall,
        stall_gain=settings.stall_gain, callback=callback,
    )  # fmt: skip
    rng = np.random.default_rng(settings.seed)
    unit = first_population(box, settings.population, start, rng, setting="genetic.population")
    costs = course.evaluate(unit)
    unit, costs = _best(unit, costs, settings.population)
    while not (stopped := course.stopped(ending)):
        children = offspring(unit, costs, settings, rng)
        unit, costs = _survivors(unit, costs, children, course.evaluate(children), settings)
    return course.result(unit, costs, stopped)


def _survivors(
    unit: Floats, costs: Floats, children: Floats, theirs: Floats, settings: GeneticSettings
) -> tuple[Floats, Floats]:
    """The next population and its costs, best first."""
    stay = len(unit) if settings.survival == "truncation" else len(unit) - len(children)
    joined = np.concatenate([unit[:stay], children])
    return _best(joined, np.concatenate([costs[:stay], theirs]), len(unit))


def _best(unit: Floats, costs: Floats, many: int) -> tuple[Floats, Floats]:
    order = costs.argsort(kind="stable")[:many]
    return unit.take(order, axis=0), costs.take(order)
