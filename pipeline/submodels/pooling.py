"""Partial pooling of a parameter over machines of a type: the normal hierarchical model.

Estimates y_j of machines j have standard errors s_j; the machines' true values are normal about a
mean mu with a standard deviation tau between machines (Gelman et al. 2013, Bayesian Data Analysis,
section 5.4).  mu has a flat prior.  tau is 0 with probability :data:`ALIKE`, that machines of the
type do not differ in this parameter, and else half-normal, since few machines say little of it: the
estimate of DerSimonian and Laird (1986) is often 0 for a few that do differ, and intervals that
take it for certain are too narrow (Gelman 2006).  Given tau all is in closed form; over tau it is
summed on a grid.  For machine j the others are the prior: normal about their mean mu_-j with
variance P = var(mu_-j) + tau^2, so that the pooled value is

    w y_j + (1 - w) mu_-j   with   w = P / (P + s_j^2),   variance w s_j^2

and w is how far its own records move the value from the others' mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.model import Parameter
from pipeline.submodels.statistics import NORMAL_95

BETWEEN = 0.3
"""Scale of the half-normal prior of the standard deviation of a parameter's logarithm between
machines of a type [1]: three in ten, as for a transfer."""
ALIKE = 0.3
"""Probability that machines of a type do not differ in a parameter, before their records [1]."""
GRID = 401
"""Values of tau that are summed over, the first 0 [1]."""
FARTHEST = 20.0
"""Greatest tau of the grid over the scale of its prior [1]."""
LEAST_ERROR = 1e-6
"""Least standard error over the value, below which digits of a file end [1]."""


@dataclass(frozen=True, kw_only=True)
class Pooled:
    """A machine's parameter pooled with those of its siblings, in the parameter's unit."""

    siblings: int
    """Siblings that have an estimate [1]."""
    expected: float
    """Siblings' mean, of a logarithm where all are positive."""
    value: float
    """Pooled value; that of the siblings where the machine has none."""
    interval_95: tuple[float, float]
    """Its 95 % interval."""
    moved: float
    """Part of the way from the siblings' mean that the own records moved the value [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Others:
    """Distribution of a machine's value by the other machines, for each tau of the grid."""

    mean: Floats
    variance: Floats
    """Mean and variance of it, shape (G,)."""
    probability: Floats
    """Posterior probability of each tau, shape (G,)."""


def _others(y: Floats, s: Floats, scale: float, own: int | None) -> _Others:
    """Prior of machine ``own`` by all others; of a further machine where ``own`` is None."""
    u = np.arange(GRID) / (GRID - 1)
    tau = FARTHEST * scale * u**3  # fine near 0
    v = s**2 + tau[:, None] ** 2  # (G, J)
    mean, variance = _weighted(y, v)
    prior = np.exp(-0.5 * (tau / scale) ** 2) * u**2  # times the width of a cell
    prior *= (1 - ALIKE) / prior.sum()
    prior[0] = ALIKE
    log = np.log(prior, where=prior > 0, out=np.full(GRID, -np.inf))
    log += 0.5 * (np.log(variance) - np.log(v).sum(1) - ((y - mean[:, None]) ** 2 / v).sum(1))
    probability = np.exp(log - log.max())
    if own is not None:
        mean, variance = _weighted(np.delete(y, own), np.delete(v, own, axis=1))
    return _Others(
        mean=mean, variance=variance + tau**2, probability=probability / probability.sum()
    )


def _weighted(y: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Mean (G,) of estimates (J,) weighted by 1 over their variances (G, J), and its variance."""
    variance = 1 / (1 / v).sum(1)
    return variance * (y / v).sum(1), variance


def expected(
    estimates: Sequence[float], errors: Sequence[float], scale: float
) -> tuple[float, float]:
    """Mean and standard deviation of a further machine's value.

    ``estimates``, ``errors``: of machines of its type, with standard errors; ``scale``: that of the
    half-normal prior of the deviation between machines.  From a single machine it is that one's
    value, with its variance and twice the mean square of tau: both are off the type's mean.

    >>> mean, deviation = expected([1.0], [0.4], 0.3)
    >>> round(mean, 3), round(deviation, 3)
    (1.0, 0.535)
    """
    prior = _others(np.array(estimates), np.array(errors), scale, None)
    mean = float(prior.probability @ prior.mean)
    spread = prior.probability @ (prior.variance + (prior.mean - mean) ** 2)
    return mean, float(np.sqrt(spread))


def standard_error(p: Parameter, *, logarithmic: bool) -> float | None:
    """Standard error of a parameter or of its logarithm; None without a value or interval."""
    if not p.determined or p.value is None or p.interval_95 is None:
        return None
    low, high = p.interval_95
    if logarithmic and low > 0:
        wide = float(np.log(high / low))
    else:
        wide = (high - low) / abs(p.value) if logarithmic else high - low
    least = LEAST_ERROR * (1.0 if logarithmic else abs(p.value))
    return max(wide / (2 * NORMAL_95), least)


def pooled(
    own: Parameter, siblings: Sequence[Parameter], between: float = BETWEEN
) -> Pooled | None:
    """A parameter pooled with its siblings'; None where no sibling has an estimate.

    ``between``: scale of the prior of the deviation of logarithms between machines [1]; of a
    parameter that is not positive at all machines, of the deviation over the RMS of its values.
    """
    known = [p for p in siblings if standard_error(p, logarithmic=False) is not None]
    has_own = standard_error(own, logarithmic=False) is not None
    every = [*([own] if has_own else []), *known]
    values = np.array([p.value for p in every], float)
    size = float(np.sqrt(np.mean(values**2))) if known else 0.0
    if not known or not size:
        return None
    logarithmic = bool(np.all(values > 0))
    s = np.array([standard_error(p, logarithmic=logarithmic) for p in every], float)
    y, scale = (np.log(values), between) if logarithmic else (values, between * size)
    prior = _others(y, s, scale, 0 if has_own else None)
    w, mean, variance = np.zeros(GRID), prior.mean, prior.variance
    if has_own:
        w = prior.variance / (prior.variance + s[0] ** 2)
        mean, variance = w * y[0] + (1 - w) * prior.mean, w * s[0] ** 2
    p = prior.probability
    ends = _interval(mean, np.sqrt(variance), p)
    back = np.exp if logarithmic else np.asarray
    low, value, high, others = (
        float(back(one)) for one in (ends[0], p @ mean, ends[1], p @ prior.mean)
    )
    return Pooled(
        siblings=len(known), expected=others, value=value, interval_95=(low, high),
        moved=float(p @ w),
    )  # fmt: skip


def _interval(mean: Floats, deviation: Floats, probability: Floats) -> tuple[float, float]:
    """95 % interval of a mixture of normal distributions (G,)."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    low, high = (mean - 10 * deviation).min(), (mean + 10 * deviation).max()

    def quantile(share: float) -> float:
        return float(
            brentq(lambda x: probability @ ndtr((x - mean) / deviation) - share, low, high)
        )

    return quantile(0.025), quantile(0.975)
