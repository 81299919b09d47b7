"""Head of a machine's page: which sub-model decides, and which is only told."""

from types import SimpleNamespace

import pytest

from pipeline.charts.sections import PartVerdict, SubModelPage
from pipeline.report import verdict


def facts(**parts: PartVerdict) -> SimpleNamespace:
    models = [
        SimpleNamespace(name=name, page=SubModelPage(verdict=one)) for name, one in parts.items()
    ]
    return SimpleNamespace(models=models, pages=[one.page for one in models], parts=())


@pytest.fixture(autouse=True)
def nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_grave", "_notes", "warning_words"):
        monkeypatch.setattr(verdict, name, lambda given: [])
    monkeypatch.setattr(verdict, "loading_words", lambda given: "")


PASSED = PartVerdict(status="passed", sentence="The spindle passed.", todo="Nothing to repair.")
FAILED = PartVerdict(status="failed", sentence="The other failed.", todo="Record more.")


def test_generated_signals_that_failed_are_told_and_reserve_nothing() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, synthesis=FAILED))
    assert (found.status, found.todo) == ("passed", "Nothing to repair.")
    assert "The other failed." in found.notes


def test_any_other_sub_model_that_failed_is_a_reservation() -> None:
    found = verdict.machine_verdict(facts(spindle=PASSED, cutting=FAILED))
    assert (found.status, found.todo) == ("attention", "Record more.")


def test_generated_signals_alone_decide_for_themselves() -> None:
    found = verdict.machine_verdict(facts(synthesis=FAILED))
    assert (found.status, found.todo) == ("failed", "Record more.")
