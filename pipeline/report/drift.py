"""Drift of what serves, on the page of a machine: last nights, error budget spent, what to do."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pipeline.charts.numbers import NARROW
from pipeline.charts.sections import Action, Role, Section, present
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.facts import NOW, ActionRow, MachineFacts
from pipeline.report.texts import Texts
from pipeline.schema.days import is_day
from pipeline.schema.ledger import PERIOD_NIGHTS, Night, asks, latest, serving, spent

SHOWN = 7
"""Nights of a target that the table shows."""
WHO: Mapping[str, Role] = {
    "sensor": "maintenance", "heat": "maintenance", "friction": "maintenance",
    "wear": "tool room", "program changed": "process engineer",
    "records missing": "data engineer", "not known": "ML engineer",
}  # fmt: skip
"""Who looks first, by the reason of an ask."""
STATUS = {"within": "passed", "over": "failed", "no records": "attention"}
"""Colour of a night by its result."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """Last nights of one target, the latest last, and the share of its budget that is spent."""

    title: str
    nights: tuple[Night, ...]
    spent: float | None


def drift_section(facts: MachineFacts, say: Texts) -> Section | None:
    """The state in one sentence, then a line for each quantity; None where no night was scored."""
    lines = _lines(facts, say)
    if not facts.nights:
        return None
    made = sources(facts.shelf, *([facts.folders.ledger] if facts.folders.ledger else []))
    return Section(
        key="drift",
        title=say("drift.title"),
        text=list(_sentences(facts, lines, say)),
        blocks=present(tabulated(say("drift.table"), lines, _columns(say), made)),
    )


def drift_actions(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """What the nights ask for."""
    for one in asks(facts.nights):
        why = say(
            "drift.why", rule=say.given(one.rule), night=_night(one, say),
            words=say.given(one.words),
        )  # fmt: skip
        yield ActionRow(
            action=Action(
                what=_work(one, say), where=say("where.twin_of", title=_title(facts, one, say)),
                why=why, until=NOW, who=WHO[one.reason],
            ),
            href="#drift", english=("why",),
        )  # fmt: skip


def _sentences(facts: MachineFacts, lines: list[Line], say: Texts) -> Iterator[str]:
    open_ = asks(facts.nights)
    for one in open_:
        yield say("drift.asks", title=_title(facts, one, say), work=_work(one, say),
                  night=_night(one, say))  # fmt: skip
    if not lines:
        yield say("drift.none")
    elif not open_:
        most = max((line.spent or 0.0 for line in lines), default=0.0)
        newest = max((line.nights[-1] for line in lines), key=lambda one: one.night)
        yield say("drift.quiet", night=_night(newest, say), spent=_percent(most, say),
                  nights=PERIOD_NIGHTS)  # fmt: skip


def _percent(share: float | None, say: Texts) -> str:
    return "–" if share is None else f"{say.number(round(100 * share), 3)}{NARROW}%"


def _work(one: Night, say: Texts) -> str:
    work = say(f"drift.{one.ask}")
    return say(f"drift.{one.reason.replace(' ', '_')}", work=work)


def _title(facts: MachineFacts, one: Night, say: Texts) -> str:
    return facts.titles([one.submodel], say.given)


def _night(one: Night, say: Texts) -> str:
    return say.day(one.night, year=True) if is_day(one.night) else one.night


def _lines(facts: MachineFacts, say: Texts) -> list[Line]:
    by_target: dict[tuple[str, str, str], list[Night]] = {}
    for one in latest(serving(facts.nights)):
        if one.result != "not scored":
            by_target.setdefault(one.target, []).append(one)
    found = []
    for nights in by_target.values():
        last = nights[-1]
        parts = [_title(facts, last, say), say.given(last.quantity.replace("_", " ")),
                 say.given(last.regime)]  # fmt: skip
        found.append(
            Line(title=", ".join(dict.fromkeys(p for p in parts if p)), nights=tuple(nights),
                 spent=spent(nights))
        )  # fmt: skip
    return found


def _columns(say: Texts) -> tuple[Column[Line], ...]:
    def shares(line: Line) -> str:
        return " · ".join(_percent(one.share, say) for one in line.nights[-SHOWN:])

    return (
        Column(say("drift.quantity"), lambda line: line.title),
        Column(say("drift.night"), lambda line: _night(line.nights[-1], say)),
        Column(say("drift.shares"), shares),
        Column(
            say("drift.spent", nights=PERIOD_NIGHTS),
            lambda line: _percent(line.spent, say), "",
        ),
        Column(
            say("drift.result"),
            lambda line: Cell(
                text=say(f"drift.{line.nights[-1].result.replace(' ', '_')}"),
                status=STATUS[line.nights[-1].result],
            ),
        ),
    )  # fmt: skip
