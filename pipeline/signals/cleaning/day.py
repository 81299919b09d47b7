"""One day of a machine: from its rows and what was known before to the state table."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pipeline.signals.cleaning import gaps as found_gaps
from pipeline.signals.cleaning.gaps import Gap, Lost
from pipeline.signals.cleaning.habits import Habit
from pipeline.signals.cleaning.item import Audit, Carry, Item
from pipeline.signals.cleaning.position_control import position_control
from pipeline.signals.cleaning.recorded import WHOLE
from pipeline.signals.cleaning.resample import grid, held, on_spans, resampled
from pipeline.signals.cleaning.series import Ints, Series
from pipeline.signals.cleaning.settings import NS, CleanMachine, CleanSettings
from pipeline.signals.columns import COLUMNS, Column


@dataclass(frozen=True, kw_only=True)
class Day:
    """A clean day.

    ``state`` has ``time`` [int64 ns] and the machine's columns; ``series`` are the clean series
    with their "not known" rows, by data item.
    """

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
    habits: Mapping[str, Habit],
    machine: CleanMachine,
    settings: CleanSettings,
) -> Day:
    """Clean the rows from ``start`` to ``end`` [ns] of one machine.

    Parameters
    ----------
    rows : DataFrame
        As of ``recorded.rows_of``, from ``start`` to ``end`` and the lookahead after it, and
        ``apart``: told by a logger that may run while the machine is off.
    start, end : int
        The day [ns].
    carry : dict
        What the day before left; empty for the first.
    habits : mapping of str to Habit
        By data item, and ``"*"`` for the machine as a whole.
    machine, settings
        Where signals are, and by which rules they are cleaned.
    """
    rows = rows.sort_values(["time", "sequence"], kind="stable", ignore_index=True)
    twice = rows.duplicated(["time", "data_item", "key", "number", "text"])
    today = rows["time"].to_numpy() < end
    counts = {"duplicates": int((twice & today).sum()), "rows": int(today.sum())}
    counts["restated"] = int((rows["restated"] & today).sum())
    rows = rows[~twice]
    spoken = _spoken(rows, carry)
    lost = _lost(rows, spoken, carry, habits[WHOLE], settings)
    if len(spoken) and spoken[-1] < end:  # a silence that nothing has ended yet
        lost = replace(lost, cuts=np.unique(np.r_[lost.cuts, spoken[-1] + 1]))
    audit: list[Audit] = []
    all_gaps = list(lost.gaps)
    clean: dict[str, Series] = {}
    items: Carry = {}
    for item in machine.items:
        one = Item(item, _signal_of(item, machine), carry.get("items", {}).get(item, {}))
        one.read(rows)
        audit += [a for a in one.glitches(settings, lost) if start <= a.time < end]
        all_gaps += one.gaps(lost, habits.get(item, Habit()), settings)
        clean[item] = one.known(lost)
        items[item] = one.left(end)
    at = grid(on_spans(spoken, settings), start, end, settings.period_s)
    state, control = _state(at, clean, habits, machine, settings, carry)
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


def _signal_of(item: str, machine: CleanMachine) -> Column:
    for name, found in machine.signals.items():
        if found == item:
            return COLUMNS[name]
    control = machine.position_control
    return COLUMNS["spindle_speed" if control is None else control.signals[item]]


def _spoken(rows: pd.DataFrame, carry: Carry) -> Ints:
    voice = rows["spoken"].to_numpy(dtype=bool) & ~rows["apart"].to_numpy(dtype=bool)
    time = np.unique(rows["time"].to_numpy()[voice])
    if carry.get("spoken") is not None:
        time = np.unique(np.r_[np.int64(carry["spoken"]), time])
    return time.astype(np.int64)


def _agent(rows: pd.DataFrame, carry: Carry) -> list[int] | None:
    """Time, instance and sequence of the agent's last numbered record."""
    given = rows[rows["instance"].notna()]
    if given.empty:
        return carry.get("agent")
    last = given.iloc[-1]
    return [int(last["time"]), int(last["instance"]), int(last["sequence"])]


def _lost(
    rows: pd.DataFrame, spoken: Ints, carry: Carry, habit: Habit, settings: CleanSettings
) -> Lost:
    """Gaps of the machine as a whole, and what they leave unknown."""
    given = rows["instance"].notna().to_numpy()
    time = rows["time"].to_numpy()[given]
    sequence = rows["sequence"].to_numpy(dtype=np.uint64)[given]
    instance = rows["instance"].to_numpy(dtype=np.uint64, na_value=0)[given]
    if carry.get("agent"):
        t, i, s = carry["agent"]
        time, instance = np.r_[np.int64(t), time], np.r_[np.uint64(i), instance]
        sequence = np.r_[np.uint64(s), sequence]
    real = np.ones(len(time), dtype=bool)
    quiet = found_gaps.silences(spoken, habit, settings, None)
    anew = found_gaps.instances(time, instance, real)
    missing = found_gaps.missing_sequences(time, sequence, instance, real)
    off = [
        g
        for g in quiet
        if (g.end or g.start) - g.start > settings.off_after_s * NS
        and not found_gaps.continuous(g, time, sequence, instance, real)
    ]
    longest = habit.threshold_s(settings) * NS
    torn = [g for g in missing if (g.end or g.start) - g.start > longest]
    return found_gaps.lost([*quiet, *anew, *missing], [*off, *anew, *torn])


def _state(
    at: Ints,
    clean: Mapping[str, Series],
    habits: Mapping[str, Habit],
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
            habit = habits.get(item, Habit())
            columns[name] = resampled(clean[item], COLUMNS[name].between, at, habit, settings)
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
