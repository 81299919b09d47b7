"""The feeds that limits allow each row, and those that suit all rows of a group.

Limits of a row hold its feed for each tooth f_z and its F; at one S they are one interval of F:

    max(F_low, f_z_low N S) <= F <= min(F_high, f_z_high N S, f_z_power(S) N S)

in the row's own units.  What is faster than axes, arcs and tolerances allow (``Path.cap``) changes
nothing.  Where the tool goes down in air F is at most as programmed: a floor may lie a little
higher than it should.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.optimisation.direct.row_groups import RowGroups
from pipeline.optimisation.problem.bounds import STEEP
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.text.word_numbers import ROUNDING, rounded_down

Floats = NDArray[np.float64]

SLACK = 1e-9
"""Kept free of the greatest F, as a share, so that no rounding of products passes a limit."""
ROUNDED = 1.01 * ROUNDING
"""Kept free of the least F, as a share: words round F down."""
TINY = 1e-9
"""Less than any F that a word holds."""


def feed_bounds(problem: Problem, speeds: Floats) -> tuple[Floats, Floats]:
    """Least and greatest F of each row at S, in the units of ``Moves``; the least is infinite where
    no F is allowed at that S.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    speeds : ndarray, shape (P, M)
        [rev/min].

    Returns
    -------
    tuple of ndarray, shapes (P, M)
    """
    path, cuts = problem.cut.plan.path, problem.cuts
    turns = np.where(path.moves.direction == 0, 0.0, speeds)
    chips = cuts & (turns > 0)
    teeth = np.where(chips, problem.flutes * turns / 60, 0.0)
    with np.errstate(invalid="ignore"):
        most = np.minimum(problem.f_z_high, problem.power_f_z(speeds)) * teeth
        most = np.where(chips, most, np.inf)
        least = np.where(chips, problem.f_z_low * teeth, 0.0)
    allowed = (problem.speed_low <= speeds) & (speeds <= problem.speed_high)
    allowed |= ~problem.ranges.counted
    allowed &= (problem.stable(speeds) | ~chips) & (least <= path.cap * (1 + SLACK))
    scale, in_F = _scale(problem, turns), np.where(_per_turn(problem) & (turns > 0), turns, 1.0)
    high = np.where(most < path.cap, most / scale, np.inf)
    high = np.minimum(high, problem.feed_high / in_F)
    low = np.maximum(least / scale, problem.feed_low / in_F)
    own = np.minimum(np.maximum(path.moves.feed, low), high)
    high = np.where(_descends_in_air(problem), own, high)
    return np.where(allowed, low, np.inf), high


def _descends_in_air(problem: Problem) -> NDArray[np.bool_]:
    """Rows that go down as steeply as a plunge and cut nothing; shape (M,)."""
    moves = problem.cut.plan.path.moves
    fall = moves.start[:, 2] - moves.end[:, 2]
    found: NDArray[np.bool_] = (fall > 0) & (fall >= STEEP * moves.length) & ~problem.cuts
    return found


def common_bounds(
    problem: Problem, groups: RowGroups, low: Floats, high: Floats, speeds: Floats
) -> tuple[Floats, Floats]:
    """Interval of F that suits all rows of each group, without what axes and arcs cut off.

    All of it still suits when a word rounds F down.  An interval too narrow for that is one F: as
    programmed, or such as a word holds.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    groups : RowGroups
        U groups of them.
    low, high : ndarray, shape (P, M)
        Of rows, from :func:`feed_bounds`.
    speeds : ndarray, shape (P, M)
        [rev/min].

    Returns
    -------
    tuple of ndarray, shapes (P, U)
        Empty where the first is above the second.
    """
    path = problem.cut.plan.path
    turns = np.where(path.moves.direction == 0, 0.0, speeds)
    least, most = groups.greatest(low), -groups.greatest(-high)
    useful = groups.greatest(np.broadcast_to(path.cap / _scale(problem, turns), low.shape))
    wide = least * (1 + ROUNDED) <= most * (1 - SLACK)
    own = groups.common(path.moves.feed)
    kept = np.where((least <= own) & (own <= most), own, rounded_down(np.maximum(most, TINY)))
    least = np.where(wide, least * (1 + ROUNDED), np.where(kept >= least, kept, np.inf))
    most = np.where(wide, np.clip(useful, least, most * (1 - SLACK)), kept)
    return least, most


def _scale(problem: Problem, turns: Floats) -> Floats:
    """Speed along the path for one unit of F [m/s]; 1 where nothing moves."""
    path = problem.cut.plan.path
    scale = path.factor * np.where(_per_turn(problem), turns, 1.0)
    return np.where(scale > 0, scale, 1.0)


def _per_turn(problem: Problem) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = problem.cut.plan.path.motion == Motion.PER_TURN
    return found
