"""Glitches: values out of range, impossible jumps, zeros that stand for nothing.

A value is removed, never replaced.  A series is cut where it jumps further than physics allows
(a *break*); the pieces between breaks agree with themselves.  A piece that agrees with the last
good value, or that lasts, is kept; the rest are glitches.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.series import Series
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import Column

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
