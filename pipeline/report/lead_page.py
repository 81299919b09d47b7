"""Page of one machine for its maintenance lead: what is to be done, and what may be trusted."""

from dataclasses import dataclass, field

from pipeline.charts.sections import Section, present
from pipeline.charts.tables import tabulated
from pipeline.report.alarms import lead_alarms
from pipeline.report.changes import Change, columns
from pipeline.report.evidence import EvidencePage
from pipeline.report.facts import MachineFacts
from pipeline.report.folders import MachineFolders
from pipeline.report.last_records import last_records_table
from pipeline.report.page_names import evidence_page
from pipeline.report.scorecard import Line, scorecard
from pipeline.report.states import MachineVerdict
from pipeline.report.texts import Texts
from pipeline.report.time_use import time_use_table

MOST_ACTIONS = 12
"""Actions that stand on the page at once; the others open on demand."""
MOST_CHANGES = 6
"""Changes on the page; all of them are on that of the records."""


@dataclass(frozen=True, kw_only=True)
class LeadPage:
    """One machine for its maintenance lead.

    Parameters
    ----------
    folders : MachineFolders
        Of the machine.
    verdict : MachineVerdict
        Its condition, its twin, and what is to be done.
    scorecard : list of Line
        What the twin may be trusted for.
    sections : list of Section
        Changes, alarms, time, last records.
    pages : list of (str, str)
        File and title, in English, of each page of evidence.
    """

    folders: MachineFolders
    verdict: MachineVerdict
    scorecard: list[Line]
    sections: list[Section] = field(default_factory=list)
    pages: list[tuple[str, str]] = field(default_factory=list)
    most_actions: int = MOST_ACTIONS


def lead_page(
    facts: MachineFacts, verdict: MachineVerdict, evidence: list[EvidencePage],
    changes: list[Change], why_none: str, *, since: str, say: Texts,
) -> LeadPage:  # fmt: skip
    """The lead's page of one machine.

    Parameters
    ----------
    facts, verdict, evidence
        Of the machine.
    changes : list of Change
        Since the last report.
    why_none : str
        Why there are none.
    since : str
        Which report they are changes of, as the end of a title.
    say : Texts
        Language of the page.
    """
    name = facts.folders.name
    sections = [
        lead_alarms(facts.alarms, say),
        _changes(changes, why_none, since, say),
        _time(facts, say),
        Section(key="last-records", title=say("last.title"),
                blocks=present(last_records_table(facts, say)),
                text=[] if facts.records.files else [say("last.none")]),
    ]  # fmt: skip
    return LeadPage(
        folders=facts.folders,
        verdict=verdict,
        scorecard=scorecard(name, facts.models, say),
        sections=[section for section in sections if section is not None],
        pages=[(evidence_page(name, one.subject), one.title) for one in evidence],
    )


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


def _time(facts: MachineFacts, say: Texts) -> Section:
    table = time_use_table(facts.work, say)
    return Section(key="time", title=say("time.title"), text=[] if table else [say("time.none")],
                   blocks=present(table))  # fmt: skip
