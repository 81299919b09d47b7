"""Chance-constrained feeds: greatest feeds at which a part keeps its load limit with a probability.

The draws of a tool are the same for all of its cuts, and the model's error for the whole part. Each
block gets the greatest feed at which a quantile of its load stays within the limit of its tool; the
level of that quantile, the same for all blocks, rises from 1 - epsilon until the share of draws in
which any block passes is epsilon at most.

Half of the draws tests the feeds that the other half allows.  Above the last few draws quantiles
are those of a lognormal load, and a share of few draws counts as the tail of the part's load has
it, if that is more.  The share aimed at is less than epsilon by its sampling error, so that the
probability is epsilon at most whatever the seed (of 20 seeds in 19).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.reliability.part_loads import (
    ENDLESS,
    NODES,
    Critical,
    Draws,
    Responses,
    critical,
    draws_of,
    nodes_between,
    responses,
)
from pipeline.optimisation.reliability.uncertainty import Uncertainty
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.schema.arrays import Floats
from pipeline.twin.cut.loads import Cut

NOMINAL = 0.5
"""Epsilon from which on nominal values are taken."""
HIGHEST = 6.0
"""Level at most [standard deviations]."""
STEPS = 12
"""Halvings of the level."""
PILOT_DIVISOR = 4
"""Draws for each one that is taken to find the range of feeds."""
LEVEL_SPAN_SD = 1.5
"""Rise of the level that the range covers [standard deviations]."""
BESIDE = 1.1
"""Factor by which feeds may lie outside of that range."""
LEAST = 1e-9
"""Feed for each tooth that is computed at least [m]."""
QUANTILES = (0.05, 0.5, 0.95, 0.99)
FAR = 4.0
"""Factor of a load that no draw passes: six standard deviations of a catalogue's values are 2.5."""
FRESH = 4
"""Draws that test feeds, for each one that they rest on: an estimate settles less quickly."""
SETTLED = 4
"""Draws above a quantile that settle it; beyond, the tail goes on."""
TAIL = 0.9
"""Level from which on a load's tail is lognormal."""
Z_95 = 1.6448536269514722
"""Standard deviations below which 95 % of a normal distribution lies."""
TAIL_ALONE = 1.6
"""Error of a level of the tail alone over that of the whole [1]: 1.4 to 2 for Sobol draws."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartLoads:
    """Candidates of a part, their limit, and their loads in each draw."""

    candidates: Critical
    """Q candidates in C classes."""
    limit: float
    """Limit of the load across the tool's axis [N]."""
    most: Floats
    """Greatest feed of each [m]; shape (Q,)."""
    responses: Responses
    """Responses of the classes."""

    def feeds(self, loads: Floats) -> Floats:
        """Feeds up to which each stays within where classes have these loads, (C, K); (Q,)."""
        from pipeline.optimisation.problem.kernels import feeds_within

        of, out = self.candidates, np.empty(len(self.candidates))
        feeds_within(
            self.limit, self.most, of.curve, of.scale, of.exponent, of.weight, of.group,
            self.responses.f_z, loads - self.responses.expected, out,
        )  # fmt: skip
        return out

    def peaks(self, feeds: Floats, draws: slice) -> Floats:
        """The part's greatest load in each of some draws [N]; shape (D,)."""
        from pipeline.optimisation.problem.kernels import peak_loads

        of, peaks = self.candidates, np.zeros(draws.stop - draws.start)
        drawn = self.responses
        peak_loads(
            feeds, of.curve, of.scale, of.exponent, of.weight, of.group, drawn.f_z,
            drawn.expected, drawn.values, draws.start, peaks,
        )  # fmt: skip
        return peaks


def row_feeds(candidates: Critical, feeds: Floats) -> Floats:
    """Least feed of each row's candidates; inf without one.  Shape (M,)."""
    out = np.full(candidates.rows, np.inf)
    np.minimum.at(out, candidates.row, feeds)
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class ChanceConstrainedFeeds:
    """Feeds for each tooth of M rows."""

    f_z: Floats = field(repr=False)
    nominal: Floats = field(repr=False)
    """Greatest one with and without uncertainty [m]; 0 where no feed meets the limit, inf in rows
    that cut nothing or never reach it; shape (M,)."""
    level: float
    """Level of the quantile that keeps each row's load within the limit [1]; 0.5 if nominal."""
    share: float
    """Share of held-out draws in which any row passes the limit [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exceedance:
    """Probability that a part passes the load limit of any of its tools."""

    probability: float
    """Share of draws in which any row passes it [1]."""
    interval_95: tuple[float, float]
    """95 % interval of the share by Clopper and Pearson [1]."""
    draws: int
    """Number of draws."""
    peak_quantiles: dict[float, float]
    """Quantiles of the peak load of the tools with a limit, by level [N]."""


def chance_constrained_feeds(
    cut: Cut, limits_N: Floats, margin: float, uncertain: Uncertainty,
    settings: ReliabilitySettings, *, greatest: Floats | None = None,
) -> ChanceConstrainedFeeds:  # fmt: skip
    """Greatest feeds at which P(any row's load > limit) <= epsilon for the part.

    ``limits_N`` (T,): peak load across the axis of each tool [N], infinite for none; ``margin``:
    share of it kept free [1]; ``greatest`` (M,): feed for each tooth by other limits [m].
    """
    limits_N = limits_N * (1.0 - margin)
    allowed = np.full(cut.engagement.blocks, np.inf) if greatest is None else greatest
    candidates = critical(cut, _near(cut, allowed, limits_N)).over(limits_N)
    _check(cut, candidates, uncertain)
    most = candidates.feeds(1.0)
    nominal = row_feeds(candidates, most)
    if settings.epsilon >= NOMINAL or not len(candidates):
        return ChanceConstrainedFeeds(
            f_z=nominal, nominal=nominal, level=NOMINAL, share=float("nan")
        )
    reach = np.where(np.isfinite(most), most, candidates.last_feeds)
    reach = np.maximum(np.minimum(reach, allowed[candidates.row]), LEAST)
    draws = draws_of(uncertain, settings.draws, settings.seed)
    start = normal_level(1.0 - settings.epsilon)
    nodes = _feed_nodes(cut, candidates, limits_N, reach, draws, start)
    drawn = responses(cut, candidates, nodes, draws).over(candidates, limits_N)
    part = PartLoads(candidates=candidates, limit=1.0, most=reach, responses=drawn)
    aim = aimed_share(settings.epsilon, len(draws))
    level, share = _level(part, aim)
    if share > aim:
        raise ValueError(
            f"certainty.draws = {settings.draws} are too few to tell P(load > limit) <= "
            f"{settings.epsilon:g} for this part: take more draws, or a greater epsilon"
        )
    feeds = part.feeds(quantiles(np.sort(part.responses.values, axis=2), level))
    feeds = np.where((feeds >= reach) & (reach < most), np.inf, feeds)
    return ChanceConstrainedFeeds(
        f_z=np.minimum(row_feeds(candidates, feeds), nominal), nominal=nominal,
        level=normal_share(level), share=share,
    )  # fmt: skip


def _near(cut: Cut, f_z: Floats, loads_N: Floats) -> NDArray[np.intp]:
    """Rows whose load could reach the limit of their tool (T,) [N] in any draw, at f_z (M,) [m]."""
    many = np.array([tool.flutes for tool in cut.tools] or [1])[cut.tool]
    with np.errstate(invalid="ignore"):
        loads = cut.table.peaks(np.minimum(many * f_z, ENDLESS))
    least = np.append(loads_N, np.inf)[cut.tool]
    return np.flatnonzero((FAR * loads >= least) & np.isfinite(least))


def _feed_nodes(
    cut: Cut, candidates: Critical, limits_N: Floats, reach: Floats, draws: Draws, level: float
) -> Floats:
    """Feeds at which to compute each class for levels from ``level`` on, of few draws."""
    greatest = np.full(candidates.classes, LEAST)
    np.maximum.at(greatest, candidates.group, reach)
    few = draws.first(max(len(draws) // PILOT_DIVISOR, min(len(draws), 64)))
    drawn = responses(cut, candidates, greatest[:, None] * NODES, few).over(candidates, limits_N)
    part = PartLoads(candidates=candidates, limit=1.0, most=reach, responses=drawn)
    ordered = np.sort(drawn.values, axis=2)
    most = BESIDE * part.feeds(quantiles(ordered, level))
    least = part.feeds(quantiles(ordered, level + LEVEL_SPAN_SD)) / BESIDE
    high, low = np.zeros(candidates.classes), np.full(candidates.classes, np.inf)
    np.maximum.at(high, candidates.group, np.minimum(most, reach))
    np.minimum.at(low, candidates.group, least)
    high = np.maximum(high, NODES[0] * greatest)
    return nodes_between(np.clip(low, NODES[0] * greatest, high), high)


def exceedance(
    cut: Cut, f_z: Floats, limits_N: Floats, uncertain: Uncertainty,
    settings: ReliabilitySettings, seed: int,
) -> Exceedance:  # fmt: skip
    """Probability that any load of a part passes the limit of its tool, in fresh draws.

    ``f_z`` (M,): feed for each tooth [m], nothing cut at 0; ``limits_N`` (T,): of each tool [N],
    infinite for none; ``seed``: another one than that of the feeds.
    """
    many, at = FRESH * settings.draws, np.asarray(f_z, dtype=np.float64)
    candidates = critical(cut, _judged(cut, at, limits_N))
    _check(cut, candidates, uncertain)
    feeds = at[candidates.row]
    feeds = np.where(np.isfinite(feeds), feeds, candidates.last_feeds)
    least, most = np.full(candidates.classes, np.inf), np.full(candidates.classes, LEAST)
    np.minimum.at(least, candidates.group, np.where(feeds > 0, feeds, np.inf))
    np.maximum.at(most, candidates.group, feeds)
    nodes = nodes_between(np.clip(least, LEAST, most), most)
    drawn = responses(cut, candidates, nodes, draws_of(uncertain, many, seed))
    part = PartLoads(candidates=candidates, limit=np.inf, most=feeds, responses=drawn)
    over = replace(part, candidates=candidates.over(limits_N),
                   responses=drawn.over(candidates, limits_N))  # fmt: skip
    peaks, shares = (one.peaks(feeds, slice(0, many)) for one in (part, over))
    passed = int((shares > 1.0).sum())
    return Exceedance(
        probability=passed / many,
        interval_95=clopper_pearson(passed, many),
        draws=many,
        peak_quantiles={q: float(np.quantile(peaks, q)) for q in QUANTILES},
    )


def _judged(cut: Cut, f_z: Floats, limits_N: Floats) -> NDArray[np.intp]:
    """Rows of tools with a limit that could pass it, or make the peak load of such tools."""
    loads, limit = cut.table.peaks(np.minimum(f_z, ENDLESS)), np.append(limits_N, np.inf)[cut.tool]
    share = min(float((loads / limit).max(initial=0.0)), 1.0)
    least = min(float(loads[np.isfinite(limit)].max(initial=0.0)), float(limits_N.min()))
    finite = np.isfinite(limits_N)
    of_tool = np.minimum(share * np.where(finite, limits_N, 0.0), least)
    return _near(cut, f_z, np.where(finite, of_tool, np.inf))


def _level(part: PartLoads, epsilon: float) -> tuple[float, float]:
    """Level at which few enough draws pass, in standard deviations, and their share."""
    many = part.responses.values.shape[2]
    half = many // 2
    halves = (slice(0, half), slice(half, many))
    ordered = [np.sort(part.responses.values[:, :, one], axis=2) for one in halves]

    def share(level: float) -> float:
        peaks = []
        for one, other in ((0, 1), (1, 0)):
            feeds = part.feeds(quantiles(ordered[one], level))
            feeds = row_feeds(part.candidates, feeds)[part.candidates.row]
            peaks.append(part.peaks(feeds, halves[other]))
        return share_above(np.sort(np.concatenate(peaks)), part.limit)

    low, high = normal_level(1.0 - epsilon), HIGHEST
    passing = share(low)
    if passing <= epsilon:
        return low, passing
    passing = share(high)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        here = share(middle)
        if here <= epsilon:
            high, passing = middle, here
        else:
            low = middle
    return high, passing


def _check(cut: Cut, candidates: Critical, uncertain: Uncertainty) -> None:
    missing = {cut.numbers[tool] for tool in candidates.tool.tolist()} - set(uncertain.tools)
    if missing:
        raise ValueError(
            f"certainty: tool T{min(missing)} cuts and nothing is said of what is uncertain of it: "
            "give uncertainty() the force laws of all tools that cut"
        )


def quantiles(ordered: Floats, level: float) -> Floats:
    """Quantiles of values that rise along the last axis, at a level in standard deviations.

    Above the last few values the tail is that of a lognormal distribution.
    """
    beyond = SETTLED / ordered.shape[-1]
    settled = normal_level(1.0 - beyond)
    if level <= settled:
        return _at(ordered, normal_share(level))
    body = max(min(TAIL, 1.0 - 3 * beyond), 0.1)
    before = normal_level(body)
    low, high = _at(ordered, body), _at(ordered, 1.0 - beyond)
    growth = np.divide(high, low, out=np.ones_like(high), where=low > 0)
    return high * growth ** ((level - settled) / (settled - before))


def _at(ordered: Floats, share: float) -> Floats:
    """Quantile of ordered values, between the two nearest (Hyndman and Fan 1996, type 6)."""
    many = ordered.shape[-1]
    place = min(max(share * (many + 1) - 1, 0.0), many - 1.0)
    k = min(int(place), many - 2)
    return ordered[..., k] + (place - k) * (ordered[..., k + 1] - ordered[..., k])


def share_above(ordered: Floats, limit: float) -> float:
    """Share of rising loads above a limit; of few that of the lognormal tail, if that is more."""
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
    """Share to aim at in ``many`` draws, so that a probability is rarely above ``share`` [1].

    The level z of a normal distribution errs by sqrt((1 + z^2 / 2) / n) when all of n draws
    estimate its mean and spread, and by ``TAIL_ALONE`` times as much when its tail does.

    >>> round(aimed_share(0.01, 1024), 4), round(aimed_share(0.01, 65536), 4)
    (0.0065, 0.0095)
    """
    level = normal_level(1.0 - share)
    error = TAIL_ALONE * np.sqrt((1.0 + level**2 / 2) / many)
    return 1.0 - normal_share(float(level + Z_95 * error))


def clopper_pearson(passed: int, many: int) -> tuple[float, float]:
    """95 % interval of a probability of which ``passed`` of ``many`` draws are a sample.

    >>> low, high = clopper_pearson(0, 100)
    >>> low, round(high, 4)
    (0.0, 0.0362)
    """
    from scipy.special import betaincinv

    low = 0.0 if passed == 0 else float(betaincinv(passed, many - passed + 1, 0.025))
    high = 1.0 if passed == many else float(betaincinv(passed + 1, many - passed, 0.975))
    return low, high
