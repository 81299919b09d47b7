"""The inverse dynamics by a genetic algorithm: the objective of least squares, searched blindly.

With the weights of the rows given, the sum of squares is a quadratic form of moments of the table,
so that an individual costs no pass over the rows.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.inverse_dynamics import Dynamics, bounds, modelled_force
from pipeline.identification.drive.regressors import Regressors
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]

NARROWER = 5.0
"""The genetic algorithm's box is that much narrower than that of least squares, for its sake."""


def genetic_dynamics(rows: Regressors, like: Dynamics, settings: GeneticSettings) -> Dynamics:
    """Search the parameters that ``like`` sought, on rows weighted as there.

    Parameters
    ----------
    rows : Regressors
        The table.
    like : Dynamics
        Of least squares: its weights and what it sought count, its values do not.
    settings : GeneticSettings
        Of the search.
    """
    k, steps = len(rows.names), len(rows.stribeck)
    wide = np.hstack([rows.linear, rows.dips[0], rows.dips[1]])
    moments = wide.T @ (like.weights[:, None] * wide)
    right = wide.T @ (like.weights * rows.force)
    power = float(like.weights @ rows.force**2)
    logs = np.log(rows.stribeck)

    def cost(x: Floats) -> Floats:
        whole = np.zeros((len(x), k + 4))
        whole[:, like.sought] = x
        spread = np.zeros((len(x), k + 2 * steps))
        spread[:, :k] = whole[:, :k]
        everyone = np.arange(len(x))
        for way in range(2):
            at = np.interp(whole[:, k + 2 + way], logs, np.arange(steps))
            low = np.minimum(at.astype(np.int64), steps - 2)
            dip, share = whole[:, k + way], at - low
            spread[everyone, k + way * steps + low] = dip * (1 - share)
            spread[everyone, k + way * steps + low + 1] = dip * share
        squares: Floats = power - 2 * spread @ right + ((spread @ moments) * spread).sum(axis=1)
        return squares

    low, high = bounds(rows)
    narrow = np.r_[np.full(k, NARROWER), 1.0, 1.0, 1.0, 1.0]
    found = minimise(cost, (low / narrow)[like.sought], (high / narrow)[like.sought], settings)
    values = np.zeros(k + 4)
    values[like.sought] = found.x
    return replace(
        like, values=values, residuals=rows.force - modelled_force(rows, values),
        evaluations=found.evaluations,
    )  # fmt: skip
