"""The newest week of the lead's page: one axis, weeks, time and alarms beside the week before."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from report_folders import (
    UTC_NS,
    empty_machine,
    live_table,
    machine,
    nanoseconds,
    write_alarms,
    write_table,
)

from pipeline.charts.sections import Figures, Section
from pipeline.charts.tables import Table
from pipeline.report.condition import weeks_section
from pipeline.report.facts import MachineFacts, machine_facts
from pipeline.report.folders import MachineFolders
from pipeline.report.texts import texts
from pipeline.report.week import alarms_of_week, time_section, week_section
from pipeline.schema.condition import Condition, WeekReport
from pipeline.schema.store import write_json
from pipeline.schema.twin_state import (
    MANIFEST,
    QUANTITIES,
    StateDay,
    TwinState,
    day_path,
    write_day,
)

EN = texts("en")
HOUR = 3600
BERLIN = "Europe/Berlin"


def drawn(section: Section | None) -> str:
    assert section is not None
    (block,) = section.blocks
    assert isinstance(block, Figures)
    return "".join(str(one.svg) for one in block.figures)


def hovers(section: Section | None) -> list[str]:
    return re.findall(r"<title>([^<]*)</title>", drawn(section))


def cells(table: object) -> list[list[str]]:
    assert isinstance(table, Table)
    return [[cell.text for cell in row] for row in table.rows]


def states(folders: MachineFolders, day: str, zone: str, *runs: tuple[str | None, float]) -> None:
    """A day of the state table from its midnight on: states, each with its length [h]."""
    execution = [state for state, hours in runs for _ in range(int(hours * HOUR))]
    start = pd.Timestamp(day, tz=zone).as_unit("ns").value
    times = pa.array(start + np.arange(len(execution)) * 10**9, pa.timestamp("ns", tz=zone))
    write_table(folders.clean / "state" / f"{day}.parquet", {
        "time": times, "execution": pa.array(execution, pa.string()),
    })  # fmt: skip


def alarm(folders: MachineFolders, *rows: tuple[str, str, str | None]) -> None:
    """Warnings by their message, from and to; None where one is still active."""
    ends = [None if one[2] is None else pd.Timestamp(one[2]).as_unit("ns").value for one in rows]
    write_table(folders.clean / "alarms.parquet", {
        "data_item": ["c"] * len(rows), "level": ["warning"] * len(rows),
        "code": [""] * len(rows), "message": [one[0] for one in rows],
        "start": pa.array([pd.Timestamp(one[1]).as_unit("ns").value for one in rows], UTC_NS),
        "end": pa.array(ends, pa.int64()).cast(UTC_NS),
        "ended": ["cleared" if one[2] else "open" for one in rows],
        "program": [""] * len(rows), "line": pa.array([None] * len(rows), pa.float64()),
    })  # fmt: skip


@pytest.fixture
def folders(tmp_path: Path) -> MachineFolders:
    return empty_machine(tmp_path, "m", "recorded")


def test_a_day_off_is_grey_one_that_lacks_records_hatched_and_one_to_come_empty(
    tmp_path: Path,
) -> None:
    """Two weeks of Monday to Friday without their second Wednesday."""
    folders = machine(tmp_path, "m", "recorded", days=12)
    for day in ("2024-03-09", "2024-03-10", "2024-03-13"):
        (folders.clean / "state" / f"{day}.parquet").unlink()
    section = week_section(machine_facts(folders), EN)
    said = [one for one in hovers(section) if one.endswith("00:00 to 24:00")]
    assert said == ["records missing, Wed\u00a013\u00a0Mar, 00:00 to 24:00"]
    assert drawn(section).count("s-apart") == 1, "the weekend stands apart"
    assert not any("16\u00a0Mar" in one for one in hovers(section)), "no source is as new"
    (block,) = section.blocks  # type: ignore[union-attr]
    words = [one[1] for one in block.legend]  # type: ignore[union-attr]
    assert words == ["active", "ready", "feed hold", "off, or not worked", "records missing",
                     "fault", "warning"]  # fmt: skip


def test_days_that_the_log_lacks_beside_other_live_sources_are_hatched(tmp_path: Path) -> None:
    """The log ends on its second Monday; temperatures go on to Thursday morning."""
    folders = machine(tmp_path, "m", "recorded", days=8)
    live_table(folders, "2024-03-14T06:00:00Z")
    said = hovers(week_section(machine_facts(folders), EN))
    lost = [one for one in said if one.startswith("records missing")]
    assert [one[17:27] for one in lost] == ["Tue\u00a012\u00a0Mar", "Wed\u00a013\u00a0Mar"]
    assert any(one.startswith("off, or not worked, Thu") for one in said), "not a whole day yet"


@pytest.mark.parametrize("day", ["2024-03-31", "2024-10-27"])
def test_a_week_with_a_change_of_the_clock(folders: MachineFolders, day: str) -> None:
    """The Sunday has 23 or 25 h; curves and alarms lie by the plant's clock."""
    states(folders, day, BERLIN, (None, 6), ("ACTIVE", 14))
    time = pd.date_range(f"{day}T00:00", f"{day}T23:50", freq="10s", tz=BERLIN).as_unit("ns")
    values = {"spindle_temperature_measured": np.linspace(20, 40, len(time)),
              "spindle_load": np.full(len(time), 30.0)}  # fmt: skip
    write_day(time, values, day_path(folders.clean.parent / "state", day))
    one = StateDay(role="held_out", seconds=1.0, known_s=dict.fromkeys(QUANTITIES, 0.0), unknown={})
    state = TwinState(bundle="b", submodels={}, period_s=10.0, days={day: one})
    write_json(state, folders.clean.parent / "state" / MANIFEST)
    alarm(folders, ("DOOR", f"{day}T12:00Z", f"{day}T12:01Z"))
    facts = machine_facts(replace(folders, twin_state=folders.clean.parent / "state"))
    section = week_section(facts, EN)
    local = "14:00" if day == "2024-03-31" else "13:00"
    assert f"DOOR: once, {EN.day(day)}, {local}" in hovers(section)
    loads = [one for one in hovers(section) if one.endswith("30.0\u00a0%")]
    assert len(loads) == (23 if day == "2024-03-31" else 24), "an hour that comes twice is one"
    assert cells(time_section(facts, EN).blocks[0])[0] == ["Active", "14.0"]


def test_repeats_are_one_mark_and_an_alarm_that_lasts_is_drawn_to_its_end(
    folders: MachineFolders,
) -> None:
    states(folders, "2024-03-11", "UTC", ("ACTIVE", 12))
    alarm(
        folders,
        ("LONG", "2024-03-09T00:00Z", "2024-03-11T06:00Z"),
        *(("X AXIS", f"2024-03-11T0{k // 60}:{k % 60:02d}Z", f"2024-03-11T0{k // 60}:{k % 60:02d}Z")
          for k in range(60, 160, 20)),
        ("X AXIS", "2024-03-11T09:00Z", "2024-03-11T09:10Z"),
        ("OPEN", "2024-03-11T11:00Z", None),
        ("OVER", "2024-03-04T11:00Z", "2024-03-04T12:00Z"),
    )  # fmt: skip
    facts = machine_facts(folders)
    said = [one for one in hovers(week_section(facts, EN)) if ": " in one]
    day = EN.day("2024-03-11")
    assert sorted(said) == [f"LONG: once, {day}, 00:00", f"OPEN: once, {day}, 11:00",
                            f"X AXIS: 5 times, from {day}, 01:00 on",
                            f"X AXIS: once, {day}, 09:00"]  # fmt: skip
    widths = re.findall(r'width="([\d.]+)%"[^>]*s-warned', drawn(week_section(facts, EN)))
    assert f"{100 / 28:.2f}" in widths, "6 h of the week"
    table = alarms_of_week(facts, EN)
    assert table is not None
    rows = cells(table.blocks[0])
    assert rows == [["LONG", "360.0", "1"], ["OPEN", "60.0", "1"], ["X AXIS", "10.0", "6"]]
    assert table.text == [EN("alarms.still", count=1)]


def test_alarms_without_a_text_are_one_mark_for_each_item(folders: MachineFolders) -> None:
    states(folders, "2024-03-11", "UTC", ("ACTIVE", 12))
    alarm(folders, *[("", "2024-03-11T06:00Z", "2024-03-11T06:01Z")] * 2)
    path = folders.clean / "alarms.parquet"
    table = pq.read_table(path).set_column(0, "data_item", pa.array(["door", "lamp"]))
    pq.write_table(table, path)
    said = [one for one in hovers(week_section(machine_facts(folders), EN)) if ": " in one]
    assert [one.partition(":")[0] for one in said] == ["door", "lamp"]


def test_alarms_of_a_machine_without_execution_states(folders: MachineFolders) -> None:
    write_alarms(folders, np.array([nanoseconds(d) for d in ("2024-03-04", "2024-03-12")]))
    facts = machine_facts(folders)
    assert week_section(facts, EN) is None
    found = alarms_of_week(facts, EN)
    assert found is not None and "week 11" in {one.name for one in found.blocks[0].heads}  # type: ignore[union-attr]
    assert time_section(facts, EN).text == [EN("time.none")]


def test_a_stop_over_midnight_is_one_with_its_program_and_its_alarm(
    folders: MachineFolders,
) -> None:
    states(folders, "2024-03-11", BERLIN, ("ACTIVE", 22), ("FEED_HOLD", 2))
    states(folders, "2024-03-12", BERLIN, ("FEED_HOLD", 3), ("ACTIVE", 1), ("STOPPED", 1))
    states(folders, "2024-03-04", BERLIN, ("READY", 10))
    start = pd.Timestamp("2024-03-11T20:00Z").as_unit("ns").value
    write_table(folders.clean / "cycles.parquet", {
        "program": ["O7"], "part": pa.array([None], pa.string()),
        "start": pa.array([start], UTC_NS), "end": pa.array([start + 10**9], UTC_NS),
        "active_s": [1.0], "feed_hold_s": [0.0], "interrupted_s": [0.0], "complete": [True],
    })  # fmt: skip
    alarm(folders, ("CHIP JAM", "2024-03-11T21:00Z", "2024-03-11T21:05Z"))
    uses, stops = time_section(machine_facts(folders), EN).blocks
    first, second = cells(stops)
    assert first[1:] == [EN.duration(5 * HOUR), "feed hold", "O7", "CHIP JAM"]
    assert first[0] == f"{EN.day('2024-03-11')}, 22:00" and second[1:3] == [
        EN.duration(HOUR),
        "stopped",
    ]
    rows = {row[0]: row[1:] for row in cells(uses)}
    assert rows["Active"] == ["23.0", "0.0", "+23.0"]
    assert rows["Ready and other"] == ["0.0", "10.0", "−10.0"]
    assert isinstance(uses, Table)
    assert [head.name for head in uses.heads[1:3]] == ["week 11", "week 10"]


def weeks(facts: MachineFacts, *values: float, state: str = "fine") -> Section | None:
    """Weeks of alarms that are 0 throughout, and of a load."""
    reports = tuple(
        WeekReport(week=f"2026-W{k:02d}", days=(), records="r", bundle="", conditions=(
            Condition(component="machine", kind="alarms", what="alarms", unit="1", value=0.0,
                      state="no line"),
            Condition(component="axis X", kind="friction", what="load", unit="%", value=value,
                      alert=20.0, alarm=30.0, state=state),  # type: ignore[arg-type]
        ))
        for k, value in enumerate(values, 1)
    )  # fmt: skip
    return weeks_section(facts.folders, facts.shelf, reports, EN)


def test_weeks_are_small_figures_the_gravest_first(folders: MachineFolders) -> None:
    found = weeks(machine_facts(folders), 10.0, 12.0, 25.0, state="watch")
    assert found is not None and found.title == EN("weeks.title", count=3, all=12)
    load, alarms = found.blocks[0].figures  # type: ignore[union-attr]
    assert load.caption == "axis X, load: 25.0\u00a0% ↑" and load.status == "attention"
    assert str(load.svg).count("grid limit") == 2
    assert alarms.caption.startswith("machine, alarms: 0") and not alarms.status
    assert alarms.caption.endswith("→"), "0 is a value"


def test_a_week_that_is_older_than_twelve_is_not_counted(folders: MachineFolders) -> None:
    facts = machine_facts(folders)
    load = Condition(component="axis X", kind="friction", what="load", unit="%", value=9.0)
    one = WeekReport(week="2019-W21", days=(), records="r", bundle="", conditions=(load,))
    old = replace(one, week="2017-W46")
    found = weeks_section(facts.folders, facts.shelf, (old, one), EN)
    assert found is not None and found.title == EN("weeks.title", count=1, all=12)
    assert found.blocks[0].figures[0].caption == "axis X, load: 9.00\u00a0%"  # type: ignore[union-attr]


def test_a_stop_has_its_own_seconds_and_the_log_its_own_end(tmp_path: Path) -> None:
    """A hold of 344 s within the steps of five minutes of the strips."""
    start = nanoseconds("2024-03-05") // 10**9 + 7 * 3600
    states = ["ACTIVE"] * 100 + ["FEED_HOLD"] * 344 + ["ACTIVE"] * 59 + ["STOPPED"] * 30
    folders = empty_machine(tmp_path, "m", "recorded")
    times = pa.array((start + np.arange(len(states))) * 10**9, pa.timestamp("ns", "UTC"))
    write_table(folders.clean / "state" / "2024-03-05.parquet",
                {"time": times, "execution": pa.array(states)})  # fmt: skip
    done = machine_facts(folders).work
    assert done.days[0].stops == [("FEED_HOLD", start + 100, start + 444)]
    assert done.last == start + len(states)
