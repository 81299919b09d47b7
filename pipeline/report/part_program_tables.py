"""Tables of optimised programs: all of them, and what was predicted beside what was cut."""

from typing import Any

from pipeline.charts.numbers import NARROW, number, real
from pipeline.charts.sources import Source, dig
from pipeline.charts.tables import Cell, Head, Table, cells, numbers, sources
from pipeline.report.cut_tables import NONE, share
from pipeline.report.facts import Facts
from pipeline.report.optimise_tables import change, figure
from pipeline.report.optimise_verdict import aim
from pipeline.report.part_program_facts import PartProgram


def overview_table(found: Facts) -> Table | None:
    """Every program: time, cost and peak load before and after, and what is proved."""
    programs = found.parts.programs
    if not programs:
        return None
    currencies = dict.fromkeys(str(p.document.get("currency") or "") for p in programs)
    currency = next(iter(currencies)) if len(currencies) == 1 else ""
    heads = [Head(name="Program"), Head(name="aim")]
    for name, unit, columns in (
        ("Time", "s", 3), ("Cost", currency, 3), ("Peak load", "N", 2),
    ):  # fmt: skip
        words = (("before", unit), ("after", unit), ("change", ""))[:columns]
        heads += numbers(*words, group=name)
    heads += [*numbers(("limit", "N")), Head(name="same moves")]
    return Table(
        caption="Part programs before and after",
        heads=heads,
        rows=[_overview(one) for one in programs],
        sources=sources(found.shelf, *(one.path for one in programs)),
    )


def _overview(one: PartProgram) -> list[Cell]:
    d = one.document
    proof = Cell(text="proved" if one.proved else "not proved",
                 status="passed" if one.proved else "failed")  # fmt: skip
    return cells(
        one.label, aim(d),
        *_pair(d, "time_s", 4), change(dig(d, "gain", "time_percent")),
        *_pair(d, "cost", 4), change(dig(d, "gain", "cost_percent")),
        *_pair(d, "peak_load_N", 3), figure(one.limit), proof,
    )  # fmt: skip


def _pair(document: dict[str, Any], key: str, digits: int) -> list[str]:
    return [figure(dig(document, which, key), digits) for which in ("before", "after")]


def cut_table(found: Facts, one: PartProgram) -> Table | None:
    """Predicted by the twin beside cut by the simulated shop floor, which is another machine."""
    cuts = one.cuts("after")
    if one.cut is None or cuts is None:
        return None
    limit, allowed = one.limit, one.epsilon
    rows = [
        cells("Time, s", *_sides(one, ("time_s",), ("time_s", "mean"), 4)),
        cells("Peak load, N", *_sides(one, ("peak_load_N",), ("peak_load_N", "mean"), 3)),
        cells("Highest peak load, N", NONE, *_cut(one, "before", "max"), NONE,
              *_cut(one, "after", "max")),
        cells(f"Above the limit{f' of {number(limit)}{NARROW}N' if limit is not None else ''}",
              NONE, _above(one, "before"), share(dig(one.document, "certainty", "exceedance")),
              _above(one, "after")),
    ]  # fmt: skip
    heads = [Head(name="Of the part"),
             *numbers(("predicted", ""), ("cut", ""), group="As programmed"),
             *numbers(("predicted", ""), ("cut", ""), group="Optimised")]  # fmt: skip
    asked = "" if allowed is None else f"; asked for was at most {share(allowed)}"
    return Table(
        caption=f"{one.label}: predicted, and cut on the simulated shop floor {cuts[1]} times",
        heads=heads, rows=rows, sources=_both(found, one),
        note="Each cut has its own mounting of the tool, batch of material and wear; means are "
        f"over them. The shop floor is richer than the twin, which knows nothing of it{asked}.",
    )  # fmt: skip


def _sides(
    one: PartProgram, predicted: tuple[str, ...], cut: tuple[str, ...], digits: int
) -> list[str]:
    return [
        figure(dig(side, which, *keys), digits)
        for which in ("before", "after")
        for side, keys in ((one.document, predicted), (one.cut, cut))
    ]


def _cut(one: PartProgram, which: str, key: str) -> list[str]:
    return [figure(dig(one.cut, which, "peak_load_N", key))]


def _above(one: PartProgram, which: str) -> str:
    cuts = one.cuts(which)
    return NONE if cuts is None else f"{cuts[0]} of {cuts[1]}"


def _both(found: Facts, one: PartProgram) -> list[Source]:
    trial = found.parts.trial
    return sources(found.shelf, one.path, *([trial] if trial is not None else []))


def trial_time_error(one: PartProgram) -> float | None:
    """By how much the predicted time of the optimised program is wrong [%]."""
    predicted = real(dig(one.document, "after", "time_s"))
    cut = real(dig(one.cut, "after", "time_s", "mean"))
    return None if predicted is None or not cut else 100 * (predicted / cut - 1)
