"""Feeds for each tooth that keep a part within its load limit with a given certainty.

What is drawn of a tool is the same for all of its cuts, and the model's error for the whole part,
so that the probability that any load of a part passes the limit is far below the sum of those of
its blocks, and above the greatest of them.  Each block gets the greatest feed at which a quantile
of its load stays within the limit; the level of that quantile, the same for all blocks, rises from
1 - epsilon until the share of draws in which any block passes is epsilon at most.

Feeds fitted to draws pass the limit more often in others: half of the draws judges the feeds that
the other half allows.  Above the last few draws quantiles go on as of a lognormal load, and a share
of few draws counts as the tail of the part's load has it, if that is more.  The share that is aimed
at is less than epsilon by what it errs in a sample of so many draws, so that the probability is
epsilon at most whatever the seed (of 20 seeds in 19).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.certainty.critical import Critical, critical
from pipeline.optimisation.certainty.draws import Draws, draws_of
from pipeline.optimisation.certainty.part_loads import PartLoads, of_rows
from pipeline.optimisation.certainty.quantiles import (
    aimed_share,
    clopper_pearson,
    normal_level,
    normal_share,
    quantiles,
    share_above,
)
from pipeline.optimisation.certainty.response import NODES, nodes_below, nodes_between, responses
from pipeline.optimisation.certainty.uncertainty import Uncertainty
from pipeline.optimisation.settings import Certainty
from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]

NOMINAL = 0.5
"""Epsilon from which on nominal values are taken."""
HIGHEST = 6.0
"""Level at most [standard deviations]."""
STEPS = 12
"""Halvings of the level."""
ROUGHLY = 4
"""Of so many draws one is taken to find out which feeds are asked for."""
RISE = 1.5
"""By which the level may rise for that [standard deviations]."""
ROOM = 1.1
"""And what feeds may be beside that."""
LEAST = 1e-9
"""Feed for each tooth that is computed at least [m]."""
QUANTILES = (0.05, 0.5, 0.95, 0.99)
WORST = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class CertainFeeds:
    """Feeds for each tooth of M rows.

    Parameters
    ----------
    f_z, nominal : ndarray, shape (M,)
        Greatest one with and without uncertainty [m]; 0 where no feed meets the limit, inf in rows
        that cut nothing or never reach it.
    level : float
        Of the quantile that each row's load keeps within the limit [1]; 0.5 for nominal values.
    share : float
        Of draws in which any row passes the limit, judged by other draws [1].
    """

    f_z: Floats = field(repr=False)
    nominal: Floats = field(repr=False)
    level: float
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Exceedance:
    """How often a part passes its load limit.

    Parameters
    ----------
    probability : float
        Share of draws in which any row passes it [1].
    interval_95 : tuple of float
        Of Clopper and Pearson.
    draws : int
        How many.
    peak_quantiles : dict of float to float
        Of the part's peak load, by level [N].
    worst_rows : tuple of (int, float)
        Rows that pass it most often and the share of draws in which they do.
    """

    probability: float
    interval_95: tuple[float, float]
    draws: int
    peak_quantiles: dict[float, float]
    worst_rows: tuple[tuple[int, float], ...]


def certain_feeds(
    cut: Cut, limit_N: float, margin: float, uncertain: Uncertainty, certainty: Certainty
) -> CertainFeeds:
    """Greatest feeds at which P(any row's load > limit) <= epsilon for the part.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    limit_N : float
        Of the peak across the tool's axis [N].
    margin : float
        Share of it that is kept free [1].
    uncertain : Uncertainty
        What is drawn; of every tool that cuts.
    certainty : Certainty
        Epsilon, draws, seed.

    Raises
    ------
    ValueError
        When a tool that cuts has no entry in ``uncertain``, or the draws are too few for epsilon.
    """
    limit = limit_N * (1.0 - margin)
    found = critical(cut)
    _check(cut, found, uncertain)
    most = found.feeds(limit)
    nominal = of_rows(found, most)
    if certainty.epsilon >= NOMINAL or not len(found):
        return CertainFeeds(f_z=nominal, nominal=nominal, level=NOMINAL, share=float("nan"))
    reach = np.where(np.isfinite(most), most, found.last_feeds)
    draws = draws_of(uncertain, certainty.draws, certainty.seed)
    start = normal_level(1.0 - certainty.epsilon)
    nodes = _asked_feeds(cut, found, limit, reach, draws, start)
    part = PartLoads(found=found, limit=limit, most=reach,
                 responses=responses(cut, found, nodes, draws))  # fmt: skip
    aim = aimed_share(certainty.epsilon, len(draws))
    level, share = _level(part, aim)
    if share > aim:
        raise ValueError(
            f"certainty.draws = {certainty.draws} are too few to tell P(load > limit) <= "
            f"{certainty.epsilon:g} for this part: take more draws, or a greater epsilon"
        )
    feeds = part.feeds(quantiles(np.sort(part.responses.values, axis=2), level))
    feeds = np.where((feeds >= reach) & ~np.isfinite(most), np.inf, feeds)
    return CertainFeeds(
        f_z=np.minimum(of_rows(found, feeds), nominal), nominal=nominal,
        level=normal_share(level), share=share,
    )  # fmt: skip


def _asked_feeds(
    cut: Cut, found: Critical, limit: float, reach: Floats, draws: Draws, level: float
) -> Floats:
    """Feeds at which to compute each class for levels from ``level`` on, of few draws."""
    greatest = np.full(found.classes, LEAST)
    np.maximum.at(greatest, found.group, reach)
    few = draws.first(max(len(draws) // ROUGHLY, min(len(draws), 64)))
    drawn = responses(cut, found, nodes_below(greatest), few)
    part = PartLoads(found=found, limit=limit, most=reach, responses=drawn)
    ordered = np.sort(drawn.values, axis=2)
    most = ROOM * part.feeds(quantiles(ordered, level))
    least = part.feeds(quantiles(ordered, level + RISE)) / ROOM
    high, low = np.zeros(found.classes), np.full(found.classes, np.inf)
    np.maximum.at(high, found.group, np.minimum(most, reach))
    np.minimum.at(low, found.group, least)
    high = np.maximum(high, NODES[0] * greatest)
    return nodes_between(np.clip(low, NODES[0] * greatest, high), high)


def exceedance(
    cut: Cut, f_z: Floats, limit_N: float, uncertain: Uncertainty, certainty: Certainty,
    seed: int,
) -> Exceedance:  # fmt: skip
    """How often the load of a part passes a limit, in fresh draws.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    f_z : ndarray, shape (M,)
        Feed for each tooth of each row [m]; nothing is cut at 0, and infinite ones count as the
        last that is tabulated.
    limit_N : float
        [N].
    uncertain : Uncertainty
        What is drawn.
    certainty : Certainty
        How many draws.
    seed : int
        Another one than that of the feeds.
    """
    found, many = critical(cut), certainty.draws
    _check(cut, found, uncertain)
    feeds = np.asarray(f_z, dtype=np.float64)[found.row]
    feeds = np.where(np.isfinite(feeds), feeds, found.last_feeds)
    least, most = np.full(found.classes, np.inf), np.full(found.classes, LEAST)
    np.minimum.at(least, found.group, np.where(feeds > 0, feeds, np.inf))
    np.maximum.at(most, found.group, feeds)
    nodes = nodes_between(np.clip(least, LEAST, most), most)
    part = PartLoads(
        found=found, limit=limit_N, most=feeds,
        responses=responses(cut, found, nodes, draws_of(uncertain, many, seed)),
    )  # fmt: skip
    peaks, beyond = part.peaks(feeds, slice(0, many))
    passed = int((peaks > limit_N).sum())
    often = np.zeros(cut.engagement.blocks)
    np.maximum.at(often, found.row, beyond / many)
    worst = np.argsort(-often, kind="stable")[:WORST]
    return Exceedance(
        probability=passed / many,
        interval_95=clopper_pearson(passed, many),
        draws=many,
        peak_quantiles={q: float(np.quantile(peaks, q)) for q in QUANTILES},
        worst_rows=tuple((int(row), float(often[row])) for row in worst if often[row] > 0),
    )


def _level(part: PartLoads, epsilon: float) -> tuple[float, float]:
    """Level at which few enough draws pass, in standard deviations, and their share."""
    many = part.responses.values.shape[2]
    half = many // 2
    halves = (slice(0, half), slice(half, many))
    ordered = [np.sort(part.responses.values[:, :, one], axis=2) for one in halves]

    def share(level: float) -> float:
        judged = []
        for one, other in ((0, 1), (1, 0)):
            feeds = part.feeds(quantiles(ordered[one], level))
            feeds = of_rows(part.found, feeds)[part.found.row]
            judged.append(part.peaks(feeds, halves[other])[0])
        return share_above(np.sort(np.concatenate(judged)), part.limit)

    low, high = normal_level(1.0 - epsilon), HIGHEST
    found = share(low)
    if found <= epsilon:
        return low, found
    found = share(high)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        here = share(middle)
        if here <= epsilon:
            high, found = middle, here
        else:
            low = middle
    return high, found


def _check(cut: Cut, found: Critical, uncertain: Uncertainty) -> None:
    missing = {cut.numbers[tool] for tool in found.tool.tolist()} - set(uncertain.tools)
    if missing:
        raise ValueError(
            f"certainty: tool T{min(missing)} cuts and nothing is said of what is uncertain of it: "
            "give uncertainty() the force laws of all tools that cut"
        )
