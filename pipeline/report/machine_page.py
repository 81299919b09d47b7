"""What stands on a machine's page, section by section, before it becomes HTML."""

from dataclasses import dataclass, field
from typing import Any

from pipeline.charts.numbers import TOGETHER, counted, fixed, hours, moment, number, percent, signed
from pipeline.charts.sections import Section, absent, present
from pipeline.charts.sources import dig
from pipeline.report.changes import Change
from pipeline.report.control_section import control_section, times_section
from pipeline.report.control_verdict import worst_error
from pipeline.report.cutting_prediction_section import prediction_section
from pipeline.report.cutting_section import cutting_section
from pipeline.report.cutting_truth import cutting_truth_table
from pipeline.report.cutting_verdict import cutting_key_figures
from pipeline.report.drive_records_section import following_section
from pipeline.report.drive_section import drives_section
from pipeline.report.drive_truth import drive_truth_table
from pipeline.report.driven import worst_following, worst_force
from pipeline.report.facts import Facts
from pipeline.report.folders import MachineFolders
from pipeline.report.model_sections import golden_section, thermal_section
from pipeline.report.part_programs import part_key_figures
from pipeline.report.part_section import part_programs_section
from pipeline.report.program_section import programs_section
from pipeline.report.record_tables import (
    cleaning_table,
    files_table,
    gap_causes_table,
    longest_gaps_table,
    reasons_table,
)
from pipeline.report.story_tables import (
    changes_table,
    origins_table,
    provenance_table,
    simulation_table,
    truth_table,
)
from pipeline.report.verdict import Verdict
from pipeline.report.work_section import work_section


@dataclass(frozen=True, kw_only=True)
class Page:
    """One machine's page: head, verdict, key figures (name, value, aside), sections."""

    folders: MachineFolders
    verdict: Verdict
    key_figures: list[tuple[str, str, str]]
    sections: list[Section] = field(default_factory=list)


def machine_page(
    found: Facts, judged: Verdict, differences: list[Change], why_none: str
) -> Page:  # fmt: skip
    """The page of one machine, in the order in which its reader needs it."""
    works = [work_section(found)]
    sections = [
        *(works if found.worked_days or not found.without_spindle else []),
        *([] if found.without_spindle else [thermal_section(found), golden_section(found)]),
        control_section(found),
        times_section(found),
        programs_section(found),
        part_programs_section(found),
        drives_section(found),
        following_section(found),
        cutting_section(found),
        prediction_section(found),
        *([] if found.worked_days or not found.without_spindle else works),
        _records_section(found),
        _missing_section(found),
        _changes_section(differences, why_none),
        *([_truth_section(found)] if found.folders.origin == "simulated" else []),
        _provenance_section(found),
    ]
    return Page(
        folders=found.folders,
        verdict=judged,
        key_figures=_key_figures(found),
        sections=[s for s in sections if s is not None],
    )


def _key_figures(found: Facts) -> list[tuple[str, str, str]]:
    v, r = found.model.validation, found.reading
    active = sum(d.seconds.get("ACTIVE", 0.0) for d in found.working.days)
    days = found.worked_days
    times = worst_error(found.control)
    error = dig(v, "windows", "all", "model", "mae_K")
    heat = [
        ("Error over one hour", _kelvin(error), f"limit {_kelvin(dig(v, 'limits', 'mae_K'))}"),
        ("Error running free", _kelvin(dig(v, "free_run", "all", "model", "mae_K")),
         "golden days, each from its first value"),
    ]  # fmt: skip
    return [
        *([] if found.without_spindle else heat),
        *([("Predicted program times", f"{signed(times)} %",
            f"worst of {counted(len(found.control.judged), 'judged run')}, "
            f"limit ±{fixed(found.control.limit, 0)} %")] if times is not None else []),
        *_drive_figures(found),
        *cutting_key_figures(found.cutting),
        *part_key_figures(found.parts),
        ("Time ACTIVE", f"{hours(active)} h" if found.working.days else "not known",
         f"on {counted(len(days), 'day')}"),
        ("Records rejected", percent(r.rejected, r.records) if r.files else "not known",
         f"{number(r.rejected)} of {number(r.records)}" if r.files else "no manifest"),
        ("Last record", moment(found.last), ""),
    ]  # fmt: skip


def _drive_figures(found: Facts) -> list[tuple[str, str, str]]:
    """The worst errors of judged recordings, and whose they are."""
    judged, drives = found.drives.judged, found.drives
    force, following = worst_force(judged), worst_following(judged)
    every = [
        ("Force of the axes", force, force.force_error if force else None, drives.force_limit),
        ("Following errors", following, following.following_error if following else None,
         drives.following_limit),
    ]  # fmt: skip
    return [
        (words, f"{fixed(error, 1)} %", f"worst of judged recordings, axis {run.axis}"
         + (f", limit{TOGETHER}{limit:g}{TOGETHER}%" if limit is not None else ""))
        for words, run, error, limit in every if run is not None
    ]  # fmt: skip


def _kelvin(value: Any) -> str:
    words = fixed(value, 2)
    return words if words == "not known" else f"{words} K"


def _records_section(found: Facts) -> Section:
    r = found.reading
    title = "What was read, and what was not"
    if r.files is None:
        return Section(key="records", title=title, text=[absent(
            found.folders.signals / "manifest.json",
            "Put the machine’s log, or its tables, under data/raw and name them in conf/machine/.",
        )])  # fmt: skip
    text = [
        f"{counted(len(r.files), 'file')} with {number(r.records)} records: "
        f"{number(r.records - r.rejected)} kept, {number(r.rejected)} rejected. "
        + ("Read equals kept plus rejected in every file." if not r.unbalanced else
           f"In {counted(len(r.unbalanced), 'file')} read is not kept plus rejected.")
    ]  # fmt: skip
    for content, path, words in (
        (r.reasons, found.folders.signals / "rejected.parquet", "why records were rejected"),
        (r.changes, found.folders.clean / "audit.parquet", "what cleaning changed"),
        (r.gap_causes, found.folders.clean / "gaps.parquet", "where the record has gaps"),
    ):
        if content is None:
            text.append(absent(path, f"Without it nobody knows {words}."))
    blocks = present(
        reasons_table(found), files_table(found), cleaning_table(found),
        gap_causes_table(found), longest_gaps_table(found),
    )  # fmt: skip
    return Section(key="records", title=title, text=text, blocks=blocks)


def _missing_section(found: Facts) -> Section | None:
    if not found.folders.missing:
        return None
    return Section(
        key="missing",
        title="What is missing, and what to record",
        pairs=[(what, record) for what, record in found.folders.missing],
    )


def _changes_section(differences: list[Change], why_none: str) -> Section:
    return Section(
        key="changes",
        title="What changed since the last report",
        text=[why_none] if why_none else [d.note for d in differences if d.note],
        blocks=present(changes_table(differences)),
    )


def _truth_section(found: Facts) -> Section:
    title = "Known truth"
    if found.model.truth is None or found.folders.truth is None:
        text = "The simulated shop floor’s truth is not there, so nothing can be held against it."
        return Section(key="truth", title=title, text=[text])
    text = (
        "This machine is simulated, so what it really did is known. It is richer than the model "
        "(more nodes, other laws of loss), so most of the model’s parameters have no single true "
        "value; what can be judged is what was found in its records, and its temperature on the "
        "golden week."
    )
    blocks = present(truth_table(found), drive_truth_table(found),
                     cutting_truth_table(found), simulation_table(found))  # fmt: skip
    return Section(key="truth", title=title, text=[text], blocks=blocks)


def _provenance_section(found: Facts) -> Section:
    broken = [f"{path} was left out: {why}." for path, why in sorted(found.shelf.broken.items())]
    return Section(
        key="provenance",
        title="Where everything comes from",
        text=[
            "Each figure and table names its source below it, with the first twelve digits of the "
            "file’s SHA-256; the whole hashes stand here.",
            *broken,
        ],
        blocks=present(provenance_table(found.shelf), origins_table(found)),
        closing=True,
    )
