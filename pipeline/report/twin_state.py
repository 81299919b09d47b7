"""State of the twin on the page of records: temperature in its band, force of cutting by tool."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import date, timedelta

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, day_words, fixed, hours, number
from pipeline.charts.sections import Section, drawing, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.schema.arrays import Floats
from pipeline.schema.days import clock
from pipeline.schema.si import DAY, HOUR, MINUTE, NS
from pipeline.schema.twin_state import (
    MANIFEST,
    PARTS,
    QUANTITIES,
    TrendCheck,
    TwinState,
    columns,
    day_path,
)

MADE_FROM = "the champion and data/clean, by the stage state"
SHOWN_DAYS, SHOWN_TOOLS = 7, 4
"""Days up to the newest one, and tools of them that cut longest, in the figures."""
LEAST_S = 10.0
"""Least time in cut of a minute that counts [s]."""
BAND = ("s-band", "90 % interval of the estimate", "box")
LINES = {
    "measured": ("l-measured", "measured", "line"),
    "window": ("l-window", "estimated", "line"),
}
Minutes = Mapping[str, Floats]
"""Time [d] since the first day shown, and parts of a quantity; shape (M,) each."""


def twin_state_section(folders: MachineFolders, shelf: SourceRegistry) -> Section | None:
    """What the champion estimates over the newest week; None where nothing was estimated."""
    folder = folders.twin_state
    state = None if folder is None else shelf.read(folder / MANIFEST, TwinState, MADE_FROM)
    if folder is None or state is None or not (state.days or state.trends):
        return None
    newest = date.fromisoformat(max(state.days)) if state.days else date.max
    first = newest - timedelta(days=SHOWN_DAYS - 1)
    paths = [day_path(folder, day) for day in state.days if day >= first.isoformat()]
    shown = [name for name in columns() if name.startswith(("spindle_temperature", "tangential"))]
    wanted = ("time", "tool_number", *shown)
    tables = [one for path in paths if (one := shelf.table(path, wanted, MADE_FROM)) is not None]
    days = Axis(words="Time of the plant", span=(0.0, float(SHOWN_DAYS)), marks=[
        (float(k), day_words((first + timedelta(days=k)).isoformat())) for k in range(SHOWN_DAYS)
    ])  # fmt: skip
    means = _frame(tables, first, "spindle_temperature").groupby("t")[list(PARTS[:4])].mean()
    heat = {str(k): one.to_numpy(float) for k, one in means.reset_index().items()}
    by_tool = _by_tool(tables, first, LEAST_S / state.period_s)
    order = sorted(by_tool, key=lambda word: (-len(by_tool[word]["t"]), word))[:SHOWN_TOOLS]
    strips = {"Spindle temperature, means over minutes; measured once at the beginning of each day "
              "and estimated from speed and load from there on.":
              [_strip("Spindle temperature, °C", heat, 160.0)]
              if np.isfinite(heat["measured"]).any() else [],
              "Tangential force from the spindle’s load in minutes of cutting, medians, of the "
              "tools that cut longest.":
              [_strip(f"Tangential force of tool {word}, N: {fixed(_middle(by_tool[word]), 0)} "
                      "in the median", by_tool[word], 70.0) for word in order]}  # fmt: skip
    made = sources(shelf, folder / MANIFEST, *paths)
    figures = [
        drawing(strips_figure(some, days, caption), caption, made, _legend(some))
        for caption, some in strips.items() if some
    ]  # fmt: skip
    trends = tabulated(
        "Vibration of recorded cuts", state.trends, TRENDS, sources(shelf, folder / MANIFEST),
        note="r: RMS of the band against what conditions and wear of the other tools say, at the "
        "level of the tool’s earlier cuts of the same kind; of a new tool, at that of the others.",
    )  # fmt: skip
    return Section(key="twin-state", title="State of the twin", text=list(_text(state)),
                   blocks=present(*figures, trends))  # fmt: skip


def _text(state: TwinState) -> Iterator[str]:
    served = ", ".join(f"{name} {status}" for name, status in state.submodels.items())
    yield f"What the models that serve estimate beside what was measured ({served or 'none'})."
    for name, why in state.intervals_unknown.items():
        yield f"{name.replace('_', ' ').capitalize()}: {why}."
    known = {name: sum(day.known_s[name] for day in state.days.values()) for name in QUANTITIES}
    total = sum(day.seconds for day in state.days.values())
    if total:
        words = (f"{name.replace('_', ' ')} {hours(s)}{NARROW}h" for name, s in known.items() if s)
        yield f"Of {hours(total)}{NARROW}h of records are known: {', '.join(words) or 'none'}."
    if (force := state.force) is not None and force.mape_percent is not None:
        yield (
            f"In {counted(force.levels, 'cut')} of known engagement the force from the spindle’s "
            f"load is off that of the dynamometer’s law by {number(force.mape_percent)}{NARROW}% "
            f"in the mean; up to {number(force.most_percent)}{NARROW}% is allowed."
        )


def _legend(strips: Sequence[Strip]) -> list[tuple[str, str, str]]:
    lines = [LINES[kind] for kind in LINES if any(kind == c[0] for s in strips for c in s.curves)]
    return [*lines, *([BAND] if any(one.areas for one in strips) else [])]


def _strip(head: str, one: Minutes, height: float) -> Strip:
    """A quantity and its interval over the week, broken over gaps of more than an hour."""
    gap = np.flatnonzero(np.diff(one["t"]) > HOUR / DAY) + 1
    x = np.insert(one["t"], gap, (one["t"][gap - 1] + one["t"][gap]) / 2)
    parts = {part: np.insert(one[part], gap, np.nan) for part in one if part != "t"}
    shown = {"window": "estimated", "measured": "measured"}
    ends = np.concatenate([v[np.isfinite(v)] for v in parts.values()])
    scale = None if "measured" in parts else (0.0, 1.1 * float(np.quantile(ends, 0.98)))
    known = np.isfinite(parts["low"]).any()
    return Strip(
        head=head, height=height, scale=scale, unit=head.partition(", ")[2].partition(":")[0],
        areas=[("s-band", x, parts["low"], parts["high"])] if known else [],
        curves=[(kind, x, parts[part]) for kind, part in shown.items() if part in parts],
    )  # fmt: skip


def _middle(one: Minutes) -> float:
    return float(np.median(one["estimated"]))


def _days(table: pa.Table, first: date) -> Floats:
    """Minute of each row on the plant's clock, as days since the first one shown; shape (T,)."""
    time = table["time"]
    local = clock(time.cast(pa.int64()).to_numpy(), time.type.tz or "UTC")
    since = (local - np.datetime64(first.isoformat(), "ns").astype(np.int64)) / NS
    return np.floor(since / MINUTE) * MINUTE / DAY


def _frame(tables: Sequence[pa.Table], first: date, name: str) -> pd.DataFrame:
    """Tool and parts of a quantity of all rows, with the time [d] of their minute."""
    parts = {part: f"{name}_{part}" for part in PARTS[:4] if f"{name}_{part}" in columns()}
    frames = [
        table.select(["tool_number", *parts.values()]).to_pandas().assign(t=_days(table, first))
        for table in tables
    ]
    none = pd.DataFrame(columns=["tool_number", "t", *parts.values()])
    every = pd.concat(frames or [none]).rename(columns={one: part for part, one in parts.items()})
    return every.astype(dict.fromkeys(parts, float) | {"tool_number": object})


def _by_tool(tables: Sequence[pa.Table], first: date, least: float) -> dict[str, Minutes]:
    """Force by tool: medians over minutes with at least ``least`` rows of cut."""
    rows = _frame(tables, first, "tangential_force").dropna(subset=["estimated", "tool_number"])
    groups = rows.groupby(["tool_number", "t"])[["estimated", "low", "high"]]
    medians = groups.median()[groups.size() >= least].reset_index()
    return {str(tool): {str(k): one[k].to_numpy(float) for k in ("t", "estimated", "low", "high")}
            for tool, one in medians.groupby("tool_number")}  # fmt: skip


TRENDS: tuple[Column[TrendCheck], ...] = (
    Column("Channel", lambda one: one.quantity.replace("_", " ")),
    Column("cuts", lambda one: number(one.recordings), ""),
    Column("tools", lambda one: number(one.tools), ""),
    Column("r", lambda one: Cell(text=fixed(one.correlation, 2), status="passed")
           if (one.correlation or 0.0) > one.least
           else Cell(text=fixed(one.correlation, 2) if one.correlation else NOT_KNOWN,
                     status="failed" if one.correlation else "unknown"), ""),
    Column("r, a new tool", lambda one: fixed(one.correlation_new_tool, 2), ""),
    Column("required", lambda one: f"> {fixed(one.least, 2)}", ""),
    Column("note", lambda one: one.reason or "–"),
)  # fmt: skip
