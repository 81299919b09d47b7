"""Page of the incidents of a machine: what to act on, evidence, what was assessed and what not."""

from collections.abc import Iterator, Sequence
from typing import Literal

from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, duration, hours, moment, number
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.schema.incident import Event, Incident, Monitored, RuleState

State = tuple[Literal["failed", "attention", "passed", "unknown"], str, list[str]]
"""Status, word and sentences of a page."""
INCIDENTS = "incidents"
"""Subject of the page."""
MADE_FROM = "the twin’s state and the control’s alarms, by the stage monitor"
STATUS = {"act": "failed", "watch": "attention", "note": "unknown"}
"""Look of a severity."""
MOST = 40


def incidents_of(
    folders: MachineFolders, shelf: SourceRegistry
) -> tuple[State, list[Section]] | None:
    """State and sections of a machine's page; None where nothing was monitored."""
    found = monitored(folders, shelf)
    if folders.incidents is None or found is None:
        return None
    made = sources(shelf, folders.incidents)
    newest = sorted(found.incidents, key=lambda one: (one.end, one.start), reverse=True)
    events = [(one, event) for one in newest for event in one.events if event.rule != "alarm"]
    sections = [
        Section(
            key="incidents", title="What happened", text=list(_text(found)),
            blocks=present(
                tabulated("Incidents, the latest first", newest, COLUMNS, made, most=MOST),
                tabulated("Evidence: the events of rules and forest", events, EVIDENCE, made,
                          most=MOST, folded=True),
            ),
        ),
        Section(
            key="assessed", title="What was assessed",
            text=["A rule holds where its value is beyond its limit for its dwell; tool changes, "
                  "run-up, tapping and warm-up do not count for loads, and a machine that is off "
                  "has no records to hold it. Limits that are learnt come from the known-good "
                  f"days: {_span(found.known_good)}."],
            blocks=present(tabulated("Rules", list(found.rules.items()), RULES, made)),
        ),
    ]  # fmt: skip
    return _state(found), sections


def monitored(folders: MachineFolders, shelf: SourceRegistry) -> Monitored | None:
    """What monitoring found on a machine; None where nothing was monitored."""
    path = folders.incidents
    found = None if path is None else shelf.read(path, Monitored, MADE_FROM)
    return found if found is not None and (found.days or found.incidents) else None


def _state(found: Monitored) -> State:
    acts, recent = found.recent("act"), found.recent("act", "watch")
    if acts:
        words = f"{counted(len(acts), 'incident')} of the last day of records to act on: "
        return "failed", "act", [words + "; ".join(one.title for one in acts) + "."]
    if recent:
        words = f"{counted(len(recent), 'incident')} of the last day of records to watch."
        return "attention", "watch", [words]
    if not any(one.assessed_s for one in found.rules.values()):
        return "unknown", "not assessed", ["No rule could be held against these records."]
    return "passed", "quiet", ["No incident on the last day of records."]


def _text(found: Monitored) -> Iterator[str]:
    by = [one.severity for one in found.incidents]
    yield (
        f"In {hours(found.worked_s)}{NARROW}h of running programs on "
        f"{counted(len(found.days), 'day')}: {counted(by.count('act'), 'incident')} to act on, "
        f"{by.count('watch')} to watch, {by.count('note')} of operation. Events of one component "
        "are one incident while they recur within a working day."
    )


def _span(days: Sequence[str]) -> str:
    if not days:
        return "none, so that nothing is learnt"
    return days[0] if len(days) == 1 else f"{min(days)} to {max(days)}, {counted(len(days), 'day')}"


COLUMNS: tuple[Column[Incident], ...] = (
    Column("Severity", lambda one: Cell(text=one.severity, status=STATUS[one.severity])),
    Column("what", lambda one: one.title),
    Column("where", lambda one: one.component),
    Column("from", lambda one: moment(one.start)),
    Column("to", lambda one: moment(one.end)),
    Column("held", lambda one: duration(one.seconds), ""),
    Column("events", lambda one: number(one.count), ""),
    Column("who", lambda one: one.who),
    Column("what to check", lambda one: f"{one.found}. {one.check}" if one.found else one.check),
)
EVIDENCE: tuple[Column[tuple[Incident, Event]], ...] = (
    Column("Rule", lambda row: row[1].rule.replace("_", " ")),
    Column("from", lambda row: moment(row[1].start)),
    Column("to", lambda row: moment(row[1].end)),
    Column("greatest", lambda row: number(row[1].value), ""),
    Column("limit", lambda row: number(row[1].limit), ""),
    Column("unit", lambda row: row[1].unit),
    Column("beside it", lambda row: row[1].evidence),
)
RULES: tuple[Column[tuple[str, RuleState]], ...] = (
    Column("Rule", lambda row: row[0].replace("_", " ")),
    Column("limit", lambda row: NOT_KNOWN if row[1].limit is None else number(row[1].limit), ""),
    Column("unit", lambda row: row[1].unit),
    Column("assessed, h", lambda row: hours(row[1].assessed_s), ""),
    Column("events", lambda row: number(row[1].events), ""),
    Column("not assessed", lambda row: row[1].not_assessed or "–"),
)
