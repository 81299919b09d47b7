"""Speeds of stretches between the values of the grid: a search that narrows, in whole rev/min."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.direct.block_model import BlockModel
from pipeline.optimisation.direct.block_optimum import block_optimum
from pipeline.optimisation.direct.speed_grid import SPEEDS
from pipeline.optimisation.direct.speed_pieces import Pieces
from pipeline.optimisation.direct.speed_waits import change_price, start_prices
from pipeline.optimisation.direct.speeds import Stretches, changes_of, spread
from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

ROUNDS = 6
CANDIDATES = 9
"""Of each round, about the best so far; the next round covers what lies between two of them."""
SAME = 1e-9
"""Values that differ by less, as a share, are the same, and the lower S is taken."""

Change = tuple[int, int, bool, float]


def refined(model: BlockModel, pieces: Pieces, found: Stretches, group: Rows) -> Floats:
    """Best S of each stretch near those given; never worse.  Shape (H,) [rev/min].

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    pieces, found : Pieces, Stretches
        What the stretches are made of, and their speeds so far.
    group : ndarray of intp, shape (M,)
        Rows that share an F, -1 where it is kept.
    """
    speeds = found.speeds.copy()
    if not len(speeds):
        return speeds
    changes = changes_of(found.of_piece, pieces)
    colours = _colours(changes, len(speeds))
    width = _widths(model.problem, found)
    steps = np.linspace(-1.0, 1.0, CANDIDATES)[:, None]
    for _ in range(ROUNDS):
        for colour in range(int(colours.max()) + 1):
            mine = colours == colour
            tried = np.where(mine, np.round(speeds * (1 + width * steps)), speeds)
            tried[CANDIDATES // 2] = speeds
            tried = np.maximum(tried, 1.0)
            values = _values(model, pieces, found, changes, group, tried)
            best = values.min(axis=0)
            first = (values <= best + SAME * np.abs(best)).argmax(axis=0)
            better = mine & np.isfinite(best)
            speeds = np.where(better, tried[first, np.arange(len(speeds))], speeds)
        width = width * 2 / (CANDIDATES - 1)
    return speeds


def _widths(problem: Problem, found: Stretches) -> Floats:
    """Ratio of two neighbours of the grid, less 1, for each stretch; shape (H,)."""
    low, high = np.full((2, len(found.speeds)), np.nan)
    rows = np.flatnonzero((found.stretch >= 0) & problem.cuts)
    low[:], high[:] = np.inf, 0.0
    np.minimum.at(low, found.stretch[rows], problem.speed_low[rows])
    np.maximum.at(high, found.stretch[rows], problem.speed_high[rows])
    low = np.maximum(np.minimum(low, found.speeds), 0.01 * found.speeds)
    high = np.minimum(np.maximum(high, found.speeds), 100 * found.speeds)
    widths: Floats = (high / low) ** (1 / (SPEEDS - 1)) - 1
    return widths


def _values(
    model: BlockModel, pieces: Pieces, found: Stretches, changes: Sequence[Change], group: Rows,
    speeds: Floats,
) -> Floats:  # fmt: skip
    """What each stretch takes, with the changes from and to it; shape (P, H) of (P, H)."""
    own = model.problem.cut.plan.path.moves.speed
    rows = np.flatnonzero(found.stretch >= 0)
    stretch = found.stretch[rows]
    values = block_optimum(model, group, spread(speeds, found.stretch, own)).values
    out = np.zeros(speeds.shape)
    for one, total in zip(values, out, strict=True):
        total += np.bincount(stretch, one[rows], minlength=len(total))
    grid = speeds.T[np.maximum(found.of_piece, 0)]
    out += _of_stretches(start_prices(model, _alone(pieces), grid), found, speeds)
    for before, after, rest, lead in changes:
        price = change_price(
            model, speeds[:, before], speeds[:, after], rest=rest, lead=lead
        )  # fmt: skip
        out[:, before] += price
        out[:, after] += price
    return out


def _alone(pieces: Pieces) -> Pieces:
    """The same pieces, each with speeds of its own."""
    return Pieces(
        piece=pieces.piece, turn=np.arange(len(pieces)), word=pieces.word, rest=pieces.rest,
        lead=pieces.lead,
        key=pieces.key,
    )  # fmt: skip


def _of_stretches(values: Floats, found: Stretches, speeds: Floats) -> Floats:
    """Sums over the pieces of each stretch; shape (P, H) of (A, P)."""
    out = np.zeros(speeds.shape)
    here = found.of_piece >= 0
    np.add.at(out.T, found.of_piece[here], values[here])
    return out


def _colours(changes: Sequence[Change], many: int) -> Rows:
    """Numbers such that stretches that follow one another have different ones; shape (H,)."""
    beside: list[set[int]] = [set() for _ in range(many)]
    for before, after, *_ in changes:
        beside[before].add(after)
        beside[after].add(before)
    colours = np.full(many, -1, dtype=np.intp)
    for one in range(many):
        taken = {int(colours[other]) for other in beside[one]}
        colours[one] = next(c for c in range(many) if c not in taken)
    return colours
