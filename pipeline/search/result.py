"""The loop of all searches with a population: settings, evaluations, stopping criteria, result."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, NotNegative, Range, Ranged
from pipeline.search.box import Box, Sides, first_population

Cost = Callable[[Floats], Floats]
"""Costs, shape (P,), of individuals, shape (P, D)."""
Evolution = Iterator[tuple[Floats, Floats]]
"""Population after population, (P, D) in the unit cube, with its costs (P,), without an end."""
Callback = Callable[[int, Floats, float], bool | None]
"""Called after each generation with its number, the best individual and its cost; True ends."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings(Ranged, ABC, section="search"):
    """Settings that all methods with a population share."""

    population: Count = 30
    """Number of individuals P."""
    generations: Count = 500
    """Generations at most, the first population among them: P times as many evaluations."""
    limit: Annotated[float, Range(finite=False)] = -inf
    """Cost at which the search ends."""
    stall: Count | None = None
    """Generations without a gain of more than ``stall_gain`` after which the search ends."""
    stall_gain: NotNegative = 0.0
    """Least gain in the cost's unit."""
    seed: Annotated[int, Range(least=0)] = 0
    """Seed of the random numbers."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_whole("population", "generations", "stall", "seed")

    def require_whole(self, *names: str) -> None:
        """Refuse counts that are no whole numbers."""
        for name in names:
            value = getattr(self, name)
            if value is not None and value != int(value):
                raise ValueError(f"{self.section}.{name} = {value} must be a whole number")

    @abstractmethod
    def evolution(
        self, progress: "Progress", rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> "Evolution":
        """Populations that follow the first one, shape (P, D) in the unit cube, with costs (P,)."""


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Result of a search."""

    x: Floats
    """The best individual that was ever tried; shape (D,)."""
    cost: float
    """Cost of ``x``; infinite when no individual had a finite one."""
    evaluations: int
    """Individuals whose cost was computed."""
    failed: int
    """Evaluations whose cost was not finite; they count as the worst."""
    generations: int
    """Generations, the first population among them."""
    history: Floats
    """The best cost up to each generation; shape (generations,)."""
    population: Floats
    """Individuals of the last generation, best first; shape (P, D)."""
    costs: Floats
    """Costs of ``population``; shape (P,)."""
    stopped: str
    """Reason of the end: ``generations``, ``limit``, ``stall`` or ``callback``."""
    at_bounds: Sides
    """-1 for each parameter of ``x`` at its lower bound, 1 at its upper one, else 0, also for one
    that is held: a bound that was hit says that a better value may lie outside the box;
    shape (D,)."""

    def bounds_hit(self, names: Sequence[str]) -> dict[str, str]:
        """``low`` or ``high`` for each parameter of the best individual at a bound, by its name."""
        if len(names) != len(self.at_bounds):
            raise ValueError(
                f"{len(names)} names for {len(self.at_bounds)} parameters: give one for each"
            )
        sides = zip(names, self.at_bounds.tolist(), strict=True)
        return {name: "low" if side < 0 else "high" for name, side in sides if side}


@dataclass(kw_only=True)
class Progress:
    """Progress of a search: evaluations, best individual, history and stopping criteria."""

    cost: Cost
    """Cost to be minimised."""
    box: Box
    """Bounds of the search, mapped to the unit cube."""
    most: int
    """Generations at most, the first population among them."""
    limit: float = -inf
    """A cost at which it is good enough."""
    stall: int | None = None
    """Generations over which the best cost must fall by more than ``stall_gain``."""
    stall_gain: float = 0.0
    """Least gain in the cost's unit."""
    callback: Callback | None = None
    """Sees each generation and may end the search."""
    x: Floats = field(default_factory=lambda: np.empty(0))
    unit: Floats = field(default_factory=lambda: np.empty(0))
    """The best individual so far, in the parameters' units and in the unit cube; shape (D,)."""
    best: float = inf
    """Cost of the best."""
    evaluations: int = 0
    failed: int = 0
    """Individuals so far, and those among them whose cost was not finite."""
    history: list[float] = field(default_factory=list)
    """The best cost up to each generation."""

    def evaluate(self, unit: Floats) -> Floats:
        """Costs, shape (P,), at points of the unit cube, shape (P, D); infinite where they fail.

        Raises ValueError when the cost does not answer with one number for each individual.
        """
        many = len(unit)
        costs = np.array(self.cost(self.box.place(unit)), dtype=np.float64)
        if costs.shape != (many,):
            raise ValueError(
                f"cost answered with shape {costs.shape} to {many} individuals: "
                f"return one number for each, shape ({many},)"
            )
        finite = np.isfinite(costs)
        if not finite.all():
            costs[~finite] = inf
            self.failed += many - int(finite.sum())
        k = int(costs.argmin())
        if costs[k] < self.best or not self.evaluations:
            self.best = float(costs[k])
            self.unit = unit[k].copy()
            self.x = self.box.place(self.unit[None])[0]
        self.evaluations += many
        return costs

    def stopped(self) -> str:
        """Add a generation to the history; the reason why the search ends with it, or ""."""
        self.history.append(self.best)
        done = len(self.history)
        interrupted = self.callback and self.callback(done, self.x.copy(), self.best)
        if self.best <= self.limit:
            return "limit"
        if interrupted:
            return "callback"
        if self.stall is not None and done > self.stall:
            before = self.history[-1 - self.stall]
            if not before - self.best > self.stall_gain:
                return "stall"
        return "generations" if done >= self.most else ""

    def result(self, unit: Floats, costs: Floats, stopped: str) -> SearchResult:
        """Result with the last population, shape (P, D), and its costs, sorted by them."""
        order = costs.argsort(kind="stable")
        return SearchResult(
            x=self.x,
            cost=self.best,
            evaluations=self.evaluations,
            failed=self.failed,
            generations=len(self.history),
            history=np.array(self.history),
            population=self.box.place(unit[order]),
            costs=costs[order],
            stopped=stopped,
            at_bounds=self.box.at_bounds(self.x),
        )


def minimise(
    cost: Cost, low: ArrayLike, high: ArrayLike, settings: SearchSettings, *,
    log: ArrayLike | None = None, integer: ArrayLike | None = None,
    start: ArrayLike | None = None, callback: Callback | None = None,
) -> SearchResult:  # fmt: skip
    """Least cost within the bounds by the method of the settings.

    ``cost`` gives costs (P,) of individuals (P, D), one that is not finite counting as the worst;
    ``low`` and ``high`` (D,) are bounds in the parameters' units; ``log`` and ``integer``:
    parameters on a logarithmic scale, in whole numbers, (D,) or one for all; ``start`` (K, D):
    individuals of the first population, the others by Latin hypercube; ``callback`` gets the
    generation's number, the best individual and its cost, and ends the search by True.  Raises
    ValueError when bounds, start or the cost's answer do not fit together.
    """
    box = Box.of(low, high, log, integer)
    progress = Progress(
        cost=cost, box=box, most=settings.generations, limit=settings.limit, stall=settings.stall,
        stall_gain=settings.stall_gain, callback=callback,
    )  # fmt: skip
    rng = np.random.default_rng(settings.seed)
    setting = f"{settings.section}.population"
    unit = first_population(box, settings.population, start, rng, setting=setting)
    costs = progress.evaluate(unit)
    evolution = settings.evolution(progress, rng, unit, costs)
    while not (stopped := progress.stopped()):
        unit, costs = next(evolution)
    return progress.result(unit, costs, stopped)
