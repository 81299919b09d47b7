"""Pages of the fleet and of each machine as HTML, with their key figures and metrics.

Every page is one file that needs nothing else: styles and figures stand in it, and a content
security policy forbids it to load anything.  No script runs but the one that moves the mark along
the path of an optimised program.  Text from records is escaped.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.report import changes
from pipeline.report.evidence import evidence_pages
from pipeline.report.facts import MachineFacts, machine_facts
from pipeline.report.fleet_page import fleet_page, fleet_row
from pipeline.report.folders import FleetInfo, MachineFolders, evidence_page
from pipeline.report.lead_page import lead_page
from pipeline.report.program_pages import machine_program_pages
from pipeline.report.standalone_page import rendered, renderer
from pipeline.report.states import MachineVerdict, Status
from pipeline.report.texts import ENGLISH, Texts
from pipeline.report.verdict import machine_notes, machine_verdict
from pipeline.schema.files import together
from pipeline.schema.store import write_json, write_text

STATUSES: tuple[Status, ...] = ("failed", "attention", "passed", "unknown")
"""Status of twins, in the metrics."""


@dataclass(frozen=True, kw_only=True)
class SubModelCounts:
    """Number of a machine's sub-models by the status of their verdict."""

    passed: int
    failed: int
    not_judged: int


@dataclass(frozen=True, kw_only=True)
class MachineMetrics:
    """Metrics of one machine's page."""

    status: Status
    days: int
    records: int
    rejected: int
    submodels: SubModelCounts


@dataclass(frozen=True, kw_only=True)
class ReportMetrics:
    """Metrics of the report: number of machines by status, and those of each machine."""

    status: Mapping[Status, int]
    machines: Mapping[str, MachineMetrics]


@together()
def write_report(
    machines: list[MachineFolders],
    fleet: FleetInfo,
    previous: Path | None,
    out: Path,
    metrics: Path | None = None,
    *,
    say: Texts = ENGLISH,
) -> list[Path]:
    """Write the pages of a fleet and ``out/report.json``, and return every page.

    Those are ``index.html``, ``<machine>.html`` for its lead, and for the evidence
    ``<machine>_<sub-model>.html``, ``<machine>_programs.html``, ``<machine>_records.html`` and for
    each part program ``<machine>_program_<name>.html``.

    Files of ``machines`` that are absent are reported, not raised. ``previous`` is the
    ``report.json`` of the last report, or its folder, which may be ``out``; written again with
    nothing changed, the pages are the same bytes. ``metrics`` is the file of the report's metrics.
    The fleet's and the leads' pages are in the language of ``say``, those of evidence in English.
    ValueError when two machines have the same name, or two pages would.
    """
    names = [m.name for m in machines]
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise ValueError(f"machine {double[0]} stands twice in the fleet; give each its own name")
    facts = {m.name: machine_facts(m) for m in machines}
    judged = {name: machine_verdict(f, say) for name, f in facts.items()}
    figures = {name: changes.key_figures(f, judged[name]) for name, f in facts.items()}
    earlier = changes.earlier_report(previous, figures)
    pages: dict[str, str] = {}
    for name in names:
        made = _machine_pages(facts[name], judged[name], earlier, figures[name], fleet, say)
        twice = sorted(set(made) & set(pages))
        if twice:
            raise ValueError(
                f"machine {name} and another would both write {twice[0]}; rename one of them"
            )
        pages |= made
    index = fleet_page([fleet_row(facts[name], judged[name], say) for name in names], say)
    pages["index.html"] = renderer(say)("index.html.j2", index=index, fleet=fleet)
    for page, text in pages.items():
        write_text(text, out / page)
    changes.write_key_figures(out / "report.json", figures, earlier)
    if metrics is not None:
        write_json(_metrics(facts, judged), metrics)
    return [out / page for page in pages]


def _machine_pages(
    facts: MachineFacts, verdict: MachineVerdict, earlier: changes.Earlier,
    now: changes.MachineFigures, fleet: FleetInfo, say: Texts,
) -> dict[str, str]:  # fmt: skip
    """HTML of the pages of one machine by file; those of evidence are in English."""
    name = facts.folders.name
    before = (earlier.machines or {}).get(name)
    changed = changes.changes_section(*_compared(earlier, facts, now, ENGLISH))
    evidence = evidence_pages(facts, changed, machine_notes(facts))
    page = lead_page(
        facts, verdict, evidence, *_compared(earlier, facts, now, say),
        since=changes.since_words(before, say), say=say,
    )  # fmt: skip
    found = {f"{name}.html": renderer(say)("machine.html.j2", page=page, fleet=fleet)}
    in_english = renderer()
    for one in evidence:
        text = in_english("evidence.html.j2", page=one, lead=page, fleet=fleet)
        found[evidence_page(name, one.subject)] = text
    return found | {file: rendered(page) for file, page in machine_program_pages(facts)}


def _compared(
    earlier: changes.Earlier, facts: MachineFacts, now: changes.MachineFigures, say: Texts
) -> tuple[list[changes.Change], str]:
    """Changes of one machine, and what to say when there are none."""
    if earlier.machines is None:
        return [], say(earlier.why_not)
    before = earlier.machines.get(facts.folders.name)
    if before is None:
        return [], say("changes.not_in_last")
    found = changes.changes(before, now, {one.name: one.page.changed for one in facts.models}, say)
    return found, "" if found else say("changes.nothing")


def _metrics(
    facts: Mapping[str, MachineFacts], judged: Mapping[str, MachineVerdict]
) -> ReportMetrics:
    return ReportMetrics(
        status={s: sum(v.status == s for v in judged.values()) for s in STATUSES},
        machines={
            name: MachineMetrics(
                status=judged[name].status,
                days=len(f.work.worked_days),
                records=f.records.records,
                rejected=f.records.rejected,
                submodels=_counts(f),
            )
            for name, f in facts.items()
        },
    )


def _counts(facts: MachineFacts) -> SubModelCounts:
    found = ["not judged" if one.judged is None else one.judged.status for one in facts.models]
    return SubModelCounts(
        passed=found.count("passed"),
        failed=found.count("failed"),
        not_judged=found.count("not judged") + found.count("not decided"),
    )
