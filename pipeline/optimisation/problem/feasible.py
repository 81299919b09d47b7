"""Utilisation of each constraint by the rows of a cut, and refusal where none of F and S fits."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.spindle_power import SpindleDrive, cutting_power, no_load_power
from pipeline.cutting.tool import tool_limits
from pipeline.machine.control.path import where
from pipeline.optimisation.problem import arrays as at
from pipeline.optimisation.problem.arrays import (
    CONSTRAINTS,
    F_Z_CONSTRAINTS,
    Editable,
    Practice,
    feeds_per_minute,
)
from pipeline.optimisation.problem.limits import (
    at_hardest_station,
    bounds_of,
    ranges_of,
    row_limits,
)
from pipeline.optimisation.problem.problem import Problem, demand_of
from pipeline.optimisation.problem.spindle import allowed_power, chatter_of
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import CutLimit, limit_words
from pipeline.twin.cut.blocks import cut_blocks, station_arcs
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import tool_life

AT = 0.98
"""Share of a limit from which a row counts as at it: words of F and S are rounded."""
ORDER = np.array([
    *F_Z_CONSTRAINTS, at.LEAST_CHIP, at.POWER, at.STABILITY, at.FEED, at.CUTTING_SPEED,
    at.SPINDLE_SPEED,
])  # fmt: skip
"""Precedence among limits that a row is at: at the end of F no S makes it faster."""
UM = 1e6
SLACK = 1e-9
"""Share that a limit may be passed by and count as kept: rounding."""
BY_TOOL = {at.LOAD: "load_N", at.DEFLECTION: "deflection_um", at.TORQUE: "torque_Nm"}
"""Limits that a tool may have of its own, by constraint."""
GIVEN = BY_TOOL | {at.ROUGHNESS: "roughness_um"}
"""Limits whose value a refusal states, by constraint."""
REMEDY = {
    at.LOAD: "raise limits.load_N",
    at.DEFLECTION: "raise limits.deflection_um",
    at.ROUGHNESS: "raise limits.roughness_um",
    at.GREATEST_CHIP: "widen limits.chip_um or the tool's feed_per_tooth_mm",
    at.TORQUE: "raise limits.torque_Nm, or take less depth",
    at.AS_PROGRAMMED: "give the tool's feed_per_tooth_mm",
    at.POWER: "take less depth",
    at.STABILITY: "take less depth, or another speed",
    at.CUTTING_SPEED: "widen limits.cutting_speed_m_min",
    at.SPINDLE_SPEED: "widen limits.speed_rpm",
    at.FEED_PER_TOOTH: "give the tool's feed_per_tooth_mm",
    at.CHANGE: "widen practice.change",
}


def constraint_utilisation(problem: Problem, feeds: Floats, speeds: Floats) -> Floats:
    """Value over limit of each row, limit over value where the limit is a least one [1].

    ``feeds`` and ``speeds`` (M,): F and S in the units of ``Moves``.  Shape (14, M) in the order of
    ``CONSTRAINTS``; 0 where nothing limits.
    """
    out = np.zeros((len(CONSTRAINTS), len(problem)))
    cuts, ranges = problem.cuts, problem.ranges
    spindle_speed = problem.spindle_speed(speeds)
    f_z = np.where(cuts, problem.feed_per_tooth(feeds, speeds), 0.0)
    out[list(F_Z_CONSTRAINTS)] = _over(f_z, problem.bounds.most)
    out[at.LEAST_CHIP] = np.where(cuts, _over(problem.bounds.least, f_z), 0.0)
    _fill_drive(out, problem, f_z, spindle_speed)
    if problem.chatter is not None:
        margins = problem.chatter.margins(spindle_speed)
        used = _over(1.0 + problem.least_margin, 1.0 + np.nan_to_num(margins, nan=np.inf))
        out[at.STABILITY] = np.where(np.isnan(margins), 0.0, used)
    surface = _outside(spindle_speed, ranges.surface_low, ranges.surface_high)
    out[at.CUTTING_SPEED] = np.where(cuts, surface, 0.0)
    machine = _outside(spindle_speed, ranges.speed_low, ranges.speed_high)
    out[at.SPINDLE_SPEED] = np.where(ranges.counted & (machine > surface), machine, 0.0)
    own = feeds_per_minute(problem.cut, feeds, spindle_speed)
    if problem.practice is not None:
        changed = np.maximum(
            _over(own, problem.practice.feed_high),
            _over(spindle_speed, problem.practice.speed_high),
        )
        out[at.CHANGE] = np.maximum(out[at.CHANGE], np.where(cuts, changed, 0.0))
    limited = np.isfinite(ranges.feed_high)
    out[at.FEED] = np.where(limited, _outside(own, ranges.feed_low, ranges.feed_high), 0.0)
    return out


def binding_constraints(problem: Problem, feeds: ArrayLike, speeds: ArrayLike) -> Rows:
    """Binding one of ``CONSTRAINTS`` in each row, -1 for none; F, S and answer of shape (M,)."""
    used = constraint_utilisation(problem, np.asarray(feeds, float), np.asarray(speeds, float))
    there = used[ORDER] >= AT
    return np.where(there.any(axis=0), ORDER[there.argmax(axis=0)], -1)


def _fill_drive(out: Floats, problem: Problem, f_z: Floats, spindle_speed: Floats) -> None:
    """Fill in the power demanded over the power allowed, as torque below the base speed."""
    drive = problem.basis.drive
    if drive is None:
        return
    torque = at_hardest_station(problem.cut, problem.bounds.torque, f_z)
    demanded = cutting_power(torque, spindle_speed / 60) + no_load_power(spindle_speed / 60, drive)
    allowed = allowed_power(spindle_speed, drive, problem.limits) * drive.efficiency
    used = np.where(problem.cuts & (spindle_speed > 0), _over(demanded, allowed), 0.0)
    slow = spindle_speed / 60 < drive.base_speed
    out[at.TORQUE] = np.maximum(out[at.TORQUE], np.where(slow, used, 0.0))
    out[at.POWER] = np.where(slow, 0.0, used)


def _outside(value: Floats, low: Floats, high: Floats) -> Floats:
    return np.maximum(_over(low, value), _over(value, high))


def _over(value: Floats | float, limit: Floats) -> Floats:
    shape = np.broadcast_shapes(np.shape(value), limit.shape)
    above = np.where(np.broadcast_to(value, shape) > 0, np.inf, 0.0)
    return np.divide(value, limit, out=above, where=limit > 0)


def check_known(cut: Cut, limits: CutLimit, drive: SpindleDrive | None) -> None:
    """Refuse limits whose quantities are not known, rather than to pass over them in silence."""
    most = tool_limits(cut.tools, "deflection_um", limits.deflection_um)
    for index in np.unique(cut.tool[cut.tool >= 0]).tolist():
        tool = cut.tools[index]
        if np.isfinite(most[index]) and tool.stickout is None and tool.kind != "drill":
            raise ValueError(
                f"limits.deflection_um = {most[index]:g} cannot be kept: "
                f"T{cut.numbers[index]} has no stickout_mm in the tool table: write it there, "
                "or leave the limit out"
            )
    if limits.power_share < 1.0 and drive is None:
        raise ValueError(
            f"limits.power_share = {limits.power_share:g} cannot be kept: the machine's file has "
            "no section spindle_drive: write it there, or leave the limit out"
        )


def problem_of(
    cut: Cut, basis: CutBasis, limits: CutLimit, editable: Editable, *,
    f_z_load: Floats | None = None, practice: Practice | None = None,
) -> Problem:  # fmt: skip
    """Limits and objectives of the rows of a cut.

    ``f_z_load`` (M,): feed for each tooth up to which the load keeps its limit [m], by default of
    the load table; ``practice``: ranges by tool and operation, and the greatest change.
    """
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    bounds = bounds_of(cut, blocks, limits, editable, f_z_load, practice)
    ranges = ranges_of(cut, limits, editable, basis.drive, practice, bounds.high)
    life, least = tool_life(cut, blocks, arcs, basis.material), limits.margins.stability
    lobes = partial(chatter_of, cut, blocks, basis.dynamics, ranges, editable.speed, least)
    problem = Problem(
        cut=cut,
        basis=basis,
        limits=limits,
        editable=editable,
        blocks=blocks,
        bounds=bounds,
        ranges=ranges,
        demand=demand_of(cut, blocks, life, basis, limits, bounds=bounds, ranges=ranges),
        lobes=cache(lobes),
        practice=practice,
    )
    if practice is not None:  # what keeps its S is cut as it is
        kept = problem.cuts & ~editable.speed
        problem = problem.staying(kept & (problem.own_margin < least))
    _check(problem, load_limited=f_z_load is not None)
    return problem


def with_load(problem: Problem, f_z_load: Floats) -> Problem:
    """Same problem, lobes included, with another bound of the load, see :func:`problem_of`."""
    bounds = bounds_of(
        problem.cut, problem.blocks, problem.limits, problem.editable, f_z_load, problem.practice
    )
    other = replace(problem, bounds=bounds, demand=problem.demand.with_bounds(bounds))
    _check(other, load_limited=True)
    return other


def with_feed_cap(problem: Problem, cap: Floats, limit: str) -> Problem:
    """The same problem with F at most ``cap`` (M,) [mm/min] where it may change."""
    ranges = problem.ranges
    free = problem.editable.block >= 0
    high = np.where(free, np.minimum(ranges.feed_high, cap), ranges.feed_high)
    _refuse(problem, free & (high < ranges.feed_low), lambda row: (
        f"the {limit} needs F {high[row]:.4g} mm/min or less, below the least of "
        f"{ranges.feed_low[row]:.4g} mm/min: widen limits.feed_mm_min or raise the limit"
    ))  # fmt: skip
    other = replace(
        problem, ranges=replace(ranges, feed_high=high),
        demand=problem.demand.with_feeds(ranges.feed_low, high),
    )  # fmt: skip
    _check(other, load_limited=True)
    return other


def _check(problem: Problem, *, load_limited: bool) -> None:
    _check_spindle_on(problem)
    _check_limited(problem, load_limited)
    _check_bounds(problem)
    _check_reach(problem)
    _check_kept(problem)


class LimitsError(ValueError):
    """No feed and speed keep the limits; those of the tool with a number, if it is one tool's."""

    def __init__(self, sentence: str, tool: int | None = None) -> None:
        super().__init__(sentence)
        self.tool = tool


def _refuse(problem: Problem, wrong: Bools, sentence: Callable[[int], str]) -> None:
    if problem.practice is not None:
        wrong = wrong & ~problem.practice.given_up
    if wrong.any():
        row, moves = int(np.argmax(wrong)), problem.cut.plan.path.moves
        raise LimitsError(f"{where(moves, row)}: {sentence(row)}", int(moves.tool[row]))


def tool_name(problem: Problem, row: int) -> str:
    """The tool of a row that cuts, as people name it."""
    return f"T{problem.cut.numbers[problem.cut.tool[row]]}"


def _check_spindle_on(problem: Problem) -> None:
    standing = problem.cuts & ~(problem.cut.plan.spindle_speed > 0)
    _refuse(problem, standing, lambda row: (
        f"{tool_name(problem, row)} goes into the material while the spindle stands: program "
        "S and M3 before it"
    ))  # fmt: skip


def _check_limited(problem: Problem, load_limited: bool) -> None:
    """Each tool that cuts needs a limit that grows with its feed per tooth."""
    limits = problem.limits
    if problem.practice is not None:
        return
    if load_limited or limits.roughness_um is not None or limits.chip_um is not None:
        return
    load, bending, torque = (
        np.isfinite(tool_limits(problem.cut.tools, name, getattr(limits, name)))
        for name in BY_TOOL.values()
    )
    made = np.array([tool.feed_per_tooth_mm is not None for tool in problem.cut.tools])
    held = np.array([tool.stickout is not None for tool in problem.cut.tools])
    free = ~(made | load | torque | (bending & held))
    _refuse(problem, problem.cuts & free[problem.cut.tool], lambda row: (
        f"nothing limits the feed of {tool_name(problem, row)}: give limits.load_N or "
        "limits.chip_um, or its feed_per_tooth_mm in the tool table"
    ))  # fmt: skip


def _check_bounds(problem: Problem) -> None:
    high, low, which = problem.bounds.high, problem.bounds.least, problem.bounds.binds
    _refuse(problem, problem.cuts & ~(high > 0), lambda row: (
        f"no feed of {tool_name(problem, row)} keeps the {CONSTRAINTS[which[row]]}"
        f"{_given(problem, row, int(which[row]))}: the edges alone take more"
        f"{_edges(problem, row, int(which[row]))}: {REMEDY[int(which[row])]}"
    ))  # fmt: skip
    _refuse(problem, problem.cuts & (low > high * (1 + SLACK)), lambda row: (
        f"the least chip of {tool_name(problem, row)} needs {low[row] * UM:.4g} um a tooth, and "
        f"the {CONSTRAINTS[which[row]]}{_given(problem, row, int(which[row]))} allows "
        f"{high[row] * UM:.4g} um: lower the least chip, or {REMEDY[int(which[row])]}"
    ))  # fmt: skip


def _edges(problem: Problem, row: int, which: int) -> str:
    """The least load possible in a row, at no feed at all."""
    if which != at.LOAD:
        return ""
    least = float(problem.cut.table.values[0][row, 0])
    limit = _limit_of(problem, row, which) * (1 - problem.limits.margins.load)
    beside = "" if least > limit else " by their nominal values, more with what is uncertain"
    return f", {least:.4g} N{beside}"


def _given(problem: Problem, row: int, which: int) -> str:
    value = _limit_of(problem, row, which)
    return f" of {value:g} {limit_words(GIVEN[which])[1]}" if np.isfinite(value) else ""


def _limit_of(problem: Problem, row: int, which: int) -> float:
    """Value of a limit in a row that cuts, in the unit of its name; infinite where none is."""
    if which in BY_TOOL:
        return float(row_limits(problem.cut, problem.limits, BY_TOOL[which])[row])
    value = getattr(problem.limits, GIVEN[which]) if which in GIVEN else None
    return np.inf if value is None else float(value)


def _check_reach(problem: Problem) -> None:
    slowest, fastest = _corners(problem)
    high, low, which = problem.bounds.high, problem.bounds.least, problem.bounds.binds
    _refuse(problem, problem.cuts & (slowest > high * (1 + SLACK)), lambda row: (
        f"{_whose(problem, row)} keep the {CONSTRAINTS[which[row]]}"
        f"{_given(problem, row, int(which[row]))}: {tool_name(problem, row)} may take "
        f"{high[row] * UM:.4g} um a tooth, and takes {slowest[row] * UM:.4g} um at least"
        f"{_load_at(problem, row, slowest, int(which[row]))}: "
        f"{_wider(problem, row)}{REMEDY[int(which[row])]}"
    ))  # fmt: skip
    _refuse(problem, problem.cuts & (fastest < low * (1 - SLACK)), lambda row: (
        f"{_whose(problem, row)} make the least chip: {tool_name(problem, row)} needs "
        f"{low[row] * UM:.4g} um a tooth, and gets {fastest[row] * UM:.4g} um at most: "
        f"{_wider(problem, row)}lower the least chip"
    ))  # fmt: skip


def _load_at(problem: Problem, row: int, f_z: Floats, which: int) -> str:
    if which != at.LOAD:
        return ""
    return f", {problem.cut.table.peaks(f_z)[row]:.4g} N"


def _whose(problem: Problem, row: int) -> str:
    if _held(problem, row):
        return "its F and S cannot be changed, and do not"
    return "no F and S of their ranges"


def _wider(problem: Problem, row: int) -> str:
    return "" if _held(problem, row) else "widen limits.feed_mm_min or limits.speed_rpm, or "


def _held(problem: Problem, row: int) -> bool:
    return bool(problem.editable.block[row] < 0 and not problem.editable.speed[row])


def _corners(problem: Problem) -> tuple[Floats, Floats]:
    """Least and greatest f_z of each row over its ranges [m]; shape (M,) each."""
    moves, ranges = problem.cut.plan.path.moves, problem.ranges
    by_feed, by_speed = problem.editable.block >= 0, problem.editable.speed
    own = moves.speed
    slow = np.where(by_speed, np.minimum(ranges.speed_low, ranges.speed_high), own)
    fast = np.where(by_speed, ranges.speed_high, own)
    f_z = []
    for feed, spindle_speed in ((ranges.feed_low, fast), (ranges.feed_high, slow)):
        per_minute = np.where(by_feed & np.isfinite(feed), feed, 0.0)
        feeds = np.where(by_feed, _in_units(problem, per_minute, spindle_speed), moves.feed)
        f_z.append(
            problem.feed_per_tooth(feeds, np.where(np.isfinite(spindle_speed), spindle_speed, own))
        )
    return f_z[0], f_z[1]


def _in_units(problem: Problem, per_minute: Floats, spindle_speed: Floats) -> Floats:
    """F in the units of ``Moves`` of feeds in [mm/min]; shape (M,)."""
    ones = feeds_per_minute(problem.cut, np.ones(len(problem)), spindle_speed)
    return np.divide(per_minute, ones, out=np.zeros(len(ones)), where=ones > 0)


def _check_kept(problem: Problem) -> None:
    """Rows that keep their S have to keep the limits that depend on it at their least F."""
    held = problem.cuts & ~problem.editable.speed
    if not held.any():
        return
    moves, low = problem.cut.plan.path.moves, problem.ranges.feed_low
    least = _in_units(problem, low, problem.cut.plan.spindle_speed)
    feeds = np.where(problem.editable.block >= 0, least, moves.feed)
    used = constraint_utilisation(problem, feeds, moves.speed)
    by_speed = np.array([at.CUTTING_SPEED, at.SPINDLE_SPEED, at.STABILITY, at.TORQUE, at.POWER])
    which = by_speed[(used[by_speed] > 1 + SLACK).argmax(axis=0)]
    worst = used[which, np.arange(len(problem))]
    _refuse(problem, held & (worst > 1 + SLACK), lambda row: (
        f"its S {moves.speed[row]:g} cannot be changed, and {tool_name(problem, row)} passes what "
        f"{CONSTRAINTS[which[row]]} allows {worst[row]:.3g} times: {REMEDY[int(which[row])]}"
    ))  # fmt: skip


SPEEDS = 33
"""Spindle speeds of a row's range that are tried for the least possible value."""


def passed_limit(problem: Problem, feeds: Floats, speeds: Floats) -> LimitsError | None:
    """Limit that F and S pass by most, in one sentence with its block; None where none is.

    ``feeds`` and ``speeds`` (M,): F and S in the units of ``Moves``.  The least possible value is
    that over the ranges of F and S of the block alone.
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
    return LimitsError(
        f"{where(moves, block)}: {tool} passes the {CONSTRAINTS[limit]}"
        f"{_given(problem, block, limit)} at F{feeds[block]:.4g} S{speeds[block]:.5g}, {reached}; "
        f"{reason}: {remedy}",
        int(moves.tool[block]),
    )


def _passed_change(problem: Problem, speeds: Floats) -> LimitsError | None:
    least = problem.limits.least_speed_change_rpm
    spindle_speed = problem.spindle_speed(speeds)[np.newaxis]
    if not problem.speed_changes.violation(spindle_speed, least)[0] > 0:
        return None
    return LimitsError(
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
            tried = np.where(own, feeds, _in_units(problem, per_minute, spindle_speed))
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
