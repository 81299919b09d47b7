"""Tables of a cut: loads and cost by tool, sharp and worn edges, blocks nearest to a limit."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Protocol

from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    TOGETHER,
    counted,
    duration,
    fixed,
    number,
    range_words,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Column, Table, tabulated
from pipeline.schema.drive import AxisInCut
from pipeline.schema.program_cut import (
    BasisRow,
    CutCost,
    CutTotals,
    CutWarning,
    EdgeForces,
    ForceInterval,
    ProgramCut,
    ToolEdge,
    ToolTotals,
    WorstBlock,
)

ROUNDING = 1e-6
"""Share of the greatest of its kind below which a force is rounding [1]."""
MOST_SPANS = 8
"""Stretches of lines that a warning names."""
NONE = "–"
NO_COST = CutCost(time=None, tools=None, energy=None, sum=None)


class Numbered(Protocol):
    """A row that belongs to a tool."""

    @property
    def tool(self) -> int:
        """Number of the tool."""

    @property
    def name(self) -> str:
        """Name of the tool."""


def tool_words(row: Numbered) -> str:
    """Number and name of a tool."""
    return f"T{row.tool} {row.name}".strip()


def figure(value: float | None, digits: int = 3) -> str:
    """A number as it stands in a table; a dash where there is none."""
    return NONE if value is None else number(value, digits)


def share(value: float | None) -> str:
    """A share [1] in percent; a dash where there is none."""
    if value is None:
        return NONE
    if abs(value) >= 0.1:
        return f"{fixed(100 * value, 0)}{NARROW}%"
    return f"{number(100 * value, 2)}{NARROW}%"


def between(row: object, key: str, words: Callable[[float], str]) -> str:
    """The ends of the interval of a cost, in brackets: one where the value is the other.

    >>> from types import SimpleNamespace as Row
    >>> [between(Row(sum=2, sum_low=1, sum_high=high), "sum", str) for high in (4, 2)]
    [' (1 to 4)', ' (1 at best)']
    """
    low, high = (getattr(row, f"{key}_{end}", None) for end in ("low", "high"))
    if low is None or high is None:
        return ""
    at, ends = getattr(row, key), (words(low), words(high))
    if at is not None and ends[0] != ends[1] and words(at) in ends:
        return f" ({ends[0]} at best)" if words(at) == ends[1] else f" ({ends[1]} at worst)"
    return f" ({ends[0]} to {ends[1]})"


def sentence(words: str) -> str:
    """The words with a capital at their beginning."""
    return words[:1].upper() + words[1:]


def spans_of(lines: Iterable[int]) -> list[str]:
    """Lines as stretches: ``33``, ``111–118``."""
    spans: list[list[int]] = []
    for line in sorted(set(lines)):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    return [str(a) if a == b else f"{a}–{b}" for a, b in spans]


def lines_words(lines: Iterable[int], most: int) -> str:
    """``line 33``, ``lines 33–35, 40 and 2 more``; empty without lines."""
    spans = spans_of(lines)
    if not spans:
        return ""
    single = len(spans) == 1 and "–" not in spans[0]
    more = f" and {len(spans) - most} more" if len(spans) > most else ""
    return f"line{'' if single else 's'} {', '.join(spans[:most])}{more}"


def warnings_pairs(warnings: Sequence[CutWarning], most: int) -> list[tuple[str, str]]:
    """Warnings before the part is cut: finding, remedy, and lines."""
    return [
        (sentence(row.what), " ".join(filter(None, (
            row.do,
            "" if row.blocks is None else f"{counted(row.blocks, 'block')}.",
            f"{sentence(where)}." if (where := lines_words(row.lines, most)) else "",
        ))))
        for row in warnings
    ]  # fmt: skip


def _quantity(
    name: str, key: str, unit: str = "", group: str = "",
    words: Callable[[float | None], str] = figure,
) -> Column[object]:  # fmt: skip
    return Column(name, lambda row: words(getattr(row, key)), unit, group)


def _cleared(rows: Sequence[ToolTotals]) -> list[ToolTotals]:
    """The rows with 0 for forces that are nothing but rounding beside the greatest."""
    pairs = [(row.peak_load_N, row.axial_force_N) for row in rows]
    least = ROUNDING * max((abs(x) for pair in pairs for x in pair if x is not None), default=0.0)

    def cleared(value: float | None) -> float | None:
        return 0 if value is not None and abs(value) < least else value

    return [
        replace(row, peak_load_N=cleared(peak), axial_force_N=cleared(axial))
        for row, (peak, axial) in zip(rows, pairs, strict=True)
    ]


def forces_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """Chip, load, torque, power, deflection, stability by tool, at the worst of its blocks."""
    return tabulated(
        "By tool: the worst of its blocks, at the highest feed that a block reaches",
        _cleared(cut.by_tool), FORCES, sources,
        note="Stability is how much deeper the block could cut before it chatters; negative where "
        "it does. Deflection is of the tool alone, clamped in its holder.",
    )  # fmt: skip


FORCES: tuple[Column[ToolTotals], ...] = (
    Column("Tool", tool_words),
    _quantity("blocks that cut", "blocks", words=figure),
    _quantity("in the material", "in_material_s", words=duration),
    _quantity("in air", "air_share", words=share),
    _quantity("feed per tooth", "feed_per_tooth_mm", "mm", "Chip"),
    _quantity("thickest", "chip_thickness_mm", "mm", "Chip"),
    _quantity("axial", "axial_depth_mm", "mm", "Depth"),
    _quantity("radial", "radial_depth_mm", "mm", "Depth"),
    _quantity("in the plane", "peak_load_N", "N", "Peak force"),
    _quantity("axial", "axial_force_N", "N", "Peak force"),
    _quantity("torque", "torque_Nm", f"N{TOGETHER}m", "Spindle"),
    _quantity("power", "power_kW", "kW", "Spindle"),
    _quantity("of the drive", "drive_share", group="Spindle", words=share),
    _quantity("deflection", "deflection_um", "µm"),
    _quantity("stability", "stability_margin", words=share),
)


def intervals_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """Peak and mean force in the plane by tool, with 90 % intervals and untrained conditions."""
    return tabulated(
        "By tool: how sure the greatest forces are", cut.forces, INTERVALS, sources,
        note="90 % intervals: coefficients and law of the chip, wear of the edge, runout, "
        "axial depth and the errors of the model on recordings left out, drawn as for the load "
        "limit of an optimisation; predicted is the median. Tables of loads have the runout of the "
        "tool table alone. Wider where feed, speed or depth were not learnt.",
    )  # fmt: skip


INTERVALS: tuple[Column[ForceInterval], ...] = (
    Column("Tool", tool_words),
    *(
        _quantity(name, f"{load}{key}_N", "N", group)
        for load, group in (("peak_load", "Peak force"), ("mean_load", "Mean force"))
        for name, key in (("predicted", ""), ("from", "_low"), ("to", "_high"))
    ),
    Column(
        "Outside of what was learnt", lambda row: range_words("; ".join(row.outside)) or "nothing"
    ),
)


def edges_table(edges: Sequence[ToolEdge], sources: list[Source], whose: str = "") -> Table | None:
    """Greatest load and power of each tool, sharp and worn; None without growth."""
    rows = [(edge, edge.forces) for edge in edges if edge.forces is not None]
    caption = sentence(f"{whose}force of each tool, sharp and worn")
    return tabulated(caption, rows, EDGES, sources, note="The greatest of the tool’s blocks. "
        "The range holds for the growth of the force with wear alone, 95 % of it.")  # fmt: skip


def _um(value: float) -> str:
    return f"{number(value)}{NARROW}µm"


EDGES: tuple[Column[tuple[ToolEdge, EdgeForces]], ...] = (
    Column("Tool", lambda row: tool_words(row[0])),
    Column("counted", lambda row: f"worn, {_um(row[0].wear_um)}" if row[0].wear_um else "sharp"),
    Column("compared at", lambda row: _um(row[1].wear_um), ""),
    Column("sharp", lambda row: figure(row[1].peak_load_sharp_N), "N", "Peak load"),
    Column("worn", lambda row: figure(row[1].peak_load_N), "N", "Peak load"),
    Column("range", lambda row: f"{figure(row[1].peak_load_low_N)} to "
           f"{figure(row[1].peak_load_high_N)}", "N", "Peak load"),
    Column("sharp", lambda row: figure(row[1].power_sharp_kW), "kW", "Power of the cut"),
    Column("worn", lambda row: figure(row[1].power_kW), "kW", "Power of the cut"),
)  # fmt: skip


def edge_words(edges: Sequence[ToolEdge]) -> list[str]:
    """Wear that the figures hold for, one sentence for tools alike."""
    alike: dict[str, list[str]] = {}
    for edge in edges:
        words = f"{edge.edge}{f' ({edge.caution})' if edge.caution and edge.wear_um else ''}"
        alike.setdefault(words, []).append(f"T{edge.tool}")
    return [
        f"{', '.join(tools)} {'counts' if len(tools) == 1 else 'count'} as {words}."
        for words, tools in alike.items()
    ]


def cost_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """Time, volume, share of tool life, cost by cause and energy by tool."""
    currency = cut.currency or ""

    def cost(key: str) -> Callable[[CutTotals], str]:
        return lambda row: figure(getattr(row.cost or NO_COST, key))

    rows: list[CutTotals] = [*cut.by_tool, cut.summary]
    return tabulated("By tool: what the part costs", rows, (
        Column("Tool", lambda row: tool_words(row) if isinstance(row, ToolTotals) else "the part"),
        _quantity("time", "time_s", words=duration),
        _quantity("removed", "volume_cm3", "cm³"),
        _quantity("rate while cutting", "removal_rate_cm3_min", "cm³/min"),
        Column("tool life used", lambda row: share(row.tool_life_share)
               + between(row, "tool_life_share", share), ""),
        *(Column(key, cost(key), currency, "Cost") for key in ("time", "tools", "energy")),
        Column("sum", lambda row: cost("sum")(row) + between(row.cost or NO_COST, "sum", figure),
               currency, "Cost"),
        _quantity("energy", "energy_kWh", "kWh"),
    ), sources, note="In brackets what the spread of the tools’ lives allows.")  # fmt: skip


def worst_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """The blocks that come nearest to a limit, or beyond it."""

    def binds(row: WorstBlock) -> Cell:
        beyond = row.used is not None and row.used > 1
        grave = cut.dynamics_measured or row.binds != "stability"
        status = ("failed" if grave else "attention") if beyond else ""
        return Cell(text=row.binds or NOT_KNOWN, status=status)

    return tabulated(
        "The blocks that come nearest to what binds them: the worst of each run of blocks",
        cut.worst,
        (
            Column("Line", lambda row: str(row.line)),
            Column("Tool", lambda row: f"T{row.tool}"),
            Column("what binds", binds),
            _quantity("of the limit", "used", words=share),
            _quantity("blocks alike", "alike"),
            _quantity("peak load", "peak_load_N", "N"),
            _quantity("feed reached", "reached_feed_mm_min", "mm/min"),
            Column("speed", lambda row: number(round(row.speed_rpm or 0)), "rev/min"),
            _quantity("feed per tooth", "feed_per_tooth_mm", "mm"),
            _quantity("axial depth", "axial_depth_mm", "mm"),
            _quantity("radial depth", "radial_depth_mm", "mm"),
            _quantity("power", "power_kW", "kW"),
            _quantity("deflection", "deflection_um", "µm"),
        ),
        sources,
    )


def axes_table(axes: Sequence[AxisInCut], sources: list[Source]) -> Table | None:
    """Following error and motor current of each axis in the cut, beside the same in air."""
    return tabulated("Axes in the cut: greatest values while the tool is in the material", axes, (
        Column("Axis", lambda row: row.axis),
        Column("in air", lambda row: number(row.following_air_um), "µm", group="Following error"),
        Column("in the cut", lambda row: number(row.following_um), "µm", group="Following error"),
        Column("RMS", lambda row: number(row.following_rms_um), "µm", group="Following error"),
        Column("line", lambda row: str(row.following_line), "", group="Following error"),
        Column("in air", lambda row: _with(row.command_air, row), "", group="Motor command"),
        Column("in the cut", lambda row: _with(row.command, row), "", group="Motor command"),
        Column("RMS", lambda row: _with(row.command_rms, row), "", group="Motor command"),
        Column("line", lambda row: str(row.command_line), "", group="Motor command"),
        Column("force", lambda row: number(row.force_N), "N"),
    ), sources, note="The force is the mean over a turn of the spindle; what each tooth adds at "
    "its own frequency is left out.")  # fmt: skip


def _with(value: float, row: AxisInCut) -> str:
    return f"{number(value)}{NARROW}{row.command_unit}"


def basis_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """Basis of the numbers: stock, force law of each tool, limits, missing data."""
    return tabulated("What these numbers rest on", cut.basis, BASIS, sources)


BASIS: tuple[Column[BasisRow], ...] = (
    Column("What", lambda row: row.what),
    Column("value", lambda row: row.value),
    Column("where it comes from", lambda row: row.source or NONE),
)
