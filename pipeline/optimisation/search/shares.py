"""Decisions as genes that keep the limits: S of each stretch, and F as a share of what S allows.

At one S the limits of each row are one interval of F
(:mod:`pipeline.optimisation.direct.feed_interval`), and so are those of rows that share an F.
A gene of F is a place in that interval, on a logarithmic scale, from 0 to 1; whatever S a search
tries, feeds follow it and keep what limits them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.direct.feed_interval import common_bounds, feed_bounds
from pipeline.optimisation.direct.row_groups import RowGroups
from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.groups import Groups
from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

LEAST = 1e-3
"""Of the greatest F that is allowed, where the range of F begins below."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shares:
    """Genes of G groups and H stretches: first G shares of F [1], then H speeds [rev/min].

    Parameters
    ----------
    problem : Problem
        Of M rows.
    start : Decision
        Whose groups they are; its S may stay as it is, all other S are whole.
    low, high : ndarray, shape (G + H,)
        Bounds.
    """

    problem: Problem = field(repr=False)
    start: Decision = field(repr=False)
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)

    @classmethod
    def of(cls, problem: Problem, start: Decision) -> "Shares":
        """The genes of a decision's groups; its S may lie outside of what rows allow."""
        slow, fast = speed_ranges(problem, start.groups, start.speeds)
        slow, fast = np.minimum(slow, start.speeds), np.maximum(fast, start.speeds)
        many = start.groups.feeds
        return cls(
            problem=problem, start=start, low=np.concatenate([np.zeros(many), slow]),
            high=np.concatenate([np.ones(many), fast]),
        )  # fmt: skip

    @property
    def groups(self) -> Groups:
        """What shares an F, what an S."""
        return self.start.groups

    @property
    def log(self) -> NDArray[np.bool_]:
        """Which genes are searched on a logarithmic scale: the speeds; shape (G + H,)."""
        return np.arange(len(self.low)) >= self.groups.feeds

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F, shape (P, G), and S, shape (P, H), of genes of shape (P, G + H)."""
        many = self.groups.feeds
        speeds = whole(genes[:, many:], self.start.speeds)
        low, high = group_bounds(self.problem, self.groups, speeds)
        possible = low <= high
        with np.errstate(over="ignore", invalid="ignore"):
            feeds = low * (high / low) ** genes[:, :many]
        # what has no F that keeps the limits is judged at the greatest that keeps the upper ones
        other = np.where((high > 0) & np.isfinite(high), high, self.start.feeds)
        return np.where(possible, np.minimum(feeds, high), other), speeds

    def encoded(self, feeds: Floats, speeds: Floats) -> Floats:
        """Genes, shape (P, G + H), of F, shape (P, G), and S, shape (P, H)."""
        low, high = group_bounds(self.problem, self.groups, speeds)
        wide = high > low
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.log(feeds / low) / np.log(high / low)
        share = np.clip(np.where(wide & np.isfinite(share), share, 1.0), 0.0, 1.0)
        many = self.groups.feeds
        return np.concatenate(
            [share, np.clip(speeds, self.low[many:], self.high[many:])], axis=1
        )  # fmt: skip


def whole(speeds: Floats, start: Floats) -> Floats:
    """Whole S, shape (P, H); those next to where the search began as it had them, (H,)."""
    return np.where(np.abs(speeds - start) < 0.5, start, np.round(speeds))


def speed_ranges(problem: Problem, groups: Groups, own: Floats) -> tuple[Floats, Floats]:
    """Least and greatest whole S that suits all rows of each stretch, shape (H,) each.

    Where there is no whole S to choose from it is kept as in ``own``, shape (H,).
    """
    rows = np.flatnonzero(groups.speed >= 0)
    low, high = np.zeros(len(own)), np.full(len(own), np.inf)
    np.maximum.at(low, groups.speed[rows], problem.speed_low[rows])
    np.minimum.at(high, groups.speed[rows], problem.speed_high[rows])
    low, high = np.maximum(np.ceil(low), 1.0), np.floor(high)
    free = np.isfinite(high) & (low <= high)
    return np.where(free, low, own), np.where(free, high, own)


def group_bounds(problem: Problem, groups: Groups, speeds: Floats) -> tuple[Floats, Floats]:
    """Least and greatest F that suits all rows of each group, shape (P, G) each.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    groups : Groups
        G of them.
    speeds : ndarray, shape (P, H)
        [rev/min].

    Returns
    -------
    tuple of ndarray
        In the units of ``Moves``; the least is above the greatest where no F keeps the limits.
    """
    rows = groups.row_speeds(speeds)
    least, most = common_bounds(
        problem, RowGroups(groups.feed), *feed_bounds(problem, rows), rows
    )  # fmt: skip
    return np.maximum(least, LEAST * most), most
