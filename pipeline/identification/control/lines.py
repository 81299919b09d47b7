"""What a run says line by line: when each was executed, and what was in force meanwhile."""

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.control.runs import Run, Series

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def line_spans(run: Run, lines: int) -> tuple[Floats, Floats, Ints]:
    """Begin and end of each line that was seen [s], and its number, from 1 to ``lines`` - 1."""
    number = run.line.value.astype(np.int64)
    keep = (number > 0) & (number < lines)
    time, number = run.line.time[keep], number[keep]
    return time, np.append(time[1:], run.end)[: len(time)], number


def override_of_lines(run: Run, series: Series, lines: int) -> Floats:
    """Mean of an override over the time of each line, spans at 0 left out [1]; 1 where unsaid.

    Parameters
    ----------
    run : Run
        Lines numbered as in the program.
    series : Series
        Of the override [%].
    lines : int
        Length of what is returned; index 0 is no line.
    """
    begin, end, number = line_spans(run, lines)
    if not len(series.time) or not len(number):
        return np.ones(lines)
    edges = np.unique(np.concatenate([series.time, begin, end]))
    value = series.at((edges[:-1] + edges[1:]) / 2, before=100.0)
    weight = np.diff(edges) * (value > 0)
    first, after = np.searchsorted(edges, begin), np.searchsorted(edges, end)

    def summed(over_edges: Floats) -> Floats:
        until = np.concatenate([[0.0], np.cumsum(over_edges)])
        found: Floats = until[after] - until[first]
        return found

    spent = summed(weight)
    level = np.divide(
        summed(weight * value), spent, out=np.full(len(spent), 100.0), where=spent > 0
    )
    mean = np.full(lines, np.nan)
    for line, until, percent in zip(number, np.append(number[1:], lines), level, strict=True):
        mean[line : max(until, line + 1)] = percent  # lines that no poll saw go with the one before
    return nearest(mean) / 100


def lines_since(run: Run, series: Series, lines: int) -> NDArray[np.bool_]:
    """Lines executed after a series began to say something."""
    known = np.zeros(lines, dtype=bool)
    if len(series.time):
        begin, _, number = line_spans(run, lines)
        later = number[begin >= series.time[0]]
        known[int(later[0]) if len(later) else lines :] = True
    return known


def nearest(values: Floats) -> Floats:
    """Each NaN replaced by the nearest value, the left one of two; ones where there are none.

    Examples
    --------
    >>> nearest(np.array([np.nan, 2.0, np.nan, 4.0, np.nan])).tolist()
    [2.0, 2.0, 2.0, 4.0, 4.0]
    """
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.ones_like(values)
    index = np.arange(len(values))
    right = np.clip(np.searchsorted(known, index), 0, len(known) - 1)
    left = np.clip(right - 1, 0, len(known) - 1)
    is_left = np.abs(known[left] - index) <= np.abs(known[right] - index)
    return values[known[np.where(is_left, left, right)]]
