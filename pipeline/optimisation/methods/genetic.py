"""Genetic search from the blockwise optimum, the baselines of its answer, and the Pareto front.

Rows too short to reach their feed weigh less than the blockwise optimum reckons.  The speeds of
stretches are moved first (:func:`pipeline.search.compass.compass`); the genetic search of Sim2023
begins with the result and with copies that are scaled and perturbed.  The front of several
objectives is that of NSGA-II from the blockwise optimum of each.
"""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from pipeline.optimisation.methods.feeds import column
from pipeline.optimisation.methods.genes import (
    BoundedGenes,
    Fitness,
    Front,
    Method,
    WordGenes,
    method_of,
    speed_ranges,
)
from pipeline.optimisation.problem.arrays import Decision, Groups, first_rows
from pipeline.optimisation.problem.feasible import passed_limit
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, SearchSettings
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.part import Objective
from pipeline.search.compass import compass
from pipeline.search.genetic import GeneticSettings
from pipeline.search.nsga2 import FrontCallback, FrontSettings, front, knee, ranks, survivors
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
    objectives, violation = problem.decided(start)
    value = float(objectives[which])
    if not np.isfinite(value):
        raise ValueError(
            f"the {OBJECTIVES[which]} of the start is not known: choose another objective"
        )
    if violation > 0:
        named = passed_limit(problem, start.row_feeds, start.row_speeds)
        raise ValueError(
            f"the start of the search passes its limits by {100 * violation:.3g} % in "
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
    genes = WordGenes(problem, groups)
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


def _best_of(
    problem: Problem, name: str, genes: BoundedGenes | WordGenes, best: SearchResult
) -> Method:
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


def pareto(
    problem: Problem,
    starts: Sequence[Decision],
    objectives: Sequence[str],
    settings: SearchSettings,
    callback: FrontCallback | None = None,
) -> Front:
    """Front of NSGA-II; in no objective worse than the best of the ``starts`` inside the limits.

    Rows share an F or an S in the front where they do so in every start; ``objectives``: those that
    count, of :data:`~pipeline.optimisation.settings.OBJECTIVES`.
    """
    count = np.array([OBJECTIVES.index(one) for one in objectives], dtype=np.intp)
    joint = [_joint(starts, one) for one in starts]
    genes = BoundedGenes.of(problem, joint[0])
    feeds, speeds = np.stack([d.feeds for d in joint]), np.stack([d.speeds for d in joint])
    evaluated = problem.evaluate(joint[0].groups, feeds, speeds)
    _check(evaluated.objectives[:, count], evaluated.violation, objectives)

    def values_of(points: Floats) -> tuple[Floats, Floats]:
        evaluated = problem.evaluate(genes.groups, *genes.decoded(points))
        return evaluated.objectives[:, count], evaluated.violation

    if not len(genes.low):  # the starts are all that there is
        return _front(
            problem, joint[0].groups, feeds, speeds, count, many=settings.front,
            evaluations=len(starts),
        )  # fmt: skip
    first = _front_population(genes, genes.encoded(feeds, speeds), settings.front)
    best = front(
        values_of, genes.low, genes.high,
        FrontSettings(
            population=settings.front, generations=settings.generations, seed=settings.seed
        ),
        log=genes.log, start=first, callback=callback,
    )  # fmt: skip
    more = genes.decoded(best.x)
    return _front(
        problem, joint[0].groups, np.concatenate([feeds, more[0]]),
        np.concatenate([speeds, more[1]]), count, many=settings.front,
        evaluations=best.evaluations + len(starts),
    )  # fmt: skip


def _check(values: Floats, violation: Floats, objectives: Sequence[str]) -> None:
    unknown = ~np.isfinite(values).all(axis=0)
    if unknown.any():
        raise ValueError(
            f"the {objectives[int(unknown.argmax())]} of the part is not known: "
            "leave it out of the front"
        )
    if not (violation <= 0).any():
        raise ValueError(
            f"no start of the front keeps the limits; the best passes them by "
            f"{100 * violation.min():.3g} % in sum: widen the limits"
        )


def _joint(starts: Sequence[Decision], one: Decision) -> Decision:
    """``one`` in groups of rows that share an F, and an S, in every start."""
    first = starts[0].groups
    feed = _refined([s.groups.feed for s in starts], [s.row_feeds for s in starts])
    speed = _refined([s.groups.speed for s in starts], [s.row_speeds for s in starts])
    groups = Groups(feed=feed, speed=speed, own_feed=first.own_feed, own_speed=first.own_speed)
    return Decision(
        groups=groups, feeds=one.row_feeds[first_rows(feed)],
        speeds=one.row_speeds[first_rows(speed)],
    )  # fmt: skip


def _refined(groups: Sequence[Rows], values: Sequence[Floats]) -> Rows:
    """Rows that are together in all groups, numbered in their order; -1 where all have -1."""
    free = np.any([group >= 0 for group in groups], axis=0)
    # rows that one start keeps have their own values there, and stay apart by them
    keys = np.stack([*groups, *values])[:, free]
    numbers = np.full(len(free), -1, dtype=np.intp)
    if keys.size:
        _, first, index = np.unique(keys, axis=1, return_index=True, return_inverse=True)
        numbers[free] = np.argsort(np.argsort(first))[index.ravel()]
    return numbers


def _front_population(genes: BoundedGenes, given: Floats, many: int) -> Floats:
    """First individuals: the starts, points between each two of them, a quarter at random."""
    given = np.unique(given, axis=0)[:many]
    pairs = list(combinations(range(len(given)), 2))
    each = (3 * many // 4 - len(given)) // len(pairs) if pairs else 0
    if each < 1:
        return given
    share = np.linspace(0.0, 1.0, each + 2)[1:-1, None]
    log = np.where(genes.log, np.log(np.maximum(given, 1e-300)), given)
    between = np.concatenate([log[a] + share * (log[b] - log[a]) for a, b in pairs])
    between = np.where(genes.log, np.exp(between), between)
    return np.concatenate([given, np.clip(between, genes.low, genes.high)])


def _front(
    problem: Problem, groups: Groups, feeds: Floats, speeds: Floats, count: Rows, *,
    many: int, evaluations: int,
) -> Front:  # fmt: skip
    """Non-dominated solutions within the limits, without duplicates."""
    evaluated = problem.evaluate(groups, feeds, speeds)
    values = evaluated.objectives[:, count]
    inside = np.flatnonzero(evaluated.violation <= 0)
    _, once = np.unique(values[inside], axis=0, return_index=True)
    members = inside[np.sort(once)]
    members = members[ranks(values[members], np.zeros(len(members))) == 0]
    stay, _ = survivors(values[members], np.zeros(len(members)), len(members))
    ends = values[members].argmin(axis=0)
    _, first = np.unique(np.concatenate([ends, stay]), return_index=True)
    members = members[np.concatenate([ends, stay])[np.sort(first)][:many]]
    members = members[np.lexsort(values[members].T[::-1])]
    no_worse = (values[members] <= problem.as_programmed.objectives[0, count]).all(axis=1)
    wanted = np.flatnonzero(no_worse if no_worse.any() else ~no_worse)
    return Front(
        decisions=tuple(Decision(groups=groups, feeds=feeds[k], speeds=speeds[k]) for k in members),
        objectives=evaluated.objectives[members], no_worse=no_worse,
        knee=int(wanted[knee(values[members[wanted]])]), evaluations=evaluations,
    )  # fmt: skip
