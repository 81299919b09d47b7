"""Pareto front of several objectives: NSGA-II from the blockwise optimum of each."""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from pipeline.optimisation.methods.genes import BoundedGenes, Front
from pipeline.optimisation.problem.arrays import Decision, Groups, first_rows
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, SearchSettings
from pipeline.schema.arrays import Floats, Rows
from pipeline.search.dominance import knee, ranks, survivors
from pipeline.search.nsga2 import FrontSettings, front

Callback = Callable[[int, Floats, Floats], bool | None]
"""Called with the generation, and genes and objectives of its front; True ends the search."""


def pareto(
    problem: Problem,
    starts: Sequence[Decision],
    objectives: Sequence[str],
    settings: SearchSettings,
    callback: Callback | None = None,
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
    first = _population(genes, genes.encoded(feeds, speeds), settings.front)
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
    groups = Groups(
        feed=feed, speed=speed, own_feed=first.own_feed, own_speed=first.own_speed
    )  # fmt: skip
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


def _population(genes: BoundedGenes, given: Floats, many: int) -> Floats:
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
