"""Values on a regular grid: held or joined by a line, never across what is not known."""

import numpy as np

from pipeline.signals.cleaning.habits import Habit
from pipeline.signals.cleaning.series import Bools, Floats, Ints, Series, Values
from pipeline.signals.cleaning.settings import NS, CleanSettings

Span = tuple[int, int]
"""From, to [ns], both included."""


def on_spans(spoken: Ints, settings: CleanSettings) -> list[Span]:
    """Stretches in which the machine was on: it said something known every ``off_after_s``.

    Parameters
    ----------
    spoken : array of int64, shape (T,)
        Ascending times [ns] at which any item had a value.
    settings : CleanSettings
        ``off_after_s``.
    """
    if not len(spoken):
        return []
    cut = np.flatnonzero(np.diff(spoken) > settings.off_after_s * NS)
    first = np.r_[spoken[0], spoken[cut + 1]]
    last = np.r_[spoken[cut], spoken[-1]]
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True)]


def grid(spans: list[Span], start: int, end: int, period_s: float) -> Ints:
    """Times [ns], multiples of the period, inside the spans and in ``start <= t < end``."""
    step = round(period_s * NS)
    pieces = []
    for first, last in spans:
        low = -(-max(first, start) // step) * step
        high = min(last, end - 1)
        pieces.append(np.arange(low, high + 1, step, dtype=np.int64))
    if not pieces:
        return np.array([], dtype=np.int64)
    return np.concatenate(pieces)


def held(series: Series, at: Ints) -> Values:
    """The last value said at or before each time [ns]; NaN or None before the first, shape (T,)."""
    place = np.searchsorted(series.time, at, side="right") - 1
    if series.text:
        value = np.append(series.value, np.array([None], dtype=object))
    else:
        value = np.append(series.value.astype(float), np.nan)
    return np.asarray(value[place])  # -1, before the first, is the one that was appended


def linear(series: Series, at: Ints, longest_s: float) -> Floats:
    """Values on the lines between neighbours at most ``longest_s`` apart; held elsewhere.

    Times are subtracted as integers: nanoseconds since 1970 do not fit a float.
    """
    value = held(series, at).astype(float)
    if len(series.time) < 2:
        return value
    left = np.searchsorted(series.time, at, side="right") - 1
    inside = (left >= 0) & (left < len(series.time) - 1)
    i = np.clip(left, 0, len(series.time) - 2)
    width = (series.time[i + 1] - series.time[i]).astype(float)
    share = (at - series.time[i]) / np.maximum(width, 1.0)
    a, b = series.value[i].astype(float), series.value[i + 1].astype(float)
    join = inside & (width <= longest_s * NS) & ~np.isnan(a) & ~np.isnan(b)
    value[join] = (a + share * (b - a))[join]
    return value


def resampled(
    series: Series, between: str, at: Ints, habit: Habit, settings: CleanSettings
) -> Values:
    """A series on a grid.

    Parameters
    ----------
    series : Series
        With its "not known from here on" rows.
    between : {"hold", "linear"}
        How the value goes on.
    at : array of int64, shape (T,)
        Grid [ns].
    habit : Habit
        Of the item; a value that is reported on change stands still over long intervals.
    settings : CleanSettings
        ``linear_intervals``.
    """
    if series.text or between == "hold":
        return held(series, at)
    typical = habit.typical_s if np.isfinite(habit.typical_s) else settings.period_s
    return linear(series, at, settings.linear_intervals * max(typical, settings.period_s))


def removed_holes(series: Series, removed: Bools, bridge_s: float) -> Ints:
    """Times [ns] from which a value is not known because too many after it were removed.

    A stretch of removed values no longer than ``bridge_s`` up to the next good one is bridged; a
    longer one is a hole from its first removed value.
    """
    if not removed.any():
        return np.array([], dtype=np.int64)
    first = np.flatnonzero(removed & ~np.r_[False, removed[:-1]])
    good = np.flatnonzero(~removed)
    place = np.searchsorted(good, first)
    last = series.time[-1]
    until = np.where(
        place < len(good),
        series.time[good[np.minimum(place, len(good) - 1)]] if len(good) else last,
        np.iinfo(np.int64).max,
    )
    return np.asarray(series.time[first][until - series.time[first] > bridge_s * NS])
