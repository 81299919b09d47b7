"""The best feed of each block at given spindle speeds: exact where blocks do not interact.

Rows that share an F have to suit all their intervals
(:mod:`pipeline.optimisation.direct.feed_interval`).  Time falls with F; so does all else, unless
wear depends on the feed for each tooth: then the best F may lie inside, where a golden section
finds it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.direct.block_model import BlockModel
from pipeline.optimisation.direct.feed_interval import SLACK, common_bounds, feed_bounds
from pipeline.optimisation.direct.row_groups import RowGroups

__all__ = ["BlockOptimum", "block_optimum", "feed_bounds"]

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

STEP = 1e-4
"""Below the greatest feed, as a share, to see whether the objective still falls there."""
GOLDEN = (np.sqrt(5) - 1) / 2
SECTIONS = 32
ROOM = 2**18
"""Rows times individuals that are looked at together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockOptimum:
    """Best feeds of M rows at P choices of S.

    Parameters
    ----------
    feeds : ndarray, shape (P, M)
        In the units of ``Moves``; rows that keep theirs have their own.
    values : ndarray, shape (P, M)
        Objective of each row at that F and S; infinite where no F meets the limits.
    low, high : ndarray, shape (P, M)
        Interval that suits all rows of a group; empty where ``low`` is above ``high``.
    """

    feeds: Floats = field(repr=False)
    values: Floats = field(repr=False)
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)


def block_optimum(model: BlockModel, group: Rows, speeds: Floats) -> BlockOptimum:
    """Best F of each group of rows at given speeds.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    group : ndarray of intp, shape (M,)
        Rows that share an F, from 0 without gaps; -1 where the row keeps its own.
    speeds : ndarray, shape (P, M)
        S of each row [rev/min].
    """
    many = max(1, ROOM // max(speeds.shape[1], 1))
    parts = [
        _solved(model, group, speeds[first : first + many]) for first in range(0, len(speeds), many)
    ]
    return BlockOptimum(
        feeds=np.concatenate([part.feeds for part in parts]),
        values=np.concatenate([part.values for part in parts]),
        low=np.concatenate([part.low for part in parts]),
        high=np.concatenate([part.high for part in parts]),
    )


def best_feeds(
    model: BlockModel, groups: RowGroups, speeds: Floats, low: Floats, high: Floats
) -> Floats:
    """F of each row, the best of its group from ``low`` to ``high``.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    groups : RowGroups
        U groups that share an F; other rows keep theirs.
    speeds : ndarray, shape (P, M)
        S of each row [rev/min].
    low, high : ndarray, shape (P, U)
        Where that is empty, the mean of the group's own feeds is taken.

    Returns
    -------
    ndarray, shape (P, M)
    """
    own = model.problem.cut.plan.path.moves.feed

    def values(feeds: Floats, rows: Rows | slice) -> Floats:
        return groups.total(model.values(groups.spread(feeds, own), speeds[rows]))

    possible, given = low <= high, groups.mean(own)
    best = _lowest(values, np.where(possible, low, given), np.where(possible, high, given))
    return groups.spread(best, own)


def _solved(model: BlockModel, group: Rows, speeds: Floats) -> BlockOptimum:
    problem = model.problem
    own, groups = problem.cut.plan.path.moves.feed, RowGroups(group)
    low, high = feed_bounds(problem, speeds)
    least, most = common_bounds(problem, groups, low, high, speeds)
    feeds = best_feeds(model, groups, speeds, least, most)
    bad = groups.spread(np.where(least <= most, 0.0, 1.0), np.zeros(len(own))) > 0
    held = problem.cuts & (group < 0)
    bad |= held & ~((low <= own * (1 + SLACK)) & (own <= high * (1 + SLACK)))
    return BlockOptimum(
        feeds=feeds,
        values=np.where(bad, np.inf, model.values(feeds, speeds)),
        low=groups.spread(least, own),
        high=groups.spread(most, own),
    )


def _lowest(
    values: Callable[[Floats, Rows | slice], Floats], low: Floats, high: Floats
) -> Floats:  # fmt: skip
    """Feeds from ``low`` to ``high`` of the least values; shapes (P, U)."""
    every = slice(None)
    inside = np.maximum(high * (1 - STEP), low)
    turned = values(inside, every) < values(high, every)
    rows = np.flatnonzero(turned.any(axis=1))
    if not len(rows):
        return high
    best = high.copy()
    found = _golden(lambda feeds: values(feeds, rows), low[rows], high[rows])
    best[rows] = np.where(turned[rows], found, high[rows])
    return best


def _golden(values: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Where a function with one valley is least, by golden section over log F."""
    left, right = np.log(low), np.log(high)
    one, two = right - GOLDEN * (right - left), left + GOLDEN * (right - left)
    at_one, at_two = values(np.exp(one)), values(np.exp(two))
    for _ in range(SECTIONS):
        lower = at_one <= at_two  # the valley is left of the second
        left, right = np.where(lower, left, one), np.where(lower, two, right)
        new_one = right - GOLDEN * (right - left)
        new_two = left + GOLDEN * (right - left)
        new = values(np.exp(np.where(lower, new_one, new_two)))
        at_one, at_two = np.where(lower, new, at_two), np.where(lower, at_one, new)
        one, two = new_one, new_two
    ends = np.stack([low, np.clip(np.exp(0.5 * (left + right)), low, high)])
    sides = np.stack([values(ends[0]), values(ends[1])])
    return np.where(sides[0] <= sides[1], ends[0], ends[1])
