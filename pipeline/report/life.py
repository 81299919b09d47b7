"""Page of a model's life: what serves, what was decided, by which rules, who said so."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.charts.numbers import moment
from pipeline.charts.sections import Section, present
from pipeline.charts.tables import Cell, Column, Table, code, sources, tabulated
from pipeline.report.folders import CHOICES
from pipeline.schema.decision import RULES, Compared, Decision, Result, Rule
from pipeline.schema.history import Entry, document_of, instant, looks, served, served_until

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pipeline.report.facts import MachineFacts, Serving, Status

    State = tuple[Status, str, list[str]]

LIFE = "life"
"""Subject of the page."""
BROKEN = re.compile(r"rule '([^']+)' is ")
"""Rules in the words of an entry."""
SIGNS: "Mapping[Result, str]" = {
    "kept": "passed", "broken": "failed", "not decided": "unknown", "no data": "unknown",
}  # fmt: skip
"""Look of a rule's result."""
AGAINST = {"better": "passed", "worse": "failed", "equal": "unknown", "not decided": "unknown"}


def life_of(facts: "MachineFacts") -> "tuple[State, list[Section]] | None":
    """State and sections of a machine's page; None where nothing serves."""
    if facts.serving is None:
        return None
    entries = facts.serving.history
    decisions = {e.number: d for e in entries if (d := _decision(facts, e)) is not None}
    sections = [_history_section(facts, entries)]
    if decisions:
        last = max(decisions)
        sections.append(_decision_section(facts, entries[last - 1], decisions[last]))
    return _state(facts, facts.serving, entries), sections


def _decision(facts: "MachineFacts", entry: Entry) -> Decision | None:
    """Document of a decision, which a history that is read is held to."""
    if facts.folders.history is None or not entry.decision:
        return None
    return facts.shelf.read(document_of(facts.folders.history, entry), Decision, CHOICES)


def _state(facts: "MachineFacts", held: "Serving", entries: tuple[Entry, ...]) -> "State":
    """What serves since when by whom, against which rules, and what does not serve."""
    statuses = {name: one.status for name, one in held.bundle.submodels.items()}
    serving = served(entries)
    if serving:
        last = serving[-1]
        does = last.serving
        since = _at(last.at) if last.at else "it was registered"
        first = f"Version {last.version} serves since {since}; "
        first += f"{last.event} by {last.by}: {last.why}."
        anyway = f" It serves against the rules: {last.rules}." if last.anyway else ""
    else:
        does = tuple(n for n, status in statuses.items() if status == "passed")
        first, anyway = "The first bundle serves; nobody has promoted another yet.", ""
    idle = [f"{facts.titles([n])} ({one})" for n, one in statuses.items() if n not in does]
    said = f"It serves with {facts.titles(list(does))}." if does else "No sub-model of it serves."
    unproven = [f"{facts.titles([n])} ({statuses[n]})" for n in does
                if statuses.get(n, "passed") != "passed"]  # fmt: skip
    if unproven:
        said += f" Of these did not pass: {', '.join(unproven)}."
    if idle:
        said += f" Without: {', '.join(idle)}."
    status: Status = "attention" if anyway or idle or unproven else "passed"
    broken = [held.broken] if held.broken else []
    return status, "serves" if does else "does not serve", [first + anyway, said, *broken]


def _history_section(facts: "MachineFacts", entries: tuple[Entry, ...]) -> Section:
    looked = looks(entries, entries[-1]) if entries else 0
    against = sum(one.anyway for one in entries)
    text = (
        "Each line is an entry of an append-only file, and names the hash of the one before. "
        f"Promoted against the rules: {against}. Looks at the sealed set: {looked}."
    )
    return Section(key="history", title="Who served when, by whom and why", text=[text],
                   blocks=present(_history_table(facts, entries)))  # fmt: skip


def _history_table(facts: "MachineFacts", entries: tuple[Entry, ...]) -> Table | None:
    def until(one: Entry) -> str:
        left = served_until(entries, one)
        return "–" if left is None else _at(left) if left else "now"

    columns: tuple[Column[Entry], ...] = (
        Column("At", lambda one: _at(one.at)),
        Column("event", _event),
        Column("version", lambda one: str(one.version), unit=""),
        Column("serves until", until),
        Column("by", lambda one: one.by),
        Column("why", lambda one: one.why),
        Column("against it, rules", lambda one: ", ".join(BROKEN.findall(one.rules)) or "–"),
        Column("sealed set", lambda one: f"look {looks(entries, one)}" if one.sealed else "–"),
        Column("bundle, sha256", lambda one: code(one.bundle[:12])),
    )
    path = facts.folders.history
    return tabulated(
        "Events, the latest first",
        list(reversed(entries)),
        columns,
        sources(facts.shelf, path) if path is not None else (),
    )


def _at(text: str) -> str:
    return moment(instant(text)) if text else "–"


def _event(entry: Entry) -> Cell:
    status = "failed" if entry.event == "refused" else "attention" if entry.anyway else "passed"
    return Cell(text=f"{entry.event} anyway" if entry.anyway else entry.event, status=status)


def _decision_section(facts: "MachineFacts", entry: Entry, decision: Decision) -> Section:
    used = sources(facts.shelf, document_of(facts.folders.history or Path(), entry))
    may = "may serve" if decision.may_serve else "may not serve"
    if decision.overridden:
        may = "may not serve by the rules, and was promoted all the same,"
    changed = facts.titles(list(decision.changed)) if decision.changed else "no sub-model"
    text = (
        f"Version {decision.challenger.version} {may} in the place of version "
        f"{decision.champion.version}, decided at {_at(decision.at)} by {decision.by}. "
        f"What changed: {changed}."
    )
    rules: tuple[Column[Rule], ...] = (
        Column("Rule: the challenger", lambda one: RULES[one.name]),
        Column("result", lambda one: Cell(text=one.result, status=SIGNS[one.result])),
        Column("why", lambda one: one.sentence or "–"),
    )
    compared: tuple[Column[tuple[Rule, Compared]], ...] = (
        Column("Rule", lambda row: row[0].name),
        Column("model of", lambda row: facts.titles([row[1].submodel])),
        Column("quantity", lambda row: f"{row[1].quantity} {row[1].regime}".strip()),
        Column("groups", lambda row: str(row[1].groups), unit=""),
        Column("champion, mean error", lambda row: f"{row[1].champion:.4g} {row[1].unit}"),
        Column("challenger, mean error", lambda row: f"{row[1].challenger:.4g} {row[1].unit}"),
        Column("result", lambda row: Cell(text=row[1].result, status=AGAINST[row[1].result])),
    )
    figures = [(rule, one) for rule in decision.rules for one in rule.figures]
    blocks = [
        tabulated("Rules of the gate", list(decision.rules), rules, used),
        tabulated("Errors of both on the same records", figures, compared, used),
    ]
    return Section(key="decision", title="The last decision: may it serve?", text=[text],
                   blocks=present(*blocks))  # fmt: skip
