"""State of the twin over the newest week: force of cutting by tool, rows for other pages."""

from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import NARROW, counted, day_words, fixed, hours, number
from pipeline.charts.sections import Figures, Section, drawing, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import sources
from pipeline.report.folders import MachineFolders
from pipeline.schema.arrays import Floats
from pipeline.schema.twin_state import MANIFEST, QUANTITIES, TwinState, day_path

MADE_FROM = "the champion and data/clean, by the stage state"
SHOWN_DAYS, SHOWN_TOOLS = 7, 4
"""Days up to the newest one, and tools of them that cut longest, in the figure."""
LEAST_S = 10.0
"""Least known time of a minute that counts [s]."""
HEAT, FORCE = "spindle_temperature", "tangential_force"
SHOWN = {HEAT: ("measured", "estimated", "low", "high"), FORCE: ("estimated", "low", "high")}
"""Quantities of the figure with the parts that are drawn."""
LEGEND = [
    ("l-window", "estimated", "line"), ("s-band", "90 % interval of the estimate", "box"),
]  # fmt: skip


def twin_state_section(folders: MachineFolders, shelf: SourceRegistry) -> Section | None:
    """What the champion estimates over the newest week; None where nothing was estimated."""
    folder = folders.twin_state
    state = None if folder is None else shelf.read(folder / MANIFEST, TwinState, MADE_FROM)
    if folder is None or state is None or not (state.days or state.trends):
        return None
    week = _week(state, folders, shelf) if state.days else None
    return Section(key="twin-state", title="State of the twin", text=list(_text(state)),
                   blocks=present(week))  # fmt: skip


def state_rows(
    folders: MachineFolders, shelf: SourceRegistry, first: str, last: str, columns: tuple[str, ...]
) -> tuple[pd.DataFrame, list[Path]]:
    """Rows of the days from ``first`` to ``last`` by the plant's clock, and the files read."""
    folder = folders.twin_state
    state = None if folder is None else shelf.read(folder / MANIFEST, TwinState, MADE_FROM)
    if folder is None or state is None:
        return pd.DataFrame(), []
    paths = [day_path(folder, day) for day in state.days if first <= day <= last]
    tables = [table for path in paths if (table := shelf.table(path, columns, MADE_FROM))]
    if not tables:
        return pd.DataFrame(), []
    rows = pd.concat([one.to_pandas() for one in tables]).set_index("time").tz_localize(None)
    return rows, [folder / MANIFEST, *paths]


def parts_by(rows: pd.DataFrame, name: str, every: str, least: float) -> pd.DataFrame:
    """Medians of the parts of a quantity in steps of time, unknown where too few rows are known."""
    parts = rows[[f"{name}_{part}" for part in SHOWN[name]]].set_axis(SHOWN[name], axis=1)
    steps = parts.resample(every)
    return steps.median().where(steps.count() >= least)


def days_since(times: pd.Index, first: date) -> Floats:
    """Time since midnight of a day [d], shape (T,)."""
    since = (times.to_numpy() - np.datetime64(first)) / np.timedelta64(1, "D")
    return np.asarray(since, np.float64)


def strip_of(
    head: str, name: str, shown: pd.DataFrame, first: date, height: float, zero: bool = False
) -> Strip:
    """A quantity in its 90 % band; without a curve where it is not known."""
    x = days_since(shown.index, first)
    drawn = {part: shown[part].to_numpy(float) for part in SHOWN[name] if shown[part].notna().any()}
    kinds = {"estimated": "window", "measured": "measured"}
    return Strip(
        head=head, height=height, zero=zero, unit=head.partition(", ")[2].partition(":")[0],
        curves=[(kind, x, drawn[part]) for part, kind in kinds.items() if part in drawn],
        areas=[("s-band", x, drawn["low"], drawn["high"])] if "low" in drawn else [],
    )  # fmt: skip


def _week(state: TwinState, folders: MachineFolders, shelf: SourceRegistry) -> Figures | None:
    """Force of the tools that cut longest in the newest week; None where it is not known."""
    last = max(state.days)
    first = date.fromisoformat(last) - timedelta(days=SHOWN_DAYS - 1)
    columns = ("time", "tool_number", *(f"{FORCE}_{part}" for part in SHOWN[FORCE]))
    rows, files = state_rows(folders, shelf, first.isoformat(), last, columns)
    if rows.empty:
        return None
    cut, strips = rows[rows[f"{FORCE}_estimated"].notna()], []
    for tool in cut["tool_number"].value_counts().index[:SHOWN_TOOLS]:
        own = cut[cut["tool_number"] == tool]
        head = (f"Tangential force of tool {tool}, N: "
                f"{fixed(float(own[f'{FORCE}_estimated'].median()), 0)} in the median")  # fmt: skip
        minutes = parts_by(own, FORCE, "1min", LEAST_S / state.period_s)
        strips.append(strip_of(head, FORCE, minutes, first, 70.0, zero=True))
    shown = [one for one in strips if one.curves]
    caption = (
        "Medians over minutes of the force by the spindle’s load, of the tools that cut longest. "
        "The spindle temperature in its band is on the machine’s page."
    )
    days = Axis(words="Time of the plant", span=(0.0, float(SHOWN_DAYS)), marks=[
        (float(k), day_words((first + timedelta(days=k)).isoformat())) for k in range(SHOWN_DAYS)
    ])  # fmt: skip
    made = sources(shelf, *files)
    return drawing(strips_figure(shown, days, caption), caption, made, LEGEND) if shown else None


def _text(state: TwinState) -> Iterator[str]:
    served = ", ".join(f"{name} {status}{', not used' * (name in state.idle)}"
                       for name, status in state.submodels.items())  # fmt: skip
    yield f"What the champion’s models estimate beside what was measured ({served or 'none'})."
    if state.temperature_interval_unknown:
        yield f"Spindle temperature: {state.temperature_interval_unknown}."
    total = sum(day.seconds for day in state.days.values())
    if total:
        known = {name: sum(day.known_s[name] for day in state.days.values()) for name in QUANTITIES}
        words = (f"{name.replace('_', ' ')} {hours(s)}{NARROW}h" for name, s in known.items() if s)
        yield f"Estimated in {hours(total)}{NARROW}h of records: {', '.join(words) or 'nothing'}."
    if (force := state.force) is not None and force.mape_percent is not None:
        yield (
            f"In {counted(force.levels, 'cut')} of known engagement the force from the spindle’s "
            f"load is off that of the dynamometer’s law by {number(force.mape_percent)}{NARROW}% "
            f"in the mean; up to {number(force.most_percent)}{NARROW}% is allowed."
        )
    if state.trends:
        channels = "; ".join(
            f"{one.quantity.replace('_', ' ')} {fixed(one.correlation, 2)} "
            f"({fixed(one.correlation_new_tool, 2)}) in {counted(one.recordings, 'cut')} of "
            f"{counted(one.tools, 'tool')}{', ' * bool(one.reason)}{one.reason}"
            for one in state.trends
        )
        yield (
            "Vibration of recorded cuts correlates with what conditions, wear and the tool’s "
            f"earlier cuts say (in brackets: of a new tool) by {channels}; more than "
            f"{fixed(state.trends[0].least, 2)} is required."
        )
