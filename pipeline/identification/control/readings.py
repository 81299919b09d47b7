"""What steady readings of the speed along the path tell: feeds and rates that were reached.

On a long line the control settles at programmed feed x override to the last digit, so that
readings, one after the other, agree.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.identification.control.runs import Run
from pipeline.machine.spindle import CUTTING

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEADY = 0.005
"""Two readings, one after the other, that differ by less than this share are steady."""
LAG = 0.25
"""How much later than the machine a polled line may be [s]."""
FEWEST = 6
"""Steady polls that make a plateau: about a second."""
SHARE = 0.05
"""Share of the steady readings that a plateau needs at least."""
WIDTH = 0.004
"""Readings within this share of one another lie on one plateau."""
LOWEST, HIGHEST = 0.02, 3.0
"""Ratios outside are no override that a control offers."""


def feed_of_lines(moves: Moves) -> Floats:
    """Feed of each line [mm/s], NaN where it does not cut; index 0 is no line."""
    feed = np.full(int(moves.line.max(initial=0)) + 1, np.nan)
    rows = np.isin(moves.kind, CUTTING) & (moves.feed_mode == FeedMode.PER_MINUTE)
    rows &= moves.feed > 0
    feed[moves.line[rows]] = moves.feed[rows] / 60
    return feed


def steady(readings: Floats) -> NDArray[np.bool_]:
    """Which readings agree with the one before."""
    before = np.concatenate([[np.nan], readings])[:-1]
    same: NDArray[np.bool_] = np.abs(readings - before) < STEADY * before
    return same


def steady_ratios(run: Run, moves: Moves, *, arcs: bool = False) -> tuple[Ints, Floats]:
    """Steady readings of the feed on straight cuts: the line, and the share of its feed.

    A reading counts when the one before it agrees and both were taken while lines that cut were
    executed, since a while.

    Parameters
    ----------
    run : Run
        Lines numbered as in the program.
    moves : Moves
        Of the program.
    arcs : bool
        Whether to read on arcs too, where the control may settle at what their curvature allows.
    """
    programmed = feed_of_lines(moves)
    wanted = np.zeros(len(programmed), dtype=bool)
    wanted[moves.line[np.isin(moves.kind, (Kind.FEED, Kind.ARC) if arcs else Kind.FEED)]] = True
    feed = run.feed.polled()
    lines = lines_at(run, feed.time, len(programmed))
    ratio = feed.value / programmed[lines]
    ratio[~np.isfinite(programmed[lines_at(run, feed.time - LAG, len(programmed))])] = np.nan
    kept = steady(ratio) & wanted[lines]
    return lines[kept], ratio[kept]


def lines_at(run: Run, time: Floats, lines: int) -> Ints:
    """Line in force at ``time``; 0, no line, where the program has none of that number."""
    found = run.line.at(time, before=0.0).astype(np.int64)
    return np.where((found >= 0) & (found < lines), found, 0)


def plateau(ratio: Floats, width: float = WIDTH) -> float | None:
    """The highest level that readings share within ``width``, None where they share none.

    A line may be too short to reach its feed, and readings below the level are no sign of it;
    readings above it are rapids on the way out.

    Examples
    --------
    >>> plateau(np.array([0.3, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 1.7]))
    0.9
    """
    ratio = np.sort(ratio[(ratio > LOWEST) & (ratio < HIGHEST)])
    last = np.searchsorted(ratio, ratio * (1 + width), side="right")
    count = last - np.arange(len(ratio))
    enough = np.flatnonzero(count >= max(FEWEST, SHARE * len(ratio)))
    if not len(enough):
        return None
    first = enough[-1]
    return float(np.median(ratio[first : last[first]]))
