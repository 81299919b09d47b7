"""Time series of one data item: its values on a regular grid, and its glitches.

Glitches are values out of range, impossible jumps, zeros that stand for nothing; they are removed,
never replaced.  A series is cut where it jumps further than physics allows (a *break*); the pieces
between breaks agree with themselves.  A piece that agrees with the last good value, or that lasts,
is kept; the rest are glitches.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import Column

Values = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class Series:
    """Reports of one data item."""

    time: Ints
    """When [ns since 1970, UTC], ascending; shape (T,)."""
    value: Values
    """NaN, or None for words: not known from here on; shape (T,)."""
    fresh: Bools
    """Whether the value was reported at that time; False for what was carried over from before;
    shape (T,)."""

    @property
    def text(self) -> bool:
        """Whether the values are words."""
        return self.value.dtype == object

    @property
    def known(self) -> Bools:
        """Whether there is a value, shape (T,)."""
        if self.text:
            return np.array([v is not None for v in self.value], dtype=bool)
        return np.asarray(~np.isnan(self.value.astype(float)))

    def keep(self, mask: Bools) -> "Series":
        """Rows where ``mask`` holds."""
        return Series(time=self.time[mask], value=self.value[mask], fresh=self.fresh[mask])

    def unknown_at(self, times: Ints) -> "Series":
        """The same with "not known from here on" put in at ``times`` [ns], after equal times."""
        at = np.searchsorted(self.time, times, side="right")
        hole: Any = None if self.text else np.nan
        return Series(
            time=np.insert(self.time, at, times),
            value=np.insert(self.value, at, hole),
            fresh=np.insert(self.fresh, at, False),
        )

    def before(self, end: int) -> "Series":
        """Rows before ``end`` [ns]."""
        return self.keep(self.time < end)


def empty(*, text: bool) -> Series:
    """A series without rows."""
    value = np.array([], dtype=object if text else float)
    return Series(time=np.array([], dtype=np.int64), value=value, fresh=np.array([], dtype=bool))


def joined(first: Series, second: Series) -> Series:
    """Two series in the order of time; of equal times the first comes first."""
    time = np.concatenate([first.time, second.time])
    order = np.argsort(time, kind="stable")
    value = np.concatenate([first.value, second.value])
    fresh = np.concatenate([first.fresh, second.fresh])
    return replace(first, time=time[order], value=value[order], fresh=fresh[order])


Span = tuple[int, int]
"""Start and end [ns], both included."""


def on_spans(spoken: Ints, settings: CleanSettings) -> list[Span]:
    """Times in operation: something was reported at least every ``off_after_s``.

    ``spoken`` are the ascending times [ns] at which any item had a value, shape (T,).
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
    """Last value reported at or before each time [ns]; NaN or None before the first, shape (T,)."""
    place = np.searchsorted(series.time, at, side="right") - 1
    if series.text:
        value = np.append(series.value, np.array([None], dtype=object))
    else:
        value = np.append(series.value.astype(float), np.nan)
    return np.asarray(value[place])  # -1, before the first, is the one that was appended


def linear(series: Series, at: Ints, longest_s: float) -> Floats:
    """Values on the lines between neighbours at most ``longest_s`` apart; held elsewhere."""
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
    series: Series, between: str, at: Ints, *, typical_s: float, settings: CleanSettings
) -> Values:
    """Series with its "not known" rows on a grid [ns], shape (T,), ``"hold"`` or ``"linear"``.

    ``typical_s``: median interval between reports of the item [s], NaN where it is not known.
    """
    if series.text or between == "hold":
        return held(series, at)
    typical = typical_s if np.isfinite(typical_s) else settings.period_s
    return linear(series, at, settings.linear_intervals * max(typical, settings.period_s))


def removed_holes(series: Series, removed: Bools, bridge_s: float) -> Ints:
    """Times [ns] from which a value is not known because too many after it were removed.

    A run of removed values no longer than ``bridge_s`` up to the next good one is bridged; a
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


COUNTERS_OF_TIME = ("total_time", "auto_time", "cut_time")

Possible = Callable[[Floats, Floats, Bools], Bools]
"""(change, elapsed [s], whether data was lost between) -> whether the quantity can do that."""

NO_CUTS = np.array([], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Audit:
    """One change that cleaning made; ``after`` is null: removed."""

    time: int
    data_item: str
    before: str
    rule: str


@dataclass(frozen=True, kw_only=True)
class Cleaned:
    """Series without its glitches; ``removed`` rows by ``rule``, shape (T,) each."""

    series: Series
    removed: Bools
    rule: np.ndarray


def possible_change(signal: Column, settings: CleanSettings) -> Possible | None:
    """Physically possible change of a signal; None when it allows any.

    Temperatures have a largest step and slew; counters of seconds cannot run faster than the clock
    and do not run back.
    """
    if signal.unit == "CELSIUS":
        reach, step = settings.temperature_reach_s, settings.temperature_step_K
        slew = settings.temperature_slew_K_per_s

        def temperature(change: Floats, elapsed: Floats, lost: Bools) -> Bools:
            unseen = np.where(lost, elapsed, np.minimum(elapsed, reach))
            return np.asarray(np.abs(change) <= step + slew * unseen)

        return temperature
    if signal.name in COUNTERS_OF_TIME:
        slack = settings.counter_slack_s

        def counter(change: Floats, elapsed: Floats, lost: Bools) -> Bools:
            return (change >= 0) & (change <= elapsed + slack)

        return counter
    return None


def without_glitches(
    series: Series, signal: Column, settings: CleanSettings, cuts: Ints = NO_CUTS
) -> Cleaned:
    """Remove the glitches of a series, idempotently; ``cuts`` (K,): losses of the machine [ns]."""
    n = len(series.time)
    removed, rule = np.zeros(n, dtype=bool), np.full(n, "", dtype=object)
    if series.text or n == 0:
        return Cleaned(series=series, removed=removed, rule=rule)
    value = series.value.astype(float)
    known = ~np.isnan(value)
    wild = known & ((value < signal.low) | (value > signal.high))
    removed |= wild
    rule[wild] = "out_of_range"
    possible = possible_change(signal, settings)
    if possible is not None:
        at = np.flatnonzero(known & ~wild)
        epoch = (np.cumsum(~known) + np.searchsorted(cuts, series.time, side="left"))[at]
        points = _Points(
            time=series.time[at], value=value[at], fresh=series.fresh[at], epoch=epoch,
            suspect=(value[at] == 0) & (signal.unit == "CELSIUS"),
        )  # fmt: skip
        bad = _impossible(points, possible, settings)
        removed[at[bad]] = True
        word = "counter" if signal.name in COUNTERS_OF_TIME else "jump"
        rule[at[bad]] = np.where(points.suspect[bad], "zero", word)
    return Cleaned(series=series.keep(~removed), removed=removed, rule=rule)


@dataclass(frozen=True, kw_only=True)
class _Points:
    """The known values of a series, shape (T,): ``epoch`` counts losses of data before each."""

    time: Ints
    value: Floats
    fresh: Bools
    epoch: Ints
    suspect: Bools

    def change(self, i: Ints, j: Ints) -> tuple[Floats, Floats, Bools]:
        """Change and time [s] from rows i to rows j, and whether data was lost between."""
        elapsed = (self.time[j] - self.time[i]) / NS
        return self.value[j] - self.value[i], elapsed, self.epoch[j] != self.epoch[i]


def _impossible(points: _Points, possible: Possible, settings: CleanSettings) -> Bools:
    """Glitches among the points, shape (T,)."""
    n = len(points.time)
    if n < 2:
        return np.zeros(n, dtype=bool)
    rows = np.arange(n)
    fine = possible(*points.change(rows[:-1], rows[1:]))
    breaks = np.flatnonzero(~fine | (np.diff(points.epoch) != 0)) + 1
    if fine.all():
        return np.zeros(n, dtype=bool)
    start, stop = np.r_[0, breaks], np.r_[breaks, n]
    alone = ~np.r_[True, fine[breaks - 1]] | ~np.r_[fine[breaks - 1], True]
    zero = np.logical_and.reduceat(points.suspect, start) & alone
    long = points.time[stop - 1] - points.time[start] >= settings.settle_s * NS
    lasts = long & (stop - start > 1) & ~zero
    keep = np.zeros(len(start), dtype=bool)
    base = _base(start, stop, lasts, zero, points.fresh)
    keep[base] = True
    for direction in (range(base + 1, len(start)), range(base - 1, -1, -1)):
        last = base
        for k in direction:
            if zero[k]:
                continue
            a, b = (last, k) if k > last else (k, last)
            if lasts[k] or possible(*points.change(stop[a : a + 1] - 1, start[b : b + 1]))[0]:
                keep[k], last = True, k
    return np.repeat(~keep, stop - start)


def _base(start: Ints, stop: Ints, lasts: Bools, zero: Bools, fresh: Bools) -> int:
    """The piece to trust: the one brought over, else the first that lasts, else the longest."""
    if not fresh[0] and not zero[0]:
        return 0
    if lasts.any():
        return int(np.argmax(lasts))
    return int(np.argmax(np.where(zero, 0, stop - start)))
