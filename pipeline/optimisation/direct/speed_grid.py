"""Spindle speeds that are tried for each tool: a geometric row, and those that stand out."""

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.optimisation.direct.speed_pieces import Pieces
from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]

SPEEDS = 48
"""Of the geometric row."""
CORNERS = 16
"""Speeds at most at which the greatest chip meets the greatest feed."""
SLOWEST = 0.1
"""Of the program's least S, where no limit is lower than that."""


def speed_grid(problem: Problem, pieces: Pieces) -> Floats:
    """Speeds tried for each run of pieces of one tool, in whole rev/min or as programmed.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    pieces : Pieces
        In T runs.

    Returns
    -------
    ndarray, shape (T, K)
        Rising [rev/min]; the last one stands repeatedly where a run has fewer.
    """
    moves = problem.cut.plan.path.moves
    listed = []
    for turn in range(int(pieces.turn.max(initial=-1)) + 1):
        rows = (pieces.piece >= 0) & (pieces.turn[pieces.piece] == turn)
        own = np.unique(moves.speed[rows & (moves.speed > 0)])
        cuts = rows & problem.cuts
        listed.append(_speeds(problem, cuts, own) if cuts.any() else np.array([1.0]))
    many = max((len(speeds) for speeds in listed), default=1)
    grid = np.empty((len(listed), many))
    for row, speeds in zip(grid, listed, strict=True):
        row[: len(speeds)], row[len(speeds) :] = speeds, speeds[-1]
    return grid


def _speeds(problem: Problem, cuts: NDArray[np.bool_], own: Floats) -> Floats:
    low, high = speed_range(problem, cuts, own)
    row = np.geomspace(low, max(high, low), SPEEDS)
    corners = _corners(problem, cuts)
    corners = corners[(corners > low) & (corners < high)]
    if len(corners) > CORNERS:
        corners = np.quantile(corners, np.linspace(0, 1, CORNERS))
    ends = [np.ceil(low), np.floor(high)]
    whole = np.concatenate([ends, np.round(row), np.ceil(corners)])
    inside = whole[(whole >= low) & (whole <= high)]
    found: Floats = np.unique(np.concatenate([inside, own[(own >= low) & (own <= high)]]))
    return found if len(found) else np.array([low])


def speed_range(problem: Problem, cuts: NDArray[np.bool_], own: Floats) -> tuple[float, float]:
    """Least and greatest S of any of some rows that cut [rev/min].

    Where nothing limits S, it is what the program has at most, and a tenth of what it has at least.
    """
    least, most = float(own.min(initial=np.inf)), float(own.max(initial=0.0))
    low = float(problem.speed_low[cuts].min())
    high = float(problem.speed_high[cuts].max())
    least = min(SLOWEST * least, high)
    low = max(low, least) if np.isfinite(least) else low
    return max(low, 1.0), high if np.isfinite(high) else max(most, low)


def _corners(problem: Problem, cuts: NDArray[np.bool_]) -> Floats:
    """Least S of each row at which it may be as fast as its F and axes go [rev/min]."""
    path = problem.cut.plan.path
    rows = np.flatnonzero(cuts & (path.motion != Motion.PER_TURN) & (problem.f_z_high > 0))
    fastest = np.minimum(path.factor[rows] * problem.feed_high[rows], path.cap[rows])
    speed = 60 * fastest / (problem.f_z_high[rows] * problem.flutes[rows])
    found: Floats = np.unique(np.ceil(speed[np.isfinite(speed)]))
    return found
