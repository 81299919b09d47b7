"""A front of answers to several objectives: the genetic algorithm NSGA-II.

Deb, Pratap, Agarwal and Meyarivan 2002 (IEEE Transactions on Evolutionary Computation 6(2)):
parents and children together are sorted by constrained domination, and within a front by how free
each stands, and the better half goes on.  Crossover and mutation are those of
:mod:`pipeline.search.breeding`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.search.box import Box
from pipeline.search.breeding import bred, mutation_rate
from pipeline.search.dominance import crowded_tournament, ranks, survivors
from pipeline.search.first import first_population
from pipeline.search.front_settings import FrontSettings

__all__ = ["FrontResult", "FrontSettings", "front"]

Floats = NDArray[np.float64]
Judge = Callable[[Floats], tuple[Floats, Floats]]
"""Objectives, shape (P, O), and violations, shape (P,), of individuals, shape (P, D)."""
FrontCallback = Callable[[int, Floats, Floats], bool | None]
"""Called after each generation with its number, and x (F, D) and objectives (F, O) of its front."""


@dataclass(frozen=True, kw_only=True)
class FrontResult:
    """Where the search ended.

    Parameters
    ----------
    x : ndarray, shape (F, D)
        Members of the last generation that none dominates, each once, by their first objective.
    objectives : ndarray, shape (F, O)
        Theirs.
    violation : ndarray, shape (F,)
        Theirs: 0, or all the same where no individual keeps its limits.
    evaluations, failed : int
        Individuals that were judged, and those among them with an objective that is not finite.
    generations : int
        The first population among them.
    stopped : str
        Why it ended: ``generations`` or ``callback``.
    """

    x: Floats = field(repr=False)
    objectives: Floats = field(repr=False)
    violation: Floats = field(repr=False)
    evaluations: int
    failed: int
    generations: int
    stopped: str


def front(
    judge: Judge,
    low: ArrayLike,
    high: ArrayLike,
    settings: FrontSettings,
    *,
    log: ArrayLike | None = None,
    start: ArrayLike | None = None,
    callback: FrontCallback | None = None,
) -> FrontResult:
    """The answers that no other is found to dominate, within the bounds.

    Parameters
    ----------
    judge : callable
        Objectives, shape (P, O), all to become least, and violations, shape (P,), of individuals,
        shape (P, D); one with an objective that is not finite counts as the worst.
    low, high : array_like, shape (D,)
        Bounds, in the parameters' units; no individual leaves them.
    settings : FrontSettings
        How it searches.
    log : array_like of bool, optional
        Which parameters are searched on a logarithmic scale, shape (D,), or one answer for all.
    start : array_like, shape (K, D), optional
        Individuals of the first population; the others fill the box evenly (Latin hypercube).
    callback : callable, optional
        Called after each generation with its number and its front; True ends the search.

    Raises
    ------
    ValueError
        When bounds, start or what the judge answers do not fit together.

    Examples
    --------
    >>> def judge(x):
    ...     return np.stack([x[:, 0] ** 2, (x[:, 0] - 2) ** 2], axis=1), np.zeros(len(x))
    >>> found = front(judge, [-10.0], [10.0], FrontSettings(population=20, generations=60))
    >>> len(found.x), bool(found.x.min() > -0.01), bool(found.x.max() < 2.01)
    (20, True, True)
    """
    box = Box.of(low, high, log)
    bench = _Bench(judge, box)
    rng = np.random.default_rng(settings.seed)
    unit = first_population(
        box, settings.population, start, rng, setting="the population of the front"
    )
    alive = bench.judged(unit).best(settings.population)
    done, stopped = 1, ""
    while not stopped:
        if callback is not None and callback(done, *_front(alive, box)[:2]):
            stopped = "callback"
        elif done >= settings.generations:
            stopped = "generations"
        else:
            children = _children(alive, settings, rng)
            alive = alive.joined(bench.judged(children)).best(settings.population)
            done += 1
    x, objectives, violation = _front(alive, box)
    return FrontResult(
        x=x, objectives=objectives, violation=violation, evaluations=bench.evaluations,
        failed=bench.failed, generations=done, stopped=stopped,
    )  # fmt: skip


@dataclass(frozen=True)
class _Population:
    """P individuals in the unit cube, their objectives and violations, and how free they stand."""

    unit: Floats
    objectives: Floats
    violation: Floats
    room: Floats

    def joined(self, other: "_Population") -> "_Population":
        return _Population(
            *(
                np.concatenate([mine, theirs])
                for mine, theirs in (
                    (self.unit, other.unit),
                    (self.objectives, other.objectives),
                    (self.violation, other.violation),
                    (self.room, other.room),
                )
            )
        )

    def best(self, many: int) -> "_Population":
        """The ``many`` best, best first."""
        stay, room = survivors(self.objectives, self.violation, many)
        return _Population(self.unit[stay], self.objectives[stay], self.violation[stay], room)


def _children(alive: _Population, settings: FrontSettings, rng: np.random.Generator) -> Floats:
    """As many children as there are parents, shape (P, D), in the unit cube."""
    many, genes = alive.unit.shape
    parents = crowded_tournament(
        alive.objectives, alive.violation, alive.room, 2 * ((many + 1) // 2), rng
    )
    breeding = settings.breeding
    rate = mutation_rate(genes, breeding)
    return bred(alive.unit[parents], breeding.crossover_rate, rate, breeding, rng)[:many]


@dataclass
class _Bench:
    """Where individuals are judged, and counted."""

    judge: Judge
    box: Box
    evaluations: int = 0
    failed: int = 0

    def judged(self, unit: Floats) -> _Population:
        objectives, violation = self.judge(self.box.place(unit))
        objectives = np.array(objectives, dtype=np.float64)
        violation = np.array(violation, dtype=np.float64)
        many = len(unit)
        if objectives.ndim != 2 or len(objectives) != many or violation.shape != (many,):
            raise ValueError(
                f"the judge answered with objectives of shape {objectives.shape} and violations "
                f"of shape {violation.shape} to {many} individuals: return shapes "
                f"({many}, O) and ({many},)"
            )
        lost = ~np.isfinite(objectives).all(axis=1) | np.isnan(violation)
        objectives[lost], violation[lost] = np.inf, np.inf
        self.evaluations += many
        self.failed += int(lost.sum())
        return _Population(unit, objectives, violation, np.zeros(many))


def _front(alive: _Population, box: Box) -> tuple[Floats, Floats, Floats]:
    """x, objectives and violations of those that none dominates, each once."""
    first = (ranks(alive.objectives, alive.violation) == 0).nonzero()[0]
    x = box.place(alive.unit[first])
    _, once = np.unique(x, axis=0, return_index=True)
    members = first[once]
    by_first = np.lexsort((*x[once].T, *alive.objectives[members].T[::-1]))
    members = members[by_first]
    return x[once][by_first], alive.objectives[members], alive.violation[members]
