"""Pages of a machine's part programs.

A page is that of the command: of an optimised program that of ``kerf optimise``, with what the
simulated shop floor cut of it; of a simulated one where its time goes.
"""

from collections.abc import Iterator
from dataclasses import replace

from pipeline.charts.numbers import NARROW, number, signed
from pipeline.charts.sections import PartVerdict, Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Column, Table, sources, tabulated
from pipeline.report.cut.tables import NONE, figure, share
from pipeline.report.facts import MachineFacts
from pipeline.report.folders import PROGRAMS, evidence_page
from pipeline.report.optimised import tables
from pipeline.report.optimised.page import optimised_page
from pipeline.report.part_programs import PartProgram, PartPrograms
from pipeline.report.programs.simulated import feed_classes, simulated_page, time_section
from pipeline.report.standalone_page import StandalonePage
from pipeline.schema.part import Side

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
    for name, file in facts.program_files.items():
        if name not in parts:
            page = simulated_page(simulated[name], classes, facts.shelf, _assumed(facts))
        else:
            page = _part_page(facts, parts[name])
            if name in simulated:
                program = simulated[name]
                section = time_section(program, classes, *program.sources(facts.shelf))
                page = replace(page, sections=[*page.sections, section])
        yield file, replace(page, up=up, credit=facts.folders.credit)


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


def trial_section(
    parts: PartPrograms, shelf: SourceRegistry, part: PartProgram
) -> Section | None:  # fmt: skip
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
