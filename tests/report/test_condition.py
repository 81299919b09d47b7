"""Section on the condition over weeks: the newest kept report beside the one before."""

from dataclasses import replace
from pathlib import Path

from report_folders import empty_machine

from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.report.condition import condition_section
from pipeline.schema.condition import Condition, TimeToLine, WeekReport
from pipeline.schema.store import write_json


def report(week: str, value: float, **given: object) -> WeekReport:
    load = Condition(component="axis X", kind="axis_load", what="load at 20 mm/s", unit="%",
                     value=value, low=value - 1, high=value + 1, days=4, reference=10.0,
                     alert=12.0, alarm=14.0, state="watch")  # fmt: skip
    hours = Condition(component="spindle", kind="hours", what="time turning", unit="h", value=30.0,
                      days=4, state="no line")  # fmt: skip
    return WeekReport(
        week=week, days=("2026-01-05", "2026-01-06"), records="r", bundle="b",
        conditions=(replace(load, **given), hours), missing={"tool_life": "no record says when"},
    )  # fmt: skip


def cells(root: Path) -> list[str]:
    folders = replace(empty_machine(root, "m"), condition=root / "condition")
    found = condition_section(folders, SourceRegistry())
    assert found is not None and isinstance(found.blocks[0], Table)
    return [cell.text for cell in found.blocks[0].rows[0]]


def test_the_newest_week_stands_beside_the_one_before_and_not_beside_older_ones(
    tmp_path: Path,
) -> None:
    left = TimeToLine(median=3.2, low=1.4, high=None, probability=0.92, horizon=26.0,
                      confidence=0.9)  # fmt: skip
    for week, value in (("2025-W52", 99.0), ("2026-W01", 12.5), ("2026-W02", 13.0)):
        write_json(report(week, value, to_alarm=left), tmp_path / f"condition/{week}.json")
    row = cells(tmp_path)
    assert row[2] == "13.0 (12.0 to 14.0)" and row[3].startswith("+4.0")
    assert row[7] == "watch" and row[8].startswith("3 (between 1 and over 26 at 90")
    folders = replace(empty_machine(tmp_path, "m2"), condition=tmp_path / "condition")
    found = condition_section(folders, SourceRegistry())
    assert found is not None
    assert "Week 2026-W02, 2 days with records, beside 2026-W01." in found.text[0]
    assert "tool life (no record says when)" in found.text[1]


def test_a_time_beyond_the_horizon_and_a_week_that_is_too_few_are_words(tmp_path: Path) -> None:
    never = TimeToLine(median=None, low=20.0, high=None, probability=0.08, horizon=26.0,
                       confidence=0.9)  # fmt: skip
    write_json(report("2026-W02", 10.0, to_alarm=never), tmp_path / "condition/2026-W02.json")
    assert cells(tmp_path)[8].startswith("more than 26 (8")
    few = report("2026-W02", 10.0, reason="2 of 5 weeks needed")
    write_json(few, tmp_path / "condition/2026-W02.json")
    assert cells(tmp_path)[8] == "2 of 5 weeks needed"


def test_nothing_is_said_without_a_report(tmp_path: Path) -> None:
    assert condition_section(empty_machine(tmp_path, "m"), SourceRegistry()) is None
    (tmp_path / "condition").mkdir()
    (tmp_path / "condition/2026-W02.json").write_text("{}")
    folders = replace(empty_machine(tmp_path, "m2"), condition=tmp_path / "condition")
    shelf = SourceRegistry()
    assert condition_section(folders, shelf) is None and shelf.broken
