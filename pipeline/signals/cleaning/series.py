"""Time series of one data item, and its values on a regular grid, held or joined by a line."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.settings import CleanSettings

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
