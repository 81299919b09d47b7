"""Which limit F and S pass: the block, the limit and its value, and the least that is possible."""

import numpy as np

from pipeline.machine.control.path import where
from pipeline.optimisation.problem import arrays as at
from pipeline.optimisation.problem.arrays import CONSTRAINTS, F_Z_CONSTRAINTS, Rows
from pipeline.optimisation.problem.feasible import (
    REMEDY,
    SLACK,
    UM,
    constraint_utilisation,
    given_value,
    in_units,
    tool_name,
)
from pipeline.optimisation.problem.problem import Problem
from pipeline.schema.arrays import Floats

SPEEDS = 33
"""Spindle speeds of a row's range that are tried for the least possible value."""


def passed_limit(problem: Problem, feeds: Floats, speeds: Floats) -> str:
    """The limit that F and S pass by most, in one sentence with its block; empty where none is.

    The least possible value is that over the ranges of F and S of the block alone: where it keeps
    the limit, blocks that share an F or an S with it are what stands against it.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    feeds, speeds : ndarray, shape (M,)
        F and S in the units of ``Moves``.
    """
    used = constraint_utilisation(problem, feeds, speeds)
    which, row = np.unravel_index(int(np.argmax(used)), used.shape)
    limit, block = int(which), int(row)
    if not used[limit, block] > 1 + SLACK:
        return _passed_change(problem, speeds)
    least, feed, speed = _least(problem, limit, block, feeds, speeds)
    moves = problem.cut.plan.path.moves
    tool = tool_name(problem, block) if problem.cuts[block] else f"T{moves.tool[block]}"
    reached = _value(problem, limit, block, float(feeds[block]), float(speeds[block]))
    possible = _value(problem, limit, block, feed, speed)
    if least <= 1 + SLACK:
        reason = f"{possible} would keep it, and blocks that share its F or S cannot have that"
    else:
        reason = f"{possible} is the least possible there"
    remedy = REMEDY.get(limit, "widen the ranges of F and S")
    return (
        f"{where(moves, block)}: {tool} passes the {CONSTRAINTS[limit]}"
        f"{given_value(problem, limit)} at F{feeds[block]:.4g} S{speeds[block]:.5g}, {reached}; "
        f"{reason}: {remedy}"
    )


def _passed_change(problem: Problem, speeds: Floats) -> str:
    least = problem.limits.least_speed_change_rpm
    spindle_speed = problem.spindle_speed(speeds)[np.newaxis]
    if not problem.speed_changes.violation(spindle_speed, least)[0] > 0:
        return ""
    return (
        f"{problem.cut.plan.path.moves.files[0]}: S changes by less than "
        f"limits.least_speed_change_rpm = {least:g}, or later than the spindle is as fast: lower "
        "it, or keep the program's own S words (grouping.speeds own)"
    )


def _least(
    problem: Problem, limit: int, row: int, feeds: Floats, speeds: Floats
) -> tuple[float, float, float]:
    """Least utilisation of a limit by a row over its ranges, with the F and S where it is."""
    best = (np.inf, float(feeds[row]), float(speeds[row]))
    for S in _speeds(problem, row, float(speeds[row])):
        turning = np.where(problem.editable.speed, S, speeds)
        spindle_speed = problem.spindle_speed(turning)
        for bound in (problem.ranges.feed_low, problem.ranges.feed_high):
            own = (problem.editable.block < 0) | ~np.isfinite(bound)
            per_minute = np.where(own, 0.0, bound)
            tried = np.where(own, feeds, in_units(problem, per_minute, spindle_speed))
            used = constraint_utilisation(problem, tried, turning)[limit, row]
            if used < best[0]:
                best = (float(used), float(tried[row]), float(turning[row]))
    return best


def _speeds(problem: Problem, row: int, own: float) -> list[float]:
    low, high = problem.ranges.speed_low[row], problem.ranges.speed_high[row]
    if not problem.editable.speed[row] or not low < high or not np.isfinite(high):
        return [own]
    return [own, *np.linspace(max(low, 1.0), high, SPEEDS).tolist()]


def _value(problem: Problem, limit: int, row: int, feed: float, speed: float) -> str:
    """Value of a row at F and S, in the unit of the limit."""
    rows: Rows = np.arange(len(problem))
    moves = problem.cut.plan.path.moves
    feeds = np.where(rows == row, feed, moves.feed)
    speeds = np.where(rows == row, speed, moves.speed)
    if limit == at.FEED:
        return f"F{feed:.4g}"
    if limit in (at.SPINDLE_SPEED, at.CUTTING_SPEED):
        return f"{problem.spindle_speed(speeds)[row]:.5g} rev/min"
    f_z = problem.feed_per_tooth(feeds, speeds)
    if limit == at.LOAD:
        return f"{problem.cut.table.peaks(f_z)[row]:.4g} N with {f_z[row] * UM:.4g} um a tooth"
    if limit in (*F_Z_CONSTRAINTS, at.LEAST_CHIP) and limit != at.TORQUE:
        return f"{f_z[row] * UM:.4g} um a tooth"
    return f"{constraint_utilisation(problem, feeds, speeds)[limit, row]:.3g} times what is allowed"
