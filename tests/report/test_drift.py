"""Section on drift of a machine's page: quiet, asking, without a night, and a broken ledger."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.report.drift import drift_actions, drift_section
from pipeline.report.facts import MachineFacts, machine_facts
from pipeline.report.folders import MachineFolders
from pipeline.report.texts import texts
from pipeline.schema.bundle import Bundle, BundledModel
from pipeline.schema.ledger import Night, write_ledger
from pipeline.schema.store import write_json

QUIET = Night(
    night="2026-02-03", bundle="b", model="m", submodel="spindle", quantity="spindle_temperature",
    regime="windows", unit="K", records="r", n=400, mae=0.5, share=0.28, result="within",
)  # fmt: skip
ASKS = replace(
    QUIET, night="2026-02-04", share=1.4, result="over", ask="identification", reason="heat",
    since="2026-02-01",
    rule="over the error budget on two nights running", words="it goes with the temperature",
)  # fmt: skip


def facts(root: Path, *nights: Night) -> MachineFacts:
    path = root / "ledger/mill.jsonl"
    write_ledger(nights, path)
    served = {"spindle": BundledModel(sha256="m", status="passed")}
    bundle = Bundle(machine="mill", origin="recorded", sha256="b", submodels=served)
    write_json(bundle, root / "champion/bundle.json")
    return machine_facts(
        MachineFolders(
            name="mill", signals=root, clean=root, models=root / "models", golden=root / "g.json",
            origin="recorded", submodels=("spindle",), ledger=path,
            champion=root / "champion",
        )
    )  # fmt: skip


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_page_says_in_one_sentence_whether_a_model_drifted(
    tmp_path: Path, language: str
) -> None:
    say = texts(language)
    quiet = drift_section(facts(tmp_path / "a", QUIET), say)
    assert (
        quiet is not None
        and "1" in quiet.text[0]
        and "28" in quiet.text[0]
        and len(quiet.text) == 1
    )
    found = facts(tmp_path / "b", QUIET, ASKS)
    asking = drift_section(found, say)
    assert asking is not None
    (row,) = drift_actions(found, say)
    assert row.action.who == "maintenance" and row.href == "#drift"
    assert row.action.what in asking.text[0]
    assert say.day("2026-02-01", year=True) in asking.text[0], "not since the first night"
    (table,) = asking.blocks
    (cells,) = table.rows  # type: ignore[union-attr]
    assert "28" in cells[2].text and "140" in cells[2].text and cells[-1].status == "failed"
    assert drift_section(facts(tmp_path / "c"), say) is None


def test_a_broken_ledger_is_named_and_the_page_goes_on(tmp_path: Path) -> None:
    found = facts(tmp_path, QUIET)
    assert found.folders.ledger is not None
    found.folders.ledger.write_text("{}\n")
    again = machine_facts(found.folders)
    assert again.nights == () and any("mill.jsonl" in name for name in again.shelf.broken)
