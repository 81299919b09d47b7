"""Advice to the programmer: the planned program against the same with one thing changed.

Each change is planned by the same control, so that its seconds are those of the model; it is not
made. Heights are compared in the machine's frame, where the tool stands along Z.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.gcode.moves import Kind, Moves, PathMode
from pipeline.machine.control.planner import Plan
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.program_cut import Advice
from pipeline.twin.control import planned_program

LEAST_S, LEAST_SHARE = 0.1, 0.005
"""Saving from which advice is worth a line [s], and over the program's time [1]."""
STILL_MM = 1e-6
"""Distance below which an axis does not move [mm]."""
MOST_HOLES, MOST_LINES = 500, 40
"""Holes of a row whose order is improved; lines that a piece of advice names."""
WIDER = 2.0
"""Path tolerance that is tried over that of the program [1]."""


def program_advice(plan: Plan) -> tuple[Advice, ...]:
    """What the programmer can gain besides F and S, the greatest saving first."""
    least = max(LEAST_S, LEAST_SHARE * plan.total)
    found = [*_retracts(plan), *_order(plan), *_stops(plan), *_tolerance(plan), *_changes(plan)]
    return tuple(sorted((one for one in found if one.seconds >= least), key=lambda a: -a.seconds))


def _advice(
    plan: Plan, moves: Moves, rows: Rows, what: str, assumes: str, saved: float | None = None
) -> Advice:
    """Advice with the seconds that the control takes less for ``moves``, or that are ``saved``."""
    if saved is None:
        saved = plan.total - planned_program(moves, plan.path.control).total
    lines = tuple(dict.fromkeys(plan.path.moves.line[rows].tolist()))[:MOST_LINES]
    return Advice(what=what, assumes=assumes, seconds=round(saved, 3), lines=lines)


def _upright(moves: Moves) -> bool:
    """Whether the tool stands along Z throughout: arcs in XY, no rotary axis moves, no turning."""
    cutting, rotary = np.isin(moves.kind, CUTTING), np.vstack([moves.origin, moves.end])[:, 3:]
    still = bool((np.ptp(rotary, axis=0) == 0).all())
    return still and bool((moves.plane[cutting] == 17).all()) and bool(cutting.any())


def _retracts(plan: Plan) -> Iterator[Advice]:
    moves = plan.path.moves
    if not _upright(moves):
        return
    cutting, end, start = np.isin(moves.kind, CUTTING), moves.end.copy(), moves.start[:, 2]
    zero = np.array([frame.translation[2] for frame in moves.frames])[moves.frame]
    top = (end[:, 2] - zero)[cutting].max()  # of the part, as far as any tool has shown it
    down = cutting & (end[:, 2] < start - STILL_MM)  # fed down: it begins above what it cuts
    parts = np.flatnonzero(np.isin(moves.kind, (Kind.TOOL_CHANGE, Kind.STOP)))
    for first, last in pairwise([0, *parts, len(moves)]):
        cuts = first + np.flatnonzero(cutting[first:last])
        clear = (start - zero)[cuts[down[cuts]]].max(initial=-np.inf)
        if len(cuts) > 1 and clear > top + STILL_MM:
            between = np.arange(cuts[0], cuts[-1])
            between = between[~cutting[between]]
            end[between, 2] = np.minimum(end[between, 2], clear + zero[between])
    over = moves.end[:, 2] - end[:, 2]
    high = np.flatnonzero((over > STILL_MM) & (moves.end[:, 2] > start + STILL_MM))
    if len(high):
        yield _advice(
            plan, replace(moves, end=end), high,
            f"retract no higher than the tool is fed down from: {len(high)} retracts "
            f"go up to {over.max():.4g} mm above (in cycles G99 in place of G98)",
            "no clamp and nothing uncut stands as high as that between them",
        )  # fmt: skip


def _order(plan: Plan) -> Iterator[Advice]:
    moves = plan.path.moves
    if not _upright(moves):
        return
    rows, holes, before, after = np.arange(len(moves)), list[int](), 0.0, 0.0
    for starts, end in _hole_rows(moves):
        first = starts[0]
        places = moves.end[starts, :2]
        begin = moves.start[first, :2]
        leave = moves.end[end, :2] if end < len(moves) and moves.kind[end] == Kind.RAPID else None
        order = shorter_order(places, begin, leave)
        blocks = [np.arange(a, b) for a, b in pairwise([*starts, end])]
        rows[first:end] = np.concatenate([blocks[i] for i in order])
        before += tour_length(places, begin, leave)
        after += tour_length(places[order], begin, leave)
        holes += [starts[i] for i in order]
    if after < before - STILL_MM:
        columns: dict[str, Any] = {name: column[rows] for name, column in moves.columns()}
        yield _advice(
            plan, replace(moves, **columns), np.array(holes),
            f"visit the holes in another order: {before:.4g} mm of rapids between {len(holes)} "
            f"holes, {after:.4g} mm in the order of these lines",
            "holes of a tool may be drilled in any order, nothing stands in the way between them",
        )  # fmt: skip


def _hole_rows(moves: Moves) -> Iterator[tuple[list[int], int]]:
    """Rapids that begin with a hole in a row of holes at one height, and the end of the last."""
    step = np.abs(moves.end - moves.start)
    across = (step[:, :2] > STILL_MM).any(axis=1)
    transfer = (moves.kind == Kind.RAPID) & across & (step[:, 2] <= STILL_MM)
    inside = np.isin(moves.kind, (Kind.RAPID, Kind.FEED, Kind.DWELL)) & ~across
    breaks = np.append(np.flatnonzero(~inside), len(moves))
    cuts, found, end = np.isin(moves.kind, CUTTING), list[int](), 0
    for row in [*np.flatnonzero(transfer).tolist(), -1]:
        after = int(breaks[np.searchsorted(breaks, row + 1)])
        # a hole ends at the height that it began at, so that the next can be any other
        level = row >= 0 and abs(moves.end[after - 1, 2] - moves.end[row, 2]) <= STILL_MM
        hole = level and bool(cuts[row + 1 : after].any())
        if found and not (hole and row == end):
            yield from [(found, end)] * (2 < len(found) <= MOST_HOLES)
            found = []
        if hole:
            found.append(row)
            end = after


def tour_length(places: Floats, begin: Floats, leave: Floats | None) -> float:
    """Length from ``begin`` through ``places`` (N, 2), and on to ``leave`` where there is one."""
    ends = places if leave is None else np.vstack([places, leave])
    return float(np.linalg.norm(np.diff(np.vstack([begin, ends]), axis=0), axis=1).sum())


def shorter_order(places: Floats, begin: Floats, leave: Floats | None) -> Rows:
    """Shortest order of ``places`` (N, 2) by 2-opt from theirs and from nearest neighbours.

    >>> square = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    >>> shorter_order(square, np.array([-1.0, 0.0]), None).tolist()
    [0, 2, 1, 3]
    """
    own = np.arange(len(places))
    left, order, at = list(range(len(places))), list[int](), begin
    while left:
        nearest = int(np.argmin(np.linalg.norm(places[left] - at, axis=1)))
        order.append(left.pop(nearest))
        at = places[order[-1]]
    trials = [_two_opt(places, np.array(one), begin, leave) for one in (order, own)]
    return min([own, *trials], key=lambda one: tour_length(places[one], begin, leave))


def _two_opt(places: Floats, order: Rows, begin: Floats, leave: Floats | None) -> Rows:
    """Order without a pair of legs that are shorter when the stretch between them is reversed."""
    order, better = order.copy(), True
    while better:
        better = False
        for i in range(len(order) - 1):
            before = begin if i == 0 else places[order[i - 1]]
            here, last = places[order[i]], places[order[i + 1 :]]
            after = np.vstack([last[1:], last[-1:] if leave is None else leave])
            gain = np.linalg.norm(before - here, axis=-1) - np.linalg.norm(before - last, axis=1)
            legs = np.linalg.norm(last - after, axis=1) - np.linalg.norm(here - after, axis=1)
            if leave is None:
                legs[-1] = 0.0
            j = int(np.argmax(gain + legs))
            if gain[j] + legs[j] > STILL_MM:
                order[i : i + j + 2] = order[i : i + j + 2][::-1]
                better = True
    return order


def _stops(plan: Plan) -> Iterator[Advice]:
    moves = plan.path.moves
    exact: Bools = (moves.path_mode != PathMode.CONTINUOUS) & np.isin(moves.kind, CUTTING)
    if exact.any():
        mode = np.where(exact, PathMode.CONTINUOUS, moves.path_mode).astype(np.uint8)
        yield _advice(
            plan, replace(moves, path_mode=mode), np.flatnonzero(exact),
            f"continuous path (G64) in place of exact stops (G61, G9) in {exact.sum()} blocks",
            "their corners may be as round as the control makes them",
        )  # fmt: skip


def _tolerance(plan: Plan) -> Iterator[Advice]:
    moves, control = plan.path.moves, plan.path.control
    own = control.tolerance if control.corner == "tolerance" else 0.0
    now = np.where(moves.tolerance > 0, moves.tolerance, own)
    held = (now > 0) & np.isin(moves.kind, CUTTING)
    if held.any():
        least, most = now[held].min(), now[held].max()
        range_ = f"{least:.3g} mm" if least == most else f"{least:.3g} to {most:.3g} mm"
        yield _advice(
            plan, replace(moves, tolerance=np.where(held, WIDER * now, moves.tolerance)),
            np.array([], int), f"a path tolerance {WIDER:g} times as wide as {range_}",
            "the part allows it; where only roughing is widened, it is less",
        )  # fmt: skip


def _changes(plan: Plan) -> Iterator[Advice]:
    moves, seen, again = plan.path.moves, set[int](), []
    for row in np.flatnonzero(moves.kind == Kind.TOOL_CHANGE).tolist():
        if moves.tool[row] in seen:
            again.append(row)
        seen.add(int(moves.tool[row]))
    if again:
        tools = ", ".join(f"T{n}" for n in dict.fromkeys(moves.tool[again].tolist()))
        yield _advice(
            plan, moves, np.array(again),
            f"one call of each tool: {len(again)} of the changes call again for {tools}",
            "the order of operations allows it; the way to the changer is not counted",
            saved=float(plan.time[again].sum()),
        )  # fmt: skip
