"""How often a data item speaks, learnt from its own intervals while the machine is on.

Intervals are counted in eight bins an octave, so that the counts of many files add up in any order
and a new day seldom moves a habit.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.signals.cleaning.series import Floats, Ints
from pipeline.signals.cleaning.settings import NS, CleanSettings

BINS_PER_OCTAVE = 8
_LOWEST = -10  # octave: about 1 ms
_HIGHEST = 20  # octave: about 12 days
N_BINS = (_HIGHEST - _LOWEST) * BINS_PER_OCTAVE

FAST_S = 10.0
"""Longest typical interval [s] of an item that speaks by the clock; slower ones follow the work."""

ENOUGH = 300
"""Intervals below which no habit is claimed."""

STEADY_SHARE = 0.01
"""An item is steady when long intervals take up less than this share of its time."""


@dataclass(frozen=True, kw_only=True)
class Habit:
    """An item's habit.

    Parameters
    ----------
    typical_s : float
        Median interval [s]; NaN when it is not known.
    long_s : float
        Interval that one in a thousand exceeds, up to the next power of two [s].
    steady : bool
        Whether the item speaks all the time, so that its silence means something: at least every
        few seconds (``FAST_S``), and almost never less often.
    """

    typical_s: float = float("nan")
    long_s: float = float("nan")
    steady: bool = False

    def threshold_s(self, settings: CleanSettings) -> float:
        """The longest interval that is still the habit [s]."""
        if math.isnan(self.long_s):
            return settings.off_after_s
        longest = max(settings.silence_min_s, settings.silence_factor * self.long_s)
        return float(min(longest, settings.off_after_s))

    def effect(self, settings: CleanSettings) -> list[float | bool | None]:
        """All that cleaning takes from the habit."""
        typical = None if math.isnan(self.typical_s) else self.typical_s
        return [typical, self.threshold_s(settings), self.steady]


def counted_intervals(time: Ints, longest_s: float) -> Ints:
    """How many of the intervals between ascending times [ns] fall in each bin, shape (N_BINS,).

    Intervals of zero are several values at one time; longer ones than ``longest_s`` are a machine
    that is off.
    """
    interval = np.diff(time) / NS
    interval = interval[(interval > 0) & (interval <= longest_s)]
    place = np.floor((np.log2(interval) - _LOWEST) * BINS_PER_OCTAVE).astype(int)
    return np.bincount(np.clip(place, 0, N_BINS - 1), minlength=N_BINS).astype(np.int64)


def habit(counts: Ints) -> Habit:
    """The habit behind counted intervals, shape (N_BINS,)."""
    n = int(counts.sum())
    if n == 0:
        return Habit()
    top: Floats = 2.0 ** (_LOWEST + (np.arange(N_BINS) + 1) / BINS_PER_OCTAVE)
    below = np.cumsum(counts)
    typical = float(top[np.searchsorted(below, 0.5 * n)])
    long = 2.0 ** math.ceil(math.log2(top[np.searchsorted(below, 0.999 * n)]))
    spent = counts * top
    late = float(spent[top > 5 * typical].sum() / spent.sum())
    steady = n >= ENOUGH and late <= STEADY_SHARE and typical <= FAST_S
    return Habit(typical_s=typical, long_s=long, steady=steady)
