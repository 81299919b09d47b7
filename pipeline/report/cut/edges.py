"""Table of the force of each tool with a sharp edge and with a worn one, and its words."""

from collections.abc import Iterator, Sequence

from pipeline.charts.numbers import NARROW, number
from pipeline.charts.sources import Source
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.report.cut.tables import NONE, sentence
from pipeline.schema.program_cut import EdgeForces, ToolEdge

Row = tuple[ToolEdge, EdgeForces]


def edges_table(edges: Sequence[ToolEdge], sources: list[Source], whose: str = "") -> Table | None:
    """Greatest load and power of each tool, sharp and worn; None where no growth is known."""
    rows: list[Row] = [(one, one.forces) for one in edges if one.forces is not None]
    caption = f"{whose}force of each tool, sharp and worn"
    return tabulated(sentence(caption), rows, COLUMNS, sources, note=NOTE)


NOTE = (
    "The greatest of the tool’s blocks. The range holds for the growth of the force with wear "
    "alone, 95 % of it."
)
COLUMNS: tuple[Column[Row], ...] = (
    Column("Tool", lambda row: f"T{row[0].tool} {row[0].name}".strip()),
    Column("counted", lambda row: f"worn, {_um(row[0].wear_um)}" if row[0].wear_um else "sharp"),
    Column("compared at", lambda row: _um(row[1].wear_um), ""),
    Column("sharp", lambda row: _figure(row[1].peak_load_sharp_N), "N", "Peak load"),
    Column("worn", lambda row: _figure(row[1].peak_load_N), "N", "Peak load"),
    Column("range", lambda row: _range(row[1]), "N", "Peak load"),
    Column("sharp", lambda row: _figure(row[1].power_sharp_kW), "kW", "Power of the cut"),
    Column("worn", lambda row: _figure(row[1].power_kW), "kW", "Power of the cut"),
)


def edge_words(edges: Sequence[ToolEdge]) -> list[str]:
    """Which wear the figures hold for, one sentence for tools alike."""
    alike: dict[str, list[str]] = {}
    for one in edges:
        said = f"{one.edge}{f' ({one.caution})' if one.caution and one.wear_um else ''}"
        alike.setdefault(said, []).append(f"T{one.tool}")
    return [sentence(words) for words in _sentences(alike)]


def _sentences(alike: dict[str, list[str]]) -> Iterator[str]:
    for said, tools in alike.items():
        verb = "counts" if len(tools) == 1 else "count"
        yield f"{', '.join(tools)} {verb} as {said}."


def _um(value: float) -> str:
    return f"{number(value)}{NARROW}µm"


def _figure(value: float | None) -> str:
    return NONE if value is None else number(value)


def _range(forces: EdgeForces) -> str:
    return f"{_figure(forces.peak_load_low_N)} to {_figure(forces.peak_load_high_N)}"
