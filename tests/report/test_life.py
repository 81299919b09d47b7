"""Page of a model's life: refused, promoted against the rules, rolled back; and the lead's page."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import pytest
from page_reader import every_word, outline
from report_folders import FLEET, machine

from pipeline.report.folders import MachineFolders
from pipeline.report.pages import write_report
from pipeline.schema.bundle import Champions, Served, bundle_of, copy_bundle
from pipeline.schema.decision import Compared, Decision, Rule, Side
from pipeline.schema.history import Entry, document_of, write_history
from pipeline.schema.store import json_text, write_json, write_text

GOLDEN = Path(__file__).with_name("page_life.txt")
ERRORS = Compared(
    submodel="spindle", quantity="spindle_temperature", regime="windows", unit="K", groups=2,
    champion=0.8, challenger=1.2, result="worse", worst_group="2026-01-13",
)  # fmt: skip
RULES = (
    Rule(name="complete", result="kept"),
    Rule(name="not worse", result="broken", words=(f"worse: {ERRORS.words}",), figures=(ERRORS,)),
    Rule(name="newest day", result="no data", words=("there are no such records",)),
    Rule(name="better", result="not decided", words=("the gain is within the spread",)),
)
REFUSED = Decision(
    machine="m", origin="simulated", champion=Side(version=1, bundle="1" * 64),
    challenger=Side(version=2, bundle="2" * 64), changed=("spindle",), golden="", rules=RULES,
    serving=("spindle",), at="2026-03-01T12:00:00Z", by="Kim", why="new oil",
)  # fmt: skip
ANYWAY = replace(REFUSED, at="2026-03-01T13:00:00Z", why="no other", anyway=True)


@pytest.fixture
def folders(tmp_path: Path) -> MachineFolders:
    """A machine whose spindle serves, with the history of its choices."""
    one = replace(machine(tmp_path, "m"), history=tmp_path / "data/history/m.jsonl")
    write_json(Served(inputs={}, outputs={}), one.models / "spindle/served.json")
    assert one.champion is not None and one.history is not None
    copy_bundle(one.models, bundle_of(one.models, "m", ["spindle"]), one.champion)
    entries = [Entry(machine="m", number=1, event="first", version=1, bundle="1" * 64,
                     at="2026-02-01T00:00:00Z", by="dvc repro", why="first bundle",
                     serving=("spindle",))]  # fmt: skip
    for decision in (REFUSED, ANYWAY):
        document = json_text(decision)
        entry = Entry(
            machine="m", number=len(entries) + 1, version=2, bundle="2" * 64, at=decision.at,
            event="promoted" if decision.promoted else "refused", by=decision.by, why=decision.why,
            serving=decision.serving if decision.promoted else (), anyway=decision.overridden,
            rules=decision.objections, decision=hashlib.sha256(document.encode()).hexdigest(),
            sealed="5" * 64 if decision.anyway else "", before=entries[-1].sha256,
        )  # fmt: skip
        write_text(document, document_of(one.history, entry))
        entries.append(entry)
    write_history(entries, one.history)
    return one


def written(folders: MachineFolders, out: Path) -> Path:
    """The page of the life, in the report of the machine."""
    write_report([folders], FLEET, None, out)
    return out / "m_life.html"


def test_the_page_is_the_golden_one(folders: MachineFolders, tmp_path: Path) -> None:
    """KERF_WRITE_GOLDEN=1 stores it."""
    page = outline(written(folders, tmp_path / "out"))
    lines = [" ".join(one.split()) for one in page.text if one.strip()]
    text = "\n".join(lines).replace(f"{tmp_path.name}/", "")
    if os.environ.get("KERF_WRITE_GOLDEN"):
        GOLDEN.write_text(f"{text}\n")
    assert f"{text}\n" == GOLDEN.read_text(), f"if it is meant, write {GOLDEN.name} anew"


def test_the_page_says_against_which_rules_it_serves(
    folders: MachineFolders, tmp_path: Path
) -> None:
    said = every_word(written(folders, tmp_path / "out"))
    assert "It serves against the rules: rule 'not worse' is broken: worse: spindle" in said
    assert "mean error 1.2 K against the champion's 0.8 K over 2 groups" in said
    lead = every_word(tmp_path / "out/m.html")
    assert "Version 2 serves since 2026-03-01; it was promoted against the rules" in lead


def test_a_decision_that_was_changed_is_named_and_the_report_goes_on(
    folders: MachineFolders, tmp_path: Path
) -> None:
    assert folders.history is not None
    path = folders.history.with_suffix("") / "0003.json"
    path.write_text(path.read_text().replace("no other", "a wish"))
    said = every_word(written(folders, tmp_path / "out"))
    assert "The history of what serves cannot be read" in said
    assert "0003.json is not the decision that" in said and "git checkout" in said


def test_a_history_that_is_gone_is_named(folders: MachineFolders, tmp_path: Path) -> None:
    """champions.json, beside ``data``, names its last entry."""
    assert folders.history is not None
    champions = Champions(histories={"m": "7" * 64})
    write_json(champions, folders.history.parents[2] / "champions.json")
    folders.history.unlink()
    said = every_word(written(folders, tmp_path / "out"))
    assert "The history of what serves cannot be read" in said
    assert "lacks the entry 777777777777, the last one by champions.json" in said
