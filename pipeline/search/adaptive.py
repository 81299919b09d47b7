"""Rates of crossover and mutation that follow fitness (Srinivas and Patnaik 1994).

p_c = k (f_max - f') / (f_max - f_mean) for a pair whose better fitness f' is at least the mean,
else k; p_m the same with the individual's own fitness.  What is good is kept, what is poor is
searched with, and as the population draws together the rates of all rise.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def crossover_rates(fitness: Floats, better: Floats, greatest: float) -> Floats:
    """Probability p_c that a pair crosses [1], shape (N,).

    Parameters
    ----------
    fitness : ndarray, shape (P,)
        Of the population; the greater, the better.
    better : ndarray, shape (N,)
        f', the better of the two fitnesses of each pair.
    greatest : float
        k, the probability of pairs below the mean.
    """
    best, mean = fitness.max(), fitness.mean()
    if not best > mean:
        return np.full(len(better), greatest)
    return greatest * np.minimum((best - better) / (best - mean), 1.0)


def mutation_rates(fitness: Floats, own: Floats, greatest: float) -> Floats:
    """Probability p_m that a gene mutates [1], shape (N,), of individuals with fitness ``own``."""
    return crossover_rates(fitness, own, greatest)
