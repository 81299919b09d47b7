"""Page of a fleet of 200 machines: groups with counts, what needs attention first, 90 days each."""

import re
import time
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from page_reader import outline, words
from report_folders import FLEET, empty_machine

from pipeline.charts.sections import Action
from pipeline.report.facts import ActionRow, MachineVerdict, StateLine, machine_facts
from pipeline.report.fleet_page import (
    DAYS,
    HEIGHTS,
    FleetRow,
    day_bar,
    fleet_page,
    fleet_row,
    group_of,
    kinds_of_days,
)
from pipeline.report.provenance import Made
from pipeline.report.records import FileRead
from pipeline.report.standalone_page import renderer
from pipeline.report.texts import ENGLISH, languages, texts
from pipeline.report.work import NO_RECORD, Day, Work

UNKNOWN = StateLine(status="unknown", word="not assessed yet", sentences=[])
PASSED = StateLine(status="passed", word="all 8 sub-models passed", sentences=[])
FAILED = StateLine(status="attention", word="7 of 8 sub-models passed", sentences=[])
URGENT = Action(what="Clear the fault", where="Spindle", why="410.", until="now", who="maintenance")
CHECK = replace(URGENT, what="Check the sensor", until="next stop")
MODEL = replace(URGENT, what="Record more", until="before its figures are used", who="ML engineer")
LAST = date(2026, 3, 31)  # a Tuesday
HOUR = 3600.0


def verdict(twin: StateLine, *actions: Action) -> MachineVerdict:
    rows = [ActionRow(action=one, risk=2 if one is URGENT else 0) for one in actions]
    return MachineVerdict(condition=UNKNOWN, twin=twin, actions=rows)


@pytest.mark.parametrize(
    ("given", "group"),
    [
        (verdict(PASSED), "nothing"), (verdict(PASSED, CHECK), "maintenance"),
        (verdict(FAILED, CHECK, URGENT), "now"), (verdict(FAILED, MODEL), "twin"),
        (verdict(PASSED, MODEL), "other"), (verdict(UNKNOWN), "unknown"),
        (verdict(UNKNOWN, URGENT), "now"),
    ],
)  # fmt: skip
def test_the_most_urgent_action_names_the_group(given: MachineVerdict, group: str) -> None:
    assert group_of(given) == group


def day(at: date, hours: float) -> Day:
    """A day on which the machine is on for eight hours and runs for some of them."""
    seconds = {"ACTIVE": hours * HOUR, "READY": (8 - hours) * HOUR, NO_RECORD: 16 * HOUR}
    none = np.full(288, np.nan)
    return Day(day=at.isoformat(), seconds=seconds, running=None, position_control=None,
               speed_known=None, runs=[("ACTIVE", 96, 192)], speed=none, held=none)  # fmt: skip


def facts(hours: dict[date, float], incidents=(), **others) -> SimpleNamespace:
    days = [day(at, many) for at, many in sorted(hours.items())]
    work = Work(folders=None, shelf=None, days=days, cycles=None, state_files=[])
    monitored = SimpleNamespace(incidents=incidents)
    return SimpleNamespace(work=work, monitored=monitored, **others)


def weekdays(many: int) -> dict[date, float]:
    days = (LAST - timedelta(days=k) for k in range(many))
    return {one: 6.0 for one in days if one.weekday() < 5}


def incident(severity: str, first: date, last: date) -> SimpleNamespace:
    at = (datetime(d.year, d.month, d.day, 10, tzinfo=UTC).isoformat() for d in (first, last))
    return SimpleNamespace(severity=severity, start=next(at), end=next(at), events=())


def test_each_of_ninety_days_has_the_kind_that_its_records_give_it() -> None:
    hours = weekdays(120)
    stood, lost, bad, odd = (LAST - timedelta(days=k) for k in (1, 6, 8, 11))
    hours[stood] = 0.0
    del hours[lost]
    kinds = kinds_of_days(facts(hours, [
        incident("act", bad, bad), incident("watch", odd, odd + timedelta(days=4)),
        incident("watch", bad, bad), incident("note", LAST, LAST),
    ]))  # fmt: skip
    assert len(kinds) == DAYS and max(kinds) == LAST.isoformat()
    of = {one: kinds[one.isoformat()] for one in (LAST, stood, lost, bad, odd)}
    assert list(of.values()) == ["worked", "stood", "lost", "act", "watch"]
    weekends = {k for d, k in kinds.items() if date.fromisoformat(d).weekday() > 4}
    assert weekends == {"off"}, "a usual weekend is grey, also within an incident"


def test_days_before_the_first_record_are_none_and_a_hole_of_weeks_is_grey() -> None:
    young = kinds_of_days(facts(weekdays(12)))
    assert len(young) == 12 and set(young.values()) == {"worked", "off"}
    early = {LAST - timedelta(days=60): 6.0, LAST: 6.0}
    assert set(kinds_of_days(facts(early)).values()) == {"worked", "off"}


def test_a_machine_without_a_log_has_no_bar_and_one_that_never_ran_stood() -> None:
    assert kinds_of_days(facts({})) == {} and day_bar(facts({}), ENGLISH) is None
    assert set(kinds_of_days(facts({LAST: 0.0})).values()) == {"stood"}


@pytest.mark.parametrize("language", languages())
def test_a_bar_says_its_counts_and_draws_each_day_once(language: str) -> None:
    given = facts(weekdays(90), [incident("act", LAST, LAST)])
    bar, say = str(day_bar(given, texts(language))), texts(language)
    assert f"{say('fleet.day.act')} 1" in bar and say("fleet.day.lost") not in bar
    widths = [int(w) for w in re.findall(r"h(\d+)v", bar)]
    assert sum(widths) == DAYS and len(bar) < 2500
    assert len(set(HEIGHTS[kind] for kind in ("worked", "stood", "off", "lost"))) == 4


def page_of(root: Path, many: int) -> Path:
    kinds = [verdict(PASSED), verdict(PASSED, CHECK), verdict(FAILED, MODEL, URGENT)]
    incidents = [incident("act", LAST - timedelta(days=5), LAST)]
    bar = day_bar(facts(weekdays(90), incidents), ENGLISH)
    parts = ("Spindle", "Axes", "Tools", "Coolant and oil", "Sensors", "Control", "Twin")
    shapes = tuple((name, "attention", "watch, load of the spindle rises") for name in parts)
    rows = [
        FleetRow(folders=empty_machine(root, f"m{i:03d}"), verdict=kinds[i % 3], bar=bar,
                 group=group_of(kinds[i % 3]), last="Mon 5 Jan 2026, 14:00 UTC", shapes=shapes)
        for i in range(many)
    ]  # fmt: skip
    page = root / "index.html"
    made = renderer()("index.html.j2", page.name, Made(), index=fleet_page(rows), fleet=FLEET)
    page.write_text(made.html)
    return page


def test_two_hundred_machines_stand_in_one_line_each_the_urgent_first(tmp_path: Path) -> None:
    begin = time.process_time()
    page = page_of(tmp_path, 200)
    assert time.process_time() - begin < 5.0  # a quarter of a second; slow machines count too
    text = page.read_text()
    assert "200 machines: 66 with something due now, 67 with checks for maintenance" in words(page)
    links = re.findall(r'<a href="(m\d+)\.html"', text)
    assert len(links) == len(set(links)) == 200
    assert [int(name[1:]) % 3 for name in links] == [2] * 66 + [1] * 67 + [0] * 67
    heads = [a["id"] for t, a in outline(page).tags if t == "section"]
    assert heads == ["now", "maintenance", "nothing"]
    assert len(text) < 1_000_000
    assert text.count("<details>") == 1 and text.index("<details>") > text.index('id="nothing"')


def test_a_row_has_the_whole_first_action_its_deadline_and_owner(tmp_path: Path) -> None:
    text = words(page_of(tmp_path, 3))
    assert "Clear the fault: Spindle and 1 more now maintenance" in text


def test_the_greater_risk_comes_first_within_a_group(tmp_path: Path) -> None:
    given = {"a": verdict(PASSED, CHECK, CHECK), "b": verdict(FAILED, URGENT)}
    rows = [FleetRow(folders=empty_machine(tmp_path, name), verdict=one, group="now")
            for name, one in given.items()]  # fmt: skip
    (group,) = fleet_page(rows).groups
    assert [row.folders.name for row in group.rows] == ["b", "a"]


def test_the_last_record_is_that_of_the_machines_log(tmp_path: Path) -> None:
    folders = empty_machine(tmp_path, "m")
    made = machine_facts(folders)
    row = fleet_row(made, verdict(PASSED), ENGLISH)
    assert row.last == "nothing read" and row.bar is None
    log = facts(weekdays(5)).work
    newer = replace(made.records, files={"other.csv": FileRead(last="2027-01-01T00:00:00Z")})
    row = fleet_row(replace(made, work=log, records=newer), verdict(PASSED), ENGLISH)
    assert " ".join(row.last.split()) == "Tue 31 Mar 2026, 16:00 UTC"


def test_an_empty_fleet_is_said(tmp_path: Path) -> None:
    assert "No machine." in words(page_of(tmp_path, 0))
