"""Genetic algorithm over real numbers, all individuals of a generation at once."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.ranges import Count, Positive, Range, Share
from pipeline.search import operators
from pipeline.search.result import Evolution, Progress, SearchSettings

CHOICES = {
    "selection": ("tournament", "stochastic_universal"),
    "crossover": ("sbx", "blend"),
    "survival": ("truncation", "replacement"),
    "fitness": ("rank", "exponential", "window"),
}


@dataclass(frozen=True, kw_only=True)
class GeneticSettings(SearchSettings, section="genetic"):
    """Settings of the genetic algorithm.

    Examples
    --------
    >>> from pipeline.search.result import minimise
    >>> def cost(x):
    ...     return (x[:, 0] - 3.0) ** 2 + (np.log10(x[:, 1]) + 4.0) ** 2
    >>> result = minimise(cost, [0, 1e-6], [10, 1], GeneticSettings(), log=[False, True])
    >>> bool(abs(result.x[0] - 3) < 0.01), bool(abs(result.x[1] - 1e-4) < 1e-6), result.evaluations
    (True, True, 6301)
    """

    population: Annotated[int, Range(least=2)] = 64
    """Individuals P, at least 2."""
    generations: Count = 100
    """Generations at most, the first population among them."""
    selection: str = "stochastic_universal"
    """Selection: ``tournament`` or ``stochastic_universal``."""
    tournament: Count = 2
    """Competitors for each parent's place."""
    fitness: str = "exponential"
    """Measure of stochastic universal selection and of the adaptive rates: ``rank``,
    ``exponential`` (FFNN2015) or ``window``, how much better than the worst."""
    breadth: Positive = 1.0
    """c of ``exponential``, exp(-(f - f_min) / (c sigma)): the smaller, the more the best alone are
    chosen [1]."""
    crossover: str = "sbx"
    """Crossover: ``sbx`` (simulated binary) or ``blend``."""
    crossover_eta: Annotated[float, Range(least=0.0, most=1000.0)] = 5.0
    """Distribution index of ``sbx``."""
    alpha: Annotated[float, Range(least=0.0, most=10.0)] = 0.5
    """Widening of ``blend``."""
    crossover_rate: Share = 1.0
    """Share of the pairs that cross; with ``adaptive`` the greatest."""
    gene_rate: Share = 1.0
    """Share of a crossing pair's genes that cross."""
    mutation_rate: Share | None = None
    """Share of the genes that mutate, 1 / D unless given; with ``adaptive`` the greatest."""
    mutation_eta: Annotated[float, Range(least=0.0, most=1000.0)] = 20.0
    """Distribution index of polynomial mutation."""
    elite: Annotated[int, Range(least=0)] = 1
    """Best individuals that always stay."""
    generation_gap: Annotated[float, Range(above=0.0, most=1.0)] = 1.0
    """Children of a generation as a share of the population, above 0 to 1; never so many that the
    elite had no place."""
    survival: str = "truncation"
    """Survival; ``truncation``: the best of parents and children together; ``replacement``: all
    children, in place of the worst parents."""
    adaptive: bool = False
    """Rates by fitness (Srinivas and Patnaik 1994): the best are disrupted least."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.elite >= self.population:
            raise ValueError(
                f"genetic.elite = {self.elite} must lie below genetic.population = "
                f"{self.population}"
            )
        self.require_whole("tournament", "elite")
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"genetic.{name} = {getattr(self, name)!r} is not one of {', '.join(choices)}"
                )

    @property
    def children(self) -> int:
        """Children of each generation [1]."""
        most = self.population - self.elite
        return min(max(round(self.generation_gap * self.population), 1), most)

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Selection, crossover, mutation and survival."""
        unit, costs = _best(unit, costs, self.population)
        while True:
            children = offspring(unit, costs, self, rng)
            unit, costs = _survivors(unit, costs, children, progress.evaluate(children), self)
            yield unit, costs


def _survivors(
    unit: Floats, costs: Floats, children: Floats, theirs: Floats, settings: GeneticSettings
) -> tuple[Floats, Floats]:
    stay = len(unit) if settings.survival == "truncation" else len(unit) - len(children)
    joined = np.concatenate([unit[:stay], children])
    return _best(joined, np.concatenate([costs[:stay], theirs]), len(unit))


def _best(unit: Floats, costs: Floats, many: int) -> tuple[Floats, Floats]:
    order = costs.argsort(kind="stable")[:many]
    return unit.take(order, axis=0), costs.take(order)


def offspring(
    unit: Floats, costs: Floats, settings: GeneticSettings, rng: np.random.Generator
) -> Floats:
    """Children (settings.children, D) of ``unit`` (P, D), best first, in the unit cube."""
    pairs = (settings.children + 1) // 2
    parents, crossing, mutating = _selected(
        costs, pairs, mutation_rate(unit.shape[1], settings), settings, rng
    )
    children = bred(unit.take(parents, axis=0), crossing, mutating, settings, rng)
    return children[: settings.children]


def mutation_rate(genes: int, settings: GeneticSettings) -> float:
    """Share of the genes that mutate [1]; where none is set, one gene of each individual."""
    return 1.0 / genes if settings.mutation_rate is None else settings.mutation_rate


def bred(
    parents: Floats, crossing: float | Floats, mutating: float | Floats,
    settings: GeneticSettings, rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """Children of pairs of ``parents`` (2 N, D), shape (2 N, D), in the unit cube.

    ``crossing`` and ``mutating``: probabilities of a pair and of a gene [1], one or (N, 1), (2 N,
    1).
    """
    pairs = len(parents) // 2
    first, second = parents[:pairs], parents[pairs:]
    crossed = rng.random(first.shape) < settings.gene_rate
    crossed &= rng.random((pairs, 1)) < crossing
    if settings.crossover == "sbx":
        children = operators.simulated_binary(first, second, crossed, settings.crossover_eta, rng)
    else:
        children = operators.blend(first, second, crossed, settings.alpha, rng)
    children = children.reshape(parents.shape)
    mutated = rng.random(parents.shape) < mutating
    if settings.mutation_rate != 0:
        _no_copies(mutated, children, parents, rng)
    genes = mutated.ravel().nonzero()[0]
    children.put(genes, operators.polynomial(children.take(genes), settings.mutation_eta, rng))
    return children


def _selected(
    costs: Floats, pairs: int, rate: float, settings: GeneticSettings, rng: np.random.Generator
) -> tuple[Rows, float | Floats, float | Floats]:
    """Places of the parents, (2 pairs,), and the rates at which pairs cross and genes mutate."""
    fitness = _fitness(costs, settings)
    if settings.selection == "stochastic_universal":
        parents = operators.stochastic_universal(fitness, 2 * pairs, rng)
    else:
        parents = operators.tournament(len(costs), 2 * pairs, settings.tournament, rng)
    if not settings.adaptive:
        return parents, settings.crossover_rate, rate
    # best first: the lower place is the fitter of a pair
    better = np.minimum(parents[:pairs], parents[pairs:])
    return (
        parents,
        operators.adaptive_rates(fitness, fitness[better], settings.crossover_rate)[:, None],
        operators.adaptive_rates(fitness, fitness[parents], rate)[:, None],
    )


def _no_copies(mutated: Bools, children: Floats, parents: Floats, rng: np.random.Generator) -> None:
    """Mutate one gene of each child that would be a copy of its parent, whose cost is computed."""
    copies = (~((children != parents) | mutated).any(axis=1)).nonzero()[0]
    genes = rng.random(len(copies)) * children.shape[1]
    mutated[copies, genes.astype(np.intp)] = True


def _fitness(costs: Floats, settings: GeneticSettings) -> Floats:
    if settings.fitness == "rank":
        return operators.ranked(len(costs))
    if settings.fitness == "window":
        return operators.windowed(costs)
    return operators.exponential(costs, settings.breadth)
