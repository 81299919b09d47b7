"""Section on the state of the twin: the newest week, its band, the force of tools."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from report_folders import empty_machine

from pipeline.charts.sections import Figures
from pipeline.charts.sources import SourceRegistry
from pipeline.report.twin_state import twin_state_section
from pipeline.schema.store import write_json
from pipeline.schema.twin_state import (
    MANIFEST,
    QUANTITIES,
    ForceCheck,
    StateDay,
    TrendCheck,
    TwinState,
    day_path,
    write_day,
)

N = 7200
DAYS = ("2025-12-01", "2026-01-05", "2026-01-09")


def state(folder: Path, *, low: bool = True) -> TwinState:
    """Two hours on each of three days; tool 4 cuts at 200 N, tool 7 for five seconds."""
    tool = np.array(["4"] * (N - 5) + ["7"] * 5)
    force = np.where(np.arange(N) < 3600, np.nan, 200.0)
    for day in DAYS:
        time = pd.date_range(f"{day}T08:00", periods=N, freq="s", tz="UTC").as_unit("ns")
        heat = {"measured": 30.0, "estimated": 31.0, "residual": -1.0}
        heat |= {"low": 29.0, "high": 33.0} if low else {}
        values = {f"spindle_temperature_{k}": np.full(N, v) for k, v in heat.items()}
        values |= {f"tangential_force_{k}": force * s
                   for k, s in (("estimated", 1.0), ("low", 0.9), ("high", 1.1))}  # fmt: skip
        values["tool_number"] = tool
        write_day(time, values, day_path(folder, day))
    known = dict.fromkeys(QUANTITIES, 0.0) | {"tangential_force": 3600.0}
    one = StateDay(role="held_out", seconds=N, unknown={}, known_s=known)
    found = TwinState(
        bundle="b", submodels={"spindle": "failed"}, period_s=1.0,
        days=dict.fromkeys(DAYS, one), force=ForceCheck(
            recordings=("a",), levels=8, mape_percent=2.6, most_percent=20.0),
        trends=(TrendCheck(quantity="vibration_x", recordings=50, tools=5, correlation=0.7,
                           correlation_new_tool=0.3, least=0.85),),
        temperature_interval_unknown="" if low else "3 training cases give none",
    )  # fmt: skip
    write_json(found, folder / MANIFEST)
    return found


def section(root: Path, **kwargs: bool):
    state(root / "state", **kwargs)
    folders = replace(empty_machine(root, "m"), twin_state=root / "state")
    found = twin_state_section(folders, SourceRegistry())
    assert found is not None
    return found


def test_the_newest_week_is_shown_with_its_band_and_its_tools(tmp_path: Path) -> None:
    found = section(tmp_path)
    (week,) = found.blocks
    assert isinstance(week, Figures)
    drawn = str(week.figures[0].svg)
    assert drawn.count("s-band") == 1 and "curve window" in drawn
    assert [source.path.rpartition("/")[2] for source in week.figures[0].sources] == [
        MANIFEST, "2026-01-05.parquet", "2026-01-09.parquet"
    ]  # fmt: skip
    heads = re.findall(r"Tangential force of tool (\d+), N: (\d+)", drawn)
    assert heads == [("4", "200")], "five seconds in cut are no minute"
    text = " ".join(found.text)
    assert "vibration x 0.70 (0.30) in 50 cuts of 5 tools" in text
    assert "spindle failed" in text and "2.60" in text and "tangential force 3.0" in text


def test_an_interval_that_is_not_known_is_said_and_not_drawn(tmp_path: Path) -> None:
    found = section(tmp_path, low=False)
    assert "3 training cases give none" in " ".join(found.text)


def test_nothing_is_said_where_nothing_was_estimated(tmp_path: Path) -> None:
    folders = replace(empty_machine(tmp_path, "m"), twin_state=tmp_path / "state")
    assert twin_state_section(folders, SourceRegistry()) is None
    found = state(tmp_path / "state")
    write_json(replace(found, days={}), tmp_path / "state" / MANIFEST)
    alone = twin_state_section(folders, SourceRegistry())
    assert alone is not None and not alone.blocks and len(alone.text) == 3, (
        "recordings without a day of a log"
    )
    write_json(replace(found, days={}, trends=()), tmp_path / "state" / MANIFEST)
    assert twin_state_section(folders, SourceRegistry()) is None
    (tmp_path / "state" / MANIFEST).write_text("{}")
    shelf = SourceRegistry()
    assert twin_state_section(folders, shelf) is None and shelf.broken
