"""Predicted spindle power of a program beside that of the machine's log when it cut the program."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.numbers import duration, number
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.cut.tables import NONE, tool_words
from pipeline.report.folders import MachineFolders
from pipeline.report.programs.simulated import Program
from pipeline.report.work import Work
from pipeline.schema.arrays import Floats
from pipeline.schema.days import day_of
from pipeline.schema.program_cut import ProgramCut
from pipeline.schema.twin_state import MANIFEST, TwinState, day_path

COLUMNS = ("program", "mode", "tool_number",
           *(f"cutting_power_{part}" for part in ("estimated", "low", "high")))  # fmt: skip
MADE_FROM = "the machine’s log, by the stage state"
WHAT = (
    "Mean power at the tool while it cuts. The log’s is its spindle load where the speed is "
    "steady, less the power without a cut; that it ran this very text, the log does not say."
)
Row = tuple[str, str, str, str, str, str, Cell]


def against(predicted: tuple[float, float], other: tuple[float, float]) -> str:
    """Where an interval lies beside that of a prediction.

    >>> [against((1.0, 2.0), other) for other in ((1.9, 3.0), (2.1, 3.0), (0.2, 0.9))]
    ['within', 'higher than predicted', 'lower than predicted']
    """
    if other[0] > predicted[1]:
        return "higher than predicted"
    return "lower than predicted" if other[1] < predicted[0] else "within"


def recorded_section(
    program: Program, folders: MachineFolders, work: Work, shelf: SourceRegistry
) -> Section | None:
    """Power by tool, predicted and recorded; None where nothing cuts."""
    if program.cut is None or not program.cut.by_tool:
        return None
    names = {one.lower() for one in (program.name, Path(program.summary.file).stem)}
    cycles = [one for one in work.cycles or [] if one.program.lower() in names]
    days = sorted({day_of(at, work.time_zone) for one in cycles for at in (one.start, one.end)})
    folder, why = folders.twin_state, "the machine’s log has not cut a program of this name"
    state = None if folder is None else shelf.read(folder / MANIFEST, TwinState, MADE_FROM)
    paths = []
    if cycles:
        days = [day for day in days if state and day in state.days]
        paths = [] if folder is None else [day_path(folder, day) for day in days]
        said = [state.days[day].unknown.get("cutting_power", "") for day in days] if state else []
        why = next(filter(None, said), "its load was steady nowhere in the cut")
    tables = [t for path in paths if (t := shelf.table(path, COLUMNS, MADE_FROM)) is not None]
    powers, period = _powers(tables, names), state.period_s if state else 0.0
    return Section(
        key="recorded", title="Predicted load beside that of the log", text=[WHAT],
        blocks=present(tabulated(
            "Power by tool, predicted and recorded",
            list(_rows(program.cut, powers, period, why)), (
                Column("Tool", lambda row: row[0]),
                Column("mean", lambda row: row[1], "kW", "Predicted"),
                Column("90 % interval", lambda row: row[2], "kW", "Predicted"),
                Column("mean", lambda row: row[3], "kW", "Recorded"),
                Column("90 % interval", lambda row: row[4], "kW", "Recorded"),
                Column("over", lambda row: row[5], "", "Recorded"),
                Column("recorded is", lambda row: row[6]),
            ), [*program.sources(shelf)[0], *sources(shelf, *paths)],
        )),
    )  # fmt: skip


def _powers(tables: Sequence[pa.Table], names: Collection[str]) -> dict[int, Floats]:
    """Power of the log's rows in which a program cuts, with its interval [kW], by tool; (N, 3)."""
    found: dict[int, list[list[float | None]]] = {}
    for table in tables:
        program, mode = (table.column(name).cast(pa.string()) for name in COLUMNS[:2])
        own = pc.is_in(pc.utf8_lower(program), value_set=pa.array(sorted(names)))
        own = table.filter(pc.and_(own, pc.equal(mode, "cut")))
        for tool, *power in zip(*(own.column(one).to_pylist() for one in COLUMNS[2:]), strict=True):
            if (digits := re.search(r"\d+", str(tool))) and None not in power:
                found.setdefault(int(digits[0]), []).append(power)
    return {tool: 1e-3 * np.array(rows, float) for tool, rows in found.items()}


def _rows(cut: ProgramCut, powers: Mapping[int, Floats], period: float, why: str) -> Iterator[Row]:
    spread = {one.tool: one for one in cut.forces}
    for tool in cut.by_tool:
        known = [(b.power_kW, b.in_material_s) for b in cut.blocks
                 if b.tool == tool.tool and b.power_kW is not None and b.in_material_s]  # fmt: skip
        mean = sum(p * s for p, s in known) / sum(s for _, s in known) if known else None
        force, recorded = spread.get(tool.tool), powers.get(tool.tool)
        ends = None
        if mean is not None and force and force.mean_load_N:
            shares = [None if end is None else end / force.mean_load_N
                      for end in (force.mean_load_low_N, force.mean_load_high_N)]  # fmt: skip
            if shares[0] is not None and shares[1] is not None:
                ends = mean * shares[0], mean * shares[1]
        lacking = why if recorded is None else "its predicted load has no interval"
        word = Cell(text=f"not comparable because {lacking}", status="unknown")
        of_log = NONE, NONE, NONE
        if recorded is not None:
            value, low, high = recorded.mean(axis=0).tolist()
            over = duration(len(recorded) * period)
            of_log = number(value), f"{number(low)} to {number(high)}", over
            if ends is not None:
                said = against(ends, (low, high))
                word = Cell(text=said, status="passed" if said == "within" else "attention")
        shown = NONE if ends is None else f"{number(ends[0])} to {number(ends[1])}"
        yield (tool_words(tool), NONE if mean is None else number(mean), shown, *of_log, word)
