"""Section on optimised part programs: before and after, reliability, trial cuts."""

from collections.abc import Iterator

from pipeline.charts.numbers import NARROW, counted, number, signed
from pipeline.charts.sections import Block, Heading, PartVerdict, Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, Head, Table, cells, numbers, sources, tabulated
from pipeline.report import optimised_tables as tables
from pipeline.report.cut.edges import edge_words, edges_table
from pipeline.report.cut.tables import NONE, share
from pipeline.report.optimised_figures import load_figures
from pipeline.report.optimised_program import feeds_table, increases_table, ranges_table
from pipeline.report.optimised_verdict import aim, verdict
from pipeline.report.part_programs import PartProgram, PartPrograms
from pipeline.schema.part import OptimisedPart

WHAT = (
    "F and S of each block were chosen again, inside the limits of the part; every other byte of "
    "the program is as it was. Times are those of the control that was identified; loads rest on "
    "the coefficients in the tables of uncertain quantities."
)
MORE = "kerf optimise draws F, S, time and cost block by block on a page of its own."


def part_programs_section(
    parts: PartPrograms, shelf: SourceRegistry, forces: PartVerdict | None
) -> Section | None:
    """All programs in a table, then each: load, gain, changes, certainty, methods, cut, proof.

    ``forces`` is the verdict on the machine's cutting forces, which the loads rest on.
    """
    programs = parts.programs
    if not programs:
        return None
    blocks: list[Block] = present(overview_table(parts, shelf))
    for one in programs:
        blocks += _program(parts, shelf, forces, one)
    title = "Part programs: faster or cheaper"
    return Section(key="part-programs", title=title, text=[f"{WHAT} {MORE}"], blocks=blocks)


def _program(
    parts: PartPrograms, shelf: SourceRegistry, forces: PartVerdict | None, one: PartProgram
) -> list[Block]:
    part, files = one.part, sources(shelf, one.path)
    _, word, said = verdict(part)
    words = " ".join([*_doubt(forces), *said, *_trial(one), *edge_words(part.edges), *_held(part)])
    return present(
        Heading(heading=f"{one.label}: {word}", text=words),
        load_figures(part, one.label, "", files, kind="one"),
        tables.gain_table(part, files),
        cut_table(parts, shelf, one),
        edges_table(part.edges, files, f"{one.label}, optimised: "),
        increases_table(part, files),
        feeds_table(part, files),
        ranges_table(part, files),
        tables.binding_table(part, files),
        tables.methods_table(part, files),
        tables.uncertain_table(part, files),
        tables.groups_table(part, files),
        tables.proof_table(part, files),
    )


def _trial(one: PartProgram) -> list[str]:
    """Trial cuts on the simulated shop floor."""
    cuts, before = one.cuts("after"), one.cuts("before")
    if one.cut is None or cuts is None or before is None:
        return []
    error = trial_time_error(one)
    said = (
        f"Cut on the simulated shop floor {cuts[1]} times, it passed the limit of the load in "
        f"{cuts[0]} of them, the program as it was in {before[0]}"
    )
    times = [tables.figure(side.time_s.mean, 4) for side in (one.cut.after, one.cut.before)]
    if error is not None:
        said += (
            f"; it took {times[0]}{NARROW}s instead of {times[1]}{NARROW}s, and its time was "
            f"predicted with an error of {signed(error)}{NARROW}%"
        )
    return [f"{said}."]


def _doubt(forces: PartVerdict | None) -> list[str]:
    """Why the predicted loads must not be trusted, where the machine's forces were judged."""
    if forces is None or forces.status == "passed":
        return []
    return ["Do not load it yet: the forces of this machine’s cut have not passed their judgement, "
            "and its loads rest on them."]  # fmt: skip


def _held(part: OptimisedPart) -> list[str]:
    many = sum(row.rows for row in part.held)
    if not many:
        return []
    reasons = ", ".join(row.reason for row in part.held[:3])
    return [f"{counted(many, 'move')} stayed as programmed: {reasons}."]


def overview_table(parts: PartPrograms, shelf: SourceRegistry) -> Table | None:
    """Every program: time, cost and peak load before and after, and what is proved."""
    programs = parts.programs
    currencies = {one.part.currency or "" for one in programs}
    currency = currencies.pop() if len(currencies) == 1 else ""

    def total(name: str, unit: str, key: str, digits: int) -> list[Column[PartProgram]]:
        return [
            Column("before", lambda one: tables.side(one.part, "before", key, digits), unit, name),
            Column("after", lambda one: tables.side(one.part, "after", key, digits), unit, name),
        ]

    return tabulated("Part programs before and after", programs, (
        Column("Program", lambda one: one.label),
        Column("aim", lambda one: aim(one.part)),
        *total("Time", "s", "time_s", 4),
        Column("change", lambda one: tables.change(one.part.gain.time_percent), "", "Time"),
        *total("Cost", currency, "cost", 4),
        Column("change", lambda one: tables.change(one.part.gain.cost_percent), "", "Cost"),
        *total("Peak load", "N", "peak_load_N", 3),
        Column("limit", lambda one: tables.figure(one.limit), "N"),
        Column("same moves", lambda one: Cell(
            text="proved" if one.proved else "not proved",
            status="passed" if one.proved else "failed",
        )),
    ), sources(shelf, *(one.path for one in programs)))  # fmt: skip


def cut_table(parts: PartPrograms, shelf: SourceRegistry, one: PartProgram) -> Table | None:
    """Predicted by the twin beside cut by the simulated shop floor, which is another machine."""
    cut, cuts = one.cut, one.cuts("after")
    if cut is None or cuts is None:
        return None
    limit, allowed, of = one.limit, one.epsilon, one.part.certainty

    def totals(key: str, digits: int) -> Iterator[str]:
        """Predicted and cut, before and after."""
        for which in ("before", "after"):
            yield tables.side(one.part, which, key, digits)
            yield tables.figure(getattr(cut.side(which), key).mean, digits)

    rows = [
        cells("Time, s", *totals("time_s", 4)),
        cells("Peak load, N", *totals("peak_load_N", 3)),
        cells("Highest peak load, N", NONE, tables.figure(cut.before.peak_load_N.max), NONE,
              tables.figure(cut.after.peak_load_N.max)),
        cells(f"Above the limit{f' of {number(limit)}{NARROW}N' if limit is not None else ''}",
              NONE, f"{cut.before.above} of {cut.seeds}",
              share(None if of is None else of.exceedance), f"{cut.after.above} of {cut.seeds}"),
    ]  # fmt: skip
    heads = [Head(name="Of the part"),
             *numbers(("predicted", ""), ("cut", ""), group="As programmed"),
             *numbers(("predicted", ""), ("cut", ""), group="Optimised")]  # fmt: skip
    asked = "" if allowed is None else f"; allowed was at most {share(allowed)}"
    trial = [] if parts.trial is None else [parts.trial]
    return Table(
        caption=f"{one.label}: predicted, and cut on the simulated shop floor {cuts[1]} times",
        heads=heads, rows=rows, sources=sources(shelf, one.path, *trial),
        note="Each cut has its own mounting of the tool, batch of material and wear; means are "
        f"over them. The shop floor is richer than the twin, which knows nothing of it{asked}.",
    )  # fmt: skip


def trial_time_error(one: PartProgram) -> float | None:
    """By how much the predicted time of the optimised program is wrong [%]."""
    predicted, cut = one.part.after.time_s, None if one.cut is None else one.cut.after.time_s.mean
    return None if predicted is None or not cut else 100 * (predicted / cut - 1)
