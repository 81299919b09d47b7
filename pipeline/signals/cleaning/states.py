"""Intervals in which the controller's states stay as they are."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.signals.cleaning.resample import held
from pipeline.signals.cleaning.series import Ints, Series
from pipeline.signals.cleaning.settings import NS

CONTROLLER = ("execution", "controller_mode", "emergency_stop", "program", "tool_number",
              "part_count")  # fmt: skip
"""Signals that cycles are made of."""


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """Stretches ``start`` to ``end`` [ns], shape (N,), and each signal's state; None: unknown."""

    start: Ints
    end: Ints
    state: Mapping[str, np.ndarray]


def intervals(series: Mapping[str, Series], end: int) -> Intervals:
    """The stretches between any two changes, up to ``end`` [ns].

    Parameters
    ----------
    series : mapping of str to Series
        Canonical signal -> words, with its "not known" rows.
    end : int
        Where the last stretch ends.
    """
    used = {name: s.before(end) for name, s in series.items() if name in CONTROLLER}
    cuts = [np.asarray(s.time) for s in used.values()]
    time = np.unique(np.concatenate(cuts)) if cuts else np.array([], dtype=np.int64)
    state = {name: held(s, time) for name, s in used.items()}
    return Intervals(start=time, end=np.r_[time[1:], end][: len(time)], state=state)


def seconds_in_states(found: Intervals, signal: str = "execution") -> dict[str, float]:
    """Seconds in each state of a signal; what is not known counts as ``unknown`` [s]."""
    if signal not in found.state:
        return {}
    word = [w if w is not None else "unknown" for w in found.state[signal]]
    spent = pd.Series((found.end - found.start) / NS).groupby(np.array(word, dtype=object)).sum()
    return {str(k): round(float(v), 3) for k, v in spent.items()}
