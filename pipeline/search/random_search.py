"""Random search: every individual is drawn evenly from the box, whatever was seen before.

The baseline of every other search (Bergstra and Bengio 2012, Journal of Machine Learning Research
13).  The first population is the Latin hypercube of the others, with the starts that are given.
"""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from pipeline.search.box import Box
from pipeline.search.result import Callback, Cost, SearchResult, SearchSettings, begin


@dataclass(frozen=True, kw_only=True)
class RandomSettings(SearchSettings, section="random"):
    """Settings of random search.

    Parameters
    ----------
    population, generations, limit, stall, stall_gain, seed
        As in :class:`~pipeline.search.result.SearchSettings`; a generation is what is evaluated at
        once.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """


def minimise(
    cost: Cost,
    low: ArrayLike,
    high: ArrayLike,
    settings: RandomSettings,
    *,
    log: ArrayLike | None = None,
    integer: ArrayLike | None = None,
    start: ArrayLike | None = None,
    callback: Callback | None = None,
) -> SearchResult:
    """Least cost of individuals drawn evenly within the bounds.

    Parameters and errors are those of :func:`pipeline.search.genetic.minimise`.
    """
    box = Box.of(low, high, log, integer)
    progress, rng, unit, costs = begin(cost, box, settings, start=start, callback=callback)
    while not (stopped := progress.stopped()):
        unit = rng.random(unit.shape)
        costs = progress.evaluate(unit)
    return progress.result(unit, costs, stopped)
