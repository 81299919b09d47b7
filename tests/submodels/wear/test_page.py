"""Page of tool wear: its words, tables and figures; tools due, and the truth of simulated ones."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.charts.sections import Heading, Section, SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact, JudgedCase
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear import due
from pipeline.submodels.wear.due import Estimate, Lasting, due_facts, fit_lasting
from pipeline.submodels.wear.due_page import due_key_figures, due_notes, due_section, due_truth
from pipeline.submodels.wear.model import GUESS, MEAN, MethodScore, WearModel
from pipeline.submodels.wear.submodel import SUBMODEL
from tests.submodels.made_pages import drawn, held_to_golden, made, tables, words
from tests.submodels.wear.shop_lives import followed, life_settings, tools, windows
from tests.submodels.wear.worn_tools import Built, build


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("wear"), blank=[(6, 2)])


def shown(built: Built, **changes: object) -> Shown[WearModel]:
    one = Shown(
        machine="rig", origin="simulated", model=built.model, verdict=built.judged.verdict,
        predictions=built.judged.predictions, shelf=SourceRegistry(), folder=built.folder,
    )  # fmt: skip
    return replace(one, **changes)  # type: ignore[arg-type]


def page_of(built: Built, **changes: object) -> SubModelPage:
    return made(SUBMODEL, shown(built, **changes))


def test_the_page_is_the_golden_one(built: Built) -> None:
    held_to_golden(page_of(built), Path(__file__).with_name("page.txt"))


def test_methods_and_thirds_of_the_wear_have_their_figures(built: Built) -> None:
    found = tables(page_of(built))
    methods = found["Methods compared"]
    assert len(methods) == len(built.model.scores) and methods[0][1] != "–"
    assert sum(row[0].endswith("(serves)") for row in methods) == 1
    assert sum(int(row[3]) for row in found["Where it errs, tools that decide"]) == 20
    tools = {row[0]: row for row in found["Errors of flank wear"] if row[1] == "held out"}
    assert set(tools) == {"T5", "T6", "T7", "all of them"}
    assert tools["T6"][2] == "6"  # one of seven was not measured


def test_the_worst_tool_is_drawn_with_its_interval_and_the_guess(built: Built) -> None:
    worst = next(svg for caption, svg in drawn(page_of(built)).items() if "Worst tool" in caption)
    assert "s-band" in worst and "curve free" in worst and "Use of the tool, min" in worst


def test_a_guess_that_is_better_is_said(built: Built) -> None:
    better = {name: MethodScore(rmse=0.1, mae=0.1, worst=0.1) for name in (GUESS, MEAN)}
    model = replace(built.model, scores={**built.model.scores, **better})
    text = words(page_of(built, model=model))
    assert "errs less than any method that looks at the signals" in text
    assert "errs less" not in words(page_of(built))


SETTINGS = life_settings("mill01")
SIGNALS = {"T26": Estimate(wear=150.0, low=120.0, high=180.0),
           "T34": Estimate(wear=60.0, low=20.0, high=100.0),
           "T24": Estimate(wear=230.0, low=200.0, high=260.0)}  # fmt: skip


@pytest.fixture(scope="module")
def lasting() -> Lasting:
    some = tools("mill01", training=True)
    return fit_lasting(windows("mill01", 2, some, forces=True, every=2), SETTINGS)


def with_lives(built: Built, lasting: Lasting, **changes: Any) -> Shown[WearModel]:
    """Page of a model with the lives of the shop's tools, and what was judged of three of them."""
    law = lasting.life
    cases = () if law is None else tuple(
        JudgedCase(case=tool, group=tool, role="held_out",
                   facts=due_facts(windows("mill01", 2, [tool]), one, law, SETTINGS))
        for tool, one in SIGNALS.items()
    )  # fmt: skip
    return shown(
        built, model=replace(built.model, lasting=lasting), predictions=None,
        verdict=replace(built.judged.verdict, cases=cases), **changes,
    )  # fmt: skip


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
    found = section(with_lives(built, lasting))
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
    one = with_lives(built, lasting)
    assert one.verdict is not None
    failed = replace(one, verdict=replace(one.verdict, status="failed"))
    *_, now, _, by, _ = rows(section(failed), "Tools in use")["T26"]
    assert now.endswith("not relied on") and by == due.READING


def test_the_head_names_the_next_tool_and_those_to_be_changed_soon(
    built: Built, lasting: Lasting
) -> None:
    one = with_lives(built, lasting)
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
    one = with_lives(built, lasting)
    assert one.verdict is not None
    facts = one.verdict.cases[-1].facts
    told, inside = (int(str(facts[n].value).removesuffix(".0")) for n in (due.ESTIMATES, due.HELD))
    assert f"{inside} of {told} ranges held" in section(one).text[0]
    learnt = tuple(replace(c, role="training") for c in one.verdict.cases)
    none = section(replace(one, verdict=replace(one.verdict, cases=learnt)))
    assert "could not be tried" in none.text[0]


def test_what_wear_adds_to_forces_is_said_with_its_interval(built: Built, lasting: Lasting) -> None:
    found = section(with_lives(built, lasting))
    (heading,) = (b for b in found.blocks if isinstance(b, Heading) and "forces" in b.heading)
    assert lasting.edges is not None
    value = lasting.edges.parameters["K_re_over_VB"].value
    assert value is not None and f"across it by {0.1 * value:.1f} (" in heading.text


def test_a_machine_without_lives_says_why_or_nothing(built: Built) -> None:
    assert due_section(with_lives(built, Lasting())) is None
    reason = Lasting(reasons=("no tool life: 2 tools were measured",))
    (text,) = section(with_lives(built, reason)).text
    assert text == "No time left can be told: no tool life: 2 tools were measured."


def test_the_truth_of_tools_in_use_stands_beside_what_is_told(
    built: Built, lasting: Lasting
) -> None:
    worn = [{"tool": t, "worn_after_min": followed("mill01", 2, t).worn_after} for t in SIGNALS]
    (table,) = due_truth(with_lives(built, lasting, truth={"wear": {"tools": worn}}))
    life = followed("mill01", 2, "T26")
    true = {row[0].text: float(row[1].text) for row in table.rows}
    assert set(true) == {"T26", "T34"}
    assert true["T26"] == pytest.approx(life.worn_after - life.times[-1], rel=0.02)
    assert due_truth(with_lives(built, lasting)) == []


def test_lives_are_stored_with_the_model(built: Built, lasting: Lasting, tmp_path: Path) -> None:
    model = replace(built.model, lasting=lasting)
    write_json(model, tmp_path / "model.json")
    assert read_json(tmp_path / "model.json", WearModel).lasting == lasting
