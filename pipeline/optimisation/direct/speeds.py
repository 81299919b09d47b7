"""Which S each stretch of a program has: the cheapest way through a grid of speeds, then refined.

Pieces of the program (:mod:`pipeline.optimisation.direct.speed_pieces`) are stages, speeds of the
grid the states.  A stage costs what its blocks take with their best feeds at that S; a change of S
costs the time that the control waits for the spindle, and the worth of an S word that has to be
added.  A change by less than the least one is not allowed.  All speeds are whole rev/min, or as
programmed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import where
from pipeline.optimisation.direct.block_model import BlockModel
from pipeline.optimisation.direct.block_optimum import block_optimum
from pipeline.optimisation.direct.cheapest_path import cheapest_path
from pipeline.optimisation.direct.speed_grid import speed_grid
from pipeline.optimisation.direct.speed_pieces import Pieces, speed_pieces
from pipeline.optimisation.direct.speed_waits import change_price, start_prices
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import Grouping

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

LEADS = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0])
"""Times before a cut that are told apart [s]."""
TIE = 1e-9
"""What a higher speed of the grid has to gain on the one below, as a share."""
CHANGE = 1e-7
"""What any change of S has to save, as a share of the whole part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """H stretches of one S in M rows of A pieces.

    Parameters
    ----------
    stretch : ndarray of intp, shape (M,)
        -1 in rows that keep their S.
    speeds : ndarray, shape (H,)
        [rev/min].
    of_piece : ndarray of intp, shape (A,)
        Stretch of each piece.
    """

    stretch: Rows = field(repr=False)
    speeds: Floats = field(repr=False)
    of_piece: Rows = field(repr=False)


def spread(speeds: Floats, stretch: Rows, own: Floats) -> Floats:
    """S of each row, shape (..., M), of those of stretches, (..., H); ``own`` where it is kept."""
    if not speeds.shape[-1]:
        return np.broadcast_to(own, (*speeds.shape[:-1], len(own))).copy()
    return np.where(stretch >= 0, speeds[..., stretch], own)


def best_speeds(model: BlockModel, grouping: Grouping, whole: float) -> tuple[Pieces, Stretches]:
    """Best stretches of S, each with the best value of the grid.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    grouping : Grouping
        Where S words may be added, and what they have to save.
    whole : float
        Objective of the whole part as programmed.

    Raises
    ------
    ValueError
        When no S of a block's range meets its limits.
    """
    problem, moves = model.problem, model.problem.cut.plan.path.moves
    pieces = speed_pieces(problem.cut.plan, problem.editable, problem.cuts, grouping)
    grid = speed_grid(problem, pieces)
    values = _piece_values(model, pieces, grid)
    values += start_prices(model, pieces, grid)
    values *= 1 + TIE * np.arange(values.shape[1])
    rest = model.values(moves.feed[None], moves.speed[None])[0, pieces.piece < 0]
    least = float(values.min(axis=1).sum() + rest.sum())
    whole = min(whole, least)  # as programmed may be many times what it could be
    words = whole * np.where(pieces.word, max(grouping.least_gain, CHANGE), CHANGE)
    chosen = _chosen(model, pieces, grid, values, words)
    return pieces, _stretches(pieces, grid[pieces.turn, chosen])


def _piece_values(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    """What each piece takes at each speed with its best feeds; shape (A, K)."""
    problem = model.problem
    own, block = problem.cut.plan.path.moves.speed, problem.editable.block
    group = _parts_of_blocks(block, pieces.piece)
    found = np.zeros((len(pieces), grid.shape[1]))
    failing = np.ones(len(own), dtype=bool)
    for k, speeds in enumerate(grid.T):
        row_speeds = spread(speeds[pieces.turn], pieces.piece, own)
        values = block_optimum(model, group, row_speeds[None]).values[0]
        here = pieces.piece >= 0
        found[:, k] = np.bincount(pieces.piece[here], values[here], minlength=len(pieces))
        failing &= np.isinf(values)
    if failing.any():
        raise ValueError(_no_speed(problem, pieces, grid, int(failing.argmax())))
    return found


def _parts_of_blocks(block: Rows, piece: Rows) -> Rows:
    """Rows of one block in one piece, so that pieces can be looked at one by one; (M,)."""
    found = np.full(len(block), -1, dtype=np.intp)
    rows = np.flatnonzero(block >= 0)
    if len(rows):
        pairs = np.stack([block[rows], piece[rows]])
        found[rows] = np.unique(pairs, axis=1, return_inverse=True)[1].ravel()
    return found


def _no_speed(problem: Problem, pieces: Pieces, grid: Floats, row: int) -> str:
    moves = problem.cut.plan.path.moves
    place, piece = where(moves, row), int(pieces.piece[row])
    if piece < 0:
        return (
            f"{place}: no F keeps the limits at S {moves.speed[row]:g}, which cannot be changed "
            "there: widen the limits"
        )
    speeds = grid[pieces.turn[piece]]
    span = f"no S from {speeds[0]:g} to {speeds[-1]:g} rev/min"
    if problem.editable.block[row] < 0:
        return (
            f"{place}: F {moves.feed[row]:g} cannot be changed there, and {span} keeps the limits "
            "with it: lower it in the program"
        )
    return (
        f"{place}: {span} has an F that keeps the limits: widen them, or take another tool"
    )  # fmt: skip


def _chosen(
    model: BlockModel, pieces: Pieces, grid: Floats, values: Floats, words: Floats
) -> Rows:  # fmt: skip
    """Index of each piece's speed in the grid of its run; shape (A,)."""
    values = _shared(values, pieces.key)
    first = _paths(model, pieces, grid, values, words)
    _, leader, many = np.unique(pieces.key, return_index=True, return_counts=True)
    tied = leader[many > 1]
    if not len(tied):
        return first
    for piece in tied.tolist():  # all that begin at one line take the speed of the first
        speed = grid[pieces.turn[piece], first[piece]]
        for other in np.flatnonzero(pieces.key == pieces.key[piece]).tolist():
            near = np.abs(grid[pieces.turn[other]] - speed)
            values[other, near > near.min()] = np.inf
    return _paths(model, pieces, grid, values, words)


def _shared(values: Floats, key: Rows) -> Floats:
    """Values of pieces of one key, each with the mean of all."""
    _, index, many = np.unique(key, return_inverse=True, return_counts=True)
    if (many == 1).all():
        return values
    total = np.zeros((len(many), values.shape[1]))
    np.add.at(total, index, values)
    return total[index] / many[index, None]


def _paths(
    model: BlockModel, pieces: Pieces, grid: Floats, values: Floats, words: Floats
) -> Rows:  # fmt: skip
    found = np.zeros(len(pieces), dtype=np.intp)
    for turn, speeds in enumerate(grid):
        mine = np.flatnonzero(pieces.turn == turn)
        before, after = speeds[:, None], speeds[None, :]
        kinds, kind = np.unique(_kinds(pieces)[:, mine], axis=1, return_inverse=True)
        change = np.stack([
            change_price(model, before, after, rest=bool(rest), lead=float(lead))
            for rest, lead in kinds.T
        ])  # fmt: skip
        found[mine] = cheapest_path(values[mine], change, kind.ravel(), words[mine])
        taken = values[mine, found[mine]].sum()
        if not np.isfinite(taken):
            raise ValueError(_no_way(model.problem, pieces, mine))
    return found


def _kinds(pieces: Pieces) -> Floats:
    """Whether the spindle rests before each piece, and the lead, rounded down; shape (2, A)."""
    lead = LEADS[np.searchsorted(LEADS, pieces.lead, side="right") - 1]
    return np.stack([pieces.rest.astype(np.float64), lead])


def _no_way(problem: Problem, pieces: Pieces, mine: Rows) -> str:
    moves = problem.cut.plan.path.moves
    row = int(np.isin(pieces.piece, mine).argmax())
    least = problem.limits.least_speed_change_rpm
    return (
        f"{where(moves, row)}: T{moves.tool[row]} finds no S that keeps the limits of all its "
        f"blocks with changes of at least {least:g} rev/min at the places where S may change: "
        'widen the limits, or let S words be added (grouping.speeds = "blocks")'
    )


def _stretches(pieces: Pieces, speeds: Floats) -> Stretches:
    """Pieces in a row that have one S are one stretch; so are all of one key."""
    new = (np.diff(speeds, prepend=-1.0) != 0) | (np.diff(pieces.turn, prepend=-1) != 0)
    run = np.cumsum(new) - 1
    run = _joined(run, pieces.key)
    _, first, of_piece = np.unique(run, return_index=True, return_inverse=True)
    used = pieces.piece >= 0
    there, stretch = np.unique(of_piece[pieces.piece[used]], return_inverse=True)
    rows = np.full(len(pieces.piece), -1, dtype=np.intp)
    rows[used] = stretch
    number = np.full(len(first), -1, dtype=np.intp)
    number[there] = np.arange(len(there))
    return Stretches(stretch=rows, speeds=speeds[first][there], of_piece=number[of_piece])


def _joined(run: Rows, key: Rows) -> Rows:
    """Runs that share a key made one, by the lowest of their numbers."""
    while True:
        lowest = np.full(int(key.max(initial=-1)) + 1, len(run), dtype=np.intp)
        np.minimum.at(lowest, key, run)
        of_run = np.arange(len(run) + 1)
        np.minimum.at(of_run, run, lowest[key])
        joined = of_run[run]
        if (joined == run).all():
            return run
        run = joined


def changes_of(of_piece: Rows, pieces: Pieces) -> Sequence[tuple[int, int, bool, float]]:
    """Stretches that follow one another on one tool.

    Before, after, whether the spindle rests between them, and the least lead [s].
    """
    found: dict[tuple[int, int, bool], float] = {}
    for piece in range(1, len(pieces)):
        before, after = int(of_piece[piece - 1]), int(of_piece[piece])
        same = pieces.turn[piece] == pieces.turn[piece - 1]
        if same and before != after and min(before, after) >= 0:
            key = (before, after, bool(pieces.rest[piece]))
            found[key] = min(found.get(key, np.inf), float(pieces.lead[piece]))
    return [(*key, lead) for key, lead in found.items()]
