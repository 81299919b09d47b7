"""Progress of a search: evaluations, stopping criteria and the result."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.search.box import Box

Cost = Callable[[Floats], Floats]
"""Costs, shape (P,), of individuals, shape (P, D)."""
Callback = Callable[[int, Floats, float], bool | None]
"""Called after each generation with its number, the best individual and its cost; True ends."""


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Result of a search.

    Parameters
    ----------
    x : ndarray, shape (D,)
        The best individual that was ever tried.
    cost : float
        Its cost; infinite when no individual had a finite one.
    evaluations : int
        Individuals whose cost was computed.
    failed : int
        Those among them whose cost was not finite; they count as the worst.
    generations : int
        Generations, the first population among them.
    history : ndarray, shape (generations,)
        The best cost up to each generation.
    population : ndarray, shape (P, D)
        Of the last generation, best first.
    costs : ndarray, shape (P,)
        Of ``population``.
    stopped : str
        Why it ended: ``generations``, ``limit``, ``stall`` or ``callback``.
    """

    x: Floats
    cost: float
    evaluations: int
    failed: int
    generations: int
    history: Floats
    population: Floats
    costs: Floats
    stopped: str


@dataclass(kw_only=True)
class Progress:
    """Progress of a search: evaluations, best individual, history and stopping criteria.

    Parameters
    ----------
    cost : callable
        Cost to be minimised.
    box : Box
        Bounds of the search, mapped to the unit cube.
    most : int
        Generations at most, the first population among them.
    limit : float
        A cost at which it is good enough.
    stall : int, optional
        Generations over which the best cost must fall by more than ``stall_gain``.
    stall_gain : float
        In the cost's unit.
    callback : callable, optional
        Sees each generation and may end the search.
    """

    cost: Cost
    box: Box
    most: int
    limit: float = -inf
    stall: int | None = None
    stall_gain: float = 0.0
    callback: Callback | None = None
    x: Floats = field(default_factory=lambda: np.empty(0))
    best: float = inf
    evaluations: int = 0
    failed: int = 0
    history: list[float] = field(default_factory=list)

    def evaluate(self, unit: Floats) -> Floats:
        """Costs, shape (P,), at points of the unit cube, shape (P, D); infinite where they fail.

        Raises
        ------
        ValueError
            When the cost does not answer with one number for each individual.
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
            self.x = self.box.place(unit[k : k + 1])[0]
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
        """Result with the last population, shape (P, D), and its costs."""
        return SearchResult(
            x=self.x,
            cost=self.best,
            evaluations=self.evaluations,
            failed=self.failed,
            generations=len(self.history),
            history=np.array(self.history),
            population=self.box.place(unit),
            costs=costs.copy(),
            stopped=stopped,
        )
