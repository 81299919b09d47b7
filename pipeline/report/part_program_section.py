"""The section on optimised part programs: before and after, how sure, and what was cut."""

from typing import Any

from pipeline.charts.numbers import NARROW, counted, real, signed
from pipeline.charts.sections import Block, Figure, Figures, Heading, Section, present
from pipeline.charts.sources import dig, rows_of
from pipeline.charts.tables import sources
from pipeline.report import optimise_load_figure
from pipeline.report.cutting_verdict import cutting_verdict
from pipeline.report.facts import Facts
from pipeline.report.optimise_load_figure import load_figure, tool_spans, way_load
from pipeline.report.optimise_tables import (
    binding_table,
    figure,
    gain_table,
    groups_table,
    methods_table,
    proof_table,
    uncertain_table,
)
from pipeline.report.optimise_verdict import verdict
from pipeline.report.part_program_facts import PartProgram
from pipeline.report.part_program_tables import cut_table, overview_table, trial_time_error

WHAT = (
    "F and S of each block were chosen again, inside the limits of the part; every other byte of "
    "the program is as it was. Times are those of the control that was identified; loads rest on "
    "the coefficients in the tables of what the certainty allows for."
)
MORE = "kerf optimise draws F, S, time and cost block by block on a page of its own."


def part_programs_section(found: Facts) -> Section | None:
    """All programs in a table, then each: load, gain, certainty, methods, cut, proof."""
    programs = found.parts.programs
    if not programs:
        return None
    blocks: list[Block] = present(overview_table(found))
    for one in programs:
        blocks += _program(found, one)
    title = "Part programs: faster or cheaper"
    return Section(key="part-programs", title=title, text=[f"{WHAT} {MORE}"], blocks=blocks)


def _program(found: Facts, one: PartProgram) -> list[Block]:
    document, files = one.document, sources(found.shelf, one.path)
    _, word, told = verdict(document)
    words = " ".join([*_doubt(found), *told, *_cut(one), *_held(document)])
    return present(
        Heading(heading=f"{one.label}: {word}", text=words),
        _load(found, one),
        gain_table(document, files),
        cut_table(found, one),
        binding_table(document, files),
        methods_table(document, files),
        uncertain_table(document, files),
        groups_table(document, files),
        proof_table(document, files),
    )


def _load(found: Facts, one: PartProgram) -> Figures | None:
    before, after = (way_load(one.document, which) for which in ("before", "after"))
    if before is None or after is None:
        return None
    legend = [*optimise_load_figure.LEGEND]
    if one.limit is not None:
        legend.append(optimise_load_figure.OVER)
    words = f"Load along the way of {one.label}, as programmed and optimised"
    picture = Figure(
        svg=load_figure(before, after, one.limit, tool_spans(one.document), words),
        caption=f"{words}: the highest force on the tool in the plane, predicted.",
        sources=sources(found.shelf, one.path),
    )
    return Figures(figures=[picture], legend=legend, kind="one")


def _cut(one: PartProgram) -> list[str]:
    """What the simulated shop floor made of it."""
    cuts, before = one.cuts("after"), one.cuts("before")
    if cuts is None or before is None:
        return []
    error = trial_time_error(one)
    said = (
        f"Cut on the simulated shop floor {cuts[1]} times, it passed the limit of the load in "
        f"{cuts[0]} of them, the program as it was in {before[0]}"
    )
    times = [figure(dig(one.cut, which, "time_s", "mean"), 4) for which in ("after", "before")]
    if error is not None:
        said += (
            f"; it took {times[0]}{NARROW}s instead of {times[1]}{NARROW}s, and its time was "
            f"predicted with an error of {signed(error)}{NARROW}%"
        )
    return [f"{said}."]


def _doubt(found: Facts) -> list[str]:
    """Why the predicted loads must not be trusted, where the machine's forces were judged."""
    judged = cutting_verdict(found.cutting)
    if judged is None or judged.status == "passed":
        return []
    return ["Do not load it yet: the forces of this machine’s cut have not passed their judgement, "
            "and its loads rest on them."]  # fmt: skip


def _held(document: dict[str, Any]) -> list[str]:
    rows = rows_of(document, "held")
    many = sum(int(real(row.get("rows")) or 0) for row in rows)
    if not many:
        return []
    reasons = ", ".join(str(row.get("reason")) for row in rows[:3])
    return [f"{counted(many, 'move')} stayed as programmed: {reasons}."]
