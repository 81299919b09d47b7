"""Recorded disturbances on the page: where they enter the loops, by what factor, and the cause."""

from collections.abc import Sequence

from pipeline.charts import tables
from pipeline.charts.numbers import number, real
from pipeline.charts.sources import Source
from pipeline.schema.verdict import JudgedCase

Run = tuple[str, JudgedCase]
"""Letter of an axis, and a recording that shows it."""

NOTE = (
    "Tested is whether a recorded disturbance enters at the reference position, at the speed "
    "command, at the command of the motor or as a force on the axis. Factor and delay come from "
    "the recording itself, ± half of their 95 % interval; one that is not determined is left out "
    "of the twin’s run, never taken as 1."
)


def disturbances_table(runs: Sequence[Run], sources: list[Source]) -> tables.Table | None:
    """Every recorded disturbance and its entry; None without any."""
    shown = [(axis, case) for axis, case in runs if f"disturbance {axis} enters at" in case.facts]
    if not shown:
        return None
    return tables.Table(
        caption=f"Recorded disturbances{tables.left_out(len(shown), tables.MOST_ROWS)}",
        note=NOTE,
        heads=[
            *tables.names("Recording", "axis", "enters at"),
            *tables.names("factor"), *tables.names("delay"),
            *tables.numbers(("explained", "%")), *tables.names("what to know"),
        ],
        rows=[_row(run) for run in shown[: tables.MOST_ROWS]],
        sources=sources,
    )  # fmt: skip


def causes_words(runs: Sequence[Run]) -> str:
    """What the headline says of the disturbances in runs that failed; "" without any."""
    said = {
        case.case: str(cause.value)
        for axis, case in runs
        if (cause := case.facts.get(f"disturbance {axis}, cause")) is not None
    }
    return "".join(f" In {case} {words}." for case, words in said.items())


def _row(run: Run) -> list[tables.Cell]:
    axis, case = run
    name, facts = f"disturbance {axis}", case.facts
    cause = facts.get(f"{name}, cause")
    return tables.cells(
        tables.Cell(text=case.case, code=True), axis,
        str(facts[f"{name} enters at"].value),
        _with_interval(case, f"{name}, factor"), _with_interval(case, f"{name}, delay"),
        number(real(facts[f"{name}, error explained"].value), 2),
        "as declared" if cause is None else str(cause.value),
    )  # fmt: skip


def _with_interval(case: JudgedCase, key: str) -> str:
    """Value, half width of its interval and unit; a dash where it is not determined."""
    found, half = case.facts.get(key), case.facts.get(f"{key}, half width")
    if found is None:
        return "–"
    width = "" if half is None else f" ± {number(real(half.value), 2)}"
    return f"{number(real(found.value))}{width} {found.unit}"
