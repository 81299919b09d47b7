"""Gaps of a record: times in which a machine, or one of its items, reported nothing.

Four causes: the item was UNAVAILABLE; it was silent for longer than its reporting interval allows;
the agent began anew (its instance changed); sequence numbers are missing.  An item that reports on
change and does not change is no gap while the machine reports.

After a gap an earlier value counts again only where nothing can have been lost: after a silence too
short for the machine to have been off, without a loss announced by its agent (UNAVAILABLE), and
after any silence over which the agent's numbers go on without a hole.  Reporting intervals are
estimated from an item's own reports in eight bins an octave.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.series import Series
from pipeline.signals.cleaning.settings import CleanSettings

BINS_PER_OCTAVE = 8
_LOWEST = -10  # octave: about 1 ms
_HIGHEST = 20  # octave: about 12 days
N_BINS = (_HIGHEST - _LOWEST) * BINS_PER_OCTAVE

FAST_S = 10.0
"""Longest typical interval [s] of an item that reports by the clock; others follow the work."""

ENOUGH = 300
"""Smallest number of intervals [1] from which a reporting interval is estimated."""

STEADY_SHARE = 0.01
"""Share of its time [1] that long intervals take up at most of an item that reports steadily."""


@dataclass(frozen=True, kw_only=True)
class ReportingInterval:
    """Reporting interval of an item."""

    typical_s: float = float("nan")
    """Median interval [s]; NaN when it is not known."""
    long_s: float = float("nan")
    """Interval that one in a thousand exceeds, up to the next power of two [s]."""
    steady: bool = False
    """Whether the item reports all the time, so that its silence means something: at least every
    few seconds (``FAST_S``), and almost never less often."""

    def threshold_s(self, settings: CleanSettings) -> float:
        """The longest interval that is no silence [s]."""
        if math.isnan(self.long_s):
            return settings.off_after_s
        longest = max(settings.silence_min_s, settings.silence_factor * self.long_s)
        return float(min(longest, settings.off_after_s))

    def effect(self, settings: CleanSettings) -> list[float | bool | None]:
        """All that cleaning takes from it."""
        typical = None if math.isnan(self.typical_s) else self.typical_s
        return [typical, self.threshold_s(settings), self.steady]


def counted_intervals(time: Ints, longest_s: float) -> Ints:
    """Counts (N_BINS,) of intervals between ascending times [ns] up to ``longest_s``.

    Intervals of zero are several values at one time; longer ones are a machine that is off.
    """
    interval = np.diff(time) / NS
    interval = interval[(interval > 0) & (interval <= longest_s)]
    place = np.floor((np.log2(interval) - _LOWEST) * BINS_PER_OCTAVE).astype(int)
    return np.bincount(np.clip(place, 0, N_BINS - 1), minlength=N_BINS).astype(np.int64)


def reporting_interval(counts: Ints) -> ReportingInterval:
    """Reporting interval from counted intervals, shape (N_BINS,)."""
    n = int(counts.sum())
    if n == 0:
        return ReportingInterval()
    top: Floats = 2.0 ** (_LOWEST + (np.arange(N_BINS) + 1) / BINS_PER_OCTAVE)
    below = np.cumsum(counts)
    typical = float(top[np.searchsorted(below, 0.5 * n)])
    long = 2.0 ** math.ceil(math.log2(top[np.searchsorted(below, 0.999 * n)]))
    spent = counts * top
    late = float(spent[top > 5 * typical].sum() / spent.sum())
    steady = n >= ENOUGH and late <= STEADY_SHARE and typical <= FAST_S
    return ReportingInterval(typical_s=typical, long_s=long, steady=steady)


SUBSET_SHARE = 0.1
"""Above this share of missing numbers, a record is a choice from the agent's stream."""


@dataclass(frozen=True, kw_only=True, order=True)
class Gap:
    """Gap from ``start`` to before ``end`` [ns] (None: open), of an item or (None) the machine."""

    start: int
    end: int | None
    data_item: str | None
    cause: str


@dataclass(frozen=True, kw_only=True)
class MachineGaps:
    """Gaps of the machine: ``cuts`` (K,) and ``pauses`` (L, 2) [ns] in which items are unknown."""

    gaps: list[Gap]
    cuts: Ints
    pauses: Ints


def machine_gaps(gaps: list[Gap], torn: list[Gap]) -> MachineGaps:
    """Unknown times by gaps; ``torn`` are those in which something can have been lost."""
    cuts = np.array(sorted({g.start + 1 for g in torn}), dtype=np.int64)
    pauses = sorted((g.start + 1, g.end) for g in gaps if g.end is not None and g not in torn)
    return MachineGaps(gaps=gaps, cuts=cuts, pauses=np.array(pauses, dtype=np.int64).reshape(-1, 2))


NO_MACHINE_GAPS = machine_gaps([], [])


def unavailable(item: str, series: Series) -> list[Gap]:
    """From each "not known" of an item until its next value."""
    lost = ~series.known
    if not lost.any():
        return []
    first = np.flatnonzero(lost & ~np.r_[False, lost[:-1]])
    back = np.flatnonzero(~lost & np.r_[False, lost[:-1]])
    gaps = []
    for k, i in enumerate(first):
        end = int(series.time[back[k]]) if k < len(back) else None
        start = int(series.time[i])
        if end is None or end > start:
            gaps.append(Gap(start=start, end=end, data_item=item, cause="unavailable"))
    return gaps


def silences(
    spoken: Ints, interval: ReportingInterval, settings: CleanSettings, item: str | None
) -> list[Gap]:
    """Intervals between ascending times [ns] that are longer than the reporting interval allows."""
    long = np.flatnonzero(np.diff(spoken) > interval.threshold_s(settings) * NS)
    return [
        Gap(start=int(spoken[i]), end=int(spoken[i + 1]), data_item=item, cause="silence")
        for i in long
    ]


def item_silences(
    item: str,
    series: Series,
    machine: list[Gap],
    interval: ReportingInterval,
    settings: CleanSettings,
) -> list[Gap]:
    """Silences of an item that reports steadily, while the machine as a whole does report."""
    if not interval.steady:
        return []
    known = series.known
    found = []
    for gap in silences(series.time, interval, settings, item):
        i = int(np.searchsorted(series.time, gap.start, side="right")) - 1
        covered = any(g.start < (gap.end or 0) and gap.start < (g.end or 0) for g in machine)
        if known[i] and not covered:
            found.append(gap)
    return found


def instances(time: Ints, instance: np.ndarray) -> list[Gap]:
    """From the last record of one instance of the agent until the first of the next."""
    return [
        Gap(start=int(time[i]), end=int(time[i + 1]), data_item=None, cause="instance")
        for i in np.flatnonzero(instance[1:] != instance[:-1])
        if time[i + 1] > time[i]
    ]


def missing_sequences(time: Ints, sequence: np.ndarray, instance: np.ndarray) -> list[Gap]:
    """Gaps in the sequence numbers of one instance of the agent; none for partial records."""
    gaps: list[Gap] = []
    for one in np.unique(instance):
        at = np.flatnonzero(instance == one)
        at = at[np.argsort(sequence[at], kind="stable")]
        number = sequence[at]
        missing = np.flatnonzero(number[1:] - number[:-1] > 1)  # unsigned, ascending
        if len(missing) > SUBSET_SHARE * max(len(at) - 1, 1):
            continue
        for i in missing:
            start, end = int(time[at[i]]), int(time[at[i + 1]])
            if end > start:
                gaps.append(Gap(start=start, end=end, data_item=None, cause="sequence"))
    return sorted(gaps)


def continuous(gap: Gap, time: Ints, sequence: np.ndarray, instance: np.ndarray) -> bool:
    """Whether the agent proves that nothing was lost in a silence: numbers go on without a hole."""
    before = np.flatnonzero(time <= gap.start)
    after = np.flatnonzero(time >= (gap.end or gap.start))
    if not len(before) or not len(after):
        return False
    i = before[np.argmax(sequence[before])]
    j = after[np.argmin(sequence[after])]
    return bool(instance[i] == instance[j] and sequence[j] == sequence[i] + np.uint64(1))
