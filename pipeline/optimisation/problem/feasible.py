"""Refusal of what no feed and speed can keep: one sentence with the block, the values, a remedy."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import where
from pipeline.optimisation.problem.constraints import (
    AS_PROGRAMMED,
    CONSTRAINTS,
    CUTTING_SPEED,
    DEFLECTION,
    GREATEST_CHIP,
    LOAD,
    POWER,
    ROUGHNESS,
    SPINDLE_SPEED,
    STABILITY,
    TORQUE,
)
from pipeline.optimisation.problem.nearness import shares
from pipeline.optimisation.problem.ranges import feeds_per_minute

if TYPE_CHECKING:
    from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

UM = 1e6
SLACK = 1e-9
"""Share that a limit may be passed by and count as kept: rounding."""
REMEDY = {
    LOAD: "raise limits.load_N",
    DEFLECTION: "raise limits.deflection_um",
    ROUGHNESS: "raise limits.roughness_um",
    GREATEST_CHIP: "widen limits.chip_um or the tool's feed_per_tooth_mm",
    TORQUE: "raise limits.torque_Nm, or take less depth",
    AS_PROGRAMMED: "give the tool's feed_per_tooth_mm",
    POWER: "take less depth",
    STABILITY: "take less depth, or another speed",
    CUTTING_SPEED: "widen cutting_speed_m_min",
    SPINDLE_SPEED: "widen limits.speed_rpm",
}


def check(problem: "Problem", *, certain: bool) -> None:
    """Refuse a problem that has no answer.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    certain : bool
        Whether feeds for each tooth stand for the load limit.

    Raises
    ------
    ValueError
        See :func:`pipeline.optimisation.problem.problem.problem_of`.
    """
    _check_turning(problem)
    _check_limited(problem, certain)
    _check_bounds(problem)
    _check_reach(problem)
    _check_kept(problem)


def _refuse(problem: "Problem", wrong: Flags, said: Callable[[int], str]) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"{where(problem.cut.plan.path.moves, row)}: {said(row)}")


def _tool(problem: "Problem", row: int) -> str:
    return f"T{problem.cut.numbers[problem.cut.tool[row]]}"


def _check_turning(problem: "Problem") -> None:
    standing = problem.cuts & ~(problem.cut.plan.spindle_speed > 0)
    _refuse(problem, standing, lambda row: (
        f"{_tool(problem, row)} goes into the material while the spindle stands: program S and M3 "
        "before it"
    ))  # fmt: skip


def _check_limited(problem: "Problem", certain: bool) -> None:
    """Each tool that cuts needs a limit that grows with its chips."""
    limits = problem.limits
    every = (limits.load_N, limits.roughness_um, limits.chip_um, limits.torque_Nm)
    if certain or any(limit is not None for limit in every):
        return
    bends = limits.deflection_um is not None
    free = np.array([
        tool.feed_per_tooth_mm is None and not (bends and tool.stickout is not None)
        for tool in problem.cut.tools
    ])  # fmt: skip
    _refuse(problem, problem.cuts & free[problem.cut.tool], lambda row: (
        f"nothing limits the feed of {_tool(problem, row)}: give limits.load_N or chip_um, or its "
        "feed_per_tooth_mm in the tool table"
    ))  # fmt: skip


def _check_bounds(problem: "Problem") -> None:
    """Least and greatest feed for each tooth leave something between them."""
    high, low, which = problem.f_z_high, problem.f_z_low, problem.binds_high
    _refuse(problem, problem.cuts & ~(high > 0), lambda row: (
        f"no feed of {_tool(problem, row)} keeps the {CONSTRAINTS[which[row]]}"
        f"{_given(problem, int(which[row]))}: the edges alone take more: {REMEDY[int(which[row])]}"
    ))  # fmt: skip
    _refuse(problem, problem.cuts & (low > high * (1 + SLACK)), lambda row: (
        f"the least chip of {_tool(problem, row)} needs {low[row] * UM:.4g} um a tooth, and the "
        f"{CONSTRAINTS[which[row]]}{_given(problem, int(which[row]))} allows "
        f"{high[row] * UM:.4g} um: lower the least chip, or {REMEDY[int(which[row])]}"
    ))  # fmt: skip


def _given(problem: "Problem", which: int) -> str:
    limits = problem.limits
    values = {
        LOAD: (limits.load_N, "N"), DEFLECTION: (limits.deflection_um, "um"),
        ROUGHNESS: (limits.roughness_um, "um"), TORQUE: (limits.torque_Nm, "N m"),
    }  # fmt: skip
    value, unit = values.get(which, (None, ""))
    return "" if value is None else f" of {value:g} {unit}"


def _check_reach(problem: "Problem") -> None:
    """Feed for each tooth that the ranges of F and S reach."""
    slowest, fastest = _corners(problem)
    high, low, which = problem.f_z_high, problem.f_z_low, problem.binds_high
    _refuse(problem, problem.cuts & (slowest > high * (1 + SLACK)), lambda row: (
        f"{_whose(problem, row)} keep the {CONSTRAINTS[which[row]]}"
        f"{_given(problem, int(which[row]))}: {_tool(problem, row)} may take "
        f"{high[row] * UM:.4g} um a tooth, and takes {slowest[row] * UM:.4g} um at least: "
        f"{_wider(problem, row)}{REMEDY[int(which[row])]}"
    ))  # fmt: skip
    _refuse(problem, problem.cuts & (fastest < low * (1 - SLACK)), lambda row: (
        f"{_whose(problem, row)} make the least chip: {_tool(problem, row)} needs "
        f"{low[row] * UM:.4g} um a tooth, and gets {fastest[row] * UM:.4g} um at most: "
        f"{_wider(problem, row)}lower the least chip"
    ))  # fmt: skip


def _whose(problem: "Problem", row: int) -> str:
    if _held(problem, row):
        return "its F and S cannot be changed, and do not"
    return "no F and S of their ranges"


def _wider(problem: "Problem", row: int) -> str:
    return "" if _held(problem, row) else "widen feed_mm_min or speed_rpm, or "


def _held(problem: "Problem", row: int) -> bool:
    return bool(problem.editable.block[row] < 0 and not problem.editable.speed[row])


def _corners(problem: "Problem") -> tuple[Floats, Floats]:
    """Least and greatest f_z of each row over its ranges [m]; shape (M,) each."""
    moves, ranges = problem.cut.plan.path.moves, problem.ranges
    by_feed, by_speed = problem.editable.block >= 0, problem.editable.speed
    own = moves.speed
    slow = np.where(by_speed, np.minimum(ranges.speed_low, ranges.speed_high), own)
    fast = np.where(by_speed, ranges.speed_high, own)
    found = []
    for feed, turns in ((ranges.feed_low, fast), (ranges.feed_high, slow)):
        per_minute = np.where(by_feed & np.isfinite(feed), feed, 0.0)
        asked = np.where(by_feed, in_units(problem, per_minute, turns), moves.feed)
        found.append(problem.feed_per_tooth(asked, np.where(np.isfinite(turns), turns, own)))
    return found[0], found[1]


def in_units(problem: "Problem", per_minute: Floats, turns: Floats) -> Floats:
    """F in the units of ``Moves`` of feeds in [mm/min]; shape (M,)."""
    ones = feeds_per_minute(problem.cut, np.ones(len(problem)), turns)
    units: Floats = np.divide(per_minute, ones, out=np.zeros(len(ones)), where=ones > 0)
    return units


def _check_kept(problem: "Problem") -> None:
    """Rows that keep their S have to keep what depends on it at their least F."""
    held = problem.cuts & ~problem.editable.speed
    if not held.any():
        return
    moves, low = problem.cut.plan.path.moves, problem.ranges.feed_low
    least = in_units(problem, low, problem.cut.plan.spindle_speed)
    feeds = np.where(problem.editable.block >= 0, least, moves.feed)
    found = shares(problem, feeds, moves.speed)
    judged = np.array([CUTTING_SPEED, SPINDLE_SPEED, STABILITY, TORQUE, POWER])
    which = judged[(found[judged] > 1 + SLACK).argmax(axis=0)]
    worst = found[which, np.arange(len(problem))]
    _refuse(problem, held & (worst > 1 + SLACK), lambda row: (
        f"its S {moves.speed[row]:g} cannot be changed, and {_tool(problem, row)} passes what "
        f"{CONSTRAINTS[which[row]]} allows {worst[row]:.3g} times: {REMEDY[int(which[row])]}"
    ))  # fmt: skip
