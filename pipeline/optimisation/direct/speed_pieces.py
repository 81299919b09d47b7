"""Where a program's S may change: rows between two such places are one piece, which has one S."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Moves
from pipeline.machine.control.planner import Plan
from pipeline.optimisation.problem.speed_changes import leads
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable import Editable

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A pieces of a program of M rows, in the order that they are run in.

    Parameters
    ----------
    piece : ndarray of intp, shape (M,)
        -1 in rows that keep their S.
    turn : ndarray of intp, shape (A,)
        Runs of pieces of one tool; S is free to change from one to the next.
    word : ndarray of bool, shape (A,)
        Whether an S word has to be added for S to change at the piece's first line.
    rest : ndarray of bool, shape (A,)
        Whether the spindle stands when the piece begins.
    lead : ndarray, shape (A,)
        Time from the beginning of the piece to its first cut, at rapids and at rest [s].
    key : ndarray of intp, shape (A,)
        Pieces of one key begin at the same line, run again, and have one S.
    """

    piece: Rows = field(repr=False)
    turn: Rows = field(repr=False)
    word: Flags = field(repr=False)
    rest: Flags = field(repr=False)
    lead: NDArray[np.float64] = field(repr=False)
    key: Rows = field(repr=False)

    def __len__(self) -> int:
        return len(self.turn)


def speed_pieces(plan: Plan, editable: Editable, cuts: Flags, grouping: Grouping) -> Pieces:
    """Pieces of a program.

    A piece goes from a line where an S word may stand to the next such line.  A word is added only
    between two cuts, and at the first line after a cut: the way to the next cut is made at the
    speed of that one, the way out of the last at the speed that it was cut with.  A line that is
    run more than once (a loop, a subprogram) gives S the same value each time: there only the
    program's own S words count, and each always begins a piece.  Tools that cut nothing keep their
    S.

    Parameters
    ----------
    plan : Plan
        M rows as programmed.
    editable : Editable
        Which S may change.
    cuts : ndarray of bool, shape (M,)
        Rows that cut at feed.
    grouping : Grouping
        Whether S words may be added.
    """
    moves = plan.path.moves
    visit, line = _visits(moves)
    repeated = np.bincount(line)[line] > 1
    own = _any(editable.own_start & editable.speed, visit)
    may = _any(editable.may_start & editable.speed, visit)
    begins = own.copy()
    if grouping.speeds == "blocks":
        begins |= _between_cuts(
            own, may & ~repeated, _any(cuts, visit), moves.tool[_first(visit)].astype(np.intp)
        )
    piece = np.cumsum(begins)[visit] - 1
    first = np.searchsorted(visit, np.flatnonzero(begins))
    changed = np.diff(moves.tool[first], prepend=-2) != 0
    turn = np.cumsum(changed) - 1
    free = editable.speed & (piece >= 0)
    cutting = np.zeros(int(turn.max(initial=-1)) + 1, dtype=bool)
    cutting[turn[piece[free & cuts]]] = True
    free[free] = cutting[turn[piece[free]]]
    standing = np.where(first > 0, moves.direction[first - 1], 0) == 0
    return Pieces(
        piece=np.where(free, piece, -1), turn=turn, word=~own[begins], rest=standing,
        lead=leads(plan, editable, cuts)[first], key=line[begins],
    )  # fmt: skip


def _visits(moves: Moves) -> tuple[Rows, Rows]:
    """Which run of rows of one line each row belongs to, (M,), and the line of each run, (V,)."""
    new = (np.diff(moves.line, prepend=-1) != 0) | (np.diff(moves.file, prepend=-1) != 0)
    first = np.flatnonzero(new)
    where = np.stack([moves.file[first].astype(np.intp), moves.line[first].astype(np.intp)])
    _, line = np.unique(where, axis=1, return_inverse=True)
    return (np.cumsum(new) - 1).astype(np.intp), line.ravel()


def _between_cuts(own: Flags, may: Flags, cuts: Flags, tool: Rows) -> Flags:
    """Visits where a word may be added with a cut of the piece before and one of its own; (V,)."""
    ends = own | (np.diff(tool, prepend=tool[:1]) != 0)
    found, cut_since = np.zeros(len(own), dtype=bool), False
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
            found[v], cut_since = True, False
        cut_since |= bool(cuts[v])
    return found


def _first(visit: Rows) -> Rows:
    """First row of each visit."""
    return np.flatnonzero(np.diff(visit, prepend=-1))


def _any(flags: Flags, visit: Rows) -> Flags:
    """Whether any row of each visit has a flag; shape (V,)."""
    found: Flags = np.bincount(visit[flags], minlength=int(visit.max(initial=-1)) + 1) > 0
    return found
