"""State of the twin on the page of records: temperature in its band, force of cutting by tool."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    counted,
    day_words,
    fixed,
    hours,
    number,
    quantity,
    unit_words,
)
from pipeline.charts.sections import Figures, Section, drawing, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.schema.arrays import Floats
from pipeline.schema.si import DAY, MINUTE
from pipeline.schema.twin_state import (
    MANIFEST,
    QUANTITIES,
    RECORDINGS,
    Quantity,
    TrendCheck,
    TwinState,
    day_path,
)

MADE_FROM = "the champion and data/clean, by the stage state"
TEMPERATURE, FORCE = "spindle_temperature", "tangential_force"
NUMBERS = ("measured", "estimated", "low", "high")
SHOWN_DAYS, SHOWN_TOOLS = 7, 4
"""Days up to the newest one, and tools of them that cut longest, in the figures."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolForce:
    """Tangential force of one tool by the minute in cut, (M,) each [N]."""

    tool: str
    days: Floats
    """Time of the minute since the first day shown [d]."""
    estimated: Floats
    low: Floats
    high: Floats


def twin_state_section(folders: MachineFolders, shelf: SourceRegistry) -> Section | None:
    """What the champion estimates over the newest week; None where the stage has not run."""
    if folders.twin_state is None:
        return None
    path = folders.twin_state / MANIFEST
    state = shelf.read(path, TwinState, MADE_FROM)
    if state is None or not (state.days or state.trends):
        return None
    week, first = shown_week(state)
    tables = {day: one for day in week if (one := _table(folders.twin_state, day, shelf))}
    made = sources(shelf, path, *(day_path(folders.twin_state, day) for day in tables))
    forces = tool_forces(tables, first)
    blocks = present(
        _temperature(tables, first, made, state),
        _forces(forces, first, made),
        _tools(forces, made),
        _coverage(state, sources(shelf, path)),
        _trends(state.trends, sources(shelf, path, folders.twin_state / RECORDINGS)),
    )
    return Section(key="twin-state", title="State of the twin", text=list(_text(state, week)),
                   blocks=blocks)  # fmt: skip


def shown_week(state: TwinState) -> tuple[list[str], date]:
    """Days of the newest week with records, and its first day."""
    newest = date.fromisoformat(max(state.days)) if state.days else date.min
    first = newest - timedelta(days=SHOWN_DAYS - 1) if state.days else newest
    return [day for day in state.days if date.fromisoformat(day) >= first], first


def _text(state: TwinState, week: Sequence[str]) -> Iterator[str]:
    served = ", ".join(f"{name} {status}" for name, status in state.submodels.items())
    yield (
        f"What the models that serve estimate beside what was measured ({served or 'none serves'})."
        + (f" Figures show {counted(len(week), 'day')} up to {day_words(max(week), year=True)}."
           if week else "")
    )  # fmt: skip
    for name, why in state.intervals_unknown.items():
        yield f"{_words(name)}: {why}."
    force = state.force
    if force is not None and force.mape_percent is not None:
        yield (
            f"In {counted(force.levels, 'cut')} of known engagement the force from the spindle’s "
            f"load is off that of the dynamometer’s law by {number(force.mape_percent)}{NARROW}% "
            f"in the mean; up to {number(force.most_percent)}{NARROW}% is allowed."
        )


def _table(folder: Path, day: str, shelf: SourceRegistry) -> pa.Table | None:
    names = [f"{TEMPERATURE}_{part}" for part in NUMBERS]
    names += [f"{FORCE}_{part}" for part in NUMBERS[1:]]
    return shelf.table(day_path(folder, day), ("time", "tool_number", *names), MADE_FROM)


def _minutes(table: pa.Table, day: str, first: date) -> tuple[Floats, Floats]:
    """Minute of each row since the first day's midnight, and the minutes that there are."""
    local = table["time"].cast(pa.timestamp("ns")).to_numpy()
    if (zone := table.schema.field("time").type.tz) not in (None, "UTC"):
        import pandas as pd

        shown = pd.DatetimeIndex(local, tz="UTC").tz_convert(zone).tz_localize(None)
        local = shown.as_unit("ns").to_numpy()
    since = (local - np.datetime64(first.isoformat(), "ns")) / np.timedelta64(1, "s")
    minute = np.floor(np.asarray(since, dtype=float) / MINUTE)
    return minute, np.unique(minute)


def _numbers(table: pa.Table, name: str) -> Floats:
    return np.array(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def _temperature(
    tables: dict[str, pa.Table], first: date, made: list, state: TwinState
) -> Figures | None:
    """Measured temperature of the spindle in the 90 % band of the free run."""
    parts: list[list[Floats]] = []
    for day, table in tables.items():
        minute, every = _minutes(table, day, first)
        place = np.searchsorted(every, minute)
        means = []
        for part in NUMBERS:
            values = _numbers(table, f"{TEMPERATURE}_{part}")
            known = np.isfinite(values)
            count = np.bincount(place[known], minlength=len(every))
            total = np.bincount(place[known], values[known], minlength=len(every))
            means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        gap = [np.array([np.nan])] * len(NUMBERS)
        x = np.append(every * MINUTE / DAY, every[-1] * MINUTE / DAY)
        parts.append([x, *(np.append(one, end) for one, end in zip(means, gap, strict=True))])
    if not parts:
        return None
    x, measured, estimated, low, high = (np.concatenate(one) for one in zip(*parts, strict=True))
    if not np.isfinite(measured).any():
        return None
    strip = Strip(
        head="Spindle temperature, °C", height=160.0, unit="°C",
        areas=[("s-band", x, low, high)] if np.isfinite(low).any() else [],
        curves=[("l-window", x, estimated), ("l-measured", x, measured)],
    )  # fmt: skip
    legend = [("l-measured", "measured", "line"), ("l-window", "estimated", "line")]
    if strip.areas:
        legend.append(("s-band", "90 % interval of the estimate", "box"))
    caption = ("Spindle temperature, measured once at the beginning of each day and estimated from "
               "speed and load from there on; means over minutes.")  # fmt: skip
    svg = strips_figure([strip], week_axis(first), f"Spindle temperature over {len(tables)} days")
    return drawing(svg, caption, made, legend)


def week_axis(first: date) -> Axis:
    """Axis over a week in days, weekends in place."""
    days = [first + timedelta(days=k) for k in range(SHOWN_DAYS)]
    marks = [(float(k), day_words(day.isoformat())) for k, day in enumerate(days)]
    return Axis(words="Time of the plant", span=(0.0, float(SHOWN_DAYS)), marks=marks)


def tool_forces(tables: dict[str, pa.Table], first: date) -> list[ToolForce]:
    """Force by tool: medians over minutes of at least ten seconds in cut; the longest first."""
    found: dict[str, list[Floats]] = {}
    for day, table in tables.items():
        minute, _ = _minutes(table, day, first)
        values = np.array([_numbers(table, f"{FORCE}_{part}") for part in NUMBERS[1:]])
        coded = table["tool_number"].combine_chunks()
        tools = np.asarray(coded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
        for code, word in enumerate(coded.dictionary.to_pylist()):
            rows = (tools == code) & np.isfinite(values[0])
            every, begin = np.unique(minute[rows], return_index=True)
            if len(every):
                pieces = np.split(values[:, rows], begin[1:], axis=1)
                medians = [np.median(one, axis=1) for one in pieces]
                found.setdefault(word, []).append(np.vstack([every * MINUTE / DAY,
                                                             np.array(medians).T]))  # fmt: skip
    joined = {word: np.concatenate(some, axis=1) for word, some in found.items()}
    order = sorted(joined, key=lambda word: (-joined[word].shape[1], word))
    return [
        ToolForce(tool=word, days=one[0], estimated=one[1], low=one[2], high=one[3])
        for word in order if (one := joined[word]) is not None
    ]  # fmt: skip


def _forces(forces: Sequence[ToolForce], first: date, made: list) -> Figures | None:
    """Force of the tools that cut longest over the week."""
    strips = []
    for one in forces[:SHOWN_TOOLS]:
        lifted = np.flatnonzero(np.diff(one.days) > 1.5 * MINUTE / DAY) + 1
        x, y, low, high = (
            np.insert(v, lifted, np.nan if k else one.days[lifted])
            for k, v in enumerate((one.days, one.estimated, one.low, one.high))
        )
        strips.append(Strip(
            head=f"Tangential force of tool {one.tool}, N", height=70.0, zero=True, unit="N",
            areas=[("s-band", x, low, high)], curves=[("l-window", x, y)],
        ))  # fmt: skip
    if not strips:
        return None
    legend = [("l-window", "estimated", "line"), ("s-band", "its 90 % interval", "box")]
    caption = ("Tangential force from the spindle’s load in minutes of cutting, medians, of the "
               "tools that cut longest.")  # fmt: skip
    svg = strips_figure(strips, week_axis(first), f"Tangential force of {len(strips)} tools")
    return drawing(svg, caption, made, legend)


TOOLS: tuple[Column[ToolForce], ...] = (
    Column("Tool", lambda one: one.tool),
    Column("minutes with cuts", lambda one: number(len(one.days)), ""),
    Column("median force", lambda one: fixed(np.median(one.estimated), 0), "N"),
    Column("90 % interval, from", lambda one: fixed(np.median(one.low), 0), "N"),
    Column("to", lambda one: fixed(np.median(one.high), 0), "N"),
    Column("highest minute", lambda one: fixed(np.max(one.estimated), 0), "N"),
)


def _tools(forces: Sequence[ToolForce], made: list) -> Table | None:
    return tabulated("Tangential force by tool in the week shown", forces, TOOLS, made)


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _coverage(state: TwinState, made: list) -> Table | None:
    """Time over which each quantity is known, and the reason for the longest time without."""
    seconds = sum(day.seconds for day in state.days.values())

    def known(one: Quantity) -> float:
        return sum(day.quantities[one.name].known_s for day in state.days.values())

    def why(one: Quantity) -> str:
        lost: dict[str, float] = {}
        for day in state.days.values():
            for reason, s in day.quantities[one.name].unknown_s.items():
                lost[reason] = lost.get(reason, 0.0) + s
        return "; ".join(
            f"{reason} {hours(lost[reason])}{NARROW}h"
            for reason in sorted(lost, key=lambda r: -lost[r])[:2]
        )

    columns: tuple[Column[Quantity], ...] = (
        Column("Quantity", lambda one: _words(one.name)),
        Column("means", lambda one: f"{one.meaning}, {unit_words(one.unit)}"),
        Column("known", lambda one: hours(known(one)), "h"),
        Column("elsewhere", why),
    )
    caption = f"What is known of {hours(seconds)} h of records"
    return tabulated(caption, QUANTITIES if state.days else (), columns, made, folded=True)


TRENDS: tuple[Column[TrendCheck], ...] = (
    Column("Channel", lambda one: _words(one.quantity)),
    Column("cuts", lambda one: number(one.recordings), ""),
    Column("tools", lambda one: number(one.tools), ""),
    Column("r", lambda one: Cell(
        text=NOT_KNOWN if one.correlation is None else fixed(one.correlation, 2),
        status="unknown" if one.correlation is None
        else "passed" if one.correlation > one.least else "failed",
    ), ""),
    Column("r, a new tool", lambda one: fixed(one.correlation_new_tool, 2), ""),
    Column("required", lambda one: f"> {fixed(one.least, 2)}", ""),
    Column("note", lambda one: one.reason or "–"),
)  # fmt: skip


def _trends(trends: Sequence[TrendCheck], made: list) -> Table | None:
    if not trends:
        return None
    low, high = trends[0].band_Hz
    return tabulated(
        f"Vibration of recorded cuts, RMS from {number(low)} to {quantity(high, 'Hz')}", trends,
        TRENDS, made,
        note="r: measured against what conditions and wear of the other tools say, at the level of "
        "the tool’s earlier cuts of the same kind; of a new tool, at the level of the others.",
    )  # fmt: skip
