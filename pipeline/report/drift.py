"""Drift of what serves, on the page of a machine: last nights, error budget spent, what to do."""

from collections.abc import Iterator, Mapping

from pipeline.charts.numbers import NARROW
from pipeline.charts.sections import NOW, Action, Role, Section, present
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.facts import ActionRow, MachineFacts
from pipeline.report.texts import Texts
from pipeline.schema.days import is_day
from pipeline.schema.ledger import PERIOD_NIGHTS, Night, asks, latest, spent

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


def drift_section(facts: MachineFacts, say: Texts) -> Section | None:
    """The state in one sentence, then a line for each quantity; None where no night was scored."""
    if not facts.nights:
        return None
    lines = _lines(facts)
    made = sources(facts.shelf, *([facts.folders.ledger] if facts.folders.ledger else []))
    return Section(
        key="drift",
        title=say("drift.title"),
        text=list(_sentences(facts, lines, say)),
        blocks=present(tabulated(say("drift.table"), lines, _columns(facts, say), made)),
    )


def drift_actions(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """What the nights ask for."""
    for one in asks(facts.nights):
        why = say(
            "drift.why", rule=say.given(one.rule), night=_night(one.night, say),
            words=say.given(one.words),
        )  # fmt: skip
        yield ActionRow(
            action=Action(
                what=_work(one, say), where=say("where.twin_of", title=_title(facts, one, say)),
                why=why, until=NOW, who=WHO[one.reason],
            ),
            href="#drift", english=("why",),
        )  # fmt: skip


def _sentences(facts: MachineFacts, lines: list[list[Night]], say: Texts) -> Iterator[str]:
    open_ = asks(facts.nights)
    for one in open_:
        yield say("drift.asks", title=_title(facts, one, say), work=_work(one, say),
                  night=_night(one.since, say))  # fmt: skip
    if not lines:
        yield say("drift.none")
    elif not open_:
        most = max(spent(nights) or 0.0 for nights in lines)
        newest = max(nights[-1].night for nights in lines)
        yield say("drift.quiet", night=_night(newest, say), spent=_percent(most, say),
                  nights=PERIOD_NIGHTS)  # fmt: skip


def _percent(share: float | None, say: Texts) -> str:
    return "–" if share is None else f"{say.number(round(100 * share), 3)}{NARROW}%"


def _work(one: Night, say: Texts) -> str:
    work = say(f"drift.{one.ask}")
    return say(f"drift.{one.reason.replace(' ', '_')}", work=work)


def _title(facts: MachineFacts, one: Night, say: Texts) -> str:
    return facts.titles([one.submodel], say.given)


def _night(night: str, say: Texts) -> str:
    return say.day(night, year=True) if is_day(night) else night


def _lines(facts: MachineFacts) -> list[list[Night]]:
    """Last nights of each target, the latest last."""
    by_target: dict[tuple[str, str, str], list[Night]] = {}
    for one in latest(facts.nights):
        if one.result != "not scored":
            by_target.setdefault(one.target, []).append(one)
    return list(by_target.values())


def _columns(facts: MachineFacts, say: Texts) -> tuple[Column[list[Night]], ...]:
    def name(nights: list[Night]) -> str:
        one = nights[-1]
        parts = [_title(facts, one, say), say.given(one.quantity.replace("_", " ")),
                 say.given(one.regime)]  # fmt: skip
        return ", ".join(dict.fromkeys(part for part in parts if part))

    def result(nights: list[Night]) -> Cell:
        text = say(f"drift.{nights[-1].result.replace(' ', '_')}")
        return Cell(text=text, status=STATUS[nights[-1].result])

    return (
        Column(say("drift.quantity"), name),
        Column(say("drift.night"), lambda nights: _night(nights[-1].night, say)),
        Column(say("drift.shares"), lambda nights: " · ".join(
            _percent(one.share, say) for one in nights[-SHOWN:])),
        Column(say("drift.spent", nights=PERIOD_NIGHTS),
               lambda nights: _percent(spent(nights), say), ""),
        Column(say("drift.result"), result),
    )  # fmt: skip
