"""The same waveform problem solved by a genetic algorithm, for comparison (Sim2023 fits so)."""

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.fit import Fit, guessed, phased
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]

STEPS = 3
"""Of the phases towards where coefficients and they fit together."""
FURTHEST = 0.3
"""Of one step [rad]."""


def genetic_fit(like: Fit, settings: GeneticSettings) -> Fit:
    """The optimum that the genetic algorithm finds of a fit's problem, under its weights.

    It seeks what shapes the forces; coefficients follow by linear least squares, and phases by
    turning each revolution against the measured one.

    Parameters
    ----------
    like : Fit
        Of the same terms; where it ended is not used.
    settings : GeneticSettings
        How it searches.
    """
    problem = like.problem
    low, high = problem.bounds
    phases = len(problem.cuts)
    shared = len(low) - phases
    if shared == 0:
        return like
    start = np.zeros(len(low))

    def placed(individual: Floats) -> Floats:
        x = np.concatenate([start[:phases], individual])
        x = phased(problem, x, guessed(problem, x))
        for _ in range(STEPS):
            here = problem.solved(x)
            slopes = problem.slopes(x, here.values, phases)
            slopes = slopes - here.base @ (here.base.T @ slopes)
            step = np.linalg.lstsq(slopes, here.residuals, rcond=None)[0]
            x[:phases] += np.clip(step, -FURTHEST, FURTHEST)
        return x

    def cost(individuals: Floats) -> Floats:
        return np.array([problem.solved(placed(one)).cost for one in individuals])

    found = minimise(cost, low[phases:], high[phases:], settings)
    x = placed(found.x)
    return Fit(problem=problem, x=x, solved=problem.solved(x), evaluations=found.evaluations)
