"""What an answer is measured against: the program as it is, and searches that begin anywhere."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.optimisation.direct.block_model import column
from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.groups import Groups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.search.fitness import Fitness
from pipeline.optimisation.search.shares import Shares, speed_ranges
from pipeline.optimisation.settings import Objective, SearchSettings
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Callback = Callable[[int, Floats, float], bool | None]

WEIGHT = 1.0
"""Of a penalty: passing one row's limit once over costs as much as the whole program."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """What one way to choose F and S comes to.

    Parameters
    ----------
    name : str
        Of the method.
    decision : Decision or None
        What it chose; None for the program as it is.
    objectives : ndarray, shape (4,)
        Time [s], cost, energy [kWh], share of tool life [1]; NaN where not known.
    violation : float
        Sum over rows of what passes each limit, as a share of it [1]; 0 inside all limits.
    evaluations : int
        That it took.
    """

    name: str
    decision: Decision | None = field(repr=False)
    objectives: Floats
    violation: float
    evaluations: int


def method_of(problem: Problem, name: str, decision: Decision, evaluations: int) -> Method:
    """What a decision comes to."""
    found = problem.evaluate(decision.groups, decision.feeds[None], decision.speeds[None])
    return Method(
        name=name, decision=decision, objectives=found.objectives[0],
        violation=float(found.violation[0]), evaluations=evaluations,
    )  # fmt: skip


def baselines(
    problem: Problem,
    groups: Groups,
    objective: Objective,
    settings: SearchSettings,
    callback: Callback | None = None,
) -> list[Method]:
    """As programmed, Sim2023's way, and the best that many evaluations find from a random start.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    groups : Groups
        What shares an F, what an S, in all but the program as it is.
    objective : Objective
        What is to be least; ``pareto`` counts as time.
    settings : SearchSettings
        Population, generations, evaluations, seed.
    callback : callable, optional
        Called after each generation of each search with its number; True ends the search.
    """
    moves = problem.cut.plan.path.moves
    found = problem.evaluate_rows(moves.feed[None], moves.speed[None])
    programmed = Method(
        name="as programmed", decision=None, objectives=found.objectives[0],
        violation=float(found.violation[0]), evaluations=1,
    )  # fmt: skip
    which = column(objective)
    reference = float(programmed.objectives[which])
    size = reference if reference > 0 else 1.0
    methods = [programmed, _published(problem, groups, which, size, settings, callback)]
    if settings.baseline:
        methods.append(_best_of_many(problem, groups, which, size, settings, callback))
    return methods


def _published(
    problem: Problem, groups: Groups, which: int, reference: float, settings: SearchSettings,
    callback: Callback | None,
) -> Method:  # fmt: skip
    """Sim2023: F and S themselves as genes, from random ones, J = objective + w sum max(0, over).

    Excess counts as a share of each limit, w as the objective of the program as it is; Sim2023
    leaves it open.
    """
    genes = _Words(problem, groups)
    fitness = Fitness(
        problem=problem, genes=genes, column=which, reference=reference, weight=WEIGHT
    )
    chosen = GeneticSettings(
        population=settings.population, generations=settings.paper_generations, seed=settings.seed
    )
    found = minimise(fitness, genes.low, genes.high, chosen, callback=callback)
    feeds, speeds = genes.decoded(found.x[None])
    decision = Decision(groups=groups, feeds=feeds[0], speeds=speeds[0])
    name = f"genetic, random start, {settings.paper_generations} generations"
    return method_of(problem, name, decision, found.evaluations)


def _best_of_many(
    problem: Problem, groups: Groups, which: int, reference: float, settings: SearchSettings,
    callback: Callback | None,
) -> Method:  # fmt: skip
    """The genetic search with limits first, in shares of what they allow, from random ones."""
    shares = Shares.of(problem, _anywhere(problem, groups))
    fitness = Fitness(problem=problem, genes=shares, column=which, reference=reference)
    population = max(2, min(settings.population, settings.baseline))
    chosen = GeneticSettings(population=population, seed=settings.seed)
    generations = 1 + (settings.baseline - population) // max(chosen.children, 1)
    chosen = GeneticSettings(
        population=population, generations=max(generations, 1), seed=settings.seed
    )
    found = minimise(fitness, shares.low, shares.high, chosen, log=shares.log, callback=callback)
    feeds, speeds = shares.decoded(found.x[None])
    decision = Decision(groups=groups, feeds=feeds[0], speeds=speeds[0])
    name = f"best of {settings.baseline} evaluations"
    return method_of(problem, name, decision, found.evaluations)


def _anywhere(problem: Problem, groups: Groups) -> Decision:
    """As the first row of each group is programmed, with S inside its range."""
    feeds = groups.own_feed[_first_rows(groups.feed)]
    own = groups.own_speed[_first_rows(groups.speed)]
    return Decision(
        groups=groups, feeds=feeds, speeds=np.clip(own, *speed_ranges(problem, groups, own))
    )


def _first_rows(group: Rows) -> Rows:
    """First row of each group, shape (G,)."""
    found, first = np.unique(group, return_index=True)
    return first[found >= 0]


class _Words:
    """Genes that are F [mm/min] and S [rev/min] themselves, from their ranges alone."""

    def __init__(self, problem: Problem, groups: Groups) -> None:
        self.groups = groups
        first = _first_rows(groups.feed)
        self._first = first
        self._by_turn = problem.cut.plan.path.motion[first] == Motion.PER_TURN
        slow, fast = np.zeros(len(first)), np.full(len(first), np.inf)
        rows = np.flatnonzero(groups.feed >= 0)
        np.maximum.at(slow, groups.feed[rows], problem.feed_low[rows])
        np.minimum.at(fast, groups.feed[rows], problem.feed_high[rows])
        own = groups.own_speed[_first_rows(groups.speed)]
        speeds = speed_ranges(problem, groups, own)
        self.low = np.concatenate([np.minimum(slow, fast), speeds[0]])
        self.high = np.concatenate([fast, speeds[1]])

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F in the units of ``Moves``, shape (P, G), and whole S, shape (P, H)."""
        many = len(self._first)
        speeds = np.round(genes[:, many:])
        turns = self.groups.row_speeds(speeds)[:, self._first]
        by_turn = np.where(self._by_turn & (turns > 0), turns, 1.0)
        return genes[:, :many] / by_turn, speeds
