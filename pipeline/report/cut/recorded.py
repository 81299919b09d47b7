"""Predicted spindle power of a program beside that of the machine's log when it cut the program."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.numbers import duration, number
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.cut.tables import figure, tool_words
from pipeline.report.folders import MachineFolders
from pipeline.report.programs.simulated import Program
from pipeline.report.work import Work
from pipeline.schema.arrays import Floats
from pipeline.schema.days import day_of
from pipeline.schema.program_cut import ProgramCut, ToolTotals
from pipeline.schema.twin_state import MANIFEST, TwinState, day_path

POWER = tuple(f"cutting_power_{part}" for part in ("estimated", "low", "high"))
COLUMNS = ("program", "mode", "tool_number", *POWER)
MADE_FROM = "the machine’s log, by the stage state"
KW = 1e-3

Band = tuple[float, float, float]
"""Value and the ends of its 90 % interval."""


@dataclass(frozen=True, kw_only=True)
class PowerBeside:
    """Mean power at the tool while it cuts [kW], predicted and as the log's load says it.

    ``seconds`` are those of the log [s]; ``why`` says why they cannot be compared.
    """

    tool: ToolTotals
    predicted: Band | None
    recorded: Band | None
    seconds: float = 0.0
    why: str = ""

    @property
    def word(self) -> Cell:
        """How the log's stands to the prediction's interval."""
        if self.predicted is None or self.recorded is None:
            return Cell(text=f"not comparable because {self.why}", status="unknown")
        word = against(self.predicted[1:], self.recorded[1:])
        return Cell(text=word, status="passed" if word == "within" else "attention")


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
    state = folders.twin_state
    cycles = [one for one in work.cycles or [] if one.program.lower() in names]
    days = sorted({day_of(at, work.time_zone) for one in cycles for at in (one.start, one.end)})
    found = None if state is None else shelf.read(state / MANIFEST, TwinState, MADE_FROM)
    paths = [] if state is None else [day_path(state, d) for d in days if found and d in found.days]
    tables = [t for path in paths if (t := shelf.table(path, COLUMNS, MADE_FROM)) is not None]
    rows = _rows(tables, names)
    why = "the machine’s log has not cut a program of this name"
    if cycles:
        said = [found.days[d].unknown.get("cutting_power", "") for d in days if d in found.days] \
            if found else ["there is no state of the twin"]  # fmt: skip
        why = next(filter(None, said), "its load was steady nowhere in the cut")
    made = list(_powers(program.cut, rows, found.period_s if found else 0.0, why))
    return Section(
        key="recorded", title="Predicted load beside that of the log",
        text=["Mean power at the tool while it cuts. The log’s is its spindle load where the speed "
              "is steady, less the power without a cut; that it ran this very text, the log does "
              "not say."],
        blocks=present(tabulated("Power by tool, predicted and recorded", made, (
            Column("Tool", lambda one: tool_words(one.tool)),
            Column("predicted", lambda one: figure(one.predicted and one.predicted[0]), "kW"),
            Column("90 % interval", lambda one: _range(one.predicted), "kW"),
            Column("recorded", lambda one: figure(one.recorded and one.recorded[0]), "kW"),
            Column("90 % interval", lambda one: _range(one.recorded), "kW"),
            Column("over", lambda one: duration(one.seconds) if one.recorded else "–", ""),
            Column("recorded is", lambda one: one.word),
        ), [*program.sources(shelf)[0], *sources(shelf, *paths)])),
    )  # fmt: skip


def _rows(tables: Sequence[pa.Table], names: Collection[str]) -> dict[int, Floats]:
    """Power of the log's rows in which a program cuts, with the ends of its interval, by tool."""
    found: dict[int, list[list[float | None]]] = {}
    for table in tables:
        program, mode = (table.column(name).cast(pa.string()) for name in ("program", "mode"))
        own = pc.is_in(pc.utf8_lower(program), value_set=pa.array(sorted(names)))
        own = table.filter(pc.and_(own, pc.equal(mode, "cut")))
        for tool, *power in zip(*(own.column(one).to_pylist() for one in COLUMNS[2:]), strict=True):
            digits = re.search(r"\d+", str(tool))
            if digits:
                found.setdefault(int(digits[0]), []).append(power)
    known = {tool: np.array(rows, float) for tool, rows in found.items()}
    return {tool: rows[np.isfinite(rows).all(axis=1)] for tool, rows in known.items()}


def _powers(
    cut: ProgramCut, rows: Mapping[int, Floats], period: float, why: str
) -> Iterator[PowerBeside]:
    spread = {one.tool: one for one in cut.forces}
    predicted: Band | None
    for tool in cut.by_tool:
        blocks = [(b.power_kW, b.in_material_s) for b in cut.blocks if b.tool == tool.tool]
        known = [(power, s) for power, s in blocks if power is not None and s]
        force, said = spread.get(tool.tool), why
        predicted = None
        if known and force and force.mean_load_N and None not in (
            force.mean_load_low_N, force.mean_load_high_N
        ):  # fmt: skip
            mean = sum(power * s for power, s in known) / sum(s for _, s in known)
            ends = (force.mean_load_low_N or 0.0, force.mean_load_high_N or 0.0)
            low, high = (mean * end / force.mean_load_N for end in ends)
            predicted = mean, low, high
        else:
            said = "its predicted load has no interval"
        of = rows.get(tool.tool, np.zeros((0, 3)))
        power = tuple((of.mean(axis=0) * KW).tolist()) if len(of) else None
        yield PowerBeside(tool=tool, predicted=predicted, recorded=power, why=said,
                          seconds=len(of) * period)  # fmt: skip


def _range(band: Band | None) -> str:
    return "–" if band is None else f"{number(band[1])} to {number(band[2])}"
