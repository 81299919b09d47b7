"""Pareto front of several objectives: dominance, crowding, the knee, and the search NSGA-II.

An answer dominates another that is nowhere better than it and somewhere worse.  Limits come first:
what keeps them dominates what does not, and of two that do not, the one that passes them by less
(constrained domination).  The less of an objective, the better.

Deb, Pratap, Agarwal and Meyarivan 2002 (IEEE Transactions on Evolutionary Computation 6(2)):
parents and children together are sorted by constrained domination, and within a front by crowding
distance, and the better half goes on.  Crossover and mutation are those of
:mod:`pipeline.search.genetic`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.search.box import Box, first_population
from pipeline.search.genetic import GeneticSettings, bred, mutation_rate

Ranks = NDArray[np.intp]


def dominates(one: Floats, other: Floats, mine: Floats, theirs: Floats) -> Bools:
    """Whether individuals dominate others; the leading axes broadcast.

    Objectives ``one`` and ``other`` (..., O), none NaN; ``mine`` and ``theirs`` (...) by how much
    each passes its limits, 0 inside all of them.
    """
    shape = np.broadcast_shapes(one.shape, other.shape)[:-1]
    nowhere_worse, somewhere_better = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)
    # one objective at a time: the widest array has no axis of objectives
    for k in range(one.shape[-1]):
        nowhere_worse &= one[..., k] <= other[..., k]
        somewhere_better |= one[..., k] < other[..., k]
    inside = (mine <= 0) & (theirs <= 0)
    return np.where(inside, nowhere_worse & somewhere_better, mine < theirs)


def ranks(objectives: Floats, violation: Floats) -> Ranks:
    """Front of each individual, 0 for those that none dominates; shape (P,).

    Front k + 1 is what none dominates once fronts 0 to k are taken away.  Those of one front keep
    all limits, or pass them by the same.

    Objectives (P, O), none NaN; ``violation`` (P,) is 0 inside all limits.
    """
    above = dominates(objectives[:, None], objectives, violation[:, None], violation)
    dominated_by = above.sum(axis=0)
    fronts = np.zeros(len(objectives), dtype=np.intp)
    rank = 0
    while (front := (dominated_by == 0).nonzero()[0]).size:
        fronts[front] = rank
        dominated_by -= above[front].sum(axis=0)
        dominated_by[front] = -1
        rank += 1
    return fronts


def crowding(objectives: Floats) -> Floats:
    """Crowding distance of the members of one front, shape (F,); infinite at the extremes.

    Sum over the objectives (F, O) of the distance between both neighbours over the front's range.
    """
    many = len(objectives)
    distance = np.zeros(many)
    for column in objectives.T:
        order = column.argsort(kind="stable")
        ordered = column[order]
        distance[order[[0, -1]]] = np.inf
        # among those that failed an objective has no range
        span = ordered[-1] - ordered[0] if np.isfinite(ordered[-1]) else 0.0
        if span > 0:
            distance[order[1:-1]] += (ordered[2:] - ordered[:-2]) / span
    return distance


def survivors(objectives: Floats, violation: Floats, many: int) -> tuple[Ranks, Floats]:
    """The ``many`` best, shape (many,), by front, then crowding distance, and that distance."""
    front = ranks(objectives, violation)
    distance = np.empty(len(front))
    for rank in range(int(front.max(initial=-1)) + 1):
        members = (front == rank).nonzero()[0]
        distance[members] = crowding(objectives[members])
    order = np.lexsort((-distance, front))[:many]
    return order, distance[order]


def crowded_tournament(
    objectives: Floats, violation: Floats, distance: Floats, draws: int, rng: np.random.Generator
) -> Ranks:
    """Winners of ``draws`` pairs: who dominates, else who has the greater distance; shape (draws,).

    Everyone meets another as often as others do, but for one.  The front itself is not compared, as
    in Deb's own program: what stands alone on a worse front, and is not dominated by whom it meets,
    keeps its chance, and a front that begins in a corner still spreads.

    Objectives and violation as in :func:`ranks`; ``distance`` (P,) is the crowding distance of
    each.
    """
    rounds = -(-2 * draws // len(distance))
    drawn = np.concatenate([rng.permutation(len(distance)) for _ in range(rounds)])[: 2 * draws]
    a, b = drawn.reshape(draws, 2).T
    better = dominates(objectives[a], objectives[b], violation[a], violation[b])
    worse = dominates(objectives[b], objectives[a], violation[b], violation[a])
    freer = np.where(distance[a] == distance[b], rng.random(draws) < 0.5, distance[a] > distance[b])
    return np.where(better | (~worse & freer), a, b)


_SAME = 1e-12  # of scaled objectives


def knee(objectives: ArrayLike) -> int:
    """Knee of a front, where a small gain in one objective costs most of another.

    Objectives (F, O) are scaled to 0 and 1 over the front; the knee lies farthest from the plane
    through the least of each objective, on the side of the ideal (Das 1999; Branke, Deb, Dierolf
    and Osswald 2004).  Where fewer points than objectives make the plane, the side of the ideal is
    the part of -(1, ..., 1) at right angles to them.  Raises ValueError when the front is empty or
    an objective is not finite.

    >>> knee([[0.0, 4.0], [1.0, 1.0], [4.0, 0.0]])
    1
    """
    front = np.array(objectives, dtype=np.float64)
    if front.ndim != 2 or front.size == 0 or not np.isfinite(front).all():
        raise ValueError(
            f"front of shape {front.shape} has no knee: give at least one member, "
            "all its objectives finite"
        )
    least, span = front.min(axis=0), np.ptp(front, axis=0)
    scaled = ((front - least) / np.where(span > 0, span, 1.0))[:, span > 0]
    if not scaled.size:
        return 0
    total = scaled.sum(axis=1)
    ends = scaled[[np.lexsort((total, column))[0] for column in scaled.T]]
    toward = _toward_ideal(ends[1:] - ends[0])
    depth = (scaled - ends[0]) @ toward
    # rounding may not choose between members that are as far
    return int((depth >= depth.max() - _SAME).argmax())


def _toward_ideal(edges: Floats) -> Floats:
    """Unit vector to the ideal's side, shape (O,), at right angles to edges of shape (O - 1, O)."""
    down = -np.ones(edges.shape[1])
    if len(edges):
        _, strengths, directions = np.linalg.svd(edges, full_matrices=False)
        along = directions[strengths > _SAME]
        across = down - along.T @ (along @ down)
        if np.linalg.norm(across) > 1e-6:
            down = across
    return down / np.linalg.norm(down)


@dataclass(frozen=True, kw_only=True)
class FrontSettings(Ranged, section="front"):
    """Settings of NSGA-II; the defaults are those of Deb et al. 2002."""

    population: Annotated[int, Range(least=4)] = 100
    """Individuals P, and children of a generation; at least 4."""
    generations: int = 250
    """Generations at most, the first population among them."""
    crossover_rate: float = 0.9
    gene_rate: float = 0.5
    """Share of the pairs that cross, and of their genes."""
    crossover_eta: float = 20.0
    mutation_eta: float = 20.0
    """Distribution indices of crossover and mutation."""
    mutation_rate: float | None = None
    """Share of the genes that mutate, 1 / D unless given."""
    seed: int = 0
    """Seed of the random numbers."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.breeding

    @property
    def breeding(self) -> GeneticSettings:
        """The same for :func:`~pipeline.search.genetic.offspring`: as many children as parents."""
        return GeneticSettings(
            population=self.population, generations=self.generations, seed=self.seed,
            selection="tournament", tournament=2, elite=0,
            crossover_rate=self.crossover_rate, gene_rate=self.gene_rate,
            crossover_eta=self.crossover_eta, mutation_eta=self.mutation_eta,
            mutation_rate=self.mutation_rate,
        )  # fmt: skip


Objectives = Callable[[Floats], tuple[Floats, Floats]]
"""Objectives, shape (P, O), and violations, shape (P,), of individuals, shape (P, D)."""
FrontCallback = Callable[[int, Floats, Floats], bool | None]
"""Called after each generation with its number, and x (F, D) and objectives (F, O) of its front."""


@dataclass(frozen=True, kw_only=True)
class FrontResult:
    """Result of the search."""

    x: Floats = field(repr=False)
    """Members of the last generation that none dominates, each once, by their first objective;
    shape (F, D)."""
    objectives: Floats = field(repr=False)
    """Objectives of the front's members; shape (F, O)."""
    violation: Floats = field(repr=False)
    """Theirs: 0, or all the same where no individual keeps its limits; shape (F,)."""
    evaluations: int
    failed: int
    """Individuals that were evaluated, and those among them with an objective that is not
    finite."""
    generations: int
    """The first population among them."""
    stopped: str
    """Reason of the end: ``generations`` or ``callback``."""


def front(
    evaluate: Objectives,
    low: ArrayLike,
    high: ArrayLike,
    settings: FrontSettings,
    *,
    log: ArrayLike | None = None,
    integer: ArrayLike | None = None,
    start: ArrayLike | None = None,
    callback: FrontCallback | None = None,
) -> FrontResult:
    """Non-dominated answers within the bounds.

    ``evaluate`` gives objectives (P, O), all to become least, and violations (P,) of individuals
    (P, D); one with an objective that is not finite counts as the worst. Bounds (D,) are in the
    parameters' units; ``log``, ``integer``, ``start`` and ``callback`` as in
    :func:`~pipeline.search.result.minimise`.  Raises ValueError when bounds, start or what
    ``evaluate`` returns do not fit together.

    >>> def squares(x):
    ...     return np.stack([x[:, 0] ** 2, (x[:, 0] - 2) ** 2], axis=1), np.zeros(len(x))
    >>> result = front(squares, [-10.0], [10.0], FrontSettings(population=20, generations=60))
    >>> len(result.x), bool(result.x.min() > -0.01), bool(result.x.max() < 2.01)
    (20, True, True)
    """
    box = Box.of(low, high, log, integer)
    evaluator = _Evaluator(evaluate, box)
    rng = np.random.default_rng(settings.seed)
    unit = first_population(
        box, settings.population, start, rng, setting="the population of the front"
    )
    population = evaluator.evaluate(unit).best(settings.population)
    done, stopped = 1, ""
    while not stopped:
        if callback is not None and callback(done, *_front(population, box)[:2]):
            stopped = "callback"
        elif done >= settings.generations:
            stopped = "generations"
        else:
            children = _children(population, settings, rng)
            population = population.joined(evaluator.evaluate(children)).best(settings.population)
            done += 1
    x, objectives, violation = _front(population, box)
    return FrontResult(
        x=x, objectives=objectives, violation=violation, evaluations=evaluator.evaluations,
        failed=evaluator.failed, generations=done, stopped=stopped,
    )  # fmt: skip


class _Population(NamedTuple):
    """P individuals in the unit cube, their objectives, violations and crowding distances."""

    unit: Floats
    objectives: Floats
    violation: Floats
    distance: Floats

    def joined(self, other: "_Population") -> "_Population":
        return _Population(*map(np.concatenate, zip(self, other, strict=True)))

    def best(self, many: int) -> "_Population":
        stay, distance = survivors(self.objectives, self.violation, many)
        return _Population(self.unit[stay], self.objectives[stay], self.violation[stay], distance)


def _children(population: _Population, settings: FrontSettings, rng: np.random.Generator) -> Floats:
    """Children, as many as there are parents, shape (P, D), in the unit cube."""
    many, genes = population.unit.shape
    parents = crowded_tournament(
        population.objectives, population.violation, population.distance, 2 * ((many + 1) // 2), rng
    )
    breeding = settings.breeding
    rate = mutation_rate(genes, breeding)
    return bred(population.unit[parents], breeding.crossover_rate, rate, breeding, rng)[:many]


@dataclass
class _Evaluator:
    """Evaluates individuals, and counts them."""

    objectives: Objectives
    box: Box
    evaluations: int = 0
    failed: int = 0

    def evaluate(self, unit: Floats) -> _Population:
        objectives, violation = self.objectives(self.box.place(unit))
        objectives = np.array(objectives, dtype=np.float64)
        violation = np.array(violation, dtype=np.float64)
        many = len(unit)
        if objectives.ndim != 2 or len(objectives) != many or violation.shape != (many,):
            raise ValueError(
                f"the evaluation returned objectives of shape {objectives.shape} and violations "
                f"of shape {violation.shape} to {many} individuals: return shapes "
                f"({many}, O) and ({many},)"
            )
        lost = ~np.isfinite(objectives).all(axis=1) | np.isnan(violation)
        objectives[lost], violation[lost] = np.inf, np.inf
        self.evaluations += many
        self.failed += int(lost.sum())
        return _Population(unit, objectives, violation, np.zeros(many))


def _front(population: _Population, box: Box) -> tuple[Floats, Floats, Floats]:
    """x, objectives and violations of those that none dominates, each once."""
    first = (ranks(population.objectives, population.violation) == 0).nonzero()[0]
    x = box.place(population.unit[first])
    _, once = np.unique(x, axis=0, return_index=True)
    members = first[once]
    by_first = np.lexsort((*x[once].T, *population.objectives[members].T[::-1]))
    members = members[by_first]
    return x[once][by_first], population.objectives[members], population.violation[members]
