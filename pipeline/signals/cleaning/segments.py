"""What the machine did: off, warm_up, idle, air or cut.

Told from the state table second by second: ``off`` between stretches of the record; ``warm_up``
a spindle that turns without load after a cold start, or a program named for it; ``cut`` while a
program moves with the load of a spindle above its no-load level; ``air`` executing without;
``idle`` the rest.  Seconds in which the execution is not known belong to no segment.
"""

import numpy as np
import pandas as pd

from pipeline.signals.cleaning.no_load import no_load
from pipeline.signals.cleaning.series import Bools, Floats, Ints
from pipeline.signals.cleaning.settings import NS, CleanSettings

KINDS = ("off", "warm_up", "idle", "air", "cut")
SPINDLES = ("", "second_")
FEEDS = ("path_feedrate", "x_feedrate", "y_feedrate", "z_feedrate",
         "a_angular_velocity", "b_angular_velocity", "c_angular_velocity")  # fmt: skip
USED = (
    "execution",
    "program",
    *(f"{s}spindle_{q}" for s in SPINDLES for q in ("speed", "load")),
    *FEEDS,
)
"""Columns of the state table that segments are told from, where the machine has them."""

_UNKNOWN = -1
_SETTLE_S = 2
"""A spindle's load counts from this long after its speed last changed [s]; it accelerated."""


def segments(
    state: pd.DataFrame, settings: CleanSettings, warm_up_programs: tuple[str, ...] = ()
) -> pd.DataFrame:
    """The segments of a state table.

    Parameters
    ----------
    state : DataFrame
        ``time`` and those of the columns ``USED`` that the machine has, ascending in time.
    settings : CleanSettings
        Margins and shortest durations.
    warm_up_programs : tuple of str
        Programs that only warm up.

    Returns
    -------
    DataFrame
        Columns start, end (UTC), kind.
    """
    if state.empty:
        return _table(np.array([], dtype=np.int64), np.array([], dtype=np.int64), [])
    time: Ints = np.array(state["time"].astype("datetime64[ns, UTC]").astype("int64"), np.int64)
    period = round(settings.period_s * NS)
    stretch = np.cumsum(np.r_[0, np.diff(time) > settings.off_after_s * NS])
    turning, loaded = _spindles(state, settings)
    kind = _kinds(state, turning, loaded, warm_up_programs)
    _warm_up(kind, time, stretch, turning, settings)
    _absorb_short(kind, stretch, settings)
    return _runs(kind, time, stretch, period)


def _column(state: pd.DataFrame, name: str) -> Floats:
    if name not in state:
        return np.full(len(state), np.nan)
    return np.array(state[name], dtype=float)


def _spindles(state: pd.DataFrame, settings: CleanSettings) -> tuple[Bools, Bools]:
    """Whether a spindle turns, and whether its load is above no-load, shape (T,)."""
    turning, loaded = np.zeros(len(state), dtype=bool), np.zeros(len(state), dtype=bool)
    for prefix in SPINDLES:
        speed = _column(state, f"{prefix}spindle_speed")
        load = _column(state, f"{prefix}spindle_load")
        turns = np.abs(speed) > settings.turning_rpm
        steady = turns & ~_changing(speed, settings)
        limits = no_load(np.where(steady, speed, np.nan), load, settings)
        turning |= turns
        loaded |= steady & limits.cutting(speed, np.abs(load))
    return turning, loaded


def _changing(speed: Floats, settings: CleanSettings) -> Bools:
    """Whether the speed changed by a twentieth within the last seconds, shape (T,)."""
    before = np.r_[np.nan, speed[:-1]]
    jump = ~(np.abs(speed - before) <= 0.05 * np.maximum(np.abs(speed), settings.turning_rpm))
    wait = max(1, round(_SETTLE_S / settings.period_s))
    return np.convolve(jump, np.ones(wait + 1), mode="full")[: len(jump)] > 0


def _kinds(state: pd.DataFrame, turning: Bools, loaded: Bools, warm: tuple[str, ...]) -> Ints:
    """Kind of each row before warm-up after a cold start is looked at, shape (T,)."""
    execution = _words(state, "execution")
    kind = np.full(len(state), KINDS.index("idle"))
    known = [name for name in FEEDS if name in state]
    moving = np.zeros(len(state), dtype=bool)
    for name in known:
        moving |= np.abs(_column(state, name)) > 0
    active = execution == "ACTIVE" if "execution" in state else turning | moving
    cut = active & loaded & (moving if known else True)
    kind[active & (turning | moving)] = KINDS.index("air")
    kind[cut] = KINDS.index("cut")
    if warm:
        kind[active & np.isin(_words(state, "program"), list(warm))] = KINDS.index("warm_up")
    if "execution" in state:
        kind[execution == ""] = _UNKNOWN
    return kind


def _words(state: pd.DataFrame, name: str) -> np.ndarray:
    if name not in state:
        return np.full(len(state), "", dtype=object)
    return np.array(state[name].astype(object).where(state[name].notna(), ""), dtype=object)


def _warm_up(
    kind: Ints, time: Ints, stretch: Ints, turning: Bools, settings: CleanSettings
) -> None:
    """Mark turning without load, from a cold start to the first cut, as warm_up; in place."""
    cut, known_off = KINDS.index("cut"), settings.cold_after_s * NS
    starts = np.flatnonzero(np.r_[True, np.diff(stretch) > 0])
    for n, first in enumerate(starts):
        if n > 0 and time[first] - time[first - 1] < known_off:
            continue
        last = starts[n + 1] if n + 1 < len(starts) else len(kind)
        cuts = np.flatnonzero(kind[first:last] == cut)
        until = first + cuts[0] if len(cuts) else last
        for a, b in _runs_of(turning[first:until]):
            if (b - a) * settings.period_s >= settings.warm_up_min_s:
                part = kind[first + a : first + b]
                part[part != _UNKNOWN] = KINDS.index("warm_up")


def _runs_of(mask: Bools) -> list[tuple[int, int]]:
    edge = np.diff(np.r_[0, mask.astype(int), 0])
    return list(zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True))


def _absorb_short(kind: Ints, stretch: Ints, settings: CleanSettings) -> None:
    """Let segments shorter than the shortest join the one before them in the stretch; in place."""
    change = (kind[1:] != kind[:-1]) | (stretch[1:] != stretch[:-1])
    start = np.flatnonzero(np.r_[True, change])
    stop = np.r_[start[1:], len(kind)]
    for a, b in zip(start, stop, strict=True):
        short = (b - a) * settings.period_s < settings.segment_min_s
        if short and a > 0 and stretch[a] == stretch[a - 1] and _UNKNOWN not in kind[[a - 1, a]]:
            kind[a:b] = kind[a - 1]


def _runs(kind: Ints, time: Ints, stretch: Ints, period: int) -> pd.DataFrame:
    """Rows of one kind as segments, with ``off`` between the stretches."""
    change = (kind[1:] != kind[:-1]) | (stretch[1:] != stretch[:-1])
    start = np.flatnonzero(np.r_[True, change])
    stop = np.r_[start[1:], len(kind)] - 1
    known = kind[start] != _UNKNOWN
    begin, end = time[start], time[stop] + period
    off = np.flatnonzero(stretch[1:] != stretch[:-1])
    words = [KINDS[k] for k in kind[start][known]] + ["off"] * len(off)
    return _table(np.r_[begin[known], time[off] + period], np.r_[end[known], time[off + 1]], words)


def _table(start: Ints, end: Ints, kind: list[str]) -> pd.DataFrame:
    table = pd.DataFrame(
        {
            "start": pd.to_datetime(start, unit="ns", utc=True).astype("datetime64[ns, UTC]"),
            "end": pd.to_datetime(end, unit="ns", utc=True).astype("datetime64[ns, UTC]"),
            "kind": pd.Series(kind, dtype=object),
        }
    )
    return table.sort_values("start", ignore_index=True)
