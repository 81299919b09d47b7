"""Activity of a machine: cycles of programs, and segments off, warm_up, idle, air or cut.

A cycle is one run of a program, from ACTIVE in AUTOMATIC to READY or STOPPED, feed hold and
interruption included.  A short loss of data inside is bridged when the same program goes on; its
seconds are in none of the cycle's times.

Segments: ``off`` between the machine's times in operation; ``warm_up`` a spindle that turns without
load after a cold start, up to the first cut or another program, or a program named for it; ``cut``
while a program moves with the load of a spindle above its no-load level; ``air`` executing without;
``idle`` the rest.  Seconds of unknown execution belong to no segment.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.series import Series, held
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import SEGMENT_KINDS

CONTROLLER = ("execution", "controller_mode", "emergency_stop", "program", "tool_number",
              "part_count")  # fmt: skip
"""Signals that cycles are made of."""


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """Intervals ``start`` to ``end`` [ns], shape (N,), and each signal's state; None: unknown."""

    start: Ints
    end: Ints
    state: Mapping[str, np.ndarray]


def intervals(series: Mapping[str, Series], end: int) -> Intervals:
    """Intervals between any two changes of the controller's words, up to ``end`` [ns]."""
    used = {name: s.before(end) for name, s in series.items() if name in CONTROLLER}
    cuts = [np.asarray(s.time) for s in used.values()]
    time = np.unique(np.concatenate(cuts)) if cuts else np.array([], dtype=np.int64)
    state = {name: held(s, time) for name, s in used.items()}
    return Intervals(start=time, end=np.r_[time[1:], end][: len(time)], state=state)


def seconds_in_states(spans: Intervals, signal: str = "execution") -> dict[str, float]:
    """Seconds in each state of a signal; what is not known counts as ``unknown`` [s]."""
    if signal not in spans.state:
        return {}
    word = [w if w is not None else "unknown" for w in spans.state[signal]]
    spent = pd.Series((spans.end - spans.start) / NS).groupby(np.array(word, dtype=object)).sum()
    return {str(k): round(float(v), 3) for k, v in spent.items()}


ENDS = ("READY", "STOPPED", "PROGRAM_COMPLETED")
COMPLETED = ("READY", "PROGRAM_COMPLETED")
SHORTEST = 1_000_000
"""A last word before a silence is no run of a program [ns]."""
TIMES = {"ACTIVE": "active_s", "FEED_HOLD": "feed_hold_s", "INTERRUPTED": "interrupted_s"}
COLUMNS = ("cycle", "program", "part", "start", "end", "active_s", "feed_hold_s", "interrupted_s",
           "idle_s", "tool_changes", "complete")  # fmt: skip

State = Mapping[str, str | None]


@dataclass
class _OpenCycle:
    """A cycle that has not ended yet; times in ns."""

    program: str | None
    part: str | None
    start: int
    end: int
    last: str = ""
    tool: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    tool_changes: int = 0

    def spend(self, start: int, end: int, word: str, tool: str | None) -> None:
        column = TIMES.get(word, "idle_s")
        self.seconds[column] = self.seconds.get(column, 0.0) + (end - start) / NS
        self.end, self.last = end, word
        if tool is not None:
            self.tool_changes += self.tool is not None and tool != self.tool
            self.tool = tool

    def row(self, complete: bool) -> dict[str, object]:
        times = {c: round(self.seconds.get(c, 0.0), 3) for c in (*TIMES.values(), "idle_s")}
        return {
            "program": self.program, "part": self.part, "start": self.start, "end": self.end,
            **times, "tool_changes": self.tool_changes, "complete": complete,
        }  # fmt: skip


def cycles(spans: Intervals, settings: CleanSettings) -> pd.DataFrame:
    """Cycles in a machine's intervals, with columns ``COLUMNS`` and times in UTC.

    Losses of data longer than ``off_after_s`` end a cycle.  ``complete``: ended by READY in
    AUTOMATIC.
    """
    run = _CycleBuilder(longest_loss=round(settings.off_after_s * NS))
    names = list(spans.state)
    for i in range(len(spans.start)):
        state = {n: spans.state[n][i] for n in names}
        run.step(int(spans.start[i]), int(spans.end[i]), state)
    run.close(complete=False)
    return _cycle_table(run.rows)


@dataclass
class _CycleBuilder:
    """Goes through the intervals; ``longest_loss`` [ns] of data is bridged inside a cycle."""

    longest_loss: int
    rows: list[dict[str, object]] = field(default_factory=list)
    now: _OpenCycle | None = None

    def step(self, start: int, end: int, state: State) -> None:
        """Take one interval [ns] and the states in it."""
        word = state.get("execution")
        if word is None:  # whether a cycle goes on is reported by what comes after the loss
            return
        if self.now is not None and start > self.now.end and self._broken(start, state):
            self.close(complete=False)
        taken_over = _taken_over(state)
        if self.now is not None and (word in ENDS or taken_over):
            self.now.end = start
            self.close(complete=word in COMPLETED and not taken_over and self.now.last == "ACTIVE")
        elif self.now is None and word == "ACTIVE" and not taken_over:
            self.now = _OpenCycle(
                program=state.get("program"), part=state.get("part_count"), start=start, end=start
            )
        if self.now is not None:
            self.now.spend(start, end, word, state.get("tool_number"))

    def _broken(self, start: int, state: State) -> bool:
        """Whether what comes after a loss of data is not the same program going on."""
        now = self.now
        if now is None:
            return False
        other = state.get("program") not in (None, now.program)
        return other or state["execution"] in ENDS or start - now.end > self.longest_loss

    def close(self, *, complete: bool) -> None:
        if self.now is not None and self.now.end - self.now.start >= SHORTEST:
            self.rows.append(self.now.row(complete))
        self.now = None


def _taken_over(state: State) -> bool:
    """Whether a hand or an emergency stop has taken the program's place."""
    mode, stop = state.get("controller_mode"), state.get("emergency_stop")
    return mode not in (None, "AUTOMATIC") or stop == "TRIGGERED"


def _cycle_table(rows: list[dict[str, object]]) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=list(COLUMNS[1:]))
    table.insert(0, "cycle", range(1, len(table) + 1))
    for name in ("start", "end"):
        at = pd.to_datetime(table[name].astype("int64"), unit="ns", utc=True)
        table[name] = at.astype("datetime64[ns, UTC]")
    kinds: dict[Hashable, Any] = {
        "cycle": "int64", "tool_changes": "int64", "complete": bool,
        **dict.fromkeys(("program", "part"), object),
        **dict.fromkeys((*TIMES.values(), "idle_s"), float),
    }  # fmt: skip
    return table.astype(kinds)


LEVEL = 0.2
"""Quantile of the load at one speed that stands for no load."""

SPEEDS_PER_OCTAVE = 4
ENOUGH_S = 30
"""Seconds at a speed below which its no-load level is taken from all speeds together."""


@dataclass(frozen=True, kw_only=True)
class NoLoadLevel:
    """No-load level and ``limit`` [PERCENT] by class of speed, shape (K,), and for rare speeds."""

    limit: Floats
    elsewhere: float

    def cutting(self, speed: Floats, load: Floats) -> Bools:
        """Whether the load [PERCENT] is above no-load at the speed [rev/min], shape (T,)."""
        place = np.clip(_speed_class(speed), 0, len(self.limit) - 1)
        limit = np.where(np.isnan(self.limit[place]), self.elsewhere, self.limit[place])
        return np.asarray(load > limit)


def _speed_class(speed: Floats) -> np.ndarray:
    rounded = np.round(np.log2(np.maximum(np.abs(np.nan_to_num(speed)), 1.0)) * SPEEDS_PER_OCTAVE)
    return np.asarray(rounded.astype(int))


def no_load(speed: Floats, load: Floats, settings: CleanSettings) -> NoLoadLevel:
    """No-load limit of a spindle from its own records: lower fifth of the loads at a speed.

    The scatter below that level is its noise.  ``speed`` [REVOLUTION/MINUTE] of steady seconds and
    ``load`` [PERCENT] have shape (T,); rows with NaN are left out.
    """
    good = (np.abs(speed) > settings.turning_rpm) & ~np.isnan(load)
    classes, loads = _speed_class(speed[good]), np.abs(load[good])
    limit = np.full(int(classes.max(initial=0)) + 1, np.nan)
    for k in np.unique(classes):
        chosen = loads[classes == k]
        if len(chosen) >= ENOUGH_S:
            limit[k] = _limit(chosen, settings)
    return NoLoadLevel(limit=limit, elsewhere=_limit(loads, settings) if len(loads) else np.inf)


def _limit(load: Floats, settings: CleanSettings) -> float:
    level = float(np.quantile(load, LEVEL))
    below = level - load[load <= level]
    spread = 1.4826 * float(np.median(below))  # the normal law's sigma from half its scatter
    return level + max(settings.load_margin, settings.load_spreads * spread)


SPINDLES = ("", "second_")
FEEDS = ("path_feedrate", "x_feedrate", "y_feedrate", "z_feedrate",
         "a_angular_velocity", "b_angular_velocity", "c_angular_velocity")  # fmt: skip
USED = (
    "execution",
    "program",
    *(f"{s}spindle_{q}" for s in SPINDLES for q in ("speed", "load")),
    *FEEDS,
)
"""Columns of the state table that segments are derived from, where the machine has them."""

_UNKNOWN = -1
_OFF, _WARM_UP, _IDLE, _AIR, _CUT = range(len(SEGMENT_KINDS))
_SETTLE_S = 2
"""A spindle's load counts from this long after its speed last changed [s]; it accelerated."""


def segments(
    state: pd.DataFrame, settings: CleanSettings, warm_up_programs: tuple[str, ...] = ()
) -> pd.DataFrame:
    """Start, end (UTC) and kind of the segments of a state table, ascending in time."""
    if state.empty:
        return _segment_table(np.array([], dtype=np.int64), np.array([], dtype=np.int64), [])
    time: Ints = np.array(state["time"].astype("datetime64[ns, UTC]").astype("int64"), np.int64)
    period = round(settings.period_s * NS)
    operation = np.cumsum(np.r_[0, np.diff(time) > settings.off_after_s * NS])
    turning, loaded = _spindles(state, settings)
    kind = _kinds(state, turning, loaded, warm_up_programs)
    _warm_up(kind, time, operation, turning, _words(state, "program"), settings)
    _absorb_short(kind, operation, settings)
    return _runs(kind, time, operation, period)


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
    kind = np.full(len(state), _IDLE)
    known = [name for name in FEEDS if name in state]
    moving = np.zeros(len(state), dtype=bool)
    for name in known:
        moving |= np.abs(_column(state, name)) > 0
    active = execution == "ACTIVE" if "execution" in state else turning | moving
    cut = active & loaded & (moving if known else True)
    kind[active & (turning | moving)] = _AIR
    kind[cut] = _CUT
    if warm:
        kind[active & np.isin(_words(state, "program"), list(warm))] = SEGMENT_KINDS.index(
            "warm_up"
        )
    if "execution" in state:
        kind[execution == ""] = _UNKNOWN
    return kind


def _words(state: pd.DataFrame, name: str) -> np.ndarray:
    if name not in state:
        return np.full(len(state), "", dtype=object)
    return np.array(state[name].astype(object).where(state[name].notna(), ""), dtype=object)


def _warm_up(
    kind: Ints, time: Ints, operation: Ints, turning: Bools, program: np.ndarray,
    settings: CleanSettings,
) -> None:  # fmt: skip
    """Mark turning without load, from a cold start to the first cut, as warm_up; in place.

    It ends where another program begins: the no-load level of a speed that is only cut at hides its
    cuts.  Where no cut is seen, the first run of the spindle alone counts.
    """
    cut, known_off = _CUT, settings.cold_after_s * NS
    starts = np.flatnonzero(np.r_[True, np.diff(operation) > 0])
    for n, first in enumerate(starts):
        if n > 0 and time[first] - time[first - 1] < known_off:
            continue
        last = starts[n + 1] if n + 1 < len(starts) else len(kind)
        cuts = np.flatnonzero(kind[first:last] == cut)
        until = first + cuts[0] if len(cuts) else last
        long = [
            (a, b)
            for a, b in _runs_of(turning[first:until])
            if (b - a) * settings.period_s >= settings.warm_up_min_s
        ]
        if not long:
            continue
        (a, b), *_ = long
        running = np.where(kind == _AIR, program, "")[first + a : until]
        own, times = np.unique(running[: b - a][running[: b - a] != ""], return_counts=True)
        if len(own):
            begun = np.cumsum(running == own[times.argmax()]) > 0
            others = np.flatnonzero(begun & (running != "") & (running != own[times.argmax()]))
            until = first + a + others[0] if len(others) else until
        for a, b in long if len(cuts) else long[:1]:
            part = kind[first + a : min(first + b, until)]
            part[part != _UNKNOWN] = _WARM_UP


def _runs_of(mask: Bools) -> list[tuple[int, int]]:
    edge = np.diff(np.r_[0, mask.astype(int), 0])
    return list(zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True))


def _stretches(kind: Ints, operation: Ints) -> tuple[Ints, Ints]:
    """Begin and end of each stretch of rows of one kind within one operation, shape (S,)."""
    change = (kind[1:] != kind[:-1]) | (operation[1:] != operation[:-1])
    start = np.flatnonzero(np.r_[True, change])
    return start, np.r_[start[1:], len(kind)]


def _absorb_short(kind: Ints, operation: Ints, settings: CleanSettings) -> None:
    """Join segments that are too short to the one before them, within one operation; in place."""
    start, stop = _stretches(kind, operation)
    short = (start > 0) & ((stop - start) * settings.period_s < settings.segment_min_s)
    short &= (operation[start] == operation[start - 1]) & (kind[start] != _UNKNOWN)
    for a, b in zip(start[short].tolist(), stop[short].tolist(), strict=True):
        if kind[a - 1] != _UNKNOWN:
            kind[a:b] = kind[a - 1]


def _runs(kind: Ints, time: Ints, operation: Ints, period: int) -> pd.DataFrame:
    """Rows of one kind as segments, with ``off`` between the periods of operation."""
    start, stop = _stretches(kind, operation)
    known = kind[start] != _UNKNOWN
    begin, end = time[start], time[stop - 1] + period
    off = np.flatnonzero(operation[1:] != operation[:-1])
    words = [SEGMENT_KINDS[k] for k in kind[start][known]] + ["off"] * len(off)
    return _segment_table(
        np.r_[begin[known], time[off] + period], np.r_[end[known], time[off + 1]], words
    )


def _segment_table(start: Ints, end: Ints, kind: list[str]) -> pd.DataFrame:
    times = {
        name: pd.to_datetime(at, unit="ns", utc=True).astype("datetime64[ns, UTC]")
        for name, at in (("start", start), ("end", end))
    }
    table = pd.DataFrame({**times, "kind": pd.Series(kind, dtype=object)})
    return table.sort_values("start", ignore_index=True)
