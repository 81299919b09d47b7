"""Pages of the fleet and of each machine as HTML, with their key figures and metrics.

Every page is one file that needs nothing else: styles and figures stand in it, it runs no script,
and a content security policy forbids it to load anything.  Text from records is escaped.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.charts.numbers import NOT_KNOWN, counted, moment, number, percent
from pipeline.report import changes
from pipeline.report.facts import MachineFacts, machine_facts
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.machine_page import machine_page
from pipeline.report.standalone_page import renderer
from pipeline.report.verdict import MachineVerdict, Status, machine_verdict
from pipeline.schema.files import together
from pipeline.schema.store import write_json, write_text

STATUS_WORDS: Mapping[Status, str] = {
    "failed": "failed",
    "attention": "passed with reservations",
    "passed": "passed",
    "unknown": "without a verdict",
}
"""Status of machines in the headline of the fleet."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One machine in the fleet's table, in words."""

    folders: MachineFolders
    verdict: MachineVerdict
    days: str
    rejected: str
    last: str


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
) -> None:
    """Write ``out/index.html``, ``out/<machine>.html`` and ``out/report.json``.

    Parameters
    ----------
    machines : list of MachineFolders
        The fleet, in the order shown; files that are absent are reported, not raised.
    fleet : FleetInfo
        State of the project.
    previous : Path or None
        ``report.json`` of the last report, or its folder; it may be the one in ``out``.  Written
        again with nothing changed, the pages are the same bytes.
    out : Path
        Folder of the report; made when it does not exist.
    metrics : Path or None
        File of the report's metrics.

    Raises
    ------
    ValueError
        When two machines have the same name.
    """
    names = [m.name for m in machines]
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise ValueError(f"machine {double[0]} stands twice in the fleet; give each its own name")
    facts = {m.name: machine_facts(m) for m in machines}
    judged = {name: machine_verdict(f) for name, f in facts.items()}
    figures = {name: changes.key_figures(f, judged[name].word) for name, f in facts.items()}
    earlier = changes.earlier_report(previous, figures)
    render = renderer()
    for name in names:
        differences, reason = _compared(earlier, facts[name], figures[name])
        page = machine_page(facts[name], changes.changes_section(differences, reason))
        text = render("machine.html.j2", page=page, verdict=judged[name], fleet=fleet)
        write_text(text, out / f"{name}.html")
    rows = [_row(facts[name], judged[name]) for name in names]
    headline = _headline(rows)
    index = render("index.html.j2", rows=rows, fleet=fleet, headline=headline)
    write_text(index, out / "index.html")
    changes.write_key_figures(out / "report.json", figures, earlier)
    if metrics is not None:
        write_json(_metrics(facts, judged), metrics)


def _compared(
    earlier: changes.Earlier, facts: MachineFacts, now: changes.MachineFigures
) -> tuple[list[changes.Change], str]:
    """Changes of one machine, and what to say when there are none."""
    if earlier.machines is None:
        return [], earlier.why_not
    before = earlier.machines.get(facts.folders.name)
    if before is None:
        return [], "The machine was not in the last report."
    found = changes.changes(before, now, {one.name: one.page.changed for one in facts.models})
    return found, "" if found else "Nothing: all key figures and raw files are as they were."


def _row(facts: MachineFacts, judged: MachineVerdict) -> Row:
    records, work = facts.records, facts.work
    return Row(
        folders=facts.folders,
        verdict=judged,
        days=number(len(work.worked_days)) if work.days else NOT_KNOWN,
        rejected=percent(records.rejected, records.records),
        last=moment(records.last),
    )


def _headline(rows: list[Row]) -> str:
    """The fleet in one sentence."""
    counts = {s: sum(r.verdict.status == s for r in rows) for s in STATUS_WORDS}
    parts = [f"{counts[s]} {words}" for s, words in STATUS_WORDS.items() if counts[s]]
    return f"{counted(len(rows), 'machine')}: {', '.join(parts)}." if rows else "No machine."


def _metrics(
    facts: Mapping[str, MachineFacts], judged: Mapping[str, MachineVerdict]
) -> ReportMetrics:
    return ReportMetrics(
        status={s: sum(v.status == s for v in judged.values()) for s in STATUS_WORDS},
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
