"""Operators of searches: selection, crossover, mutation, encircling, in the unit cube.

Pure functions of arrays with an explicit generator; populations stand best first.
"""

from math import sqrt

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Rows


def tournament(many: int, draws: int, size: int, rng: np.random.Generator) -> Rows:
    """Best of ``size`` individuals drawn with replacement, ``draws`` times; shape (draws,).

    The one at place i of P (best is 0) wins with probability ((P - i)^s - (P - i - 1)^s) / P^s.
    """
    # the least of s even draws in 0..1 is 1 - (1 - u)^(1/s) of one
    least = 1.0 - (1.0 - rng.random(draws)) ** (1.0 / size)
    return np.minimum((many * least).astype(np.intp), many - 1)


def stochastic_universal(fitness: Floats, draws: int, rng: np.random.Generator) -> Rows:
    """Places in proportion to fitness (P,), from one spin of a wheel of evenly spaced pointers.

    Each individual is drawn its expectation draws f_i / sum f times, rounded up or down (Baker
    1987); the order is shuffled.
    """
    edges = fitness.cumsum()
    pointers = (np.arange(draws) + rng.random()) * (edges[-1] / draws)
    places = edges.searchsorted(pointers, side="right")
    # rounding may push the last pointer onto the edge of the last that has any fitness
    last = edges.searchsorted(edges[-1])
    return rng.permutation(np.minimum(places, last))


def ranked(many: int, pressure: float = 2.0) -> Floats:
    """Fitness that falls linearly with the place, from ``pressure`` to 2 - ``pressure``; mean 1.

    ``pressure`` is the expected number of children of the best, 1 to 2 (Baker 1985).
    """
    return np.linspace(pressure, 2.0 - pressure, many) if many > 1 else np.ones(1)


def windowed(costs: Floats) -> Floats:
    """Advantage over the worst finite cost (P,), best first; ones when all are the same."""
    finite = costs[: costs.searchsorted(np.inf)]
    if len(finite) == 0:
        return np.ones(len(costs))
    # halves, so that no difference overflows
    fitness: Floats = np.maximum(0.5 * finite[-1] - 0.5 * costs, 0.0)
    return fitness if fitness[0] > 0 else np.ones(len(costs))


def exponential(costs: Floats, breadth: float = 1.0) -> Floats:
    """exp(-(f - f_min) / (c sigma)), shape (P,), sigma of the generation's finite costs.

    ``costs`` f (P,) stand best first; of those that are infinite the fitness is 0. ``breadth`` is c
    (FFNN2015: r_g = c sigma_g).
    """
    many = int(costs.searchsorted(np.inf))
    span = float(costs[many - 1]) - float(costs[0]) if many else 0.0
    if not 0 < span < np.inf:
        return np.isfinite(costs) * 1.0 if many else np.ones(len(costs))
    depth = (costs - costs[0]) / span
    finite = depth[:many]
    # 0 and 1 are among them, so that the difference of squares is well off 0
    sigma = sqrt(finite @ finite / many - (finite.sum() / many) ** 2)
    return np.exp(depth / (-breadth * sigma))


_NARROW = 1e-14  # parents nearer to each other than this are the same but for rounding


def simulated_binary(
    first: Floats, second: Floats, crossed: Bools, eta: float, rng: np.random.Generator
) -> Floats:
    """Two children each, as far from their middle as beta times the parents; shape (2, N, D).

    The spread factor beta has density (eta + 1) / 2 beta^eta up to 1 and
    (eta + 1) / 2 beta^-(eta + 2) beyond (Deb and Agrawal 1995), cut off where the first child
    would leave the cube, the same for both, so that they keep their parents' middle.  Which child
    is nearer to which parent is left to chance for each gene.

    Parents (N, D); genes that are not ``crossed`` (N, D) are their parent's; the greater ``eta``,
    the nearer the children are to their parents.
    """
    middle = 0.5 * (first + second)
    half = 0.5 * np.abs(second - first)
    gap = np.minimum(middle, 1.0 - middle)
    # half / gap is 1 / beta at the nearer wall
    cut = (half / np.maximum(gap, _NARROW)) ** (eta + 1.0)
    chance = rng.uniform(-1.0, 1.0, middle.shape)
    share = np.abs(chance) * (2.0 - cut)
    spread = np.where(share <= 1.0, share, 1.0 / np.maximum(2.0 - share, _NARROW))
    beta = spread ** (1.0 / (eta + 1.0))
    step = np.copysign(np.minimum(beta * half, gap), chance)
    return _pair(first, second, crossed, middle - step, middle + step)


def blend(
    first: Floats, second: Floats, crossed: Bools, alpha: float,
    rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """Two children each, anywhere in the parents' interval widened by ``alpha`` of its length.

    What is outside the cube is cut off (BLX-alpha, Eshelman and Schaffer 1993); shape (2, N, D).

    Parents (N, D); genes that are not ``crossed`` (N, D) are their parent's; at an ``alpha`` of 0.5
    the children spread as their parents do.
    """
    wider = alpha * np.abs(second - first)
    low = np.maximum(np.minimum(first, second) - wider, 0.0)
    high = np.minimum(np.maximum(first, second) + wider, 1.0)
    chance = rng.random((2, *first.shape))
    child, other = low + chance * (high - low)
    return _pair(first, second, crossed, child, other)


def _pair(first: Floats, second: Floats, crossed: Bools, child: Floats, other: Floats) -> Floats:
    children = np.empty((2, *first.shape))
    children[0], children[1] = first, second
    np.copyto(children[0], child, where=crossed)
    np.copyto(children[1], other, where=crossed)
    return children


def polynomial(x: Floats, eta: float, rng: np.random.Generator) -> Floats:
    """Genes moved by a step of density (eta + 1) / 2 (1 - |d|)^eta, any shape.

    Each side of the density keeps its half and is cut off at the wall on its side, so that no gene
    leaves the cube (Deb and Agrawal 1999).

    Genes x are 0 to 1; the greater ``eta``, the smaller the steps: without walls their mean size is
    1 / (eta + 2).
    """
    chance = rng.uniform(-1.0, 1.0, x.shape)
    gap = np.where(chance > 0, 1.0 - x, x)
    beyond = (1.0 - gap) ** (eta + 1.0)
    size = 1.0 - (1.0 - np.abs(chance) * (1.0 - beyond)) ** (1.0 / (eta + 1.0))
    size = np.minimum(size, gap)
    return x + np.copysign(size, chance)


def adaptive_rates(fitness: Floats, own: Floats, greatest: float) -> Floats:
    """Probability that a pair crosses (p_c) or a gene mutates (p_m) [1], shape (N,).

    k min((f_max - f) / (f_max - f_mean), 1): the best are disrupted least (Srinivas and Patnaik
    1994).

    ``fitness`` (P,) of the population, the greater, the better; ``own`` (N,) is f, the better of
    the two of each pair, or that of each individual; ``greatest`` is k, the probability of those
    below the mean.
    """
    best, mean = fitness.max(), fitness.mean()
    if not best > mean:
        return np.full(len(own), greatest)
    return greatest * np.minimum((best - own) / (best - mean), 1.0)


def encircled(z: Floats, goal: Floats, step: Floats, swing: Floats) -> Floats:
    """Points about a goal, G - A |C G - Z|, of whales and wolves (Mirjalili et al. 2014, 2016).

    Z (P, D) is where they are, G (..., D) what they encircle, both seen from the point that counts
    as zero; ``step`` is A from -a to a, ``swing`` C from 0 to 2 [1], (..., P, D) or (..., P, 1).
    """
    away = swing * goal
    away -= z
    np.abs(away, out=away)
    away *= step
    return np.subtract(goal, away, out=away)


def inside(unit: Floats) -> Floats:
    """Points of any shape moved to the nearest wall of the cube where they left it, in place."""
    return np.minimum(np.maximum(unit, 0.0, out=unit), 1.0, out=unit)
