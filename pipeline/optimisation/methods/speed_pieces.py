"""Pieces of a program between the places where S may change, and the spindle speeds tried for them.

The grid of speeds of each tool is a geometric row, the ends of its range, and speeds at which the
feed per tooth and the feed reach their limits together.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import Plan
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.problem.spindle import leads
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.modal_words import LineRuns
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
    corners: Floats = np.unique(np.ceil(speed[np.isfinite(speed)]))
    return corners
