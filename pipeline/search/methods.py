"""Searches with a population: particle swarm, whales, grey wolves, random search; a table by name.

All take ``population`` times ``generations`` evaluations, the first population among them.

Swarm (Clerc and Kennedy 2002, IEEE Transactions on Evolutionary Computation 6(1)): each particle
remembers its best p and knows that of all, g; the velocity becomes chi (v + c_1 r (p - x) +
c_2 r' (g - x)), chi = 2 / (phi - 2 + sqrt(phi^2 - 4 phi)), phi = c_1 + c_2 > 4, so that the swarm
settles without a limit.  The velocity is limited nevertheless, as Eberhart and
Shi 2000 advise.  A particle that meets a wall stops there.  Particles start at rest (Engelbrecht
2012).

Whales (Mirjalili and Lewis 2016, Advances in Engineering Software 95, Eq. (2.1) to (2.8)): with a
falling evenly from 2 to 0, A = 2 a r - a and C = 2 r', each whale Z does one of three things,

- encircles the best so far, Z <- Z* - A |C Z* - Z|, where |A| < 1,
- roams about another whale Z_r, Z <- Z_r - A |C Z_r - Z|, where |A| >= 1,
- or, at even odds with both, spirals, Z <- |Z* - Z| exp(b l) cos(2 pi l) + Z*, l from -1 to 1.

Grey wolves (Mirjalili, Mirjalili and Lewis 2014, Advances in Engineering Software 69, Eq. (3.1) to
(3.7)): the same A and C for each axis and each leader Z_k (alpha, beta, delta: the three best so
far), Z <- mean over k of Z_k - A |C Z_k - Z|.

C Z depends on where zero lies: whales and wolves are drawn to it whatever the cost.  ``origin``
says which point of the box it is; in boxes that are symmetric about zero, as in the papers, the
middle.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import sqrt
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Range, Share
from pipeline.search import result
from pipeline.search.genetic import GeneticSettings
from pipeline.search.operators import encircled, inside
from pipeline.search.result import (
    Callback,
    Cost,
    Evolution,
    Progress,
    SearchResult,
    SearchSettings,
)

SETTLES = 4.0
"""Sum of both attractions above which the constriction is defined [1]."""


@dataclass(frozen=True, kw_only=True)
class SwarmSettings(SearchSettings, section="swarm"):
    """Settings of the particle swarm."""

    own: Annotated[float, Range(least=0.0, most=10.0)] = 2.05
    best: Annotated[float, Range(least=0.0, most=10.0)] = 2.05
    """c_1 and c_2, attraction of a particle's own best and of the best of all [1]; their sum lies
    above 4."""
    fastest: Annotated[float, Range(above=0.0, most=1.0)] = 0.5
    """Greatest velocity along each axis, as a share of the box for each generation [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.own + self.best > SETTLES:
            raise ValueError(
                f"swarm.own = {self.own} and swarm.best = {self.best} must add up to more than "
                f"{SETTLES:g}, or the swarm never settles"
            )

    @property
    def constriction(self) -> float:
        """chi, the share of the velocity that is kept [1]."""
        phi = self.own + self.best
        return 2.0 / (phi - 2.0 + sqrt(phi * (phi - 4.0)))

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Particles that remember their own best, and stop at walls."""
        velocity, own, own_costs = np.zeros_like(unit), unit, costs
        while True:
            velocity = accelerated(velocity, own - unit, progress.unit - unit, self, rng)
            ahead = unit + velocity
            unit = inside(ahead.copy())
            velocity[ahead != unit] = 0.0
            costs = progress.evaluate(unit)
            better = costs < own_costs
            own_costs = np.where(better, costs, own_costs)
            own = np.where(better[:, None], unit, own)
            yield unit, costs


def accelerated(
    velocity: Floats, to_own: Floats, to_all: Floats, settings: SwarmSettings,
    rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """Velocities (P, D) of the next generation, by distances (P, D) to own and common best."""
    chance = rng.random((2, *velocity.shape))
    chi, most = settings.constriction, settings.fastest
    faster = chi * velocity
    faster += (chi * settings.own) * chance[0] * to_own
    faster += (chi * settings.best) * chance[1] * to_all
    return np.minimum(np.maximum(faster, -most, out=faster), most, out=faster)


@dataclass(frozen=True, kw_only=True)
class WhaleSettings(SearchSettings, section="whale"):
    """Settings of the whale optimisation algorithm; the defaults are those of its authors."""

    reach: Positive = 2.0
    """a at the beginning [1]; it falls evenly to 0."""
    spiral: Annotated[float, Range(least=0.0, most=10.0)] = 1.0
    """b, how fast the spiral widens [1]."""
    least_turn: Annotated[float, Range(least=-10.0, most=10.0)] = -1.0
    greatest_turn: Annotated[float, Range(least=-10.0, most=10.0)] = 1.0
    """Range of l, turns of the spiral [1]."""
    roams: bool = True
    """Whether whales with abs(A) >= 1 roam about another whale, else they encircle the best one."""
    by_axis: bool = False
    """Whether A and C are drawn for each axis, as the paper's text has it, or once for each whale,
    as in its authors' program, which draws the whale to roam about anew for each axis, too."""
    origin: Share = 0.5
    """Place on every axis of the unit cube that the formulas take for zero [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.least_turn > self.greatest_turn:
            raise ValueError(
                f"whale.least_turn = {self.least_turn} must not lie above whale.greatest_turn = "
                f"{self.greatest_turn}"
            )

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Whales whose reach falls evenly."""
        while True:
            left = 1.0 - (len(progress.history) - 1) / self.generations
            unit = whales_moved(unit, progress.unit, left * self.reach, self, rng)
            yield unit, progress.evaluate(unit)


def whales_moved(
    unit: Floats, best: Floats, reach: float, settings: WhaleSettings, rng: np.random.Generator
) -> Floats:
    """Whales ``unit`` (P, D) a generation later, in the unit cube.

    ``best`` (D,) is Z*, the best so far; ``reach`` a of this generation [1].
    """
    many, genes = unit.shape
    chance = rng.random((3, many, 1))
    step = rng.random((many, genes if settings.by_axis else 1))
    swing = rng.random(step.shape)
    step *= 2.0 * reach
    step -= reach  # A
    swing *= 2.0  # C
    z, goal = unit - settings.origin, best - settings.origin
    prey = goal
    if settings.roams:
        other = z.take((many * chance[0, :, 0]).astype(np.intp), axis=0)
        goal = np.where(np.abs(step) >= 1.0, other, prey)
    circled = encircled(z, goal, step, swing)
    turn = settings.least_turn + (settings.greatest_turn - settings.least_turn) * chance[1]
    widening = np.exp(settings.spiral * turn) * np.cos(2.0 * np.pi * turn)
    spiral = np.abs(prey - z)
    spiral *= widening
    spiral += prey
    whales = np.where(chance[2] < 0.5, circled, spiral)
    whales += settings.origin
    return inside(whales)


LEADERS = 3
"""Alpha, beta and delta, the wolves that lead; fewer in a smaller pack."""


@dataclass(frozen=True, kw_only=True)
class WolfSettings(SearchSettings, section="wolf"):
    """Settings of the grey wolf optimiser; the defaults are those of the paper."""

    reach: Positive = 2.0
    """a at the beginning [1]; it falls evenly to 0."""
    origin: Share = 0.5
    """Place on every axis of the unit cube that the formulas take for zero [1]."""

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Wolves about the three best so far."""
        leaders, theirs = unit[:0], costs[:0]
        while True:
            leaders, theirs = _best_of(leaders, theirs, unit, costs)
            left = 1.0 - (len(progress.history) - 1) / self.generations
            unit = wolves_moved(unit, leaders, left * self.reach, self.origin, rng)
            costs = progress.evaluate(unit)
            yield unit, costs


def _best_of(leaders: Floats, theirs: Floats, unit: Floats, costs: Floats) -> tuple[Floats, Floats]:
    """The best of the leaders so far and the pack, and their costs, best first."""
    joined, all_costs = np.concatenate([leaders, unit]), np.concatenate([theirs, costs])
    order = all_costs.argsort(kind="stable")[:LEADERS]
    return joined[order], all_costs[order]


def wolves_moved(
    unit: Floats, leaders: Floats, reach: float, origin: float, rng: np.random.Generator
) -> Floats:
    """Wolves ``unit`` (P, D) a generation later, in the unit cube.

    ``leaders`` (L, D) are the best so far, L up to 3; ``reach`` is a of this generation [1];
    ``origin`` the place on every axis that the formulas take for zero [1].
    """
    shape = (len(leaders), *unit.shape)
    step = rng.random(shape)
    step *= 2.0 * reach
    step -= reach
    swing = rng.random(shape)
    swing *= 2.0
    suggested = encircled(unit - origin, leaders[:, None] - origin, step, swing)
    return inside(suggested.sum(axis=0) / len(leaders) + origin)


@dataclass(frozen=True, kw_only=True)
class RandomSettings(SearchSettings, section="random"):
    """Settings of random search, the baseline of every other search (Bergstra and Bengio 2012)."""

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Individuals drawn evenly from the box, whatever was seen before."""
        while True:
            unit = rng.random(unit.shape)
            yield unit, progress.evaluate(unit)


METHODS: dict[str, Callable[..., SearchSettings]] = {
    # no place kept for an elite: truncation keeps the best, and children are as many as parents
    "genetic": partial(GeneticSettings, elite=0),
    "whale": WhaleSettings,
    "swarm": SwarmSettings,
    "wolf": WolfSettings,
    "random": RandomSettings,
}
"""What makes the settings of each search from those of :class:`SearchSettings`, by name."""


def minimise(
    name: str, cost: Cost, low: ArrayLike, high: ArrayLike, *, population: int, generations: int,
    seed: int = 0, log: ArrayLike | None = None, integer: ArrayLike | None = None,
    start: ArrayLike | None = None, callback: Callback | None = None,
) -> SearchResult:  # fmt: skip
    """Least cost within the bounds by the search of that name, see :func:`result.minimise`.

    >>> def cost(x):
    ...     return ((x - 0.3) ** 2).sum(axis=1)
    >>> found = minimise("swarm", cost, [0, 0.3], [1, 1], population=8, generations=20)
    >>> found.evaluations, found.bounds_hit(["rate", "depth"])
    (160, {'depth': 'low'})
    """
    if name not in METHODS:
        raise ValueError(f"search {name!r} is not one of {', '.join(METHODS)}")
    settings = METHODS[name](population=population, generations=generations, seed=seed)
    return result.minimise(
        cost, low, high, settings, log=log, integer=integer, start=start, callback=callback
    )
