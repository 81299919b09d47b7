"""Spindle speed of each stretch of a program: the cheapest path through a grid of speeds.

Pieces of the program between the places where S may change are stages, speeds of the grid states.
A stage costs its blocks with their best feeds at that S; a change of S the wait for the spindle and
the worth of an added S word.  The grid of each tool is a geometric row, the ends of its range, and
speeds at which the feed per tooth and the feed reach their limits together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion, where
from pipeline.machine.control.planner import Plan
from pipeline.machine.spindle import spindle_waits
from pipeline.optimisation.methods.feeds import BlockModel, block_feeds
from pipeline.optimisation.problem.arrays import Editable, spread
from pipeline.optimisation.problem.feasible import LimitsError
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.problem.spindle import leads
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import LineRuns
from pipeline.optimisation.text.words import stepped
from pipeline.schema.arrays import Bools, Floats, Rows

SPEEDS = 48
"""Number of spindle speeds of the geometric grid."""
CORNERS = 16
"""Speeds at most at which the greatest feed per tooth meets the greatest feed."""
SLOWEST = 0.1
"""Lower end of the speed grid over the program's least S [1], where no limit is lower."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A pieces of a program of M rows, in the order that they are run in."""

    piece: Rows = field(repr=False)
    """-1 in rows that keep their S; shape (M,)."""
    tool_run: Rows = field(repr=False)
    """Runs of pieces of one tool; S is free to change from one to the next; shape (A,)."""
    word: Bools = field(repr=False)
    """Whether an S word has to be added for S to change at the piece's first line; shape (A,)."""
    rest: Bools = field(repr=False)
    """Whether the spindle stands when the piece begins; shape (A,)."""
    lead: NDArray[np.float64] = field(repr=False)
    """Time from the beginning of the piece to its first cut, at rapids and at rest [s];
    shape (A,)."""
    key: Rows = field(repr=False)
    """Pieces of one key begin at the same line, run again, and have one S; shape (A,)."""

    def __len__(self) -> int:
        return len(self.tool_run)


def speed_pieces(plan: Plan, editable: Editable, cuts: Bools, grouping: Grouping) -> Pieces:
    """Pieces of a program, each from a line where an S word may stand to the next.

    A word is added only between two cuts, at the first line after a cut: the approach is made at
    the speed of the next cut.  A line that is run more than once (a loop, a subprogram) gives S the
    same value each time: there only the program's own S words count.  Tools that cut nothing keep
    their S. ``cuts`` (M,): rows that cut at feed.
    """
    moves = plan.path.moves
    runs = LineRuns.among(moves)
    places = np.stack([moves.file, moves.line])[:, runs.first].astype(np.intp)
    line = np.unique(places, axis=1, return_inverse=True)[1].ravel()
    repeated = np.bincount(line)[line] > 1
    own = runs.any(editable.own_start & editable.speed)
    may = runs.any(editable.may_start & editable.speed)
    begins = own.copy()
    if grouping.speeds == "blocks":
        tool = moves.tool[runs.first].astype(np.intp)
        begins |= _between_cuts(own, may & ~repeated, runs.any(cuts), tool)
    piece = np.cumsum(begins)[runs.of] - 1
    first = runs.first[begins]
    changed = np.diff(moves.tool[first], prepend=-2) != 0
    tool_run = np.cumsum(changed) - 1
    free = editable.speed & (piece >= 0)
    cutting = np.zeros(int(tool_run.max(initial=-1)) + 1, dtype=bool)
    cutting[tool_run[piece[free & cuts]]] = True
    free[free] = cutting[tool_run[piece[free]]]
    standing = np.where(first > 0, moves.direction[first - 1], 0) == 0
    return Pieces(
        piece=np.where(free, piece, -1), tool_run=tool_run, word=~own[begins], rest=standing,
        lead=leads(plan, editable, cuts)[first], key=line[begins],
    )  # fmt: skip


def _between_cuts(own: Bools, may: Bools, cuts: Bools, tool: Rows) -> Bools:
    """Line runs where a word may be added: a cut before in its piece and one to come; (V,)."""
    ends = own | (np.diff(tool, prepend=tool[:1]) != 0)
    begins, cut_since = np.zeros(len(own), dtype=bool), False
    last = np.append(np.flatnonzero(ends), len(own))
    next_end = last[
        np.searchsorted(last, np.arange(len(own)), side="right").clip(max=len(last) - 1)
    ]
    cut = np.append(np.flatnonzero(cuts), len(own))
    next_cut = cut[np.searchsorted(cut, np.arange(len(own))).clip(max=len(cut) - 1)]
    to_come = next_cut < next_end
    for v in np.flatnonzero(own | may | cuts).tolist():
        if own[v]:
            cut_since = False
        elif may[v] and cut_since and to_come[v]:
            begins[v], cut_since = True, False
        cut_since |= bool(cuts[v])
    return begins


def speed_grid(problem: Problem, pieces: Pieces) -> Floats:
    """Speeds (T, K) tried for each run of pieces of one tool, rising, whole or own [rev/min]."""
    moves = problem.cut.plan.path.moves
    listed = []
    for tool_run in range(int(pieces.tool_run.max(initial=-1)) + 1):
        rows = (pieces.piece >= 0) & (pieces.tool_run[pieces.piece] == tool_run)
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
    step = problem.speed_step
    ends = stepped([low], step, np.ceil), stepped([high], step, np.floor)
    whole = np.concatenate([
        np.ceil(ends[0]), np.floor(ends[1]), np.round(stepped(row, step)),
        np.ceil(stepped(corners, step, np.ceil)),
    ])  # fmt: skip
    inside = whole[(whole >= low) & (whole <= high)]
    speeds: Floats = np.unique(np.concatenate([inside, own[(own >= low) & (own <= high)]]))
    return speeds if len(speeds) else np.array([low])


def speed_range(problem: Problem, cuts: NDArray[np.bool_], own: Floats) -> tuple[float, float]:
    """Least and greatest S of rows that cut [rev/min].

    Where nothing limits S, a tenth of the program's least and its greatest.
    """
    least, most = float(own.min(initial=np.inf)), float(own.max(initial=0.0))
    low = float(problem.ranges.speed_low[cuts].min())
    high = float(problem.ranges.speed_high[cuts].max())
    least = min(SLOWEST * least, high)
    low = max(low, least) if np.isfinite(least) else low
    return max(low, 1.0), high if np.isfinite(high) else max(most, low)


def _corners(problem: Problem, cuts: NDArray[np.bool_]) -> Floats:
    """Least S of each row at which feed per tooth and feed meet their limits [rev/min]."""
    path = problem.cut.plan.path
    rows = np.flatnonzero(cuts & (path.motion != Motion.PER_TURN) & (problem.bounds.high > 0))
    fastest = np.minimum(path.factor[rows] * problem.ranges.feed_high[rows], path.cap[rows])
    speed = 60 * fastest / (problem.bounds.high[rows] * problem.flutes[rows])
    return np.unique(np.ceil(speed[np.isfinite(speed)]))


LEADS = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0])
"""Classes of the time before a cut [s]."""
TIE = 1e-9
"""Gain of a higher speed of the grid over the one below, as a share, from which it is taken."""
CHANGE = 1e-7
"""Saving that any change of S has to reach, as a share of the whole part."""
LATE = 1e6
"""Price of cutting before the spindle has its speed: only where nothing else is possible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """H stretches of one S in M rows of A pieces."""

    stretch: Rows = field(repr=False)
    """-1 in rows that keep their S; shape (M,)."""
    speeds: Floats = field(repr=False)
    """Speeds [rev/min]; shape (H,)."""
    of_piece: Rows = field(repr=False)
    """Stretch of each piece; shape (A,)."""


def best_speeds(model: BlockModel, grouping: Grouping, whole: float) -> tuple[Pieces, Stretches]:
    """Best stretches of S, each with the best value of the grid; ``whole`` as programmed."""
    problem, moves = model.problem, model.problem.cut.plan.path.moves
    pieces = speed_pieces(problem.cut.plan, problem.editable, problem.cuts, grouping)
    grid = speed_grid(problem, pieces)
    values = _piece_values(model, pieces, grid)
    values += start_prices(model, pieces, grid)
    given = own_speeds(problem, pieces)
    changed = np.abs(grid[pieces.tool_run] - given[:, None]) > CHANGE * given[:, None]
    values += whole * grouping.least_speed_gain * changed
    values *= 1 + TIE * np.arange(values.shape[1])
    rest = model.values(moves.feed[None], moves.speed[None])[0, pieces.piece < 0]
    least = float(values.min(axis=1).sum() + rest.sum())
    whole = min(whole, least)  # as programmed may be many times what it could be
    words = whole * np.where(pieces.word, max(grouping.least_speed_gain, CHANGE), CHANGE)
    chosen = _chosen(model, pieces, grid, values, words)
    return pieces, _stretches(pieces, grid[pieces.tool_run, chosen])


def own_speeds(problem: Problem, pieces: Pieces) -> Floats:
    """S of each piece as programmed [rev/min], NaN where nothing of it cuts; shape (A,)."""
    speeds = np.full(len(pieces), np.nan)
    rows = np.flatnonzero(problem.cuts & (pieces.piece >= 0))[::-1]
    speeds[pieces.piece[rows]] = problem.cut.plan.path.moves.speed[rows]
    return speeds


def staying(problem: Problem, grouping: Grouping) -> Problem:
    """Problem in which pieces that chatter at every S may stay as they are, but come no nearer."""
    below = problem.own_margin < problem.limits.margins.stability  # NaN: not known
    if problem.practice is None or not (below & problem.editable.speed).any():
        return problem
    pieces = speed_pieces(problem.cut.plan, problem.editable, problem.cuts, grouping)
    grid = speed_grid(problem, pieces)
    values = _row_values(BlockModel.alone(problem, "time"), pieces, grid)
    without = np.flatnonzero(np.isinf(values).all(axis=1))
    return problem.staying(below & np.isin(pieces.piece, without))


def _piece_values(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    """Objective of each piece at each speed with its best feeds; shape (A, K)."""
    failing = np.ones(len(model.problem), dtype=bool)
    totals = _row_values(model, pieces, grid, failing)
    if failing.any():
        row, moves = int(failing.argmax()), model.problem.cut.plan.path.moves
        raise LimitsError(_no_speed(model.problem, pieces, grid, row), int(moves.tool[row]))
    return totals


def _row_values(
    model: BlockModel, pieces: Pieces, grid: Floats, failing: Bools | None = None
) -> Floats:
    """The same without a refusal; ``failing`` (M,) keeps rows that have no feed at any speed."""
    own, block = model.problem.cut.plan.path.moves.speed, model.problem.editable.block
    group = _parts_of_blocks(block, pieces.piece)
    totals = np.zeros((len(pieces), grid.shape[1]))
    here = pieces.piece >= 0
    for k, speeds in enumerate(grid.T):
        row_speeds = spread(speeds[pieces.tool_run], pieces.piece, own)
        values = block_feeds(model, group, row_speeds[None]).values[0]
        totals[:, k] = np.bincount(pieces.piece[here], values[here], minlength=len(pieces))
        if failing is not None:
            failing &= np.isinf(values)
    return totals


def _parts_of_blocks(block: Rows, piece: Rows) -> Rows:
    """Rows of one block in one piece, so that pieces can be looked at one by one; (M,)."""
    parts = np.full(len(block), -1, dtype=np.intp)
    rows = np.flatnonzero(block >= 0)
    if len(rows):
        pairs = np.stack([block[rows], piece[rows]])
        parts[rows] = np.unique(pairs, axis=1, return_inverse=True)[1].ravel()
    return parts


def _no_speed(problem: Problem, pieces: Pieces, grid: Floats, row: int) -> str:
    moves = problem.cut.plan.path.moves
    place, piece = where(moves, row), int(pieces.piece[row])
    if piece < 0:
        return (
            f"{place}: no F keeps the limits at S {moves.speed[row]:g}, which cannot be changed "
            "there: widen the limits"
        )
    speeds = grid[pieces.tool_run[piece]]
    span = f"no S from {speeds[0]:g} to {speeds[-1]:g} rev/min"
    tried = spread(speeds[:, None], np.where(pieces.piece == piece, 0, -1), moves.speed)
    if not problem.stable(tried)[:, row].any():
        return (
            f"{place}: {span} is free of chatter at this depth with a margin of "
            f"{problem.limits.margins.stability:g}: take less depth, another tool, or a smaller "
            "limits.margins.stability"
        )
    if problem.editable.block[row] < 0:
        return (
            f"{place}: F {moves.feed[row]:g} cannot be changed there, and {span} keeps the limits "
            "with it: lower it in the program"
        )
    return f"{place}: {span} has an F that keeps the limits: widen them, or take another tool"


def _chosen(model: BlockModel, pieces: Pieces, grid: Floats, values: Floats, words: Floats) -> Rows:
    """Index of each piece's speed in the grid of its run; shape (A,)."""
    values = _shared(values, pieces.key)
    first = _paths(model, pieces, grid, values, words)
    _, leader, many = np.unique(pieces.key, return_index=True, return_counts=True)
    tied = leader[many > 1]
    if not len(tied):
        return first
    for piece in tied.tolist():  # all that begin at one line take the speed of the first
        speed = grid[pieces.tool_run[piece], first[piece]]
        for other in np.flatnonzero(pieces.key == pieces.key[piece]).tolist():
            near = np.abs(grid[pieces.tool_run[other]] - speed)
            values[other, near > near.min()] = np.inf
    return _paths(model, pieces, grid, values, words)


def _shared(values: Floats, key: Rows) -> Floats:
    _, index, many = np.unique(key, return_inverse=True, return_counts=True)
    if (many == 1).all():
        return values
    total = np.zeros((len(many), values.shape[1]))
    np.add.at(total, index, values)
    return total[index] / many[index, None]


def _paths(model: BlockModel, pieces: Pieces, grid: Floats, values: Floats, words: Floats) -> Rows:
    chosen = np.zeros(len(pieces), dtype=np.intp)
    for tool_run, speeds in enumerate(grid):
        mine = np.flatnonzero(pieces.tool_run == tool_run)
        before, after = speeds[:, None], speeds[None, :]
        kinds, kind = np.unique(_kinds(pieces)[:, mine], axis=1, return_inverse=True)
        change = np.stack([
            change_price(model, before, after, rest=bool(rest), lead=float(lead))
            for rest, lead in kinds.T
        ])  # fmt: skip
        chosen[mine] = viterbi(values[mine], change, kind.ravel(), words[mine])
        taken = values[mine, chosen[mine]].sum()
        if not np.isfinite(taken):
            raise _no_sequence(model.problem, pieces, mine)
    return chosen


def _kinds(pieces: Pieces) -> Floats:
    """Whether the spindle rests before each piece, and the lead, rounded down; shape (2, A)."""
    lead = LEADS[np.searchsorted(LEADS, pieces.lead, side="right") - 1]
    return np.stack([pieces.rest.astype(np.float64), lead])


def _no_sequence(problem: Problem, pieces: Pieces, mine: Rows) -> LimitsError:
    moves = problem.cut.plan.path.moves
    row = int(np.isin(pieces.piece, mine).argmax())
    least = problem.limits.least_speed_change_rpm
    return LimitsError(
        f"{where(moves, row)}: T{moves.tool[row]} finds no S that keeps the limits of all its "
        f"blocks with changes of at least {least:g} rev/min at the places where S may change: "
        'widen the limits, or let S words be added (grouping.speeds = "blocks")',
        int(moves.tool[row]),
    )


def _stretches(pieces: Pieces, speeds: Floats) -> Stretches:
    """Pieces in a row that have one S are one stretch; so are all of one key."""
    new = (np.diff(speeds, prepend=-1.0) != 0) | (np.diff(pieces.tool_run, prepend=-1) != 0)
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
    """Before, after, rest of the spindle between, and least lead [s] of stretches of one tool."""
    leads: dict[tuple[int, int, bool], float] = {}
    for piece in range(1, len(pieces)):
        before, after = int(of_piece[piece - 1]), int(of_piece[piece])
        same = pieces.tool_run[piece] == pieces.tool_run[piece - 1]
        if same and before != after and min(before, after) >= 0:
            key = (before, after, bool(pieces.rest[piece]))
            leads[key] = min(leads.get(key, np.inf), float(pieces.lead[piece]))
    return [(*key, lead) for key, lead in leads.items()]


def viterbi(values: Floats, change: Floats, kind: Rows, word: Floats) -> Rows:
    """States of A stages that cost least together: dynamic programming (Viterbi 1967).

    ``values`` (A, K): cost of each state, infinite where it is not allowed; ``change`` (C, K, K):
    price from one state (first) to another, by kind of change; ``kind`` (A,): kind of the change to
    each stage; ``word`` (A,): price of any change there.  Of equal costs the lowest states and the
    earliest changes; 0 where a stage is infinite in all; (A,).
    """
    stages, states = values.shape
    before = np.tile(np.arange(states), (stages, 1))
    best = values[0]
    for stage in range(1, stages):
        price = best[:, None] + change[kind[stage]]
        cheapest = price.argmin(axis=0)
        moved = price[cheapest, np.arange(states)] + word[stage]
        before[stage] = np.where(moved < best, cheapest, before[stage])
        best = np.minimum(moved, best) + values[stage]
    path = np.zeros(stages, dtype=np.intp)
    path[-1] = best.argmin()
    for stage in range(stages - 1, 0, -1):
        path[stage - 1] = before[stage, path[stage]]
    return path


def change_price(
    model: BlockModel, before: Floats, after: Floats, *, rest: bool, lead: float
) -> Floats:
    """Price of a change of S between two places of one tool; infinite below the least change.

    ``before`` and ``after``: [rev/min], of shapes that broadcast; ``rest``: whether the spindle
    stands in between; ``lead``: time from the change to the next cut [s], too short for a control
    that does not wait where chips get too thick.
    """
    problem, least = model.problem, model.problem.limits.least_speed_change_rpm
    step = np.abs(after - before)
    price = np.zeros(step.shape)
    if not rest:
        price += problem.speed_changes.time(before, after) * model.second_price
        price += np.where(problem.speed_changes.ramp(before, after) > lead, LATE, 0.0)
    price = np.where(step > 0, price, 0.0)
    return np.where((step > 0) & (step < least), np.inf, price)


def start_prices(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    """Price of starting the spindle for each piece, and stopping it after; shape (A, K).

    Infinite where S would be too near to that of a row beside the piece that keeps its own;
    ``grid`` (T, K): speeds of each run of pieces [rev/min].
    """
    prices, price = _beside_held(model, pieces, grid), model.second_price
    if not len(pieces) or price == 0.0:
        return prices
    plan = model.problem.cut.plan
    moves, auxiliary = plan.path.moves, plan.path.control.auxiliary
    speeds = np.where(pieces.piece >= 0, grid.T[:, pieces.tool_run[pieces.piece]], moves.speed)
    speeds[:, moves.direction == 0] = 0.0
    rows, waiting, seconds = spindle_waits(moves, auxiliary, speeds)
    passed = np.concatenate([[0.0], np.cumsum(plan.time)])
    for row, until, needed in zip(rows.tolist(), waiting.tolist(), seconds.T, strict=True):
        was_on = row > 0 and moves.direction[row - 1] != 0
        starts = moves.direction[row] != 0
        if was_on and starts:
            continue  # a change of speed
        piece = pieces.piece[row] if starts else pieces.piece[row - 1]
        if piece >= 0 and was_on != starts:
            meanwhile = passed[until] - passed[min(row + 1, until)]
            prices[piece] += price * np.maximum(0.0, needed - meanwhile)
    return prices


def _beside_held(model: BlockModel, pieces: Pieces, grid: Floats) -> Floats:
    prices, problem = np.zeros((len(pieces), grid.shape[1])), model.problem
    moves, least = problem.cut.plan.path.moves, problem.limits.least_speed_change_rpm
    on = np.flatnonzero(moves.direction != 0)
    if least == 0.0:
        return prices
    for rows, others in ((on[:-1], on[1:]), (on[1:], on[:-1])):
        met = (pieces.piece[rows] >= 0) & (pieces.piece[others] < 0)
        met &= moves.tool[rows] == moves.tool[others]
        piece = pieces.piece[rows[met]]
        step = np.abs(grid[pieces.tool_run[piece]] - moves.speed[others[met], None])
        np.add.at(prices, piece, np.where((step > 0) & (step < least), np.inf, 0.0))
    return prices
