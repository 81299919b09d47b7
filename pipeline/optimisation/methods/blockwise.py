"""Blockwise optimum: block by block the best F, stretch by stretch the best S.

It is exact where each row runs at its F nearly all along.  Where rows are too short for that, the
speed that they reach is taken from the plan of the solution so far, for a few rounds.  Speeds are
refined between the values of the grid, in whole rev/min.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pipeline.machine.control.path import where
from pipeline.optimisation.methods.feed_groups import feed_groups
from pipeline.optimisation.methods.feeds import BlockModel, block_feeds, column
from pipeline.optimisation.methods.speeds import (
    SPEEDS,
    Pieces,
    Stretches,
    best_speeds,
    change_price,
    changes_of,
    own_speeds,
    start_prices,
)
from pipeline.optimisation.problem.arrays import Decision, Groups, spread
from pipeline.optimisation.problem.feasible import LimitsError, passed_limit
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, Grouping
from pipeline.optimisation.text.words import stepped
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.part import Objective

ROUNDS = 3
"""Rounds in which the reach of rows is taken from the plan of the best so far."""
WORTH = 1e-4
"""Gain that another round has to bring, as a share."""
NARROWINGS = 6
CANDIDATES = 9
"""Feeds evaluated per round around the best so far; the next round covers its neighbours' span."""
SAME = 1e-9
"""Values that differ by less, as a share, are the same, and the lower S is taken."""
Change = tuple[int, int, bool, float]


def blockwise_optimum(problem: Problem, objective: Objective, grouping: Grouping) -> Decision:
    """F and S of least time, cost, energy or wear, row by row, inside all limits."""
    which = column(objective)
    whole = _as_programmed(problem, objective)
    kept: list[tuple[float, Decision]] = []
    passed: list[tuple[float, Decision]] = []
    for decision in _rounds(problem, objective, grouping, whole):
        objectives, violation = problem.decided(decision)
        if violation > 0.0:
            passed.append((violation, decision))
            continue
        value = float(objectives[which])
        best = min((found for found, _ in kept), default=np.inf)
        kept.append((value, decision))
        if value > best * (1 - WORTH):
            break
    if not kept:
        least, nearest = min(passed, key=lambda one: one[0])
        raise _passed(problem, least, nearest)
    return min(kept, key=lambda one: one[0])[1]


def _rounds(
    problem: Problem, objective: Objective, grouping: Grouping, whole: float
) -> Iterator[Decision]:
    """Solutions, each reckoned with what the rows reach in the one before."""
    model = BlockModel.alone(problem, objective)
    for _ in range(1 + ROUNDS):
        decision = _solved(model, grouping, whole)
        yield decision
        speeds = decision.row_speeds
        fastest = block_feeds(
            BlockModel.alone(problem, "time"), problem.editable.block, speeds[None]
        )
        model = BlockModel.planned(problem, objective, fastest.feeds[0], speeds)


def _solved(model: BlockModel, grouping: Grouping, whole: float) -> Decision:
    problem = model.problem
    moves = problem.cut.plan.path.moves
    pieces, stretches = best_speeds(model, grouping, whole)
    worth = grouping.least_speed_gain
    speeds = refined(model, pieces, stretches, problem.editable.block, worth=worth)
    speeds = _with_feeds(model, stretches, speeds)
    row_speeds = spread(speeds, stretches.stretch, moves.speed)
    whole = min(whole, _of_blocks(model, row_speeds))
    feed, feeds = feed_groups(model, grouping, stretches.stretch, row_speeds, whole)
    groups = Groups(feed=feed, speed=stretches.stretch, own_feed=moves.feed, own_speed=moves.speed)
    return Decision(groups=groups, feeds=feeds, speeds=speeds)


def _with_feeds(model: BlockModel, stretches: Stretches, speeds: Floats) -> Floats:
    """The speeds, as programmed where no F suits all runs of a line at those chosen; shape (H,)."""
    problem, own = model.problem, model.problem.cut.plan.path.moves.speed
    row_speeds = spread(speeds, stretches.stretch, own)
    bad = np.isinf(block_feeds(model, problem.editable.block, row_speeds[None]).values[0])
    wrong = np.unique(stretches.stretch[bad & (stretches.stretch >= 0)])
    if not len(wrong):
        return speeds
    kept = speeds.copy()
    for stretch in wrong.tolist():
        there = own[(stretches.stretch == stretch) & (own > 0)]
        if len(there) and (there == there[0]).all():
            kept[stretch] = there[0]
    return kept


def _as_programmed(problem: Problem, objective: Objective) -> float:
    which, name = column(objective), problem.cut.plan.path.moves.files[0]
    whole = float(problem.as_programmed.objectives[0, which])
    if not np.isfinite(whole):
        raise ValueError(
            f"the {OBJECTIVES[which]} of {name} is not known: {_missing(problem, objective)}, or "
            "choose another objective"
        )
    return whole


def _missing(problem: Problem, objective: Objective) -> str:
    cut, material = problem.cut, problem.basis.material
    for index in np.unique(cut.tool[cut.tool >= 0]).tolist():
        if objective in ("cost", "wear") and material.tool_life(cut.tools[index]) is None:
            return f"T{cut.numbers[index]}: {material.no_life(cut.tools[index])}"
    return "give what not_known of kerf simulate names"


def _of_blocks(model: BlockModel, speeds: Floats) -> float:
    problem = model.problem
    values = block_feeds(model, problem.editable.block, speeds[None]).values[0]
    bad = np.isinf(values)
    if bad.any():
        moves, row = problem.cut.plan.path.moves, int(bad.argmax())
        raise LimitsError(
            f"{where(moves, row)}: the line is run at S of {_listed(problem, speeds, row)} rev/min "
            "and no F keeps the limits at all of them: widen the limits, or write it once for each",
            int(moves.tool[row]),
        )
    return float(values.sum())


def _listed(problem: Problem, speeds: Floats, row: int) -> str:
    block = problem.editable.block
    same = block == block[row] if block[row] >= 0 else np.arange(len(block)) == row
    return ", ".join(f"{speed:g}" for speed in np.unique(speeds[same]).tolist())


def _passed(problem: Problem, violation: float, nearest: Decision) -> LimitsError:
    named = passed_limit(problem, nearest.row_feeds, nearest.row_speeds)
    return named or LimitsError(
        f"{problem.cut.plan.path.moves.files[0]}: no F and S were found that keep all limits; the "
        f"best passes them by {100 * violation:.3g} % in sum over its blocks: widen the limits"
    )


def refined(
    model: BlockModel, pieces: Pieces, stretches: Stretches, group: Rows, *, worth: float = 0.0
) -> Floats:
    """Best S of each stretch near those given; never worse.  Shape (H,) [rev/min].

    ``group`` (M,): rows that share an F, -1 where it is kept; ``worth``: least saving of another S
    than that programmed, as a share; without it all are refined.
    """
    speeds = stretches.speeds.copy()
    if not len(speeds):
        return speeds
    changes = changes_of(stretches.of_piece, pieces)
    colours = _colours(changes, len(speeds))
    width = _widths(model.problem, stretches)
    steps = np.linspace(-1.0, 1.0, CANDIDATES)[:, None]
    step = model.problem.speed_step
    given = own_speeds(model.problem, pieces)
    kept = np.zeros(len(speeds), dtype=np.bool_)
    there = stretches.of_piece >= 0
    kept[stretches.of_piece[there]] = (worth > 0) & (
        given[there] == speeds[stretches.of_piece[there]]
    )
    for _ in range(NARROWINGS):
        for colour in range(int(colours.max()) + 1):
            mine = (colours == colour) & ~kept
            tried = np.where(mine, np.round(stepped(speeds * (1 + width * steps), step)), speeds)
            tried[CANDIDATES // 2] = speeds
            tried = np.maximum(tried, 1.0)
            values = _values(model, pieces, stretches, changes, group, tried)
            best = values.min(axis=0)
            first = (values <= best + SAME * np.abs(best)).argmax(axis=0)
            better = mine & np.isfinite(best)
            speeds = np.where(better, tried[first, np.arange(len(speeds))], speeds)
        width = width * 2 / (CANDIDATES - 1)
    return speeds


def _widths(problem: Problem, stretches: Stretches) -> Floats:
    """Ratio of two neighbours of the grid, less 1, for each stretch; shape (H,)."""
    low, high = np.full((2, len(stretches.speeds)), np.nan)
    rows = np.flatnonzero((stretches.stretch >= 0) & problem.cuts)
    low[:], high[:] = np.inf, 0.0
    np.minimum.at(low, stretches.stretch[rows], problem.ranges.speed_low[rows])
    np.maximum.at(high, stretches.stretch[rows], problem.ranges.speed_high[rows])
    low = np.maximum(np.minimum(low, stretches.speeds), 0.01 * stretches.speeds)
    high = np.minimum(np.maximum(high, stretches.speeds), 100 * stretches.speeds)
    return (high / low) ** (1 / (SPEEDS - 1)) - 1


def _values(
    model: BlockModel, pieces: Pieces, stretches: Stretches, changes: Sequence[Change], group: Rows,
    speeds: Floats,
) -> Floats:  # fmt: skip
    """Objective of each stretch, with the changes from and to it; shape (P, H) of (P, H)."""
    own = model.problem.cut.plan.path.moves.speed
    rows = np.flatnonzero(stretches.stretch >= 0)
    stretch = stretches.stretch[rows]
    values = block_feeds(model, group, spread(speeds, stretches.stretch, own)).values
    out = np.zeros(speeds.shape)
    for one, total in zip(values, out, strict=True):
        total += np.bincount(stretch, one[rows], minlength=len(total))
    grid = speeds.T[np.maximum(stretches.of_piece, 0)]
    alone = replace(pieces, tool_run=np.arange(len(pieces)))  # each with speeds of its own
    out += _of_stretches(start_prices(model, alone, grid), stretches, speeds)
    for before, after, rest, lead in changes:
        price = change_price(model, speeds[:, before], speeds[:, after], rest=rest, lead=lead)
        out[:, before] += price
        out[:, after] += price
    return out


def _of_stretches(values: Floats, stretches: Stretches, speeds: Floats) -> Floats:
    """Sums over the pieces of each stretch; shape (P, H) of (A, P)."""
    out = np.zeros(speeds.shape)
    here = stretches.of_piece >= 0
    np.add.at(out.T, stretches.of_piece[here], values[here])
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
