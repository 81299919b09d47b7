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
from pipeline.identification.control.programs import feed_of_lines, steady_ratios
from pipeline.identification.control.runs import Run, Series, Span

Floats = NDArray[np.float64]

FEWEST = 6
"""Steady polls that make a plateau: about a second."""
SHARE = 0.05
"""Share of the steady readings that a plateau needs at least."""
WIDTH = 0.004
"""Readings within this share of one another lie on one plateau."""
LOWEST, HIGHEST = 0.02, 3.0
"""Ratios outside are no override that a control offers."""


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
    feed_read, feed_said : float
        Share of the cutting lines whose feed was read from plateaus, and from the override that the
        log says; the rest is taken as programmed [1].
    """

    feed: Floats
    rapid: Floats
    spindle: Floats
    said: Floats
    stops: tuple[Span, ...]
    feed_read: float
    feed_said: float


def operator_of(run: Run, moves: Moves) -> Operator:
    """What the operator did to ``run`` of the program ``moves``."""
    cutting = feed_of_lines(moves)
    rapid_lines = np.zeros(len(cutting), dtype=bool)
    rapid_lines[moves.line[moves.kind == Kind.RAPID]] = True
    stretches = _stretches(run, moves, len(cutting))
    feed, read, said = _feed(run, moves, cutting, stretches)
    rapid = _mean_over_lines(run, run.rapid_override, len(cutting)) / 100
    stops = [
        *run.held,
        *_zeros(run, run.feed_override, np.isfinite(cutting)),
        *_zeros(run, run.rapid_override, rapid_lines),
    ]
    return Operator(
        feed=feed,
        rapid=rapid,
        spindle=_spindle(run, moves, len(cutting)),
        said=_mean_over_lines(run, run.feed_override, len(cutting)) / 100,
        stops=joined(stops),
        feed_read=read,
        feed_said=said,
    )


def _stretches(run: Run, moves: Moves, lines: int) -> NDArray[np.int64]:
    """Number of the stretch that each line lies in: one tool, one programmed feed, one override."""
    label = np.zeros((lines, 2))
    tool = np.zeros(lines)
    tool[moves.line] = moves.tool
    label[:, 0] = np.maximum.accumulate(np.where(tool != 0, np.arange(lines), 0))
    label[:, 0] = tool[label[:, 0].astype(int)]
    label[:, 1] = _mean_over_lines(run, run.feed_override, lines)
    _, numbers = np.unique(
        np.column_stack([label, np.nan_to_num(feed_of_lines(moves))]), axis=0, return_inverse=True
    )
    return numbers.ravel().astype(np.int64)


def _feed(
    run: Run, moves: Moves, cutting: Floats, stretches: NDArray[np.int64]
) -> tuple[Floats, float, float]:
    """Feed factor of each line, and the shares of lines that were read and said."""
    said = _mean_over_lines(run, run.feed_override, len(cutting)) / 100
    known = _lines_with(run, run.feed_override, len(cutting))
    factor = _levels(len(cutting), stretches, *steady_ratios(run, moves))
    cuts = np.isfinite(cutting)
    if not np.isfinite(factor[cuts & ~known]).any():  # no straight cut is long enough
        curved = _levels(len(cutting), stretches, *steady_ratios(run, moves, arcs=True))
        factor = np.where(np.isfinite(factor) | known, factor, curved)
    read = np.isfinite(factor) & cuts
    # unsaid and unread: as on the nearest line where it could be read
    filled = np.where(known, said, _nearest(np.where(cuts, factor, np.nan)))
    factor = np.where(np.isfinite(factor), factor, filled)
    count = max(int(cuts.sum()), 1)
    rest = int((cuts & ~read & known).sum()) / count
    return np.where(factor > 0, factor, 1.0), float(read.sum() / count), rest


def _levels(
    lines: int, stretches: NDArray[np.int64], where: NDArray[np.int64], ratio: Floats
) -> Floats:
    """The plateau of each stretch, at its lines; NaN where there is none."""
    factor = np.full(lines, np.nan)
    for number in np.unique(stretches[where]):
        level = plateau(ratio[stretches[where] == number])
        if level is not None:
            factor[stretches == number] = level
    return factor


def _lines_with(run: Run, series: Series, lines: int) -> NDArray[np.bool_]:
    """Lines executed after a series began to say something."""
    known = np.zeros(lines, dtype=bool)
    if len(series.time):
        begin, _, number = _line_spans(run, lines)
        later = number[begin >= series.time[0]]
        known[int(later[0]) if len(later) else lines :] = True
    return known


def _spindle(run: Run, moves: Moves, lines: int) -> Floats:
    """Factor of the spindle's speed: what the log last said while one S was in force."""
    factor = np.ones(lines)
    on = moves.direction != 0
    change = np.flatnonzero(np.diff(moves.speed * on, prepend=0.0, append=0.0))
    begin, end, number = _line_spans(run, lines)
    for first, after in pairwise(change):
        programmed = moves.speed[first]
        span = moves.line[first], moves.line[after - 1]
        seen = (number >= span[0]) & (number <= span[1])
        if not on[first] or programmed <= 0 or not seen.any():
            continue
        ratio = float(run.speed.at(begin[seen][-1:], before=0.0)[0]) / programmed
        if LOWEST < ratio < HIGHEST:
            factor[span[0] : span[1] + 1] = ratio
    return factor


def plateau(ratio: Floats, width: float = WIDTH) -> float | None:
    """The highest level that readings share within ``width``, None where they share none.

    A line may be too short to reach its feed, and readings below the level are no sign of it;
    readings above it are rapids on the way out.
    """
    ratio = np.sort(ratio[(ratio > LOWEST) & (ratio < HIGHEST)])
    last = np.searchsorted(ratio, ratio * (1 + width), side="right")
    count = last - np.arange(len(ratio))
    enough = np.flatnonzero(count >= max(FEWEST, SHARE * len(ratio)))
    if not len(enough):
        return None
    first = enough[-1]
    return float(np.median(ratio[first : last[first]]))


def _nearest(values: Floats) -> Floats:
    """Each NaN replaced by the nearest value; ones where there are none."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.ones_like(values)
    index = np.arange(len(values))
    right = np.clip(np.searchsorted(known, index), 0, len(known) - 1)
    left = np.clip(right - 1, 0, len(known) - 1)
    nearer = np.where(
        np.abs(known[left] - index) <= np.abs(known[right] - index), known[left], known[right]
    )
    return values[nearer]


def _mean_over_lines(run: Run, series: Series, lines: int) -> Floats:
    """Mean of an override [%] over the time of each line, spans at 0 left out; 100 where unsaid."""
    begin, end, first = _line_spans(run, lines)
    mean = np.full(lines, np.nan)
    if not len(series.time):
        return np.full(lines, 100.0)
    edges = np.unique(np.concatenate([series.time, begin, end]))
    middle = (edges[:-1] + edges[1:]) / 2
    value = series.at(middle, before=100.0)
    weight = np.diff(edges) * (value > 0)
    total = np.concatenate([[0.0], np.cumsum(weight * value)])
    time = np.concatenate([[0.0], np.cumsum(weight)])
    a, b = np.searchsorted(edges, begin), np.searchsorted(edges, end)
    spent = time[b] - time[a]
    level = np.where(spent > 0, (total[b] - total[a]) / np.where(spent > 0, spent, 1), 100.0)
    for number, line in enumerate(first):
        until = first[number + 1] if number + 1 < len(first) else lines
        mean[line : max(until, line + 1)] = level[number]
    return _nearest(mean)


def _line_spans(run: Run, lines: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Begin and end of each line that was seen, and its number (rising lines only)."""
    number = run.line.value.astype(np.int64)
    keep = (number > 0) & (number < lines)
    time, number = run.line.time[keep], number[keep]
    return time, np.append(time[1:], run.end), number


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


def joined(spans: list[Span]) -> tuple[Span, ...]:
    """Spans without overlap, in order."""
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return tuple(found)


def stopped_within(stops: tuple[Span, ...], begin: Floats, end: Floats) -> Floats:
    """How long the machine was held between ``begin`` and ``end`` [s]."""
    if not stops:
        return np.zeros_like(begin)
    edges = np.array(stops)
    lengths = np.concatenate([[0.0], np.cumsum(edges[:, 1] - edges[:, 0])])

    def until(time: Floats) -> Floats:
        index = np.searchsorted(edges[:, 0], time, side="right") - 1
        inside = np.clip(time - edges[np.maximum(index, 0), 0], 0, None)
        span = edges[np.maximum(index, 0), 1] - edges[np.maximum(index, 0), 0]
        return np.where(index >= 0, lengths[np.maximum(index, 0)] + np.minimum(inside, span), 0.0)

    held: Floats = until(end) - until(begin)
    return held
