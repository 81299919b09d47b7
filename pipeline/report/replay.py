"""Page of a replay: measured, champion, previous version, and the part that would explain it."""

from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    counted,
    day_words,
    fixed,
    hours,
    joined,
    number,
)
from pipeline.charts.sections import Section, drawing, present
from pipeline.charts.tables import Cell, Column, tabulated
from pipeline.report.provenance import Made
from pipeline.report.standalone_page import StandalonePage, rendered, source_of
from pipeline.schema.replay import Replacement, Replay, ReplayedQuantity
from pipeline.schema.twin_state import day_path

STATUS = {"named": "attention", "not told apart": "attention", "none explains": "unknown",
          "nothing to explain": "passed"}  # fmt: skip
UNIT = {"CELSIUS": "°C", "WATT": "W", "PERCENT": "%", "SECOND": "s", "MILLIMETER": "mm"}
MOST = 4
"""Quantities in the figure."""


def write_replay_page(found: Replay, folder: Path, out: Path, made: Made) -> None:
    """Write the page of a replay whose tables lie in ``folder``."""
    source = [source_of(folder / "replay.json")]
    named = found.stands or list(found.quantities)
    best = found.replaced[0].key if found.replaced and found.outcome != "none explains" else ""
    strips = [_strip(name, found, folder, best) for name in named[:MOST]]
    legend = [("l-measured", "measured", "line"), ("l-window", "champion", "line"),
              ("s-band", "its 90 % interval", "box"), ("l-free", "with the part replaced", "line"),
              ("l-mean", "version before", "line")]  # fmt: skip
    n = (date.fromisoformat(found.days[-1]) - date.fromisoformat(found.days[0])).days + 1
    marks = [(float(k), day_words(str(date.fromisoformat(found.days[0]) + pd.Timedelta(days=k))[:10]))
             for k in range(0, n, max(n // 7, 1))]  # fmt: skip
    axis = Axis(words="Time of the plant", span=(0.0, float(n)), marks=marks)
    caption = "Medians over five minutes. The champion stands for the machine without the fault."
    page = StandalonePage(
        program=f"Replay of {found.machine}", machine=found.machine, origin=found.origin,
        about=f"{found.first} to {found.last}, {found.origin} records", running="Replay",
        status=STATUS[found.outcome], word=found.outcome, sentences=[f"{found.sentence}."],
        key_figures=[("Version that serves", str(found.version), ""),
                     ("Version before", str(found.previous or NOT_KNOWN), "")],
        sections=[
            Section(key="replay", title="What was measured, and what the models say",
                    blocks=present(drawing(strips_figure(strips, axis, caption), caption, source,
                                           legend))),
            Section(key="replaced", title="Each part replaced in turn", text=[
                "A part is fitted to every other block of what stands beyond the interval and "
                "removes so much of it from the blocks between."],
                blocks=present(tabulated("Parts", found.replaced, PARTS, source))),
            Section(key="compared", title="What was compared", text=[*_text(found)],
                    blocks=present(tabulated("Quantities", list(found.quantities.items()),
                                             QUANTITIES, source))),
        ],
        computed="Estimates are computed from the records of the control.",
    )  # fmt: skip
    rendered(page, out.name, made).write(out)


def _strip(name: str, found: Replay, folder: Path, best: str) -> Strip:
    """A quantity over the days, in medians over five minutes."""
    parts = {"measured": "measured", "previous": "mean", "estimated": "window"} | (
        {best: "free"} if best else {})  # fmt: skip
    rows = pd.concat([pd.read_parquet(day_path(folder, day)) for day in found.days])
    rows = rows.set_index("time").filter(regex=f"^{name}_").astype(float)
    shown = rows.resample("5min").median().rename(columns=lambda one: one.removeprefix(f"{name}_"))
    zero = pd.Timestamp(found.days[0])
    x = ((shown.index.tz_localize(None) - zero) / pd.Timedelta(days=1)).to_numpy(float)
    unit = UNIT.get(found.quantities[name].unit, "")
    return Strip(
        head=f"{name.replace('_', ' ').capitalize()}, {unit}", unit=unit,
        curves=[(kind, x, shown[part].to_numpy()) for part, kind in parts.items()
                if part in shown and shown[part].notna().any()],
        areas=[("s-band", x, shown["low"].to_numpy(), shown["high"].to_numpy())],
    )  # fmt: skip


def _text(found: Replay) -> Iterator[str]:
    yield (
        "Beside the champion’s estimates stand what is usual for a program and tool, an axis’ speed, "
        f"a program’s cycle and a morning on {counted(len(found.known_good), 'known-good day')}."
    )
    if found.previous is None:
        yield "No version served before this one."
    for name, why in found.missing.items():
        yield f"Not compared: {name.replace('_', ' ')} ({why})."


def _parameters(row: Replacement) -> str:
    return "; ".join(f"{name} {number(value)}" for name, value in row.parameters.items()) or "–"


def _share(value: float | None) -> str:
    return "–" if value is None else f"{fixed(100 * value, 0)}{NARROW}%"


PARTS: tuple[Column[Replacement], ...] = (
    Column("Sub-model", lambda row: row.submodel),
    Column("part", lambda row: row.part),
    Column("removes", lambda row: _share(row.removed), ""),
    Column("with the other span’s parameters", lambda row: _share(row.borrowed), ""),
    Column("clearly the best in samples", lambda row: _share(row.best), ""),
    Column("parameters", _parameters),
    Column("ruled out by", lambda row: row.spoilt.replace("_", " ") or "–"),
)
QUANTITIES: tuple[Column[tuple[str, ReplayedQuantity]], ...] = (
    Column("Quantity", lambda row: row[0].replace("_", " ")),
    Column("estimate by", lambda row: row[1].basis),
    Column("compared, h", lambda row: hours(row[1].seconds), ""),
    Column("beyond the interval", lambda row: number(row[1].excess), ""),
    Column("limit", lambda row: number(row[1].limit), ""),
    Column("residual", lambda row: Cell(text="stands" if row[1].stands else "none",
                                        status="attention" if row[1].stands else "passed")),
)  # fmt: skip
