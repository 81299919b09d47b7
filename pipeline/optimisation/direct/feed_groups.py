"""Groups of blocks that share an F at given spindle speeds, and the best F of each."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Moves
from pipeline.machine.control.path import Motion
from pipeline.optimisation.direct.block_model import BlockModel
from pipeline.optimisation.direct.block_optimum import best_feeds, block_optimum
from pipeline.optimisation.direct.merge import Curves, merged
from pipeline.optimisation.direct.row_groups import RowGroups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import Grouping

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

NODES = 49
"""Feeds at which blocks are tabulated."""
SPAN = 1.0 + 1e-6
"""What the table reaches beyond the least and greatest feed, as a factor."""


def feed_groups(
    model: BlockModel, grouping: Grouping, stretch: Rows, speeds: Floats, whole: float
) -> tuple[Rows, Floats]:  # fmt: skip
    """Groups of F, and the best F of each.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    grouping : Grouping
        When blocks are merged.
    stretch : ndarray of intp, shape (M,)
        Stretch of S of each row; a group lies in one.
    speeds : ndarray, shape (M,)
        S of each row [rev/min].
    whole : float
        Objective of the whole part as programmed.

    Returns
    -------
    group : ndarray of intp, shape (M,)
        -1 where F is kept.
    feeds : ndarray, shape (G,)
        In the units of ``Moves``.

    Raises
    ------
    ValueError
        When no F suits all rows of a block.
    """
    problem, block = model.problem, model.problem.editable.block
    if not (block >= 0).any():
        return block.copy(), np.zeros(0)
    blocks = RowGroups(block)
    alone = block_optimum(model, block, speeds[None])
    low, high = (blocks.first(bound[0]) for bound in (alone.low, alone.high))
    curves = _curves(model, blocks, speeds, low, high)
    joint = _joint(problem.cut.plan.path.moves, _codes(problem, stretch), problem)
    gain = grouping.least_gain * whole
    of_block = merged(curves, joint, gain=gain, least_time=grouping.least_block_s)
    groups = RowGroups(np.where(block >= 0, of_block[block], -1))
    least, most = groups.greatest(alone.low), -groups.greatest(-alone.high)
    best = groups.first(best_feeds(model, groups, speeds[None], least, most)[0])
    return groups.group, _kept(model, groups, best, (least[0], most[0]), speeds, gain)


def _curves(
    model: BlockModel, blocks: RowGroups, speeds: Floats, low: Floats, high: Floats
) -> Curves:
    """Tables of all blocks over the feeds that any of them may have."""
    own = model.problem.cut.plan.path.moves.feed
    feeds = np.geomspace(low.min() / SPAN, high.max() * SPAN, NODES)
    tables = np.empty((2, len(low), NODES))
    for node, feed in enumerate(feeds):
        tried = blocks.spread(np.full((1, len(low)), feed), own)
        found = model.demands(tried, speeds[None])
        tables[0, :, node] = blocks.total(found[model.column])[0]
        tables[1, :, node] = blocks.total(found[0])[0]
    return Curves(
        feeds=feeds, values=tables[0], times=tables[1], low=low, high=high, own=blocks.common(own)
    )


def _codes(problem: Problem, stretch: Rows) -> Rows:
    """Number of each row's tool, stretch and kind of feed; shape (M,)."""
    path = problem.cut.plan.path
    parts = np.stack([path.moves.tool, stretch, path.motion.astype(np.intp)])
    return np.unique(parts, axis=1, return_inverse=True)[1].ravel()


def _joint(moves: Moves, code: Rows, problem: Problem) -> Flags:
    """Whether each block may share an F with the next one of the text; shape (B - 1,).

    Both need the same tools, stretches and kind of feed, and no row between them that keeps its F:
    its word would end the group in any case.
    """
    block, line = problem.editable.block, problem.editable.line
    rows = np.flatnonzero(block >= 0)
    pairs = np.unique(np.stack([block[rows], code[rows]]), axis=1)
    codes = np.split(pairs[1], np.flatnonzero(np.diff(pairs[0])) + 1)
    alike = np.array([
        len(one) == len(other) and bool((one == other).all())
        for one, other in pairwise(codes)
    ], dtype=bool)  # fmt: skip
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
