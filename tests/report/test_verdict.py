"""Head of a machine's page: its condition and its twin are two lines, and what is to be done."""

from types import SimpleNamespace

import pytest

from pipeline.charts.sections import Action, PartVerdict, SubModelPage
from pipeline.report import verdict
from pipeline.report.alarms import Alarms
from pipeline.report.facts import ActionRow
from pipeline.schema.incident import Incident, Monitored, Severity


def facts(**parts: PartVerdict) -> SimpleNamespace:
    models = [
        SimpleNamespace(name=name, title=name, page=SubModelPage(verdict=one))
        for name, one in parts.items()
    ]
    return SimpleNamespace(
        models=models, pages=[one.page for one in models], silence=None, monitored=None,
        alarms=Alarms(folders=None, shelf=None, alarms=[]),
    )  # fmt: skip


def asked(*who: str) -> list[ActionRow]:
    return [
        ActionRow(action=Action(what="Look", where="T1", why="It is due.", until="now", who=one))
        for one in who
    ]


@pytest.fixture(autouse=True)
def nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verdict, "_grave", lambda given, say: [])
    monkeypatch.setattr(verdict, "machine_actions", lambda *given, **named: [])


PASSED = PartVerdict(status="passed", sentence="The spindle passed.", todo="It may serve.")
FAILED = PartVerdict(status="failed", sentence="The other failed.", todo="Record more.")


def test_a_twin_that_passed_says_nothing_of_the_machine() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, cutting=PASSED))
    assert (found.condition.status, found.condition.word) == ("unknown", "not assessed yet")
    assert (found.twin.status, found.twin.word) == ("passed", "all 2 sub-models passed")


def incident(severity: Severity, end: str) -> Incident:
    return Incident(
        id=severity + end, machine="m", origin="simulated", component="X", title="Friction rises",
        severity=severity, check="Look at X.", who="maintenance", start=f"{end}T08:00Z",
        end=f"{end}T09:00Z", seconds=60.0, count=1, events=(),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("found", "status", "word"),
    [
        ([], "passed", "quiet"),
        ([("act", "2026-01-05")], "passed", "quiet"),  # not on the last day
        ([("watch", "2026-01-06")], "attention", "watch"),
        ([("watch", "2026-01-06"), ("act", "2026-01-06")], "failed", "act"),
    ],
)
def test_the_machine_is_what_monitoring_found_on_the_last_day(
    found: list[tuple[Severity, str]], status: str, word: str
) -> None:
    given = facts(spindle=PASSED)
    given.monitored = Monitored(
        machine="m", origin="simulated", days=("2026-01-05", "2026-01-06"), known_good=(),
        worked_s=1.0, rules={}, incidents=tuple(incident(*one) for one in found),
    )  # fmt: skip
    line = verdict.machine_verdict(given).condition
    assert (line.status, line.word) == (status, word)


def test_generated_signals_that_failed_decide_nothing_and_are_said() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, synthesis=FAILED))
    assert (found.twin.status, found.twin.word) == ("passed", "1 of 2 sub-models passed")
    assert found.passed == (1, 2)  # as many as the table has rows
    assert found.twin.sentences == ["Synthesis failed; nothing else rests on it."]


def test_a_sub_model_that_failed_is_counted_and_named() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, cutting=FAILED))
    assert (found.twin.status, found.twin.word) == ("attention", "1 of 2 sub-models passed")
    assert found.twin.sentences == ["1 failed (cutting)."]


def test_generated_signals_alone_decide_for_themselves() -> None:
    found = verdict.machine_verdict(facts(synthesis=FAILED))
    assert (found.twin.status, found.twin.word) == ("failed", "synthesis failed")


def test_checks_of_maintenance_stand_in_the_line_of_the_machine(monkeypatch) -> None:
    rows = asked("maintenance", "maintenance", "ML engineer")
    monkeypatch.setattr(verdict, "machine_actions", lambda *given, **named: rows)
    found = verdict.machine_verdict(facts(spindle=PASSED))
    assert "2 checks for maintenance below." in found.condition.sentences
