"""Tools due: facts of a tool in use, which of them counts, and what the page says to do."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.charts.sources import SourceRegistry
from pipeline.schema.verdict import Fact
from pipeline.submodels.wear import due
from pipeline.submodels.wear.due import DueTool, Estimate, due_facts, fit_lasting, left_names
from pipeline.submodels.wear.due_page import due_actions, due_lead, todo_words
from pipeline.submodels.wear.life import LifeLaw, fit_life, uses
from tests.submodels.wear.shop_lives import followed, life_settings, tools, windows

SETTINGS = life_settings("mill01")


@pytest.fixture(scope="module")
def law() -> LifeLaw:
    found = windows("mill01", 2, tools("mill01", training=True))
    return fit_life(uses(found, SETTINGS), SETTINGS)


def test_a_tool_in_use_is_told_by_its_reading_by_its_signals_and_by_its_use(law: LifeLaw) -> None:
    found, life = windows("mill01", 2, ["T26"]), followed("mill01", 2, "T26")
    estimate = Estimate(wear=120.0, low=100.0, high=140.0)
    facts = due_facts(found, estimate, law, SETTINGS)
    assert facts[due.IN_USE].value == "yes" and facts[due.TYPE].value == "EM12Z4"
    assert facts[due.TIME].value == pytest.approx(life.times[-1], rel=1e-3)
    read = life.measured[np.isfinite(life.measured)][-1]
    assert facts[due.READ].value == read and facts[due.NOW].value == 120.0
    for by in (due.READING, due.SIGNALS, due.USE):
        low, middle, high = (facts[name].value for name in left_names(by))
        assert isinstance(low, float) and isinstance(middle, float) and isinstance(high, float)
        assert 0 <= low < middle < high
    spans = [facts[left_names(by)[2]].value - facts[left_names(by)[0]].value  # type: ignore[operator]
             for by in (due.READING, due.USE)]  # fmt: skip
    assert spans[0] < spans[1]


def test_without_an_interval_of_the_signals_they_tell_no_time(law: LifeLaw) -> None:
    estimate = Estimate(wear=120.0, low=math.nan, high=math.nan)
    facts = due_facts(windows("mill01", 2, ["T26"]), estimate, law, SETTINGS)
    assert left_names(due.SIGNALS)[1] not in facts and facts[due.NOW_LOW].value is None


def test_of_a_tool_that_was_used_up_it_is_counted_how_often_the_range_held(law: LifeLaw) -> None:
    found = windows("mill01", 2, ["T24"])
    facts = due_facts(found, Estimate(wear=220.0, low=200.0, high=240.0), law, SETTINGS)
    assert due.IN_USE not in facts
    told, inside = facts[due.ESTIMATES].value, facts[due.HELD].value
    assert isinstance(told, float) and isinstance(inside, float) and 0 < inside <= told
    assert due.held({"T24": facts, "T26": {}}) == (int(told), int(inside))


def test_of_an_unknown_type_nothing_is_told(law: LifeLaw) -> None:
    shape = dict(SETTINGS.cutters) | {"NEW": SETTINGS.cutters["EM12Z4"]}
    found = windows("mill01", 2, ["T26"])
    strange = replace(
        found, conditions=dict(found.conditions) | {"tool_type": np.full(len(found), "NEW")}
    )
    estimate = Estimate(wear=1.0, low=0.0, high=2.0)
    known = due_facts(strange, estimate, law, replace(SETTINGS, cutters=shape))
    assert "no tool of its type was worn" in str(known[due.NO_ESTIMATE].value) and len(known) == 1
    unknown = due_facts(strange, estimate, law, SETTINGS)
    assert "wear_life.cutters has no 'NEW'" in str(unknown[due.NO_ESTIMATE].value)


def test_what_records_do_not_tell_is_a_reason_and_no_error() -> None:
    found = windows("mill01", 2, ["T21", "T22"])
    lasting = fit_lasting(found, SETTINGS)
    assert lasting.life is None and lasting.edges is None and len(lasting.reasons) == 2
    assert "tools measured up to" in lasting.reasons[0]
    assert fit_lasting(found, replace(SETTINGS, criterion_um=None)).reasons == ()


def told(low: float, middle: float, high: float, *, by: str = due.READING) -> dict[str, Fact]:
    values = zip(left_names(by), (low, middle, high), strict=True)
    return {name: Fact(value=value, unit="min") for name, value in values}


@pytest.mark.parametrize(
    ("left", "status", "words"),
    [
        ((0.0, 0.0, 0.0), "failed", "Change it now"),
        ((5.0, 12.0, 20.0), "unknown", "change it within 5.0"),
        ((40.0, 60.0, 90.0), "passed", "measure its land again within 20"),
    ],
)
def test_what_to_do_follows_the_least_time_left(
    left: tuple[float, float, float], status: str, words: str
) -> None:
    facts = told(*left) | {due.LIFE: Fact(value=100.0, unit="min")}
    tool = DueTool(name="T1", facts=facts, by_signals=False)
    assert tool.status == status and words in todo_words(tool).replace("\u00a0", " ")


def test_tools_that_are_due_are_actions_and_every_tool_in_use_is_a_bar() -> None:
    cases = tuple(
        SimpleNamespace(case=name, facts=told(*left) | {
            due.LIFE: Fact(value=100.0, unit="min"), due.TIME: Fact(value=50.0, unit="min"),
            due.IN_USE: Fact(value="yes")})
        for name, left in (("T1", (40.0, 60.0, 90.0)), ("T2", (5.0, 12.0, 20.0)))
    )  # fmt: skip
    shown = SimpleNamespace(
        verdict=SimpleNamespace(cases=cases, status="failed"), shelf=SourceRegistry(),
        folder=Path("data/models/m/wear"),
    )  # fmt: skip
    actions = due_actions(shown)  # type: ignore[arg-type]
    rows = [(one.where, one.until.replace("\u00a0", " "), one.who) for one in actions]
    assert rows == [("Tool T2", "within 5.0 min of cutting", "tool room")]
    bars = due_lead(shown)  # type: ignore[arg-type]
    assert bars is not None
    drawn = str(bars.blocks[0].figures[0].svg)  # type: ignore[union-attr]
    assert drawn.index("T2:") < drawn.index("T1:")  # the one that is due first stands first
    assert 'width="35.71%"' in drawn and 'x2="100.00%"' in drawn  # used 50 of 50 + 90 min


def test_signals_count_where_they_are_more_precise_and_their_model_passed() -> None:
    facts = told(10.0, 30.0, 60.0) | told(20.0, 25.0, 30.0, by=due.SIGNALS)
    facts |= told(0.0, 50.0, 200.0, by=due.USE) | {due.LIFE: Fact(value=100.0, unit="min")}
    relied, not_relied = (DueTool(name="T1", facts=facts, by_signals=one) for one in (True, False))
    assert (relied.rests_on, relied.left) == (due.SIGNALS, (20.0, 25.0, 30.0))
    assert (not_relied.rests_on, not_relied.left) == (due.READING, (10.0, 30.0, 60.0))
    bare = DueTool(name="T1", facts=told(0.0, 50.0, 200.0, by=due.USE), by_signals=True)
    assert bare.rests_on == due.USE


def test_the_machines_files_name_their_types_and_tools_in_use() -> None:
    for machine in ("mill01", "mill02"):
        settings = life_settings(machine)
        assert set(settings.in_use) <= set(tools(machine, training=False))
        assert settings.taylor is not None and "Groover" in settings.taylor.source
