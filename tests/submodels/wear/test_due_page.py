"""Tools due on the machine's page: tables, words, notes at its head, truth of simulated ones."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.charts.sections import Heading, Section
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact, JudgedCase
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear import due
from pipeline.submodels.wear.due import Estimate, Lasting, due_facts, fit_lasting
from pipeline.submodels.wear.model import WearModel
from pipeline.submodels.wear.page import due_key_figures, due_notes, due_section, due_truth
from tests.submodels.wear.shop_lives import followed, life_settings, tools, windows
from tests.submodels.wear.worn_tools import Built, build

SETTINGS = life_settings("mill01")
SIGNALS = {"T26": Estimate(wear=150.0, low=120.0, high=180.0),
           "T34": Estimate(wear=60.0, low=20.0, high=100.0),
           "T24": Estimate(wear=230.0, low=200.0, high=260.0)}  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("wear"))


@pytest.fixture(scope="module")
def lasting() -> Lasting:
    some = tools("mill01", training=True)
    return fit_lasting(windows("mill01", 2, some, forces=True, every=2), SETTINGS)


def shown(built: Built, lasting: Lasting, **changes: Any) -> Shown[WearModel]:
    """Page of a model with the lives of the shop's tools, and what was judged of three of them."""
    law = lasting.life
    facts: Mapping[str, Mapping[str, Fact]] = {} if law is None else {
        tool: due_facts(windows("mill01", 2, [tool]), one, law, SETTINGS)
        for tool, one in SIGNALS.items()
    }  # fmt: skip
    cases = tuple(
        JudgedCase(case=tool, group=tool, role="held_out", facts=one) for tool, one in facts.items()
    )
    one = Shown(
        machine="rig", origin="simulated", model=replace(built.model, lasting=lasting),
        verdict=replace(built.judged.verdict, cases=cases), predictions=None,
        shelf=SourceRegistry(), folder=built.folder,
    )  # fmt: skip
    return replace(one, **changes)


def section(of: Shown[WearModel]) -> Section:
    found = due_section(of)
    assert found is not None
    return found


def rows(found: Section, caption: str) -> dict[str, list[str]]:
    """Rows of the table whose caption begins so, by their first cell."""
    (table,) = (b for b in found.blocks if isinstance(b, Table) and b.caption.startswith(caption))
    return {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}


def test_tools_in_use_stand_in_the_order_in_which_they_are_due(
    built: Built, lasting: Lasting
) -> None:
    found = section(shown(built, lasting))
    table = rows(found, "Tools in use")
    assert list(table) == ["T26", "T34"]
    kind, time, read, now, left, by, todo = table["T26"]
    life = followed("mill01", 2, "T26")
    assert kind == "EM12Z4" and float(time) == pytest.approx(life.times[-1], rel=0.01)
    assert "µm at" in read and now.startswith("150 (120") and "min" in left
    assert by in (due.READING, due.SIGNALS) and todo.endswith(".")
    assert found.title == "Tools due (simulated)"
    used = rows(found, "Tools that were used up")
    assert set(used) == set(tools("mill01", training=True))


def test_signals_of_a_model_that_failed_are_not_relied_on(built: Built, lasting: Lasting) -> None:
    one = shown(built, lasting)
    assert one.verdict is not None
    failed = replace(one, verdict=replace(one.verdict, status="failed"))
    *_, now, _, by, _ = rows(section(failed), "Tools in use")["T26"]
    assert now.endswith("not relied on") and by == due.READING


def test_the_head_names_the_next_tool_and_those_to_be_changed_soon(
    built: Built, lasting: Lasting
) -> None:
    one = shown(built, lasting)
    ((name, tool, aside),) = due_key_figures(one)
    assert (name, tool) == ("Next tool due", "T26") and aside.startswith("in ")
    worn = dict(one.verdict.cases[0].facts) if one.verdict is not None else {}
    for by in (due.READING, due.SIGNALS, due.USE):
        worn |= {n: Fact(value=0.0, unit="min") for n in due.left_names(by)}
    assert one.verdict is not None
    gone = replace(one.verdict.cases[0], facts=worn)
    verdict = replace(one.verdict, cases=(gone, *one.verdict.cases[1:]))
    assert due_notes(replace(one, verdict=verdict)) == ["Tool T26: Change it now."]


def test_how_often_ranges_held_is_told_of_tools_that_were_not_learnt_from(
    built: Built, lasting: Lasting
) -> None:
    one = shown(built, lasting)
    assert one.verdict is not None
    facts = one.verdict.cases[-1].facts
    told, inside = (int(str(facts[n].value).removesuffix(".0")) for n in (due.ESTIMATES, due.HELD))
    assert f"{inside} of {told} ranges held" in section(one).text[0]
    learnt = tuple(replace(c, role="training") for c in one.verdict.cases)
    none = section(replace(one, verdict=replace(one.verdict, cases=learnt)))
    assert "could not be tried" in none.text[0]


def test_what_wear_adds_to_forces_is_said_with_its_interval(built: Built, lasting: Lasting) -> None:
    found = section(shown(built, lasting))
    (heading,) = (b for b in found.blocks if isinstance(b, Heading) and "forces" in b.heading)
    assert lasting.edges is not None
    value = lasting.edges.parameters["K_re_over_VB"].value
    assert value is not None and f"across it by {0.1 * value:.1f} (" in heading.text


def test_a_machine_without_lives_says_why_or_nothing(built: Built) -> None:
    assert due_section(shown(built, Lasting())) is None
    reason = Lasting(reasons=("no tool life: 2 tools were measured",))
    (text,) = section(shown(built, reason)).text
    assert text == "No time left can be told: no tool life: 2 tools were measured."


def test_the_truth_of_tools_in_use_stands_beside_what_is_told(
    built: Built, lasting: Lasting
) -> None:
    worn = [{"tool": t, "worn_after_min": followed("mill01", 2, t).worn_after} for t in SIGNALS]
    (table,) = due_truth(shown(built, lasting, truth={"wear": {"tools": worn}}))
    life = followed("mill01", 2, "T26")
    true = {row[0].text: float(row[1].text) for row in table.rows}
    assert set(true) == {"T26", "T34"}
    assert true["T26"] == pytest.approx(life.worn_after - life.times[-1], rel=0.02)
    assert due_truth(shown(built, lasting)) == []


def test_lives_are_stored_with_the_model(built: Built, lasting: Lasting, tmp_path: Path) -> None:
    model = replace(built.model, lasting=lasting)
    write_json(model, tmp_path / "model.json")
    assert read_json(tmp_path / "model.json", WearModel).lasting == lasting
