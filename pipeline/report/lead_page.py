"""Page of one machine for its maintenance lead: its week, what to do, what the twin is good for."""

from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from markupsafe import Markup

from pipeline.charts.numbers import instant
from pipeline.charts.sections import Section, present
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.report.changes import Change, columns
from pipeline.report.components import (
    ComponentState,
    component_states,
    outline,
    weeks_worked,
)
from pipeline.report.condition import weeks_section
from pipeline.report.drift import drift_section
from pipeline.report.evidence import EvidencePage
from pipeline.report.facts import ActionRow, MachineFacts, MachineVerdict
from pipeline.report.folders import MachineFolders, evidence_page
from pipeline.report.records import source_of
from pipeline.report.scorecard import Line, scorecard
from pipeline.report.texts import Texts
from pipeline.report.week import alarms_of_week, time_section, week_section
from pipeline.schema.si import DAY, NS

MOST_ACTIONS = 5
"""Actions that stand on the page at once; the others open on demand."""
MOST_CHANGES = 3
"""Changes on the page; all of them are on that of the records."""


@dataclass(frozen=True, kw_only=True)
class LeadPage:
    """Page of a machine for its maintenance lead."""

    folders: MachineFolders
    verdict: MachineVerdict
    """Condition of the machine, its twin, and what is to be done."""
    head: list[str]
    """Calendar week, the week that it is compared with, since when the machine is off."""
    components: list[ComponentState]
    outline: Markup
    """Outline of the machine with the state of each component."""
    shown: list[ActionRow]
    folded: list[ActionRow]
    """Actions that stand on the page, and those that open on demand."""
    scorecard: list[Line]
    """What the twin may be used for, by sub-model."""
    week: Section | None = None
    first: list[Section] = field(default_factory=list)
    """The week on its time axis, and the other sections of the first sheet."""
    sections: list[Section] = field(default_factory=list)
    """Sections of the second sheet: drift, changes, last records."""
    pages: list[tuple[str, str]] = field(default_factory=list)
    """File and title, in English, of each page of evidence."""

    @property
    def engineers(self) -> int:
        """Number of the folded actions that are for engineers."""
        return sum(row.engineers for row in self.folded)


def lead_page(
    facts: MachineFacts, verdict: MachineVerdict, evidence: list[EvidencePage],
    changes: list[Change], why_none: str, *, since: str, say: Texts,
) -> LeadPage:  # fmt: skip
    """The lead's page of one machine; ``since`` names the report that changes are held against."""
    name = facts.folders.name
    components = component_states(facts, say)
    shown = [row for row in verdict.actions if not row.engineers][:MOST_ACTIONS]
    first = [weeks_section(facts.folders, facts.shelf, facts.weeks, say), time_section(facts, say),
             alarms_of_week(facts, say),
             *(page.lead for page in facts.pages)]  # fmt: skip
    second = [drift_section(facts, say), _changes(changes, why_none, since, say),
              _last_records(facts, say)]  # fmt: skip
    return LeadPage(
        folders=facts.folders,
        verdict=verdict,
        head=head_of(facts, say),
        components=components,
        outline=outline(components, say),
        shown=shown,
        folded=[row for row in verdict.actions if row not in shown],
        scorecard=scorecard(facts, say),
        week=week_section(facts, say),
        first=[section for section in first if section is not None],
        sections=[section for section in second if section is not None],
        pages=[(evidence_page(name, one.subject), one.title) for one in evidence],
    )


def head_of(facts: MachineFacts, say: Texts) -> list[str]:
    """Calendar week of the newest record, the one before it, since when the machine is off."""
    weeks, end = weeks_worked(facts), facts.work.last
    if not weeks or end is None:
        return [say("head.no_log")]
    named = [say("head.week", week=int(one[6:]), year=one[:4]) for one in weeks[-2:]]
    said = [named[-1]]
    said.append(say("head.compared", week=named[0]) if len(named) > 1 else say("head.first"))
    at = say.moment(int(end * NS))
    if facts.off:
        usual = "unusual" if facts.unusually_off else "usual"
        said.append(say("head.off", moment=at, usual=say(f"head.{usual}")))
    else:
        said.append(say("head.until", moment=at))
    return said


def _changes(changes: list[Change], why_none: str, since: str, say: Texts) -> Section:
    """The first changes, with what they mean; the rest stand on the page of the records."""
    rest = len(changes) - MOST_CHANGES
    more = [say("changes.more", count=rest)] if rest > 0 else []
    shown = changes[:MOST_CHANGES]
    return Section(
        key="changes",
        title=say("changes.since", report=since),
        text=[why_none] if why_none else [*(c.note for c in shown if c.note), *more],
        blocks=present(tabulated(say("changes.table"), shown, columns(say))),
    )


MOST_SOURCES = 4
FEWEST_ENDS = 4
"""Ends of files from which on the time between them is a habit."""
LATE = 1.5
"""Longest time between files that a source may be silent for, as a multiple of it [1]."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Source: its files, its last record [s] since 1970 (None without a clock)."""

    name: str
    files: int
    last: float | None
    silent: float | None = None
    off: bool = False
    every: float | None = None
    """Usual time between the ends of its files [s]; None for fewer than :data:`FEWEST_ENDS`."""
    late: float | None = None
    """Time from its last record to the newest of the machine [s], where it never was as long."""


def origins(facts: MachineFacts, log_name: str) -> list[Origin]:
    """Sources by folder and format of their files, the machine's own log first."""
    found: dict[str, list[float | None]] = {}
    for name, read in (facts.records.files or {}).items():
        when = instant(read.last)
        stamp = None if when is None else when.timestamp()
        found.setdefault(source_of(name, read), []).append(stamp)
    newest: dict[str, float] = {}
    for name, ends in found.items():
        kind = name.rpartition(" ")[2]
        newest[kind] = max([newest.get(kind, 0.0), *(end for end in ends if end is not None)])
    each = [
        _origin(name, ends, facts.records.newest, newest[name.rpartition(" ")[2]])
        for name, ends in found.items()
    ]
    clocked = sorted(
        (one for one in each if one.last is not None), key=lambda one: -(one.last or 0)
    )
    end = facts.work.last
    log = [
        Origin(
            name=log_name, files=len(facts.work.state_files), last=end, silent=facts.silence,
            off=facts.off,
        )
    ]  # fmt: skip
    return [*(log if end is not None else []), *clocked]


def _origin(
    name: str, ends: list[float | None], newest: datetime | None, newest_like: float
) -> Origin:
    """A source, with the time between its files and whether it is late by that.

    ``newest_like`` is the last record of all sources of its format, which go on in its place.
    """
    known = sorted({end for end in ends if end is not None})
    gaps = np.diff(known)
    last = known[-1] if known else None
    if len(known) < FEWEST_ENDS or newest is None or last is None or last - known[0] < DAY:
        return Origin(name=name, files=len(ends), last=last)
    behind = newest.timestamp() - newest_like
    late = behind if behind > LATE * float(gaps.max()) else None
    return Origin(name=name, files=len(ends), last=last, every=float(np.median(gaps)), late=late)


def origin_columns(say: Texts) -> tuple[Column[Origin], ...]:
    """Columns of the table."""
    return (
        Column(say("last.source"), lambda one: one.name),
        Column(say("last.record"), lambda one: (
            say.moment(None if one.last is None else int(one.last * NS))
        )),
        Column(say("last.every"), lambda one: (
            "–" if one.every is None else say("last.each", hours=say.number(one.every / 3600, 2))
        )),
        Column(say("last.state"), lambda one: _state(one, say)),
    )  # fmt: skip


def _state(one: Origin, say: Texts) -> Cell | str:
    if one.silent is not None:
        return Cell(text=say("last.silent", duration=say.duration(one.silent)), status="failed")
    if one.late is not None:
        return Cell(text=say("last.late", duration=say.duration(one.late)), status="attention")
    return say("last.off") if one.off else "–"


def _last_records(facts: MachineFacts, say: Texts) -> Section:
    table, files = last_records_table(facts, say), len(facts.records.files or {})
    why = say("last.clockless", count=files) if files else say("last.none")
    return Section(key="last-records", title=say("last.title"), blocks=present(table),
                   text=[] if table else [why])  # fmt: skip


def last_records_table(facts: MachineFacts, say: Texts) -> Table | None:
    """Last record of each source with a clock; the caption says how many have none."""
    log = say("last.log")
    shown = origins(facts, log)
    clocked = sum(one.files for one in shown if one.name != log)
    bare = len(facts.records.files or {}) - clocked
    caption = say("last.table_bare", count=bare) if bare > 0 else say("last.table")
    made = sources(facts.shelf, facts.folders.signals / "manifest.json")
    return tabulated(caption, shown[:MOST_SOURCES], origin_columns(say), made)
