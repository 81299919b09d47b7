"""From a good answer to a better one: a few steps around it, then the genetic search of Sim2023.

The direct solution leaves what blocks do to each other: rows too short to reach their feed weigh
less than it thought.  The speeds of stretches are moved first, which takes a few dozen evaluations
(:func:`pipeline.search.compass.compass`); the genetic search begins with what that found, and with
copies that are scaled and perturbed.  Feeds follow the speeds and keep their limits
(:class:`pipeline.optimisation.search.shares.Shares`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.direct.block_model import column
from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.search.fitness import Fitness
from pipeline.optimisation.search.shares import Shares
from pipeline.optimisation.settings import OBJECTIVES, Objective, SearchSettings
from pipeline.search.compass import compass
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]
Callback = Callable[[int, Floats, float], bool | None]
"""Told the generation, the best genes and the best value of the objective; True ends the search.

Generation 0 is that of the steps around the start.
"""

FEW = 50
"""Evaluations around the start."""
WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Standard deviations of perturbed copies, as shares of the genes' ranges."""
SCALES = (0.5, 2.0)
"""What all speeds of scaled copies are multiplied by, from one to the other."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Improved:
    """Where a search from a start ended.

    Parameters
    ----------
    decision : Decision
        The best that keeps all limits; the start itself where nothing better was found.
    value : float
        Its objective.
    evaluations : int
        Decisions that were evaluated, the start among them.
    history : ndarray, shape (evaluations,)
        The best value up to each.
    stopped : str
        Why it ended: ``generations`` or ``callback``.
    """

    decision: Decision = field(repr=False)
    value: float
    evaluations: int
    history: Floats = field(repr=False)
    stopped: str


def improve(
    problem: Problem,
    start: Decision,
    objective: Objective,
    settings: SearchSettings,
    callback: Callback | None = None,
) -> Improved:
    """The best decision that is found from ``start`` on; never worse than it.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    start : Decision
        Inside all limits; its groups are kept.
    objective : Objective
        What is to be least; ``pareto`` counts as time.
    settings : SearchSettings
        Population, generations, seed.
    callback : callable, optional
        Sees each generation and may end the search.

    Raises
    ------
    ValueError
        When the start is not inside the limits or its objective is not known.
    """
    which = column(objective)
    reference = _value(problem, start, which)
    shares = Shares.of(problem, start)
    fitness = Fitness(
        problem=problem, genes=shares, column=which, reference=reference or 1.0,
        best=reference, decision=start, evaluations=1, history=[reference],
    )  # fmt: skip
    stopped = _search(shares, fitness, settings, callback)
    return Improved(
        decision=fitness.decision or start, value=fitness.best, evaluations=fitness.evaluations,
        history=np.array(fitness.history), stopped=stopped,
    )  # fmt: skip


def _value(problem: Problem, start: Decision, which: int) -> float:
    found = problem.evaluate(start.groups, start.feeds[None], start.speeds[None])
    value = float(found.objectives[0, which])
    if not np.isfinite(value):
        raise ValueError(
            f"the {OBJECTIVES[which]} of the start is not known: choose another objective"
        )
    if found.violation[0] > 0:
        raise ValueError(
            f"the start of the search passes its limits by {100 * found.violation[0]:.3g} % in "
            "sum: begin with one that keeps them"
        )
    return value


def _search(
    shares: Shares, fitness: Fitness, settings: SearchSettings, callback: Callback | None
) -> str:
    """Why it ended; what was found is in ``fitness``."""
    start = shares.encoded(shares.start.feeds[None], shares.start.speeds[None])[0]

    def told(generation: int, genes: Floats, _: float) -> bool:
        return callback is not None and bool(callback(generation, genes, fitness.best))

    near, ended = _around(shares, fitness, start, told)
    if ended:
        return "callback"
    settled = GeneticSettings(
        population=settings.population, generations=settings.generations, seed=settings.seed
    )
    first = _population(shares, np.unique([start, near], axis=0), settings)
    found = minimise(
        fitness, shares.low, shares.high, settled, log=shares.log, start=first, callback=told
    )
    return found.stopped


def _around(
    shares: Shares, fitness: Fitness, start: Floats, told: Callable[[int, Floats, float], bool]
) -> tuple[Floats, bool]:
    """The best genes near the start, and whether the search was asked to end."""
    many = shares.groups.feeds

    def with_feeds(speeds: Floats) -> Floats:
        return np.concatenate([np.tile(start[:many], (len(speeds), 1)), speeds], axis=1)

    if not (shares.high > shares.low)[many:].any():
        return start, told(0, start, 0.0)
    found = compass(
        lambda speeds: fitness(with_feeds(speeds)), shares.low[many:], shares.high[many:],
        start[many:], evaluations=FEW - 1, log=True, callback=lambda _, x, c: told(0, x, c),
    )  # fmt: skip
    return with_feeds(found.x[None])[0], found.stopped == "callback"


def _population(shares: Shares, given: Floats, settings: SearchSettings) -> Floats:
    """First individuals: those given, all their speeds scaled, and perturbed copies.

    A quarter of the population is left to chance over the whole box.
    """
    rng = np.random.default_rng([settings.seed, 1])
    low, high, is_speed = shares.low, shares.high, shares.log
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
