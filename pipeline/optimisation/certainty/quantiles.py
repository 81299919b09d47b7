"""Quantiles and tails of few draws, and intervals of shares."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SETTLED = 4
"""Draws above a quantile that settle it; beyond, the tail goes on."""
TAIL = 0.9
"""Level from which on a load's tail is lognormal."""
SURE = 1.6448536269514722
"""Standard deviations below which 95 % of a normal distribution lies."""
TAIL_ALONE = 1.6
"""By how much more a level of the tail alone errs: of Sobol draws of parts 1.4 to 2 times."""


def quantiles(ordered: Floats, level: float) -> Floats:
    """Of values that rise along the last axis, at a level in standard deviations.

    Above the last few values the tail goes on as that of a lognormal distribution.
    """
    beyond = SETTLED / ordered.shape[-1]
    settled = normal_level(1.0 - beyond)
    if level <= settled:
        return _at(ordered, normal_share(level))
    body = max(min(TAIL, 1.0 - 3 * beyond), 0.1)
    before = normal_level(body)
    low, high = _at(ordered, body), _at(ordered, 1.0 - beyond)
    growth = np.divide(high, low, out=np.ones_like(high), where=low > 0)
    found: Floats = high * growth ** ((level - settled) / (settled - before))
    return found


def _at(ordered: Floats, share: float) -> Floats:
    """Quantile of ordered values, between the two nearest (Hyndman and Fan 1996, type 6)."""
    many = ordered.shape[-1]
    place = min(max(share * (many + 1) - 1, 0.0), many - 1.0)
    k = min(int(place), many - 2)
    found: Floats = ordered[..., k] + (place - k) * (ordered[..., k + 1] - ordered[..., k])
    return found


def share_above(ordered: Floats, limit: float) -> float:
    """Share of loads, which rise, above a limit; of few it is that of the tail, if that is more.

    The tail is a straight line through the logarithms of the highest loads over Blom's scores.
    """
    from scipy.special import ndtri

    many = len(ordered)
    counted = float((ordered > limit).mean())
    tail = np.arange(int(TAIL * many), many)
    if counted >= 1.0 - TAIL or not ordered[tail[0]] > 0:
        return counted
    place = ndtri((tail + 0.625) / (many + 0.25))
    growth, level = np.polyfit(place, np.log(ordered[tail]), 1)
    if not growth > 0:
        return counted
    return max(counted, 1.0 - normal_share(float((np.log(limit) - level) / growth)))


def normal_level(share: float) -> float:
    """Below which a share of a normal distribution lies [standard deviations]."""
    from scipy.special import ndtri

    return float(ndtri(share))


def normal_share(level: float) -> float:
    """Share of a normal distribution below a level in standard deviations."""
    from scipy.special import ndtr

    return float(ndtr(level))


def aimed_share(share: float, many: int) -> float:
    """Share to aim at in ``many`` draws, so that a probability is rarely above ``share``.

    The level z of a normal distribution errs by sqrt((1 + z^2 / 2) / n) when all of n draws tell
    its mean and spread, and by ``TAIL_ALONE`` times as much when its tail does.

    Examples
    --------
    >>> round(aimed_share(0.01, 1024), 4), round(aimed_share(0.01, 65536), 4)
    (0.0065, 0.0095)
    """
    level = normal_level(1.0 - share)
    error = TAIL_ALONE * np.sqrt((1.0 + level**2 / 2) / many)
    return 1.0 - normal_share(float(level + SURE * error))


def clopper_pearson(passed: int, many: int) -> tuple[float, float]:
    """95 % interval of a probability of which ``passed`` of ``many`` draws are a sample.

    Examples
    --------
    >>> low, high = clopper_pearson(0, 100)
    >>> low, round(high, 4)
    (0.0, 0.0362)
    """
    from scipy.special import betaincinv

    low = 0.0 if passed == 0 else float(betaincinv(passed, many - passed + 1, 0.025))
    high = 1.0 if passed == many else float(betaincinv(passed + 1, many - passed, 0.975))
    return low, high
