"""What the operator did to a run: feed and rapid override line by line, and stops.

A log says an override when it changes.  What was in force before the first change is read from the
speeds that the control reached: on a long line it settles at programmed feed x override, to the
last digit.  So are feeds that were edited at the control.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Kind, Moves
from pipeline.identification.control.lines import (
    line_spans,
    lines_since,
    nearest,
    override_of_lines,
)
from pipeline.identification.control.readings import (
    HIGHEST,
    LOWEST,
    feed_of_lines,
    plateau,
    steady_ratios,
)
from pipeline.identification.control.runs import Run, Series
from pipeline.identification.control.spans import Span, joined

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Line by line; index 0 is no line.

    Parameters
    ----------
    feed : ndarray, shape (lines + 1,)
        Feed in force over programmed feed [1].
    rapid : ndarray, shape (lines + 1,)
        Rapid override in force [1].
    spindle : ndarray, shape (lines + 1,)
        Speed of the spindle over programmed speed [1].
    said : ndarray, shape (lines + 1,)
        Feed override as the log says it; 1 where it says none [1].
    stops : tuple of (float, float)
        Spans in which the operator held the machine: the control said so, or an override was 0
        while a line that heeds it was executed [s].
    feed_read : float
        Share of the cutting lines whose feed was read from plateaus; that of the rest is as the log
        says it, or as on the nearest line that was read [1].
    """

    feed: Floats
    rapid: Floats
    spindle: Floats
    said: Floats
    stops: tuple[Span, ...]
    feed_read: float


def operator_of(run: Run, moves: Moves) -> Operator:
    """What the operator did to ``run`` of the program ``moves``."""
    programmed = feed_of_lines(moves)
    lines = len(programmed)
    cuts = np.isfinite(programmed)
    said = override_of_lines(run, run.feed_override, lines)
    feed, read = _feed(run, moves, cuts, said)
    rapids = np.zeros(lines, dtype=bool)
    rapids[moves.line[moves.kind == Kind.RAPID]] = True
    stops = [
        *run.held,
        *_zeros(run, run.feed_override, cuts),
        *_zeros(run, run.rapid_override, rapids),
    ]
    return Operator(
        feed=feed,
        rapid=override_of_lines(run, run.rapid_override, lines),
        spindle=_spindle(run, moves, lines),
        said=said,
        stops=joined(stops),
        feed_read=read,
    )


def _feed(run: Run, moves: Moves, cuts: NDArray[np.bool_], said: Floats) -> tuple[Floats, float]:
    """Feed factor of each line, and the share of the cutting lines that it was read on."""
    stretches = _stretches(moves, said)
    known = lines_since(run, run.feed_override, len(said))
    factor = _levels(stretches, *steady_ratios(run, moves))
    if not np.isfinite(factor[cuts & ~known]).any():  # no straight cut is long enough
        curved = _levels(stretches, *steady_ratios(run, moves, arcs=True))
        factor = np.where(np.isfinite(factor) | known, factor, curved)
    read = np.isfinite(factor) & cuts
    # unsaid and unread: as on the nearest line where it could be read
    rest = np.where(known, said, nearest(np.where(cuts, factor, np.nan)))
    factor = np.where(np.isfinite(factor), factor, rest)
    return np.where(factor > 0, factor, 1.0), float(read.sum() / max(cuts.sum(), 1))


def _stretches(moves: Moves, said: Floats) -> Ints:
    """Number of the stretch that each line lies in: one tool, one programmed feed, one override."""
    tool = np.zeros(len(said))
    tool[moves.line] = moves.tool
    latest = np.maximum.accumulate(np.where(tool != 0, np.arange(len(said)), 0))
    feed = np.nan_to_num(feed_of_lines(moves))
    override = np.round(said, 3)  # a mean of what is constant differs in its last digits
    label = np.column_stack([tool[latest], override, feed])
    _, numbers = np.unique(label, axis=0, return_inverse=True)
    return numbers.ravel().astype(np.int64)


def _levels(stretches: Ints, where: Ints, ratio: Floats) -> Floats:
    """The plateau of each stretch, at its lines; NaN where there is none.

    Parameters
    ----------
    stretches : ndarray of int, shape (lines + 1,)
        Number of the stretch of each line.
    where, ratio : ndarray, shape (N,)
        Lines of readings, and the share of the programmed feed that was read there [1].
    """
    factor = np.full(len(stretches), np.nan)
    for number in np.unique(stretches[where]):
        level = plateau(ratio[stretches[where] == number])
        if level is not None:
            factor[stretches == number] = level
    return factor


def _spindle(run: Run, moves: Moves, lines: int) -> Floats:
    """Factor of the spindle's speed: what the log last said while one S was in force."""
    factor = np.ones(lines)
    on = moves.direction != 0
    changes = np.flatnonzero(np.diff(moves.speed * on, prepend=0.0, append=0.0))
    begin, _, number = line_spans(run, lines)
    for row, after in pairwise(changes):
        programmed = moves.speed[row]
        first, last = moves.line[row], moves.line[after - 1]
        seen = (number >= first) & (number <= last)
        if not on[row] or programmed <= 0 or not seen.any():
            continue
        ratio = float(run.speed.at(begin[seen][-1:], before=0.0)[0]) / programmed
        if LOWEST < ratio < HIGHEST:
            factor[first : last + 1] = ratio
    return factor


def _zeros(run: Run, series: Series, heeds: NDArray[np.bool_]) -> list[Span]:
    """Spans in which an override stood at 0 while a line that heeds it was, or was about to be."""
    spans = []
    ends = np.append(series.time, run.end)[1:]
    for begin, end, value in zip(series.time, ends, series.value, strict=True):
        if value > 0:
            continue
        line = int(run.line.at(np.array([(begin + end) / 2]), before=0.0)[0])
        if heeds[line : line + 2].any():
            spans.append((float(begin), float(end)))
    return spans
