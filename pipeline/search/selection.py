"""Who becomes a parent.  Populations stand best first, those that failed last."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


def tournament(many: int, draws: int, size: int, rng: np.random.Generator) -> Indices:
    """The best of ``size`` individuals drawn with replacement, ``draws`` times; shape (draws,).

    The one at place i of P (best is 0) wins with probability ((P - i)^s - (P - i - 1)^s) / P^s.

    Parameters
    ----------
    many : int
        Individuals P, best first, so that the lowest place wins.
    draws, size : int
        Parents, and competitors s for each.
    rng : numpy.random.Generator
        Source of chance.
    """
    # the least of s even draws in 0..1 is 1 - (1 - u)^(1/s) of one
    least = 1.0 - (1.0 - rng.random(draws)) ** (1.0 / size)
    winners: Indices = np.minimum((many * least).astype(np.intp), many - 1)
    return winners


def stochastic_universal(fitness: Floats, draws: int, rng: np.random.Generator) -> Indices:
    """Places in proportion to fitness, from one spin of a wheel with evenly spaced pointers.

    Each individual is drawn its expectation draws f_i / sum f times, rounded up or down (Baker
    1987); the order is shuffled.

    Parameters
    ----------
    fitness : ndarray, shape (P,)
        At least 0, not all 0.
    draws : int
        Parents.
    rng : numpy.random.Generator
        Source of chance.
    """
    edges = fitness.cumsum()
    pointers = (np.arange(draws) + rng.random()) * (edges[-1] / draws)
    places = edges.searchsorted(pointers, side="right")
    # rounding may push the last pointer onto the edge of the last that has any fitness
    last = edges.searchsorted(edges[-1])
    shuffled: Indices = rng.permutation(np.minimum(places, last))
    return shuffled


def ranked(many: int, pressure: float = 2.0) -> Floats:
    """Fitness that falls linearly with the place, from ``pressure`` to 2 - ``pressure``; mean 1.

    Parameters
    ----------
    many : int
        Individuals P.
    pressure : float
        Expected children of the best, 1 to 2 (Baker 1985).
    """
    return np.linspace(pressure, 2.0 - pressure, many) if many > 1 else np.ones(1)


def windowed(costs: Floats) -> Floats:
    """How much better than the worst finite cost, shape (P,); ones when all are the same.

    Parameters
    ----------
    costs : ndarray, shape (P,)
        Best first.
    """
    finite = costs[: costs.searchsorted(np.inf)]
    if len(finite) == 0:
        return np.ones(len(costs))
    # halves, so that no difference overflows
    fitness: Floats = np.maximum(0.5 * finite[-1] - 0.5 * costs, 0.0)
    return fitness if fitness[0] > 0 else np.ones(len(costs))


def exponential(costs: Floats, breadth: float = 1.0) -> Floats:
    """exp(-(f - f_min) / (c sigma)), shape (P,), sigma of the generation's finite costs.

    Parameters
    ----------
    costs : ndarray, shape (P,)
        f, best first; of those that are infinite the fitness is 0.
    breadth : float
        c (FFNN2015: r_g = c sigma_g).
    """
    many = int(costs.searchsorted(np.inf))
    span = float(costs[many - 1]) - float(costs[0]) if many else 0.0
    if not 0 < span < np.inf:
        return np.isfinite(costs) * 1.0 if many else np.ones(len(costs))
    depth = (costs - costs[0]) / span
    finite = depth[:many]
    # 0 and 1 are among them, so that the difference of squares is well off 0
    sigma = sqrt(finite @ finite / many - (finite.sum() / many) ** 2)
    fitness: Floats = np.exp(depth / (-breadth * sigma))
    return fitness
