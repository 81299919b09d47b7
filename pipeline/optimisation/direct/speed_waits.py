"""What waiting for the spindle costs: its starts, its stops, and its changes of speed."""

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.spindle import spindle_waits
from pipeline.optimisation.direct.block_model import BlockModel
from pipeline.optimisation.direct.speed_pieces import Pieces

Floats = NDArray[np.float64]

LATE = 1e6
"""Price of cutting before the spindle has its speed: only where nothing else is possible."""


def change_price(
    model: BlockModel, before: Floats, after: Floats, *, rest: bool, lead: float
) -> Floats:
    """Of a change of S between two places of one tool; infinite where it is less than the least.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    before, after : ndarray
        [rev/min], of shapes that go together.
    rest : bool
        Whether the spindle stands in between; what its start takes does not belong to the change.
    lead : float
        Time from the change to the next cut [s]: a control that does not wait cuts at another speed
        than it should, with too thick chips where that is lower, when the lead is too short.
    """
    problem, least = model.problem, model.problem.limits.least_speed_change_rpm
    step = np.abs(after - before)
    price = np.zeros(step.shape)
    if not rest:
        price += problem.speed_change_time(before, after) * model.second_price
        price += np.where(problem.speed_changes.ramp(before, after) > lead, LATE, 0.0)
    price = np.where(step > 0, price, 0.0)
    return np.where((step > 0) & (step < least), np.inf, price)


def start_prices(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    """Of starting the spindle for each piece, and stopping it after; shape (A, K).

    Infinite where S would be too near to that of a row beside the piece that keeps its own.

    Parameters
    ----------
    model : BlockModel
        What is to be least, of M rows.
    pieces : Pieces
        A of them.
    grid : ndarray, shape (T, K)
        Speeds of each run of pieces [rev/min].
    """
    found, price = _beside_held(model, pieces, grid), model.second_price
    if not len(pieces) or price == 0.0:
        return found
    plan = model.problem.cut.plan
    moves, auxiliary = plan.path.moves, plan.path.control.auxiliary
    speeds = np.where(pieces.piece >= 0, grid.T[:, pieces.turn[pieces.piece]], moves.speed)
    speeds[:, moves.direction == 0] = 0.0
    rows, waiting, seconds = spindle_waits(moves, auxiliary, speeds)
    passed = np.concatenate([[0.0], np.cumsum(plan.time)])
    for row, until, needed in zip(rows.tolist(), waiting.tolist(), seconds.T, strict=True):
        turned = row > 0 and moves.direction[row - 1] != 0
        starts = moves.direction[row] != 0
        if turned and starts:
            continue  # a change of speed
        piece = pieces.piece[row] if starts else pieces.piece[row - 1]
        if piece >= 0 and turned != starts:
            meanwhile = passed[until] - passed[min(row + 1, until)]
            found[piece] += price * np.maximum(0.0, needed - meanwhile)
    return found


def _beside_held(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    found, problem = np.zeros((len(pieces), grid.shape[1])), model.problem
    moves, least = problem.cut.plan.path.moves, problem.limits.least_speed_change_rpm
    turning = np.flatnonzero(moves.direction != 0)
    if least == 0.0:
        return found
    for rows, others in ((turning[:-1], turning[1:]), (turning[1:], turning[:-1])):
        met = (pieces.piece[rows] >= 0) & (pieces.piece[others] < 0)
        met &= moves.tool[rows] == moves.tool[others]
        piece = pieces.piece[rows[met]]
        step = np.abs(grid[pieces.turn[piece]] - moves.speed[others[met], None])
        np.add.at(found, piece, np.where((step > 0) & (step < least), np.inf, 0.0))
    return found
