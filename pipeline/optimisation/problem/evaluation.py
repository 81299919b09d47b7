"""What a population of F and S makes of a problem: times of the look-ahead, sums, violation."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.path import Motion
from pipeline.machine.control.row_motion import motion_times
from pipeline.optimisation.problem.decision import Evaluation

if TYPE_CHECKING:
    from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]

AT_ONCE = 1 << 18
"""Rows of all individuals that are worked on together, so that they stay in the cache."""


def evaluation(
    problem: "Problem", many: int, rows: Callable[[slice], tuple[Floats, Floats]]
) -> Evaluation:
    """What ``many`` individuals make of a problem of M rows.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    many : int
        P.
    rows : callable
        F and S of the individuals of a slice, in the units of ``Moves``, shape (p, M) each.
    """
    path, demand = problem.cut.plan.path, problem.demand
    objectives, violation = np.empty((many, 4)), np.empty(many)
    for part in _parts(problem, many):
        feeds, speeds = rows(part)
        feed = commanded_feeds(path, feeds, 100.0, 100.0)
        turns = spindle_speeds(path, speeds)
        time = motion_times(path, feed, turns)
        wait = waits(path, turns, time)
        problem.speed_changes.add_waits(turns, time, wait)
        objectives[part] = demand.sums(time, wait, turns)
        violation[part] = _violation(problem, feed, turns)
    return Evaluation(objectives=objectives, violation=violation)


def row_objectives(problem: "Problem", feeds: Floats, speeds: Floats) -> Floats:
    """What rows take, each at its F all along; shape (4, P, M) of F and S of shape (P, M)."""
    plan = problem.cut.plan
    fed = np.isin(plan.path.motion, (Motion.CUTTING, Motion.PER_TURN))
    out = np.empty((4, *feeds.shape))
    for part in _parts(problem, len(feeds)):
        turns = spindle_speeds(plan.path, speeds[part])
        along = np.where(fed, problem.speed(feeds[part], turns), 1.0)
        time = np.where(fed, plan.path.length / along, plan.motion.time)
        out[:, part] = problem.demand.of_rows(time, np.tile(plan.wait, (len(time), 1)), turns)
    return out


def _parts(problem: "Problem", many: int) -> list[slice]:
    step = max(1, AT_ONCE // max(len(problem), 1))
    return [slice(first, first + step) for first in range(0, many, step)]


def _violation(problem: "Problem", feed: Floats, turns: Floats) -> Floats:
    """Shape (P,) of F and speeds of shape (P, M)."""
    limits = problem.limits
    out = problem.demand.violation(problem.cut.plan.path, feed, turns)
    out += problem.speed_changes.violation(turns, limits.least_speed_change_rpm)
    if problem.chatter is not None:
        out += problem.chatter.violation(turns, limits.margins.stability)
    return out
