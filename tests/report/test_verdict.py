"""Head of a machine's page: its condition and its twin are two lines, and what is to be done."""

from types import SimpleNamespace

import pytest

from pipeline.charts.sections import Action, PartVerdict, SubModelPage
from pipeline.report import verdict
from pipeline.report.components import ComponentState
from pipeline.report.facts import ActionRow, Status


def facts(**parts: PartVerdict) -> SimpleNamespace:
    models = [
        SimpleNamespace(name=name, title=name, page=SubModelPage(verdict=one), judged=None)
        for name, one in parts.items()
    ]
    return SimpleNamespace(
        models=models, pages=[one.page for one in models], silence=None,
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
    monkeypatch.setattr(verdict, "component_states", lambda given, say: [])


PASSED = PartVerdict(status="passed", sentence="The spindle passed.", todo="It may serve.")
FAILED = PartVerdict(status="failed", sentence="The other failed.", todo="Record more.")


def test_a_twin_that_passed_says_nothing_of_the_machine() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, cutting=PASSED))
    assert (found.condition.status, found.condition.word) == ("unknown", "not assessed yet")
    assert (found.twin.status, found.twin.word) == ("passed", "all 2 sub-models passed")


def states(**of: Status) -> list[ComponentState]:
    return [ComponentState(key=key, status=one, word="") for key, one in of.items()]


@pytest.mark.parametrize(
    ("found", "status", "word", "said"),
    [
        (states(axes="passed", tools="passed"), "passed", "quiet", "Fine: Axes and Tools."),
        (states(axes="passed", tools="unknown"), "passed", "quiet", "not assessed: Tools."),
        (states(axes="attention", tools="passed"), "attention", "watch", "Watch: Axes."),
        (states(axes="attention", tools="failed"), "failed", "act", "Act on: Tools. Watch: Axes."),
        (
            [ComponentState(key="axes", status="passed", word="no alarm")],
            "passed",
            "quiet",
            "was assessed.",
        ),
        (states(sensors="passed", axes="unknown"), "unknown", "not assessed yet", "was assessed."),
        (states(axes="unknown"), "unknown", "not assessed yet", "was assessed."),
    ],
)
def test_the_machine_is_as_its_worst_component(
    monkeypatch, found: list[ComponentState], status: str, word: str, said: str
) -> None:
    monkeypatch.setattr(verdict, "component_states", lambda given, say: found)
    whole = verdict.machine_verdict(facts(spindle=PASSED))
    line = whole.condition
    assert (line.status, line.word) == (status, word) and line.sentences[0].endswith(said)
    assert whole.read[0] == line.sentences[0] and len(whole.read) == 3


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


def test_what_comes_first_is_read_aloud(monkeypatch) -> None:
    rows = asked("maintenance", "maintenance", "ML engineer")
    monkeypatch.setattr(verdict, "machine_actions", lambda *given, **named: rows)
    found = verdict.machine_verdict(facts(spindle=PASSED, cutting=FAILED))
    assert found.read[1:] == (
        "First: Look, T1 (now, maintenance).",
        "The twin may be used to plan the warm-up; not to plan cuts.",
    )
