"""Time until a condition that is known week by week crosses a line, with its interval.

The trend is a + b g(t), where g is t itself, or grows exponentially and doubles within the horizon,
a half, a quarter or an eighth of it: how wear speeds up is not known beforehand.  Each shape has a
weight by its likelihood, exp(-BIC / 2) (Schwarz 1978; Raftery 1995); a and b are drawn from the
posterior of least squares without prior knowledge, a bivariate t distribution (Gelman et al.,
Bayesian Data Analysis, 14.2).  A draw crosses the line where its trend first does; the interval
holds the share of draws that is the confidence (ISO 13381-1).
"""

from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats

DRAWS, SEED = 4000, 0
"""Number of trends that are drawn, and the seed of their generator."""
STEP = 0.1
"""Step of time in which a crossing is looked for [weeks]."""
DOUBLINGS = (1, 2, 4, 8)
"""Doublings within the horizon of the trends that grow exponentially [1]."""
MISFIT = 0.03
"""Error that any shape makes, over the distance from the lowest value to the line [1]."""


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """Time from the last week to the crossing of a line; infinite beyond the horizon [weeks]."""

    median: float
    low: float
    high: float
    """Middle, and ends of the interval."""
    probability: float
    """Share of the draws that cross within the horizon [1]."""


def crossing(
    weeks: Floats, values: Floats, line: float, *, horizon: float, confidence: float
) -> Crossing:
    """Crossing of ``line`` from below by the trend of ``values`` (N,) at ``weeks`` (N,), N > 3.

    ``horizon`` in weeks after the last one; ``confidence`` is the share that the interval holds.
    """
    t, ahead = weeks - weeks[-1], np.arange(0.0, horizon + STEP / 2, STEP)
    rng, n = np.random.default_rng(SEED), len(t)
    z, chi = rng.standard_normal((2, DRAWS)), rng.chisquare(n - 2, DRAWS)
    likelihoods, crossings = [], []
    for rate in (0.0, *(np.log(2) * many / horizon for many in DOUBLINGS)):
        past, future = (np.expm1(rate * x) / rate if rate else x for x in (t, ahead))
        X = np.stack([np.ones(n), past], axis=1)
        beta, *_ = np.linalg.lstsq(X, values, rcond=None)
        misfit = n * (MISFIT * (line - float(values.min()))) ** 2
        squares = float(np.sum((values - X @ beta) ** 2)) + misfit
        likelihoods.append(-n / 2 * np.log(squares))
        spread = np.linalg.cholesky(np.linalg.inv(X.T @ X)) @ z * np.sqrt(squares / chi)
        a, b = beta[:, None] + spread
        rise = np.where(b > 0, (line - a) / np.where(b > 0, b, 1.0), np.inf)
        place = np.searchsorted(future, np.where(a >= line, 0.0, rise))
        crossings.append(np.append(ahead, np.inf)[place])
    weight = np.exp(np.array(likelihoods) - max(likelihoods))
    shape = rng.choice(len(weight), DRAWS, p=weight / weight.sum())
    drawn = np.sort(np.array(crossings)[shape, np.arange(DRAWS)])
    low, median, high = (
        float(drawn[min(int(share * DRAWS), DRAWS - 1)])
        for share in ((1 - confidence) / 2, 0.5, (1 + confidence) / 2)
    )
    probability = float(np.isfinite(drawn).mean())
    return Crossing(median=median, low=low, high=high, probability=probability)
