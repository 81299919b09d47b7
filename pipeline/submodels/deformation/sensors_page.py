"""Part of the page of spindle growth on faulty temperature sensors: note, actions, table."""

from collections.abc import Iterator

from pipeline.charts.judged import case_words
from pipeline.charts.numbers import counted, fixed, number, signed
from pipeline.charts.sections import Action
from pipeline.charts.submodel_page import made_from
from pipeline.charts.tables import Cell, Column, Table, tabulated
from pipeline.charts.words import page_words
from pipeline.submodels.deformation.figures import GrowthFacts, SensorFault, um
from pipeline.submodels.deformation.sensors import DEAD

WORDS = page_words(__file__)


def _fault_words(one: SensorFault) -> str:
    off = ""
    if one.worst_K is not None:
        side = "high" if one.worst_K > 0 else "low"
        off = WORDS("off", by=fixed(abs(one.worst_K), 1), side=side)
    return WORDS(
        "fault", kind=one.kind, case=case_words(one.case), minute=fixed(one.minute, 0),
        moment=one.moment, off=off, recordings=counted(one.cases, "recording"),
        last=case_words(one.last),
    )  # fmt: skip


def _cost_words(facts: GrowthFacts) -> str:
    if facts.cost is None:
        return ""
    return WORDS("cost", as_is=um(facts.cost[0]), replaced=um(facts.cost[1], 1))


def sensor_note(facts: GrowthFacts) -> str:
    """Faults and their cost, for the head of the page; empty without any."""
    faults = "; ".join(f"{one.sensor} is {_fault_words(one)}" for one in facts.faults)
    return WORDS("note", faults=faults, cost=_cost_words(facts)).rstrip() if faults else ""


def sensor_key_figures(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    """Number of the faulty sensors, and which they are."""
    names = ", ".join(one.sensor for one in facts.faults)
    return [(WORDS("title"), str(len(facts.faults)), names)] if names else []


def sensor_actions(facts: GrowthFacts) -> Iterator[Action]:
    """Sensors to be mended: those that are faulty to the last."""
    for one in facts.faults:
        if one.lasts:
            yield Action(
                what=WORDS("action.dead" if one.kind == DEAD else "action.wrong"),
                where=f"{one.place[:1].upper()}{one.place[1:]} ({one.sensor})",
                why=WORDS("action.why", fault=_fault_words(one)),
                until="next stop", who="maintenance", evidence="growth",
            )  # fmt: skip


def _todo(one: SensorFault) -> str:
    if not one.lasts:
        return WORDS("todo.gone")
    return WORDS("todo.dead" if one.kind == DEAD else "todo.wrong")


FAULTS: tuple[Column[SensorFault], ...] = (
    Column("Sensor", lambda one: one.sensor),
    Column("where it sits", lambda one: one.place),
    Column("is", lambda one: Cell(text=one.kind, status="failed")),
    Column("since recording", lambda one: case_words(one.case)),
    Column("at minute", lambda one: fixed(one.minute, 0), unit=""),
    Column("date", lambda one: one.moment),
    Column("off by up to", lambda one: "–" if one.worst_K is None else signed(one.worst_K), "K"),
    Column("recordings", lambda one: number(one.cases), unit=""),
    Column("last in", lambda one: case_words(one.last)),
    Column("what to do", _todo),
)


def sensor_table(facts: GrowthFacts) -> Table | None:
    """Faulty sensors, one a row; None without any."""
    made = made_from(facts.shown, "verdict.json")
    return tabulated(WORDS("title"), facts.faults, FAULTS, made, note=_cost_words(facts))
