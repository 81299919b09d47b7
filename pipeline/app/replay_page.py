"""Page of a replay: measured, champion, version before, and the part that would explain it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, day_words, fixed, hours, number
from pipeline.charts.sections import Section, drawing, present
from pipeline.charts.tables import Cell, Column, tabulated
from pipeline.monitoring.replay import Replacement, Replay, ReplayedQuantity
from pipeline.report.provenance import Made
from pipeline.report.standalone_page import StandalonePage, rendered, source_of
from pipeline.schema.twin_state import day_path

UNITS = {"CELSIUS": "°C", "WATT": "W", "PERCENT": "%", "SECOND": "s", "MILLIMETER": "mm"}
MOST = 4
"""Quantities in the figure."""
CURVES = {"measured": "measured", "estimated": "window", "previous": "speed"}
"""Look of each curve; the part's is ``free``."""
LEGEND = [
    ("l-measured", "measured", "line"), ("l-window", "champion", "line"),
    ("s-band", "its 90 % interval", "box"), ("l-free", "with the best part replaced", "line"),
    ("l-speed", "version before", "line"),
]  # fmt: skip


def write_replay_page(found: Replay, folder: Path, out: Path, made: Made) -> None:
    """Write the page of a replay whose tables lie in ``folder``."""
    source = [source_of(folder / "replay.json")]
    shown = (found.stands or list(found.quantities))[:MOST]
    tables = pd.concat([pd.read_parquet(day_path(folder, day)) for day in found.days])
    rows = (
        tables.set_index("time").tz_localize(None).select_dtypes("number").resample("5min").median()
    )
    first, last = pd.Timestamp(found.days[0]), pd.Timestamp(found.days[-1])
    n = (last - first).days + 1
    marks = [(float(k), day_words(str((first + pd.Timedelta(days=k)).date())))
             for k in range(0, n, max(n // 7, 1))]  # fmt: skip
    caption = "Medians over five minutes; the champion stands for the machine without the fault."
    axis = Axis(words="Time of the plant", span=(0.0, float(n)), marks=marks)
    figure = strips_figure([_strip(name, found, rows) for name in shown], axis, caption)
    page = StandalonePage(
        program=f"Replay of {found.machine}", machine=found.machine, origin=found.origin,
        about=f"{found.first} to {found.last}", running="Replay",
        status="attention" if found.stands else "passed",
        word=" or ".join(found.named) or ("not explained" if found.stands else "as expected"),
        sentences=[f"{found.sentence[:1].upper()}{found.sentence[1:]}."],
        key_figures=[("Version that serves", str(found.version or NOT_KNOWN), ""),
                     ("Version before", str(found.previous or "none"), "")],
        sections=[
            Section(key="replay", title="What was measured, and what the models say",
                    blocks=present(drawing(figure, caption, source, LEGEND))),
            Section(key="replaced", title="Each part replaced in turn", text=[
                "A part is fitted to every other block of what stands beyond the intervals, and "
                "removes so much of it from the blocks between."],
                blocks=present(tabulated("Parts", found.replaced, PARTS, source))),
            Section(key="compared", title="What was compared", text=list(_text(found)),
                    blocks=present(tabulated("Quantities", list(found.quantities.items()),
                                             QUANTITIES, source))),
        ],
        computed="Estimates are computed; what stands as measured comes from the control’s log.",
    )  # fmt: skip
    rendered(page, out.name, made).write(out)


def _strip(name: str, found: Replay, rows: pd.DataFrame) -> Strip:
    best = {found.replaced[0].key: "free"} if found.named else {}
    first = np.datetime64(found.days[0])
    x = ((rows.index.to_numpy() - first) / np.timedelta64(1, "D")).astype(float)
    unit = UNITS.get(found.quantities[name].unit, "")
    return Strip(
        head=f"{name.replace('_', ' ').capitalize()}, {unit}", unit=unit,
        curves=[(kind, x, rows[f"{name}_{part}"].to_numpy(float))
                for part, kind in (CURVES | best).items() if f"{name}_{part}" in rows],
        areas=[("s-band", x, rows[f"{name}_low"].to_numpy(float),
                rows[f"{name}_high"].to_numpy(float))],
    )  # fmt: skip


def _text(found: Replay) -> Iterator[str]:
    good = counted(len(found.known_good), "known-good day")
    yield f"What no model estimates is compared with what is usual on {good}."
    yield from (f"Not compared: {k.replace('_', ' ')} ({why})." for k, why in found.missing.items())


def _share(value: float | None) -> str:
    return "–" if value is None else f"{fixed(100 * value, 0)}{NARROW}%"


PARTS: tuple[Column[Replacement], ...] = (
    Column("Sub-model", lambda row: row.submodel),
    Column("part", lambda row: row.part),
    Column("removes", lambda row: _share(row.removed), ""),
    Column("with the other span’s parameters", lambda row: _share(row.borrowed), ""),
    Column("sub-model clearly the best", lambda row: _share(row.best), ""),
    Column("parameters", lambda row: "; ".join(
        f"{name} {number(value)}" for name, value in row.parameters.items()) or "–"),
    Column("ruled out by", lambda row: row.spoilt.replace("_", " ") or "–"),
)  # fmt: skip
QUANTITIES: tuple[Column[tuple[str, ReplayedQuantity]], ...] = (
    Column("Quantity", lambda row: row[0].replace("_", " ")),
    Column("estimate", lambda row: row[1].basis),
    Column("compared, h", lambda row: hours(row[1].seconds), ""),
    Column("beyond the interval", lambda row: number(row[1].excess), ""),
    Column("limit", lambda row: number(row[1].limit), ""),
    Column("residual", lambda row: Cell(text="stands" if row[1].stands else "none",
                                        status="attention" if row[1].stands else "passed")),
)  # fmt: skip
