"""What every search shares: how costs are asked for, when it ends, and what it hands back."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from pipeline.search.box import Box

Floats = NDArray[np.float64]
Cost = Callable[[Floats], Floats]
"""Costs, shape (P,), of individuals, shape (P, D)."""
Callback = Callable[[int, Floats, float], bool | None]
"""Called after each generation with its number, the best individual and its cost; True ends."""


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Where a search ended.

    Parameters
    ----------
    x : ndarray, shape (D,)
        The best individual that was ever tried.
    cost : float
        Its cost; infinite when no individual had a finite one.
    evaluations : int
        Individuals whose cost was asked for.
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


@dataclass(frozen=True, kw_only=True)
class Ending:
    """When a search ends.

    Parameters
    ----------
    generations : int
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

    generations: int
    limit: float = -inf
    stall: int | None = None
    stall_gain: float = 0.0
    callback: Callback | None = None


@dataclass(kw_only=True)
class Course:
    """A search under way: what it asked, the best it found, and its history.

    Parameters
    ----------
    cost : callable
        What is to become least.
    box : Box
        What the search walks in, as the unit cube.
    """

    cost: Cost
    box: Box
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
        found = np.array(self.cost(self.box.place(unit)), dtype=np.float64)
        if found.shape != (many,):
            raise ValueError(
                f"cost answered with shape {found.shape} to {many} individuals: "
                f"return one number for each, shape ({many},)"
            )
        known = np.isfinite(found)
        if not known.all():
            found[~known] = inf
            self.failed += many - int(known.sum())
        k = int(found.argmin())
        if found[k] < self.best or not self.evaluations:
            self.best = float(found[k])
            self.x = self.box.place(unit[k : k + 1])[0]
        self.evaluations += many
        return found

    def stopped(self, ending: Ending) -> str:
        """Write a generation into the history; why the search ends with it, or an empty word."""
        self.history.append(self.best)
        done = len(self.history)
        asked = ending.callback is not None and ending.callback(done, self.x.copy(), self.best)
        if self.best <= ending.limit:
            return "limit"
        if asked:
            return "callback"
        if ending.stall is not None and done > ending.stall:
            before = self.history[-1 - ending.stall]
            if not before - self.best > ending.stall_gain:
                return "stall"
        return "generations" if done >= ending.generations else ""

    def result(self, unit: Floats, costs: Floats, stopped: str) -> SearchResult:
        """What is handed back, with the last population, shape (P, D), and its costs."""
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
