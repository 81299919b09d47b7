"""Groups of blocks that share an F at given spindle speeds, and the best F of each.

Of all pairs of neighbours the one that loses least is merged, while the loss is less than an F word
has to save.  A group that takes less than the least block time is merged too, unless that loses
more than it takes itself.  The objective over F is tabulated over 1/F, in which time is linear, so
that tables of groups are sums of tables.
"""

from bisect import bisect_right
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import pairwise

import numpy as np

from pipeline.gcode.moves import Moves
from pipeline.machine.control.path import Motion
from pipeline.optimisation.methods.feeds import BlockModel, best_feeds, block_feeds
from pipeline.optimisation.problem.arrays import RowGroups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import Grouping
from pipeline.schema.arrays import Bools, Floats, Rows

NODES = 49
"""Feeds at which blocks are tabulated."""
SPAN = 1.0 + 1e-6
"""Factor by which the table reaches beyond the least and greatest feed."""
ROUNDING = 1e-12
"""Rounding error of sums over many blocks, as a share [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """B blocks over Q feeds."""

    feeds: Floats = field(repr=False)
    """Feeds, rising, in the units of ``Moves``; shape (Q,)."""
    values: Floats = field(repr=False)
    times: Floats = field(repr=False)
    """Objective, and time [s], of each block at each of them; shape (B, Q)."""
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)
    """Feeds that each block allows; shape (B,)."""
    own: Floats = field(repr=False)
    """F as programmed; NaN where its rows have several; shape (B,)."""


def feed_groups(
    model: BlockModel, grouping: Grouping, stretch: Rows, speeds: Floats, whole: float
) -> tuple[Rows, Floats]:
    """Groups of F, (M,), -1 where F is kept, and the best F (G,) of each in the units of ``Moves``.

    ``stretch`` (M,): stretch of S of each row; a group lies in one; ``speeds`` (M,): S of each row
    [rev/min]; ``whole``: objective of the whole part as programmed.
    """
    problem, block = model.problem, model.problem.editable.block
    if not (block >= 0).any():
        return block.copy(), np.zeros(0)
    blocks = RowGroups(block)
    alone = block_feeds(model, block, speeds[None])
    low, high = (blocks.first(bound[0]) for bound in (alone.low, alone.high))
    curves = _curves(model, blocks, speeds, low, high)
    joint = _joint(problem.cut.plan.path.moves, _codes(problem, stretch), problem)
    gain = grouping.least_gain * whole
    of_block = merged(curves, joint, gain=gain, least_time=grouping.least_block_s)
    groups = RowGroups(np.where(block >= 0, of_block[block], -1))
    least, most = groups.intersection(alone.low, alone.high)
    best = groups.first(best_feeds(model, groups, speeds[None], least, most)[0])
    return groups.group, _kept(model, groups, best, (least[0], most[0]), speeds, gain)


def _curves(
    model: BlockModel, blocks: RowGroups, speeds: Floats, low: Floats, high: Floats
) -> Curves:
    own = model.problem.cut.plan.path.moves.feed
    feeds = np.geomspace(low.min() / SPAN, high.max() * SPAN, NODES)
    tables = np.empty((2, len(low), NODES))
    for node, feed in enumerate(feeds):
        tried = blocks.spread(np.full((1, len(low)), feed), own)
        demands = model.demands(tried, speeds[None])
        tables[0, :, node] = blocks.total(demands[model.column])[0]
        tables[1, :, node] = blocks.total(demands[0])[0]
    return Curves(
        feeds=feeds, values=tables[0], times=tables[1], low=low, high=high, own=blocks.common(own)
    )


def _codes(problem: Problem, stretch: Rows) -> Rows:
    path = problem.cut.plan.path
    parts = np.stack([path.moves.tool, stretch, path.motion.astype(np.intp)])
    return np.unique(parts, axis=1, return_inverse=True)[1].ravel()


def _joint(moves: Moves, code: Rows, problem: Problem) -> Bools:
    """Blocks (B - 1,) that may share an F with the next: same tools, stretches and kind of feed."""
    block, line = problem.editable.block, problem.editable.line
    rows = np.flatnonzero(block >= 0)
    pairs = np.unique(np.stack([block[rows], code[rows]]), axis=1)
    codes = np.split(pairs[1], np.flatnonzero(np.diff(pairs[0])) + 1)
    alike = np.array(
        [len(one) == len(other) and bool((one == other).all()) for one, other in pairwise(codes)],
        dtype=bool,
    )
    fed = np.isin(problem.cut.plan.path.motion, (Motion.CUTTING, Motion.PER_TURN))
    held = fed & (block < 0)
    in_file = held & (moves.file == moves.file[rows[0]])
    lines = np.sort(moves.line[in_file])
    between = np.diff(np.searchsorted(lines, line)) > 0
    _, first = np.unique(block[rows], return_index=True)
    run = np.diff(np.cumsum(held)[rows[first]]) != 0
    return alike & ~between & ~run


def _kept(
    model: BlockModel, groups: RowGroups, best: Floats, bounds: tuple[Floats, Floats],
    speeds: Floats, gain: float,
) -> Floats:  # fmt: skip
    """The best feeds, but those as programmed of groups that lose less than a word is worth."""
    own = model.problem.cut.plan.path.moves.feed
    common, (low, high) = groups.common(own), bounds
    possible = (low <= common) & (common <= high)  # not a number is neither
    tried = np.stack([best, np.where(possible, common, best)])
    values = groups.total(model.values(groups.spread(tried, own), np.tile(speeds, (2, 1))))
    return np.where(values[1] - values[0] <= gain, tried[1], best)


@dataclass(slots=True)
class _Group:
    """Blocks in a row that share an F."""

    values: Floats
    times: Floats
    low: float
    high: float
    own: float
    feed: float = 0.0
    value: float = 0.0
    time: float = 0.0

    @property
    def kept(self) -> bool:
        return self.feed == self.own


class _Merger:
    """A chain of groups, and a heap of what merging each pair of neighbours loses."""

    def __init__(self, curves: Curves, joint: Bools, *, gain: float, least_time: float) -> None:
        self._inverse = (-1.0 / curves.feeds).tolist()  # rising
        self._feeds = curves.feeds
        self._gain, self._least_time = gain, least_time
        many = len(curves.low)
        self._groups: list[_Group | None] = [
            self._settled(_Group(values, times, low, high, own))
            for values, times, low, high, own in zip(
                curves.values, curves.times, curves.low.tolist(), curves.high.tolist(),
                curves.own.tolist(), strict=True,
            )
        ]  # fmt: skip
        self._after = [b + 1 if joint[b] else -1 for b in range(many - 1)] + [-1] * (many > 0)
        self._before = [-1] + [b if joint[b] else -1 for b in range(many - 1)]
        self._age = [0] * many
        self._heap: list[tuple[float, int, int, int, int]] = []

    def groups(self) -> Rows:
        """Group of each block, numbered in their order; shape (B,)."""
        for block in range(len(self._groups)):
            self._offer(block, self._after[block], heap=False)
        heapify(self._heap)
        while self._heap:
            _, one, other, age_one, age_other = heappop(self._heap)
            if (age_one, age_other) == (self._age[one], self._age[other]):
                self._merge(one, other)
        first = [group is not None for group in self._groups]
        return (np.cumsum(first) - 1).astype(np.intp)

    def _offer(self, one: int, other: int, *, heap: bool = True) -> None:
        if one < 0 or other < 0:
            return
        left, right = self._groups[one], self._groups[other]
        if left is None or right is None:
            return
        joined = self._joined(left, right)
        if joined is None:
            return
        loss = joined.value - left.value - right.value
        if self._allowed(loss, left, right, joined):
            entry = (loss, one, other, self._age[one], self._age[other])
            if heap:
                heappush(self._heap, entry)
            else:
                self._heap.append(entry)

    def _allowed(self, loss: float, left: _Group, right: _Group, joined: _Group) -> bool:
        saved = 0 if left.kept and right.kept and not joined.kept else 1
        if loss <= self._gain * saved + ROUNDING * joined.value:
            return True
        return any(one.time < self._least_time and loss <= one.value for one in (left, right))

    def _merge(self, one: int, other: int) -> None:
        left, right = self._groups[one], self._groups[other]
        if left is None or right is None:
            return
        joined = self._joined(left, right)
        if joined is None:
            return
        self._groups[one], self._groups[other] = joined, None
        self._age[one] += 1
        self._age[other] += 1
        after = self._after[one] = self._after[other]
        if after >= 0:
            self._before[after] = one
        self._offer(self._before[one], one)
        self._offer(one, after)

    def _joined(self, left: _Group, right: _Group) -> _Group | None:
        low, high = max(left.low, right.low), min(left.high, right.high)
        if low > high:
            return None
        return self._settled(_Group(
            left.values + right.values, left.times + right.times, low, high,
            left.own if left.own == right.own else np.nan,
        ))  # fmt: skip

    def _settled(self, group: _Group) -> _Group:
        group.feed, group.value = self._best(group)
        group.time = self._at(group.times, group.feed)
        return group

    def _best(self, group: _Group) -> tuple[float, float]:
        best = min(
            ((self._at(group.values, feed), -feed) for feed in (group.high, group.low)),
        )
        value, feed = best[0], -best[1]
        first = bisect_right(self._inverse, -1.0 / group.low)
        last = bisect_right(self._inverse, -1.0 / group.high)
        if last > first:
            index = first + int(group.values[first:last].argmin())
            if group.values[index] < value:
                value, feed = float(group.values[index]), float(self._feeds[index])
        return feed, value

    def _at(self, values: Floats, feed: float) -> float:
        """Between nodes linear in 1/F."""
        x, nodes = -1.0 / feed, self._inverse
        i = min(max(bisect_right(nodes, x), 1), len(nodes) - 1)
        share = (x - nodes[i - 1]) / (nodes[i] - nodes[i - 1])
        return float(values[i - 1] + share * (values[i] - values[i - 1]))


def merged(curves: Curves, joint: Bools, *, gain: float, least_time: float) -> Rows:
    """Group of each of B blocks, from 0, rising, without gaps; shape (B,).

    ``joint`` (B - 1,): whether each block may share an F with the next; ``gain``: least saving of
    an F word, in the units of the objective; ``least_time``: groups that take less [s] are merged
    unless that loses more than they take.
    """
    if not len(curves.low):
        return np.zeros(0, dtype=np.intp)
    return _Merger(curves, joint, gain=gain, least_time=least_time).groups()
