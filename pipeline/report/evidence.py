"""Pages of evidence of one machine: sub-models, programs as corrected, records, provenance."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    counted,
    hours,
    joined,
    moment,
    number,
    percent,
)
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import Source, SourceRegistry
from pipeline.charts.submodel_page import made_from
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, sources, tabulated
from pipeline.report.alarms import alarms_section
from pipeline.report.condition import condition_section
from pipeline.report.facts import MachineFacts, ModelledPart, StateLine, Truth, already
from pipeline.report.folders import PROGRAMS, RECORDS
from pipeline.report.incidents import INCIDENTS, incidents_of
from pipeline.report.life import LIFE, life_of
from pipeline.report.part_programs import part_key_figures, part_programs_section
from pipeline.report.programs.simulated import programs_section
from pipeline.report.records import records_section
from pipeline.report.texts import ENGLISH
from pipeline.report.twin_state import twin_state_section
from pipeline.report.work_section import work_section
from pipeline.schema.bundle import MODEL, VERDICT
from pipeline.schema.model import SourceFile

MADE_FROM = "both commands of each program, driven on the simulated shop floor"
MOVES_UM = 1.0
"""Following error of an axis that moves in cuts, RMS [um]; less is that of one that stands."""
PLACES = {"measured": "at the loop’s sensor", "carriage": "at the carriage"}
"""Place of the error: at the sensor that closes the loop, and at the carriage itself."""


def corrected_section(path: Path | None, shelf: SourceRegistry) -> Section | None:
    """Following error of each axis with the command as planned and as corrected, from the JSON."""
    if path is None:
        return None
    document = shelf.document(path, MADE_FROM)
    if document is None:
        return None
    programs: dict[str, Any] = document["programs"]
    rows = [row for name, one in programs.items() for row in _rows(name, one)]
    refused = [f"{name}: {one['refused']}" for name, one in programs.items() if "refused" in one]
    table = tabulated(
        f"Following error on the shop floor, {len(rows)} rows", rows, CORRECTED,
        sources(shelf, path), folded=True,
        note="; ".join(["Mean of runs with different noise, nothing is cut", *refused]) + ".",
    )  # fmt: skip
    if table is None:
        return None
    text = [*_gain(programs), *_rapids(programs)]
    return Section(key="corrected", title="Corrected commands", text=text, blocks=[table])


def _gain(programs: dict[str, Any]) -> Iterator[str]:
    """Remaining following error of axes that move in cuts."""
    in_cuts = [
        axis["measured"].get("cutting", axis["measured"])
        for one in programs.values()
        for axis in one.get("axes", {}).values()
    ]
    moved = [one for one in in_cuts if one["before"]["rms_um"]["mean"] >= MOVES_UM]
    shares = [_mean(one["share_left"]) for one in moved]
    still = len(in_cuts) - len(moved)
    beside = (
        f", but for {counted(still, 'axis', 'axes')} below {MOVES_UM:g} µm as planned"
        if still else ""
    )  # fmt: skip
    if shares:
        yield (
            f"Driven on the simulated shop floor, the corrected commands leave "
            f"{_share(min(shares))} to {_share(max(shares))} of the axes’ following error in cuts "
            f"(RMS at the loop’s sensor{beside}). They were made from the models alone, "
            "before the motion; "
            "kerf simulate PROGRAM --machine M --corrected FILE makes them for a program of yours."
        )


def _rapids(programs: dict[str, Any]) -> Iterator[str]:
    """Effect on rapids, and a warning where the path as a whole is further off."""
    yield (
        "Rapids are commanded as planned, since their axes are at their limits: the correction "
        "fades out after a cut and in before the next, for all axes at the same time."
    )
    off = [
        f"{name} by {number(place['after']['max_um']['mean'], 2)} µm"
        for name, one in programs.items()
        if (place := one.get("path", {}).get("measured")) and _mean(place["share_left"] or 0.0) > 1
    ]
    if off:
        yield f"The whole path is further off than as planned in {joined(off)} at most."


def _share(part: float) -> str:
    return percent(part, 1.0) if part <= 1 else f"{100 * part:.0f}{NARROW}%"


Driven = tuple[str, str, str, str, dict[str, Any]]
"""Program, axis or path, place of the error, in cuts or whole; errors before and after."""


def _rows(name: str, one: dict[str, Any]) -> Iterator[Driven]:
    """Rows of one program: each axis at each place, then the path."""
    for axis, places in (*one.get("axes", {}).items(), ("path", one.get("path") or {})):
        for place, words in PLACES.items():
            if (whole := places.get(place)) is not None:
                for where, part in (("in cuts", whole.get("cutting")), ("whole", whole)):
                    if part is not None:
                        yield name, axis, words, where, part


def _error(when: str, key: str) -> Callable[[Driven], str]:
    return lambda row: number(row[4][when][key]["mean"], 3)


def _left(row: Driven) -> str:
    left = row[4]["share_left"]
    return NOT_KNOWN if left is None else _share(_mean(left))


CORRECTED: tuple[Column[Driven], ...] = (
    Column("Program", lambda row: row[0]),
    Column("Axis", lambda row: row[1]),
    Column("Error", lambda row: row[2]),
    Column("Where", lambda row: row[3]),
    *(
        Column(name, _error(when, key), "µm", group)
        for when, group in (("before", "as planned"), ("after", "corrected"))
        for key, name in (("rms_um", "RMS"), ("max_um", "greatest"))
    ),
    Column("left of RMS", _left, ""),
)


def _mean(value: Any) -> float:
    return float(value["mean"] if isinstance(value, dict) else value)


STATUS = {
    "passed": "passed", "failed": "failed", "not decided": "unknown", "not judged": "unknown",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class EvidencePage:
    """Body of a page on one subject of a machine: a sub-model, its programs, its records."""

    subject: str
    """Subject of :func:`~pipeline.report.folders.evidence_page`."""
    title: str
    """Title for readers."""
    state: StateLine | None = None
    """State of what was assessed; None where nothing was."""
    key_figures: list[tuple[str, str, str]] = field(default_factory=list)
    """Name, value, aside."""
    notes: list[str] = field(default_factory=list)
    """Further notes."""
    sections: list[Section] = field(default_factory=list)
    """Sections in reading order."""
    pages: list[tuple[str, str]] = field(default_factory=list)
    """Address and title of pages below this one: those of the programs."""
    model: str = ""
    """Hash of the sub-model; empty on pages of several."""
    made_from: list[Source] = field(default_factory=list)
    """Files of the key figures; empty for all that the page's other figures stand on."""


def evidence_pages(facts: MachineFacts, changed: Section, notes: list[str]) -> list[EvidencePage]:
    """A page for each sub-model, for programs, incidents and life if any, and for the records."""
    return [
        *(_submodel_page(one) for one in facts.models),
        *_programs_page(facts),
        *_incidents_page(facts),
        *_life_page(facts),
        _records_page(facts, changed, notes),
    ]


def _submodel_page(one: ModelledPart) -> EvidencePage:
    page, verdict = one.page, one.page.verdict
    truth = [Section(key="truth", title="Known truth", blocks=list(page.truth))]
    state = None
    if verdict is not None:
        state = StateLine(
            status=verdict.status, word=ENGLISH(f"verdict.{verdict.status}"),
            sentences=[verdict.sentence, verdict.todo],
        )  # fmt: skip
    return EvidencePage(
        subject=one.name, title=f"{one.title[:1].upper()}{one.title[1:]}", state=state,
        key_figures=page.key_figures, notes=[*page.doubts, *page.notes],
        sections=[*page.sections, *(truth if page.truth else [])], model=one.sha256,
        made_from=made_from(one.shown, MODEL, VERDICT),
    )  # fmt: skip


def _programs_page(facts: MachineFacts) -> list[EvidencePage]:
    sections = [
        programs_section(facts.programs, facts.shelf),
        part_programs_section(facts.parts, facts.shelf),
        corrected_section(facts.folders.corrected, facts.shelf),
    ]
    present_ones = [section for section in sections if section is not None]
    if not present_ones:
        return []
    return [
        EvidencePage(
            subject=PROGRAMS, title="Part programs", key_figures=part_key_figures(facts.parts),
            sections=present_ones,
            pages=[(file, name) for name, file in facts.program_files.items()],
        )
    ]  # fmt: skip


def _incidents_page(facts: MachineFacts) -> list[EvidencePage]:
    found = incidents_of(facts.folders, facts.shelf)
    if found is None:
        return []
    (status, word, sentences), sections = found
    state = StateLine(status=status, word=word, sentences=sentences)
    return [EvidencePage(subject=INCIDENTS, title="Incidents", state=state, sections=sections)]


def _life_page(facts: MachineFacts) -> list[EvidencePage]:
    life = life_of(facts)
    if life is None:
        return []
    (status, word, sentences), sections = life
    state = StateLine(status=status, word=word, sentences=sentences)
    return [EvidencePage(subject=LIFE, title="Life of the model", state=state, sections=sections)]


def _records_page(facts: MachineFacts, changed: Section, notes: list[str]) -> EvidencePage:
    sections = [
        work_section(facts.work, facts.day_uses),
        twin_state_section(facts.folders, facts.shelf),
        condition_section(facts.folders, facts.shelf),
        alarms_section(facts.alarms),
        records_section(facts.records),
        _missing_section(facts),
        changed,
        *([_truth_section(facts)] if facts.folders.origin == "simulated" else []),
        _provenance_section(facts),
    ]
    return EvidencePage(
        subject=RECORDS, title="Records", key_figures=_key_figures(facts), notes=notes,
        sections=[s for s in sections if s is not None],
    )  # fmt: skip


def _key_figures(facts: MachineFacts) -> list[tuple[str, str, str]]:
    r, work = facts.records, facts.work
    return [
        ("Time ACTIVE", f"{hours(work.active)} h" if work.days else NOT_KNOWN,
         f"on {counted(len(work.worked_days), 'day')}"),
        ("Records rejected", percent(r.rejected, r.records),
         f"{number(r.rejected)} of {number(r.records)}" if r.files else "no manifest"),
        ("Last record", moment(r.newest),
         "of the sources that report over time" if r.last_live else "of all sources"),
    ]  # fmt: skip


def _missing_section(facts: MachineFacts) -> Section | None:
    if not facts.folders.missing:
        return None
    return Section(
        key="missing",
        title="What is missing, and what to record",
        pairs=[(what, _asked(record, facts.logged)) for what, record in facts.folders.missing],
    )


def _asked(record: str, logged: tuple[str, ...]) -> str:
    """Record that is needed, and the part of it that the log holds already."""
    held = already(record, logged)
    return f"{record.rstrip('.')}. Logged already: {joined(held)}." if held else record


def _truth_section(facts: MachineFacts) -> Section:
    title = "Known truth"
    if facts.truth is None:
        text = "The simulated shop floor’s truth is not there, so nothing can be held against it."
        return Section(key="truth", title=title, text=[text])
    text = (
        "This machine is simulated, so what it really did is known. It is richer than the model "
        "(more nodes, other laws of loss), so most of the model’s parameters have no single true "
        "value; what can be judged is what was found in its records, and its temperature on the "
        "golden week."
    )
    blocks = present(
        _records_truth_table(facts, facts.truth),
        tabulated(
            "Parameters of the simulated machine", _flat(facts.truth.parameters), SIMULATED,
            sources(facts.shelf, facts.truth.path), most=MOST_ROWS, folded=True,
        ),
    )  # fmt: skip
    return Section(key="truth", title=title, text=[text], blocks=blocks)


Counted = tuple[str, int, int | None]
"""Counted item, its true number, and the number read."""
COUNT_COLUMNS: tuple[Column[Counted], ...] = (
    Column("Quantity", lambda row: row[0]),
    Column("true", lambda row: number(row[1]), ""),
    Column("found", lambda row: number(row[2]), ""),
    Column("difference", lambda row: _difference(*row[1:])),
)


def _records_truth_table(facts: MachineFacts, truth: Truth) -> Table | None:
    """Simulated records and cycles against those that were read."""
    r, cycles = facts.records, facts.work.cycles
    glitches = truth.counts.glitches
    lost = sum(not (c.start_seen and c.end_seen) for c in truth.cycles or [])
    unseen = f", of which the log loses an end of {number(lost)}" if lost else ""
    lines = [
        ("records that cannot be read", truth.counts.rejected,
         r.rejected if r.files is not None else None),
        (f"cycles{unseen}", None if truth.cycles is None else len(truth.cycles),
         None if cycles is None else len(cycles)),
        ("wrong values in the log; removed or changed by cleaning",
         None if glitches is None else sum(glitches.values()),
         None if r.changes is None else sum(one.count for one in r.changes)),
    ]  # fmt: skip
    rows = [(what, true, found) for what, true, found in lines if true is not None]
    caption = "What was simulated against what was found"
    return tabulated(caption, rows, COUNT_COLUMNS, sources(facts.shelf, truth.path))


def _difference(true: int, seen: int | None) -> str:
    if seen is None:
        return NOT_KNOWN
    return "none" if true == seen else ("+" if seen > true else "") + number(seen - true)


SIMULATED: tuple[Column[tuple[str, str]], ...] = (
    Column("Parameter", lambda parameter: code(parameter[0])),
    Column("value", lambda parameter: parameter[1]),
)


def _flat(document: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested parameters as pairs of dotted name and value in words."""
    if isinstance(document, Mapping):
        parts = [_flat(v, f"{prefix}.{k}" if prefix else str(k)) for k, v in document.items()]
        return [row for part in parts for row in part]
    if isinstance(document, list) and len(document) > 8:
        return [(prefix, f"{len(document)} entries")]
    if isinstance(document, list):
        parts = [_flat(v, f"{prefix}[{i}]") for i, v in enumerate(document)]
        return [row for part in parts for row in part]
    if document is None or isinstance(document, bool):
        return [(prefix, {None: "none", True: "yes", False: "no"}[document])]
    return [(prefix, document if isinstance(document, str) else number(document))]


def _provenance_section(facts: MachineFacts) -> Section:
    broken = [f"{path} was left out: {why}." for path, why in sorted(facts.shelf.broken.items())]
    return Section(
        key="provenance",
        title="Where everything comes from",
        text=[
            "Each figure and table names its source below it, with the first twelve digits of the "
            "file’s SHA-256; the whole hashes stand here.",
            *broken,
        ],
        blocks=present(
            _serving_table(facts), _provenance_table(facts.shelf), _origins_table(facts)
        ),
        closing=True,
    )


def _serving_table(facts: MachineFacts) -> Table | None:
    """The champion's sub-models: their verdicts, and whether the latest are the same."""
    found = facts.serving
    if found is None:
        return None
    serving, older = found.bundle.submodels, found.older
    latest = {one.name for one in facts.models if one.model is not None}

    def verdict(name: str) -> str | Cell:
        one = serving.get(name)
        return "–" if one is None else Cell(text=one.status, status=STATUS[one.status])

    return tabulated(
        "The champion that serves, and the latest models, which this page shows",
        list(dict.fromkeys([*(one.name for one in facts.models), *serving])),
        (
            Column("Model of", lambda name: facts.titles([name])),
            Column("champion, sha256", lambda name: code(
                serving[name].sha256[:12] if name in serving else "none"
            )),
            Column("its verdict", verdict),
            Column("latest", lambda name: (
                "none" if name not in latest else "another" if name in older else "the same"
            )),
        ),
        sources(facts.shelf, found.path),
    )  # fmt: skip


USED: tuple[Column[Source], ...] = (
    Column("File", lambda one: code(one.path)),
    Column("sha256", lambda one: code(one.sha256)),
    Column("made from", lambda one: one.made_from or "–"),
)
ORIGINS: tuple[Column[tuple[str, SourceFile]], ...] = (
    Column("Used", lambda use: use[0]),
    Column("file", lambda use: code(use[1].file)),
    Column("sha256", lambda use: code(use[1].sha256)),
)


def _provenance_table(shelf: SourceRegistry) -> Table | None:
    used = sorted(shelf.used.values(), key=lambda s: s.path)
    caption = f"Every file that this page was made from ({number(len(used))})"
    return tabulated(caption, used, USED, folded=True)


def _origins_table(facts: MachineFacts) -> Table | None:
    """Raw files by hash that models were fitted on, and that they were judged on."""
    models = [one.model for one in facts.models if one.model is not None]
    fitted = {file for model in models for case in model.trained_on for file in case.files}
    golden = facts.golden.golden if facts.golden is not None else None
    uses = [("to learn", one) for one in sorted(fitted, key=lambda one: (one.file, one.sha256))]
    sealed = facts.golden.sealed if facts.golden is not None else None
    uses += [("to judge", one) for one in (golden.files if golden is not None else ())]
    uses += [("sealed", one) for one in (sealed.files if sealed is not None else ())]
    stored = [one.shown.folder / "model.json" for one in facts.models]
    return tabulated(
        "What the models were fitted on and judged on", uses, ORIGINS,
        sources(facts.shelf, *stored, facts.folders.golden), most=MOST_ROWS, folded=True,
    )  # fmt: skip
