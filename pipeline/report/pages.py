"""Pages of the fleet, of each machine and of its programs as HTML, with key figures and metrics.

The page of a program is that of the command: of an optimised one that of ``kerf optimise``, with
what the simulated shop floor cut of it; of the same as written, with its cut, that of ``kerf
simulate``; of one without a blank where its time goes.

Every page is one file that needs nothing else: styles and figures stand in it, and a content
security policy forbids it to load anything.  No script runs but the one that moves the mark along
the path of an optimised program.  Text from records is escaped.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from pipeline.charts.numbers import NARROW, number, signed
from pipeline.charts.sections import PartVerdict, Section, present
from pipeline.charts.sources import SourceRegistry, hash_of_files
from pipeline.charts.tables import Column, Table, sources, tabulated
from pipeline.parallel import mapped
from pipeline.report import changes
from pipeline.report.cut.page import cut_page
from pipeline.report.cut.recorded import against, recorded_section
from pipeline.report.cut.tables import NONE, figure, share
from pipeline.report.evidence import evidence_pages
from pipeline.report.facts import (
    MachineFacts,
    MachineVerdict,
    Status,
    machine_facts,
)
from pipeline.report.fleet_page import FleetRow, fleet_page, fleet_row
from pipeline.report.folders import PROGRAMS, RECORDS, FleetInfo, MachineFolders, evidence_page
from pipeline.report.lead_page import lead_page
from pipeline.report.optimised import tables
from pipeline.report.optimised.page import optimised_page
from pipeline.report.part_programs import PartProgram, PartPrograms
from pipeline.report.programs.simulated import feed_classes, simulated_page
from pipeline.report.provenance import Made, RenderedPage, files_of
from pipeline.report.standalone_page import StandalonePage, rendered, renderer
from pipeline.report.texts import ENGLISH, Texts
from pipeline.report.verdict import machine_notes, machine_verdict
from pipeline.schema.files import together
from pipeline.schema.part import Side
from pipeline.schema.store import write_json

LOADS_PARTS = "cutting"
"""Sub-model whose forces the predicted loads of optimised programs rest on."""


def machine_program_pages(facts: MachineFacts) -> Iterator[tuple[str, StandalonePage]]:
    """File and page of each program of a machine."""
    machine = facts.folders.name
    up = (("index.html", "All machines"), (f"{machine}.html", machine),
          (evidence_page(machine, PROGRAMS), "Part programs"))  # fmt: skip
    parts = {part.label: part for part in facts.parts.programs}
    simulated = {program.name: program for program in facts.programs}
    classes = feed_classes([one.moves for one in facts.programs if one.moves is not None])
    files, written = facts.program_files, facts.written
    labels = {program.name: label for label, program in written.items()}
    for name, file in files.items():
        beside: tuple[tuple[str, str], ...] = ()
        if name in parts:
            page = _part_page(facts, parts[name])
            if name in written:
                beside = ((files[written[name].name], "As written"),)
        elif name in labels:
            program = written[labels[name]]
            page = cut_page(program, *program.sources(facts.shelf))
            log = recorded_section(program, facts.folders, facts.work, facts.shelf)
            *first, basis = page.sections
            page = replace(page, sections=[*first, *([] if log is None else [log]), basis])
            beside = ((files[labels[name]], "Optimised"),)
        else:
            page = simulated_page(simulated[name], classes, facts.shelf, _assumed(facts))
        yield file, replace(page, up=(*up, *beside), credit=facts.folders.credit)


def _assumed(facts: MachineFacts) -> set[str]:
    """Parameters of the control that its records determine for no axis."""
    model = next((part.model for part in facts.models if part.name == "control"), None)
    groups = {} if model is None else model.parameters
    named = [(name.partition(" ")[0], p) for group in groups.values() for name, p in group.items()]
    determined = {name for name, p in named if p.determined}
    return {name for name, _ in named} - determined


def _part_page(facts: MachineFacts, part: PartProgram) -> StandalonePage:
    """Page of an optimised program with its trial cuts, and a doubt about its forces."""
    page = optimised_page(part.part, sources(facts.shelf, part.path))
    doubt = forces_doubt(facts.verdict_of(LOADS_PARTS))
    status = "attention" if doubt and page.status == "passed" else page.status
    trial = trial_section(facts.parts, facts.shelf, part)
    return replace(
        page, status=status, sentences=[*doubt, *page.sentences],
        sections=[*([] if trial is None else [trial]), *page.sections],
    )  # fmt: skip


def forces_doubt(forces: PartVerdict | None) -> list[str]:
    """Why the predicted loads must not be trusted, where the machine's forces were judged."""
    if forces is None or forces.status == "passed":
        return []
    return ["Do not load it yet: the forces of this machine’s cut have not passed their judgement, "
            "and its loads rest on them."]  # fmt: skip


def trial_section(parts: PartPrograms, shelf: SourceRegistry, part: PartProgram) -> Section | None:
    """Cuts of the program on the simulated shop floor; None where there were none."""
    after, before = part.cuts("after"), part.cuts("before")
    if part.cut is None or after is None or before is None:
        return None
    words = (
        f"Cut on the simulated shop floor {after[1]} times, it passed the limit of the load in "
        f"{after[0]} of them, the program as it was in {before[0]}"
    )
    error = trial_time_error(part)
    if error is not None:
        times = [figure(side.time_s.mean, 4) for side in (part.cut.after, part.cut.before)]
        words += (
            f"; it took {times[0]}{NARROW}s instead of {times[1]}{NARROW}s, and its time was "
            f"predicted with an error of {signed(error)}{NARROW}%"
        )
    load = _error(part.part.after.peak_load_N, part.cut.after.peak_load_N.mean)
    if load is not None:
        words += f"; its peak load was predicted with an error of {signed(load)}{NARROW}%"
    return Section(key="trial", title="Cut on the simulated shop floor", text=[f"{words}."],
                   blocks=present(trial_table(parts, shelf, part)))  # fmt: skip


def trial_table(parts: PartPrograms, shelf: SourceRegistry, part: PartProgram) -> Table | None:
    """Predicted by the twin beside cut by the simulated shop floor, which is another machine."""
    cut = part.cut
    if cut is None:
        return None
    limit, allowed, certainty = part.limit, part.epsilon, part.part.certainty
    above = f" of {number(limit)}{NARROW}N" if limit is not None else ""

    def pair(which: Side, key: str, digits: int) -> tuple[str, str]:
        return (tables.side(part.part, which, key, digits),
                figure(getattr(cut.side(which), key).mean, digits))  # fmt: skip

    def row(name: str, key: str, digits: int) -> tuple[str, ...]:
        return name, *pair("before", key, digits), *pair("after", key, digits)

    rows = [
        row("Time, s", "time_s", 4),
        row("Peak load, N", "peak_load_N", 3),
        ("Highest peak load, N", NONE, figure(cut.before.peak_load_N.max), NONE,
         figure(cut.after.peak_load_N.max)),
        (f"Above the limit{above}", NONE, f"{cut.before.above} of {cut.seeds}",
         share(None if certainty is None else certainty.exceedance),
         f"{cut.after.above} of {cut.seeds}"),
    ]  # fmt: skip
    peaks = {} if certainty is None else {one.share: one.load_N for one in certainty.peaks}
    low, high = peaks.get(0.05), peaks.get(0.95)
    if low is not None and high is not None:
        mean = cut.after.peak_load_N.mean
        rows.append(("Peak load, 90 % interval, N", NONE, NONE, f"{number(low)} to {number(high)}",
                     against((low, high), (mean, mean))))  # fmt: skip
    most = "" if allowed is None else f"; allowed was at most {share(allowed)}"
    trial = [] if parts.trial is None else [parts.trial]
    return tabulated(
        f"{part.label}: predicted, and cut on the simulated shop floor {cut.seeds} times",
        rows,
        (
            Column("Quantity of the part", lambda cells: cells[0]),
            Column("predicted", lambda cells: cells[1], "", "As programmed"),
            Column("cut", lambda cells: cells[2], "", "As programmed"),
            Column("predicted", lambda cells: cells[3], "", "Optimised"),
            Column("cut", lambda cells: cells[4], "", "Optimised"),
        ),
        sources(shelf, part.path, *trial),
        note="Each cut has its own mounting of the tool, batch of material and wear; means are "
        f"over them. The shop floor is richer than the twin, which knows nothing of it{most}.",
    )


def trial_time_error(part: PartProgram) -> float | None:
    """Error of the predicted time of the optimised program [%]."""
    return None if part.cut is None else _error(part.part.after.time_s, part.cut.after.time_s.mean)


def _error(predicted: float | None, cut: float | None) -> float | None:
    """Error of a prediction over the mean of the cuts [%]."""
    return None if predicted is None or not cut else 100 * (predicted / cut - 1)


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


@dataclass(frozen=True, kw_only=True)
class MachineReport:
    """Pages of a machine by file, its row in the fleet, its key figures and what they rest on."""

    pages: Mapping[str, RenderedPage]
    row: FleetRow
    figures: changes.MachineFigures
    earlier: changes.Earlier
    metrics: MachineMetrics
    made: Made


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
    each part program ``<machine>_program_<name>.html``; each has its record beside it.

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
    last = changes.last_report(previous)
    made = mapped(partial(machine_report, last=last, fleet=fleet, say=say), machines)
    pages: dict[str, RenderedPage] = {}
    for name, one in zip(names, made, strict=True):
        if twice := sorted(set(one.pages) & set(pages)):
            raise ValueError(
                f"machine {name} and another would both write {twice[0]}; rename one of them"
            )
        pages |= one.pages
    pages["index.html"] = _index(made, fleet, say)
    for file, page in pages.items():
        page.write(out / file)
    changes.write_key_figures(out / "report.json", {
        name: (one.figures, one.earlier) for name, one in zip(names, made, strict=True)
    })  # fmt: skip
    if metrics is not None:
        write_json(ReportMetrics(
            status={s: sum(one.metrics.status == s for one in made) for s in STATUSES},
            machines={name: one.metrics for name, one in zip(names, made, strict=True)},
        ), metrics)  # fmt: skip
    return [out / page for page in pages]


def machine_report(
    machine: MachineFolders, *, last: changes.KeyFigures | str, fleet: FleetInfo, say: Texts
) -> MachineReport:
    """Pages of one machine, and what the fleet's page says of it."""
    facts = machine_facts(machine)
    verdict = machine_verdict(facts, say)
    now = changes.key_figures(facts, verdict)
    earlier = changes.earlier(last, machine.name, now)
    pages = _machine_pages(facts, verdict, earlier, now, fleet, say)
    return MachineReport(
        pages=pages, row=fleet_row(facts, verdict, say), figures=now, earlier=earlier,
        metrics=_metrics(facts, verdict), made=_made(facts, fleet),
    )  # fmt: skip


def _index(made: Sequence[MachineReport], fleet: FleetInfo, say: Texts) -> RenderedPage:
    by = [one.made for one in made]
    whole = Made(
        code=fleet.code, files=tuple(file for one in by for file in one.files),
        settings=hash_of_files((one.settings, "") for one in by if one.settings),
        model=hash_of_files((one.model, "") for one in by if one.model),
    )  # fmt: skip
    index = fleet_page([one.row for one in made], say)
    return renderer(say)("index.html.j2", "index.html", whole, index=index, fleet=fleet)


def _made(facts: MachineFacts, fleet: FleetInfo) -> Made:
    """Origin of a machine's pages, with all of its files that were read by now."""
    settings = facts.folders.settings
    own = None if settings is None else facts.shelf.source(settings)
    return Made(
        code=fleet.code, settings="" if own is None else own.sha256,
        model="" if facts.serving is None else facts.serving.bundle.sha256,
        files=tuple(facts.shelf.used.values()),
    )  # fmt: skip


def _machine_pages(
    facts: MachineFacts, verdict: MachineVerdict, earlier: changes.Earlier,
    now: changes.MachineFigures, fleet: FleetInfo, say: Texts,
) -> dict[str, RenderedPage]:  # fmt: skip
    """Pages of one machine by file; those of evidence are in English."""
    name = facts.folders.name
    changed = changes.changes_section(*_compared(earlier, facts, now, ENGLISH))
    evidence = evidence_pages(facts, changed, machine_notes(facts))
    page = lead_page(
        facts, verdict, evidence, *_compared(earlier, facts, now, say),
        since=changes.since_words(earlier.figures, say), say=say,
    )  # fmt: skip
    programs = dict(machine_program_pages(facts))
    made, file = _made(facts, fleet), f"{name}.html"
    found = {file: renderer(say)("machine.html.j2", file, made, page=page, fleet=fleet)}
    in_english = renderer()
    for one in evidence:
        file = evidence_page(name, one.subject)
        own = () if one.subject == RECORDS else files_of(one.sections)  # that names every file
        of = replace(made, model=one.model or made.model, files=own or made.files)
        found[file] = in_english("evidence.html.j2", file, of, page=one, lead=page, fleet=fleet)
    of_programs = replace(made, files=())
    return found | {file: rendered(page, file, of_programs) for file, page in programs.items()}


def _compared(
    earlier: changes.Earlier, facts: MachineFacts, now: changes.MachineFigures, say: Texts
) -> tuple[list[changes.Change], str]:
    """Changes of one machine, and what to say when there are none."""
    if earlier.figures is None:
        return [], say(earlier.why_not)
    notes = {one.name: one.page.changed for one in facts.models}
    found = changes.changes(earlier.figures, now, notes, say)
    return found, "" if found else say("changes.nothing")


def _metrics(facts: MachineFacts, verdict: MachineVerdict) -> MachineMetrics:
    return MachineMetrics(
        status=verdict.status, days=len(facts.work.worked_days), records=facts.records.records,
        rejected=facts.records.rejected, submodels=_counts(facts),
    )  # fmt: skip


def _counts(facts: MachineFacts) -> SubModelCounts:
    found = ["not judged" if one.judged is None else one.judged.status for one in facts.models]
    return SubModelCounts(
        passed=found.count("passed"),
        failed=found.count("failed"),
        not_judged=found.count("not judged") + found.count("not decided"),
    )
