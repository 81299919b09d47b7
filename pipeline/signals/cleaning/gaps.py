"""Stretches in which a machine, or one of its items, said nothing that can be known.

Four causes: the item was UNAVAILABLE; it was silent for longer than its habit; the agent began
anew (its instance changed); sequence numbers are missing.  A gap of the whole machine has no data
item.  An item that reports on change and does not change is no gap while the machine speaks.

After a gap, what was known before counts again only where nothing can have been lost: after a
silence that is too short for the machine to have been off and in which its agent announced no loss
(it would have said UNAVAILABLE), and after any silence over which the agent's numbers go on
without a hole.  Else an item is unknown until it speaks again.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.signals.cleaning.habits import Habit
from pipeline.signals.cleaning.series import Bools, Ints, Series
from pipeline.signals.cleaning.settings import NS, CleanSettings

CAUSES = ("unavailable", "silence", "instance", "sequence")

SUBSET_SHARE = 0.1
"""Above this share of missing numbers, a record is a choice from the agent's stream."""


@dataclass(frozen=True, kw_only=True, order=True)
class Gap:
    """One gap: from ``start`` until before ``end`` [ns]; ``data_item`` None: the whole machine.

    ``end`` is None while nothing has ended it.
    """

    start: int
    end: int | None
    data_item: str | None
    cause: str


@dataclass(frozen=True, kw_only=True)
class Lost:
    """Gaps of the machine as a whole.

    ``cuts`` [ns], shape (K,): from then on an item is unknown until it speaks; ``pauses`` [ns],
    shape (L, 2): unknown from the first until before the second time.
    """

    gaps: list[Gap]
    cuts: Ints
    pauses: Ints


def lost(gaps: list[Gap], torn: list[Gap]) -> Lost:
    """What gaps leave unknown; ``torn`` are those in which something can have been lost.

    What was said at the last moment before a gap was still known at that moment.
    """
    cuts = np.array(sorted({g.start + 1 for g in torn}), dtype=np.int64)
    pauses = sorted((g.start + 1, g.end) for g in gaps if g.end is not None and g not in torn)
    return Lost(gaps=gaps, cuts=cuts, pauses=np.array(pauses, dtype=np.int64).reshape(-1, 2))


NOTHING_LOST = lost([], [])


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


def silences(spoken: Ints, habit: Habit, settings: CleanSettings, item: str | None) -> list[Gap]:
    """Intervals between ascending times [ns] that are longer than the habit."""
    long = np.flatnonzero(np.diff(spoken) > habit.threshold_s(settings) * NS)
    return [
        Gap(start=int(spoken[i]), end=int(spoken[i + 1]), data_item=item, cause="silence")
        for i in long
    ]


def item_silences(
    item: str, series: Series, machine: list[Gap], habit: Habit, settings: CleanSettings
) -> list[Gap]:
    """Silences of an item that speaks all the time, while the machine as a whole does speak."""
    if not habit.steady:
        return []
    known = series.known
    found = []
    for gap in silences(series.time, habit, settings, item):
        i = int(np.searchsorted(series.time, gap.start, side="right")) - 1
        covered = any(g.start < (gap.end or 0) and gap.start < (g.end or 0) for g in machine)
        if known[i] and not covered:
            found.append(gap)
    return found


def instances(time: Ints, instance: np.ndarray, given: Bools) -> list[Gap]:
    """From the last record of one instance of the agent until the first of the next."""
    at = np.flatnonzero(given)
    change = np.flatnonzero(instance[at][1:] != instance[at][:-1])
    return [
        Gap(start=int(time[at[i]]), end=int(time[at[i + 1]]), data_item=None, cause="instance")
        for i in change
        if time[at[i + 1]] > time[at[i]]
    ]


def missing_sequences(
    time: Ints, sequence: np.ndarray, instance: np.ndarray, given: Bools
) -> list[Gap]:
    """Where sequence numbers of one instance of the agent are missing.

    A record that was made of some of the agent's items lacks numbers everywhere and tells nothing.
    """
    gaps: list[Gap] = []
    for one in np.unique(instance[given]):
        at = np.flatnonzero(given & (instance == one))
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


def continuous(
    gap: Gap, time: Ints, sequence: np.ndarray, instance: np.ndarray, given: Bools
) -> bool:
    """Whether the agent proves that nothing was lost in a silence: numbers go on without a hole."""
    before = np.flatnonzero(given & (time <= gap.start))
    after = np.flatnonzero(given & (time >= (gap.end or gap.start)))
    if not len(before) or not len(after):
        return False
    i = before[np.argmax(sequence[before])]
    j = after[np.argmin(sequence[after])]
    return bool(instance[i] == instance[j] and sequence[j] == sequence[i] + np.uint64(1))
