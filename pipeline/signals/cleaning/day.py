"""State table of one day of a machine, from its rows and what was known before, item by item.

A spindle is under position control while its position loop holds it as a C axis: a motor that holds
a position carries current while it stands, and heats.  Without a reported rotary mode two signs
show it: the angle of the C axis changes, or driven tools turn in the other spindle, while this
one's speed is zero (engaged); and the spindle turns under speed control (released).  Between the
two the state stays.  Not seen: a spindle held at angle zero that neither moves nor is milled, a
brake, a release without a turn.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning import gaps as found_gaps
from pipeline.signals.cleaning.gaps import NO_MACHINE_GAPS, Gap, MachineGaps, ReportingInterval
from pipeline.signals.cleaning.recorded import WHOLE
from pipeline.signals.cleaning.series import (
    Audit,
    Series,
    empty,
    grid,
    held,
    joined,
    on_spans,
    removed_holes,
    resampled,
    without_glitches,
)
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.signals.columns import COLUMNS, Column

Carry = dict[str, Any]
"""State carried from one day to the next, as JSON: ``spoken``, ``agent``, ``items``, ``held``
(position control); times in ns."""


class Item:
    """One data item in the course of a day."""

    def __init__(self, item: str, signal: Column, before: Carry) -> None:
        self.item, self.signal, self.before = item, signal, before
        self.series = self.raw = empty(text=signal.text)
        self.holes = np.array([], dtype=np.int64)
        self.words: list[Audit] = []
        self.apart = False

    def read(self, rows: pd.DataFrame) -> None:
        """Take the item's rows, after what was known before."""
        chosen = rows["wanted"].to_numpy() & (rows["data_item"] == self.item).to_numpy()
        part = rows[chosen]
        time = part["time"].to_numpy().astype(np.int64)
        value = _words(part) if self.signal.text else self._numbers(part, time)
        said = Series(time=time, value=value, fresh=~part["restated"].to_numpy(dtype=bool))
        self.apart = bool(part["apart"].any() or self.before.get("apart", False))
        known = [tuple(v) for k in ("good", "said") if (v := self.before.get(k))]
        past = list(dict.fromkeys(known))  # the last value is often also the last good one
        self.raw = joined(_brought_over(past, self.signal.text), said)

    def _numbers(self, part: pd.DataFrame, time: Ints) -> np.ndarray:
        number = part["number"].to_numpy(dtype=float).copy()
        word = part["text"].notna().to_numpy() & np.isnan(number)
        if word.any():
            text = part["text"].astype(object)[word]
            number[word] = pd.to_numeric(text, errors="coerce")
            lost = np.isnan(number[word])
            self.words = [
                Audit(time=int(t), data_item=self.item, before=str(w), rule="not_a_number")
                for t, w in zip(time[word][lost], text[lost], strict=True)
            ]
        return number

    def glitches(self, settings: CleanSettings, lost: MachineGaps) -> list[Audit]:
        """Remove what cannot be true; what was removed, as audit rows."""
        cuts = NO_MACHINE_GAPS.cuts if self.apart else lost.cuts
        done = without_glitches(self.raw, self.signal, settings, cuts)
        self.series = done.series
        self.holes = removed_holes(self.raw, done.removed, settings.bridge_s)
        at = np.flatnonzero(done.removed)
        return self.words + [
            Audit(time=int(self.raw.time[i]), data_item=self.item,
                  before=f"{self.raw.value[i]:.10g}", rule=str(done.rule[i]))
            for i in at
        ]  # fmt: skip

    def gaps(
        self, lost: MachineGaps, interval: ReportingInterval, settings: CleanSettings
    ) -> list[Gap]:
        """The item's own gaps."""
        own = found_gaps.unavailable(self.item, self.raw)
        if self.apart:
            quiet = found_gaps.silences(self.raw.time, interval, settings, self.item)
        else:
            quiet = found_gaps.item_silences(self.item, self.raw, lost.gaps, interval, settings)
        self.holes = np.unique(np.r_[self.holes, [g.start + 1 for g in quiet]]).astype(np.int64)
        return own + quiet

    def known(self, lost: MachineGaps) -> Series:
        """The clean series with "not known" wherever it is not."""
        lost = NO_MACHINE_GAPS if self.apart else lost
        hole = self.before.get("hole")
        past = np.array([] if hole is None else [hole], dtype=np.int64)
        self.holes = np.unique(np.r_[self.holes, lost.cuts, past]).astype(np.int64)
        whole = self.series.unknown_at(self.holes)
        since, until = lost.pauses[:, 0], lost.pauses[:, 1]
        again = Series(time=until, value=held(whole, until), fresh=np.zeros(len(until), dtype=bool))
        return joined(whole.unknown_at(since), again.keep(again.known))

    def left(self, end: int) -> Carry:
        """State of the item at ``end`` [ns], for the next day."""
        said = self.series.before(end)
        good = said.keep(said.known)
        holes = self.holes[self.holes < end]
        last = int(said.time[-1]) if len(said.time) else -1
        open_hole = len(holes) and holes[-1] >= last
        return {
            "said": _last_value(said),
            "good": _last_value(good),
            "hole": int(holes[-1]) if open_hole else None,
            "apart": self.apart,
        }


def _last_value(series: Series) -> list[Any] | None:
    if not len(series.time):
        return None
    value = series.value[-1]
    lost = value is None or (not series.text and np.isnan(value))
    plain = None if lost else (str(value) if series.text else float(value))
    return [int(series.time[-1]), plain]


def _brought_over(past: list[tuple[Any, ...]], text: bool) -> Series:
    if not past:
        return empty(text=text)
    missing = None if text else np.nan
    words = [missing if v is None else v for _, v in past]
    value = np.array(words, dtype=object if text else float)
    time = np.array([t for t, _ in past], dtype=np.int64)
    return Series(time=time, value=value, fresh=np.zeros(len(past), dtype=bool))


def _words(part: pd.DataFrame) -> np.ndarray:
    text = np.array([None if pd.isna(word) else word for word in part["text"]], dtype=object)
    number = part["number"].to_numpy(dtype=float)
    for i in np.flatnonzero(~np.isnan(number)):
        if text[i] is None:
            text[i] = f"{number[i]:.10g}"
    return text


@dataclass(frozen=True, kw_only=True)
class Day:
    """Clean day: ``state`` with ``time`` [int64 ns], and clean ``series`` by data item."""

    state: pd.DataFrame
    audit: list[Audit]
    gaps: list[Gap]
    series: Mapping[str, Series]
    carry: Carry
    counts: dict[str, int] = field(default_factory=dict)


def clean_day(
    rows: pd.DataFrame,
    start: int,
    end: int,
    carry: Carry,
    reporting: Mapping[str, ReportingInterval],
    *,
    machine: CleanMachine,
    settings: CleanSettings,
) -> Day:
    """Clean the rows from ``start`` to ``end`` [ns] of one machine.

    ``rows`` are those of the day and the lookahead, with ``apart`` (a logger that may run while the
    machine is off); ``carry`` is the state of the day before; ``reporting`` goes by data item,
    ``"*"`` for the machine as a whole.
    """
    rows = rows.sort_values(["time", "sequence"], kind="stable", ignore_index=True)
    twice = rows.duplicated(["time", "data_item", "key", "number", "text"])
    today = rows["time"].to_numpy() < end
    counts = {"duplicates": int((twice & today).sum()), "rows": int(today.sum())}
    counts["restated"] = int((rows["restated"] & today).sum())
    rows = rows[~twice]
    spoken = _spoken(rows, carry)
    lost = _lost(rows, spoken, carry, reporting[WHOLE], settings)
    if len(spoken) and spoken[-1] < end:  # a silence that nothing has ended yet
        lost = replace(lost, cuts=np.unique(np.r_[lost.cuts, spoken[-1] + 1]))
    audit: list[Audit] = []
    all_gaps = list(lost.gaps)
    clean: dict[str, Series] = {}
    items: Carry = {}
    for item in machine.items:
        one = Item(item, machine.column(item), carry.get("items", {}).get(item, {}))
        one.read(rows)
        audit += [a for a in one.glitches(settings, lost) if start <= a.time < end]
        all_gaps += one.gaps(lost, reporting.get(item, ReportingInterval()), settings)
        clean[item] = one.known(lost)
        items[item] = one.left(end)
    at = grid(on_spans(spoken, settings), start, end, settings.period_s)
    state, control = _state(at, clean, reporting, machine, settings, carry)
    state.insert(0, "time", at)
    before_end = spoken[spoken < end]
    left: Carry = {
        "spoken": int(before_end[-1]) if len(before_end) else carry.get("spoken"),
        "agent": _agent(rows[rows["time"] < end], carry),
        "items": items,
        "held": control(end),
    }
    ended = sorted(
        (g for g in all_gaps if g.end is not None and start <= g.end < end),
        key=lambda g: (g.start, g.end or 0, g.data_item or "", g.cause),
    )
    return Day(state=state, audit=audit, gaps=ended, series=clean, carry=left, counts=counts)


def _spoken(rows: pd.DataFrame, carry: Carry) -> Ints:
    voice = rows["spoken"].to_numpy(dtype=bool) & ~rows["apart"].to_numpy(dtype=bool)
    time = np.unique(rows["time"].to_numpy()[voice])
    if carry.get("spoken") is not None:
        time = np.unique(np.r_[np.int64(carry["spoken"]), time])
    return time.astype(np.int64)


def _agent(rows: pd.DataFrame, carry: Carry) -> list[int] | None:
    given = rows[rows["instance"].notna()]
    if given.empty:
        return carry.get("agent")
    last = given.iloc[-1]
    return [int(last["time"]), int(last["instance"]), int(last["sequence"])]


def _lost(
    rows: pd.DataFrame,
    spoken: Ints,
    carry: Carry,
    interval: ReportingInterval,
    settings: CleanSettings,
) -> MachineGaps:
    """Gaps of the machine as a whole, and what they leave unknown."""
    given = rows["instance"].notna().to_numpy()
    time = rows["time"].to_numpy()[given]
    sequence = rows["sequence"].to_numpy(dtype=np.uint64)[given]
    instance = rows["instance"].to_numpy(dtype=np.uint64, na_value=0)[given]
    if carry.get("agent"):
        t, i, s = carry["agent"]
        time, instance = np.r_[np.int64(t), time], np.r_[np.uint64(i), instance]
        sequence = np.r_[np.uint64(s), sequence]
    quiet = found_gaps.silences(spoken, interval, settings, None)
    anew = found_gaps.instances(time, instance)
    missing = found_gaps.missing_sequences(time, sequence, instance)
    off = [
        g
        for g in quiet
        if (g.end or g.start) - g.start > settings.off_after_s * NS
        and not found_gaps.continuous(g, time, sequence, instance)
    ]
    longest = interval.threshold_s(settings) * NS
    torn = [g for g in missing if (g.end or g.start) - g.start > longest]
    return found_gaps.machine_gaps([*quiet, *anew, *missing], [*off, *anew, *torn])


def _state(
    at: Ints,
    clean: Mapping[str, Series],
    reporting: Mapping[str, ReportingInterval],
    machine: CleanMachine,
    settings: CleanSettings,
    carry: Carry,
) -> tuple[pd.DataFrame, Callable[[int], float | None]]:
    """The state table on the grid, and position control at any time [ns]."""
    columns: dict[str, object] = {}
    control = Series(time=at[:0], value=np.array([], dtype=float), fresh=np.zeros(0, dtype=bool))
    for name in machine.names:
        item = machine.signals.get(name)
        if item is not None:
            typical_s = reporting.get(item, ReportingInterval()).typical_s
            columns[name] = resampled(
                clean[item], COLUMNS[name].between, at, typical_s=typical_s, settings=settings
            )
        elif machine.position_control is not None:
            spindle = machine.position_control
            before = carry.get("held")
            control = position_control(
                clean[spindle.angle], clean[spindle.speed], settings,
                rate=clean.get(spindle.rate or ""),
                tool_speed=clean.get(spindle.tool_speed or ""),
                mode=clean.get(spindle.mode or ""),
                initial=np.nan if before is None else before,
            )  # fmt: skip
            columns[name] = held(control, at).astype(float)

    def at_end(end: int) -> float | None:
        value = held(control, np.array([end - 1]))
        return None if np.isnan(value[0]) else float(value[0])

    return pd.DataFrame(columns, index=range(len(at))), at_end


ANGLE_STEP = 1e-3
"""Smallest change of angle that is a motion [DEGREE]."""
RATE = 1e-2
"""Smallest angular velocity that is a motion [DEGREE/SECOND]; a held axis shows less."""
HELD_MODES = ("INDEX", "CONTOUR")
"""Rotary modes in which the position loop holds the spindle."""


def position_control(
    angle: Series,
    speed: Series,
    settings: CleanSettings,
    *,
    rate: Series | None = None,
    tool_speed: Series | None = None,
    mode: Series | None = None,
    initial: float = np.nan,
) -> Series:
    """Position control (0 released, 1 engaged, NaN not known) when angle or speed is reported.

    ``angle`` [DEGREE], ``speed`` [REVOLUTION/MINUTE], ``rate`` [DEGREE/SECOND] and ``tool_speed``
    of the driven tools' spindle are clean; ``mode`` says SPINDLE, INDEX or CONTOUR.  ``initial`` is
    the state before the first row, unknown again after ``off_after_s`` without data.
    """
    rate = empty(text=False) if rate is None else rate
    tool_speed = empty(text=False) if tool_speed is None else tool_speed
    mode = empty(text=True) if mode is None else mode
    reported = (angle, speed, rate, tool_speed, mode)
    time = np.unique(np.concatenate([series.time for series in reported]))
    if not len(time):
        return Series(time=time, value=np.array([]), fresh=np.array([], dtype=bool))
    turning, standing = _speeds(speed, time, settings.turning_rpm)
    turned = rate.fresh & (np.abs(rate.value.astype(float)) > RATE)
    moved = np.isin(time, np.concatenate([angle.time[_moves(angle)], rate.time[turned]]))
    milling, _ = _speeds(tool_speed, time, settings.turning_rpm)
    state = np.full(len(time), np.nan)
    state[(moved | milling) & standing] = 1.0
    state[turning] = 0.0
    word = held(mode, time)
    state[np.isin(word, HELD_MODES)] = 1.0
    state[word == "SPINDLE"] = 0.0
    lost, back = _off(angle, speed, time, settings)
    marked = np.where(lost, -1.0, np.where(back & np.isnan(state), 0.0, state))
    value = _carried(marked, initial)
    return Series(time=time, value=value, fresh=np.ones(len(time), dtype=bool))


def _speeds(speed: Series, time: Ints, turning_rpm: float) -> tuple[Bools, Bools]:
    """Whether the spindle turns, and whether it stands, at each time, shape (T,)."""
    value = held(speed, time).astype(float)
    return np.abs(value) > turning_rpm, np.abs(value) <= turning_rpm


def _moves(angle: Series) -> Bools:
    """Rows at which the angle moved to one other than zero, shape (T,).

    A jump to zero without the steps between is the control clearing its display, and after data was
    lost the first value is no motion.
    """
    value = angle.value.astype(float)
    before = np.r_[np.nan, value[:-1]]
    changed = np.abs(value - before) > ANGLE_STEP
    return changed & (np.abs(value) > ANGLE_STEP) & angle.fresh


def _off(angle: Series, speed: Series, time: Ints, settings: CleanSettings) -> tuple[Bools, Bools]:
    """Losses of angle and speed for long, and the first return of one of them, shape (T,)."""
    known = np.zeros(len(time), dtype=bool)
    for series in (angle, speed):
        known |= ~np.isnan(held(series, time).astype(float))
    at = np.flatnonzero(known)
    lost, back = np.zeros_like(known), np.zeros_like(known)
    if not len(at):
        return lost, back
    i, j = at[:-1], at[1:]
    hole = j > i + 1
    hole[hole] = time[j[hole]] - time[i[hole] + 1] > settings.off_after_s * NS
    lost[i[hole] + 1] = True
    back[j[hole]] = True
    if at[0] > 0:  # the record begins with a machine that was off
        lost[0], back[at[0]] = True, True
    return lost, back


def _carried(marked: Floats, initial: float) -> Floats:
    """Each marked state until the next one; -1 marks "not known"."""
    place = np.where(np.isnan(marked), -1, np.arange(len(marked)))
    place = np.maximum.accumulate(place)
    value = np.where(place < 0, initial, marked[np.maximum(place, 0)])
    return np.where(value == -1.0, np.nan, value)
