"""Page of a fleet of 200 machines: groups with counts, what needs attention first."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from page_reader import outline, words
from report_folders import FLEET, empty_machine

from pipeline.charts.sections import Action
from pipeline.report.facts import ActionRow, MachineVerdict, StateLine
from pipeline.report.pages import FleetRow, fleet_page, group_of
from pipeline.report.provenance import Made
from pipeline.report.standalone_page import renderer

UNKNOWN = StateLine(status="unknown", word="not assessed yet", sentences=[])
PASSED = StateLine(status="passed", word="all 8 sub-models passed", sentences=[])
FAILED = StateLine(status="attention", word="7 of 8 sub-models passed", sentences=[])
URGENT = Action(what="Clear the fault", where="Spindle", why="410.", until="now", who="maintenance")
CHECK = replace(URGENT, what="Check the sensor", until="next stop")
MODEL = replace(URGENT, what="Record more", until="before its figures are used", who="ML engineer")


def verdict(twin: StateLine, *actions: Action) -> MachineVerdict:
    return MachineVerdict(
        condition=UNKNOWN, twin=twin, actions=[ActionRow(action=one) for one in actions]
    )


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


def page_of(root: Path, many: int) -> Path:
    kinds = [verdict(PASSED), verdict(PASSED, CHECK), verdict(FAILED, MODEL, URGENT)]
    rows = [
        FleetRow(folders=empty_machine(root, f"m{i:03d}"), verdict=kinds[i % 3],
                 group=group_of(kinds[i % 3]), last="Mon 5 Jan 2026, 14:00 UTC")
        for i in range(many)
    ]  # fmt: skip
    page = root / "index.html"
    made = renderer()("index.html.j2", page.name, Made(), index=fleet_page(rows), fleet=FLEET)
    page.write_text(made.html)
    return page


def test_two_hundred_machines_stand_in_one_line_each_the_urgent_first(tmp_path: Path) -> None:
    page = page_of(tmp_path, 200)
    text = page.read_text()
    assert "200 machines: 66 with something due now, 67 with checks for maintenance" in words(page)
    links = re.findall(r'<a href="(m\d+)\.html"', text)
    assert len(links) == len(set(links)) == 200
    assert [int(name[1:]) % 3 for name in links] == [2] * 66 + [1] * 67 + [0] * 67
    heads = [a["id"] for t, a in outline(page).tags if t == "section"]
    assert heads == ["now", "maintenance", "nothing"]
    assert len(text) < 250_000


def test_an_empty_fleet_is_said(tmp_path: Path) -> None:
    assert "No machine." in words(page_of(tmp_path, 0))
