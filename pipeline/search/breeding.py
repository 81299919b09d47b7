"""Children of a generation: selection, crossover and mutation put together."""

import numpy as np
from numpy.typing import NDArray

from pipeline.search.adaptive import crossover_rates, mutation_rates
from pipeline.search.crossover import blend, simulated_binary
from pipeline.search.genetic_settings import GeneticSettings
from pipeline.search.mutation import polynomial
from pipeline.search.selection import (
    Indices,
    exponential,
    ranked,
    stochastic_universal,
    tournament,
    windowed,
)

Floats = NDArray[np.float64]


def offspring(
    unit: Floats, costs: Floats, settings: GeneticSettings, rng: np.random.Generator
) -> Floats:
    """Children of a generation, shape (settings.children, D), in the unit cube.

    Parameters
    ----------
    unit : ndarray, shape (P, D)
        Parents in the unit cube, best first.
    costs : ndarray, shape (P,)
        Theirs.
    settings : GeneticSettings
        How they are made.
    rng : numpy.random.Generator
        Source of chance.
    """
    pairs = (settings.children + 1) // 2
    parents, crossing, mutating = _parents(
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
    """Children of pairs of parents, shape (2 N, D), in the unit cube.

    Parameters
    ----------
    parents : ndarray, shape (2 N, D)
        In the unit cube; the first N cross with the others.
    crossing : float or ndarray, shape (N, 1)
        Probability that a pair crosses.
    mutating : float or ndarray, shape (2 N, 1)
        Probability that a gene mutates.
    settings : GeneticSettings
        Which crossover, and how wide its steps and those of mutation are.
    rng : numpy.random.Generator
        Source of chance.
    """
    pairs = len(parents) // 2
    first, second = parents[:pairs], parents[pairs:]
    crossed = rng.random(first.shape) < settings.gene_rate
    crossed &= rng.random((pairs, 1)) < crossing
    if settings.crossover == "sbx":
        children = simulated_binary(first, second, crossed, settings.crossover_eta, rng)
    else:
        children = blend(first, second, crossed, settings.alpha, rng)
    children = children.reshape(parents.shape)
    mutated = rng.random(parents.shape) < mutating
    if settings.mutation_rate != 0:
        _no_copies(mutated, children, parents, rng)
    genes = mutated.ravel().nonzero()[0]
    children.put(genes, polynomial(children.take(genes), settings.mutation_eta, rng))
    return children


def _parents(
    costs: Floats, pairs: int, rate: float, settings: GeneticSettings, rng: np.random.Generator
) -> tuple[Indices, float | Floats, float | Floats]:
    """Places of the parents, (2 pairs,), and the rates at which pairs cross and genes mutate."""
    universal = settings.selection == "stochastic_universal"
    if not (universal or settings.adaptive):
        return (
            tournament(len(costs), 2 * pairs, settings.tournament, rng),
            settings.crossover_rate,
            rate,
        )
    fitness = _fitness(costs, settings.fitness)
    if universal:
        parents = stochastic_universal(fitness, 2 * pairs, rng)
    else:
        parents = tournament(len(costs), 2 * pairs, settings.tournament, rng)
    if not settings.adaptive:
        return parents, settings.crossover_rate, rate
    # best first: the lower place is the fitter of a pair
    better = np.minimum(parents[:pairs], parents[pairs:])
    return (
        parents,
        crossover_rates(fitness, fitness[better], settings.crossover_rate)[:, None],
        mutation_rates(fitness, fitness[parents], rate)[:, None],
    )


def _no_copies(
    mutated: NDArray[np.bool_], children: Floats, parents: Floats, rng: np.random.Generator
) -> None:
    """Let a child that would be its parent's copy mutate in one gene: its cost is known already."""
    copies = (~((children != parents) | mutated).any(axis=1)).nonzero()[0]
    genes = rng.random(len(copies)) * children.shape[1]
    mutated[copies, genes.astype(np.intp)] = True


def _fitness(costs: Floats, form: str) -> Floats:
    if form == "rank":
        return ranked(len(costs))
    return exponential(costs) if form == "exponential" else windowed(costs)
