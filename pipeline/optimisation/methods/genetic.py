"""Genetic search from the blockwise optimum, and the baselines of its answer.

Rows too short to reach their feed weigh less than the blockwise optimum reckons.  The speeds of
stretches are moved first (:func:`pipeline.search.compass.compass`); the genetic search of Sim2023
begins with the result and with copies that are scaled and perturbed.
"""

from collections.abc import Callable

import numpy as np

from pipeline.machine.control.path import Motion
from pipeline.optimisation.methods.feeds import column
from pipeline.optimisation.methods.genes import (
    BoundedGenes,
    Fitness,
    Genes,
    Method,
    method_of,
    speed_ranges,
)
from pipeline.optimisation.problem.arrays import Decision, Groups, first_rows
from pipeline.optimisation.problem.feasible import passed_limit
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, SearchSettings
from pipeline.optimisation.text.words import stepped
from pipeline.schema.arrays import Floats
from pipeline.schema.part import Objective
from pipeline.search.compass import compass
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import SearchResult, minimise

Callback = Callable[[int, Floats, float], bool | None]
"""Called with the generation, the best genes and the best objective; True ends the search.

Generation 0 is that of the steps around the start.
"""

FEW = 50
"""Evaluations around the start."""
WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Standard deviations of perturbed copies, as shares of the genes' ranges."""
SCALES = (0.5, 2.0)
"""Least and greatest factor of the speeds of scaled copies."""
WEIGHT = 1.0
"""Penalty weight [1]: passing one row's limit once over costs as much as the whole program."""


def improve(
    problem: Problem,
    start: Decision,
    objective: Objective,
    settings: SearchSettings,
    callback: Callback | None = None,
) -> Fitness:
    """Best decision from ``start`` on, never worse than it, with the path to it."""
    which = column(objective)
    reference = _value(problem, start, which)
    genes = BoundedGenes.of(problem, start)
    fitness = Fitness(
        problem=problem, genes=genes, column=which, reference=reference or 1.0,
        best=reference, decision=start, evaluations=1, history=[reference],
    )  # fmt: skip
    _search(genes, fitness, settings, callback)
    return fitness


def _value(problem: Problem, start: Decision, which: int) -> float:
    evaluated = problem.evaluate(start.groups, start.feeds[None], start.speeds[None])
    value = float(evaluated.objectives[0, which])
    if not np.isfinite(value):
        raise ValueError(
            f"the {OBJECTIVES[which]} of the start is not known: choose another objective"
        )
    if evaluated.violation[0] > 0:
        named = passed_limit(problem, start.row_feeds, start.row_speeds)
        raise ValueError(
            f"the start of the search passes its limits by {100 * evaluated.violation[0]:.3g} % in "
            f"sum: begin with one that keeps them ({named or 'no single block'})"
        )
    return value


def _search(
    genes: BoundedGenes, fitness: Fitness, settings: SearchSettings, callback: Callback | None
) -> None:
    """Search on until the callback or the generations end it; the best is in ``fitness``."""
    if not len(genes.low):
        return
    start = genes.encoded(genes.start.feeds[None], genes.start.speeds[None])[0]

    def ends(generation: int, best: Floats, _: float) -> bool:
        return callback is not None and bool(callback(generation, best, fitness.best))

    near, ended = _around(genes, fitness, start, ends)
    if ended:
        return
    settled = GeneticSettings(
        population=settings.population, generations=settings.generations, seed=settings.seed
    )
    first = _population(genes, np.unique([start, near], axis=0), settings)
    minimise(fitness, genes.low, genes.high, settled, log=genes.log, start=first, callback=ends)


def _around(
    genes: BoundedGenes, fitness: Fitness, start: Floats, ends: Callable[[int, Floats, float], bool]
) -> tuple[Floats, bool]:
    """The best genes near the start, and whether the callback ends the search."""
    many = genes.groups.feeds

    def with_feeds(speeds: Floats) -> Floats:
        return np.concatenate([np.tile(start[:many], (len(speeds), 1)), speeds], axis=1)

    if not (genes.high > genes.low)[many:].any():
        return start, ends(0, start, 0.0)
    best = compass(
        lambda speeds: fitness(with_feeds(speeds)), genes.low[many:], genes.high[many:],
        start[many:], evaluations=FEW - 1, log=True, callback=lambda _, x, c: ends(0, x, c),
    )  # fmt: skip
    return with_feeds(best.x[None])[0], best.stopped == "callback"


def _population(genes: BoundedGenes, given: Floats, settings: SearchSettings) -> Floats:
    """First individuals: those given, perturbed copies, and a quarter by chance."""
    rng = np.random.default_rng([settings.seed, 1])
    low, high, is_speed = genes.low, genes.high, genes.log
    scaled = np.repeat(given[-1:], settings.population // 4, axis=0)
    scaled[:, is_speed] *= np.geomspace(*SCALES, len(scaled))[:, None]
    copies = np.repeat(given[-1:], settings.population // 4, axis=0)
    width = np.resize(WIDTHS, len(copies))[:, None]
    noise = width * rng.standard_normal(copies.shape)
    copies[:, ~is_speed] += noise[:, ~is_speed]
    span = np.log(high[is_speed] / low[is_speed])
    copies[:, is_speed] *= np.exp(noise[:, is_speed] * span)
    joined = np.concatenate([given, scaled, copies])[: settings.population]
    return np.clip(joined, low, high)


def baselines(
    problem: Problem,
    groups: Groups,
    objective: Objective,
    settings: SearchSettings,
    callback: Callback | None = None,
) -> list[Method]:
    """Baselines: as programmed, the method of Sim2023, the best of many from a random start.

    Where no F and no S may change, the program as it is is the only one.

    ``callback``: called after each generation of each search with its number; True ends the search.
    """
    evaluated = problem.as_programmed
    programmed = Method(
        name="as programmed", decision=None, objectives=evaluated.objectives[0],
        violation=float(evaluated.violation[0]), evaluations=1,
    )  # fmt: skip
    which = column(objective)
    reference = float(programmed.objectives[which])
    size = reference if reference > 0 else 1.0
    if not (groups.feeds or groups.speeds):
        return [programmed]
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
    best = minimise(fitness, genes.low, genes.high, chosen, callback=callback)
    name = f"genetic, random start, {settings.paper_generations} generations"
    return _best_of(problem, name, genes, best)


def _best_of_many(
    problem: Problem, groups: Groups, which: int, reference: float, settings: SearchSettings,
    callback: Callback | None,
) -> Method:  # fmt: skip
    """The genetic search with limits first, in shares of the allowed ranges, from random ones."""
    genes = BoundedGenes.of(problem, _anywhere(problem, groups))
    fitness = Fitness(problem=problem, genes=genes, column=which, reference=reference)
    population = max(2, min(settings.population, settings.baseline))
    chosen = GeneticSettings(population=population, seed=settings.seed)
    generations = 1 + (settings.baseline - population) // max(chosen.children, 1)
    chosen = GeneticSettings(
        population=population, generations=max(generations, 1), seed=settings.seed
    )
    best = minimise(fitness, genes.low, genes.high, chosen, log=genes.log, callback=callback)
    name = f"best of {settings.baseline} evaluations"
    return _best_of(problem, name, genes, best)


def _best_of(problem: Problem, name: str, genes: Genes, best: SearchResult) -> Method:
    feeds, speeds = genes.decoded(best.x[None])
    decision = Decision(groups=genes.groups, feeds=feeds[0], speeds=speeds[0])
    return method_of(problem, name, decision, best.evaluations)


def _anywhere(problem: Problem, groups: Groups) -> Decision:
    """F and S of the first row of each group as programmed, S limited to its range."""
    feeds = groups.own_feed[first_rows(groups.feed)]
    own = groups.own_speed[first_rows(groups.speed)]
    return Decision(
        groups=groups, feeds=feeds, speeds=np.clip(own, *speed_ranges(problem, groups, own))
    )


class _Words:
    """Genes that are F [mm/min] and S [rev/min] themselves, from their ranges alone."""

    def __init__(self, problem: Problem, groups: Groups) -> None:
        self.groups, self._step = groups, problem.speed_step
        first = first_rows(groups.feed)
        self._first = first
        self._by_turn = problem.cut.plan.path.motion[first] == Motion.PER_TURN
        slow, fast = np.zeros(len(first)), np.full(len(first), np.inf)
        rows = np.flatnonzero(groups.feed >= 0)
        np.maximum.at(slow, groups.feed[rows], problem.ranges.feed_low[rows])
        np.minimum.at(fast, groups.feed[rows], problem.ranges.feed_high[rows])
        own = groups.own_speed[first_rows(groups.speed)]
        speeds = speed_ranges(problem, groups, own)
        self.low = np.concatenate([np.minimum(slow, fast), speeds[0]])
        self.high = np.concatenate([fast, speeds[1]])

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F in the units of ``Moves``, shape (P, G), and whole S, shape (P, H)."""
        many = len(self._first)
        speeds = np.round(stepped(genes[:, many:], self._step))
        spindle_speed = self.groups.row_speeds(speeds)[:, self._first]
        by_turn = np.where(self._by_turn & (spindle_speed > 0), spindle_speed, 1.0)
        return genes[:, :many] / by_turn, speeds
