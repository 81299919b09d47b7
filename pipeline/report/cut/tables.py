"""Tables of a cut: loads and cost by tool, blocks nearest to a limit, sources of the numbers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    TOGETHER,
    counted,
    duration,
    fixed,
    number,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Column, Head, Table, cells, names, numbers, tabulated
from pipeline.schema.drive import AxisInCut
from pipeline.schema.program_cut import CutCost, CutTotals, ProgramCut, ToolTotals, WorstBlock

NOTHING = 1e-6  # of the greatest of its kind: less is rounding
MOST_SPANS = 8  # stretches of lines that a warning names
NONE = "–"
NO_COST = CutCost(time=None, tools=None, energy=None, sum=None)


def share(value: float | None) -> str:
    """A share [1] in percent; a dash where there is none."""
    if value is None:
        return NONE
    if abs(value) >= 0.1:
        return f"{fixed(100 * value, 0)}{NARROW}%"
    return f"{number(100 * value, 2)}{NARROW}%"


def between(row: object, key: str, said: Callable[[float], str]) -> str:
    """The ends of the interval of a quantity, in brackets; nothing where it has none."""
    low, high = (getattr(row, f"{key}_{end}", None) for end in ("low", "high"))
    return "" if low is None or high is None else f" ({said(low)} to {said(high)})"


def _figure(value: float | None) -> str:
    return NONE if value is None else number(value)


def _cleared(rows: Sequence[ToolTotals]) -> list[ToolTotals]:
    """The rows with 0 for forces that are nothing but rounding beside the greatest."""
    pairs = [(row.peak_load_N, row.axial_force_N) for row in rows]
    least = NOTHING * max((abs(x) for pair in pairs for x in pair if x is not None), default=0.0)

    def cleared(value: float | None) -> float | None:
        return 0 if value is not None and abs(value) < least else value

    return [
        replace(row, peak_load_N=cleared(peak), axial_force_N=cleared(axial))
        for row, (peak, axial) in zip(rows, pairs, strict=True)
    ]


def forces_table(cut: ProgramCut, sources: list[Source]) -> Table:
    """By tool: chip, load, torque, power, deflection, stability, at the worst of its blocks."""
    return Table(
        caption="By tool: the worst of its blocks, at the highest feed that a block reaches",
        heads=[
            *names("Tool"),
            *numbers(("blocks that cut", ""), ("in the material", ""), ("in air", "")),
            *numbers(("feed per tooth", "mm"), ("thickest", "mm"), group="Chip"),
            *numbers(("axial", "mm"), ("radial", "mm"), group="Depth"),
            *numbers(("in the plane", "N"), ("axial", "N"), group="Peak force"),
            *numbers(
                ("torque", f"N{TOGETHER}m"), ("power", "kW"), ("of the drive", ""), group="Spindle"
            ),
            *numbers(("deflection", "µm"), ("stability", "")),
        ],
        rows=[_force_row(row) for row in _cleared(cut.by_tool)],
        sources=sources,
        note="Stability is how much deeper the block could cut before it chatters; negative where "
        "it does. Deflection is of the tool alone, clamped in its holder.",
    )


def intervals_table(cut: ProgramCut, sources: list[Source]) -> Table:
    """By tool: peak and mean force in the plane with 90 % intervals, and what was not learnt."""
    ends = numbers(("predicted", "N"), ("from", "N"), ("to", "N"), group="Peak force")
    return Table(
        caption="By tool: how sure the greatest forces are",
        heads=[
            *names("Tool"), *ends,
            *numbers(("predicted", "N"), ("from", "N"), ("to", "N"), group="Mean force"),
            *names("Outside of what was learnt"),
        ],
        rows=[
            cells(
                f"T{row.tool} {row.name}".strip(),
                *(_figure(value) for value in (
                    row.peak_load_N, row.peak_load_low_N, row.peak_load_high_N, row.mean_load_N,
                    row.mean_load_low_N, row.mean_load_high_N,
                )),
                "; ".join(row.outside) or "nothing",
            )
            for row in cut.forces
        ],
        sources=sources,
        note="90 % intervals: coefficients and law of the chip, wear of the edge, runout, "
        "axial depth and the errors of the model on recordings left out, drawn as for the load "
        "limit of an optimisation; predicted is the median. Tables of loads have the runout of the "
        "tool table alone. Wider where feed, speed or depth were not learnt.",
    )  # fmt: skip


def _force_row(row: ToolTotals) -> list[Cell]:
    return cells(
        f"T{row.tool} {row.name}".strip(),
        number(row.blocks),
        duration(row.in_material_s),
        share(row.air_share),
        _figure(row.feed_per_tooth_mm),
        _figure(row.chip_thickness_mm),
        _figure(row.axial_depth_mm),
        _figure(row.radial_depth_mm),
        _figure(row.peak_load_N),
        _figure(row.axial_force_N),
        _figure(row.torque_Nm),
        _figure(row.power_kW),
        share(row.drive_share),
        _figure(row.deflection_um),
        share(row.stability_margin),
    )


def cost_table(cut: ProgramCut, sources: list[Source]) -> Table:
    """By tool: time, volume, share of its life, cost by cause, energy."""
    currency = cut.currency or ""
    return Table(
        caption="By tool: what the part costs",
        heads=[
            *names("Tool"),
            *numbers(("time", ""), ("removed", "cm³"), ("rate while cutting", "cm³/min")),
            *numbers(("tool life used", "")),
            *numbers(
                ("time", currency), ("tools", currency), ("energy", currency), ("sum", currency),
                group="Cost",
            ),
            *numbers(("energy", "kWh")),
        ],
        rows=[
            *(_cost_row(row, f"T{row.tool} {row.name}".strip()) for row in cut.by_tool),
            _cost_row(cut.summary, "the part"),
        ],
        sources=sources,
        note="In brackets what the spread of the tools’ lives allows.",
    )  # fmt: skip


def _cost_row(row: CutTotals, name: str) -> list[Cell]:
    cost = row.cost or NO_COST
    return cells(
        name,
        duration(row.time_s),
        _figure(row.volume_cm3),
        _figure(row.removal_rate_cm3_min),
        share(row.tool_life_share) + between(row, "tool_life_share", share),
        *(_figure(one) for one in (cost.time, cost.tools, cost.energy)),
        _figure(cost.sum) + between(cost, "sum", _figure),
        _figure(row.energy_kWh),
    )


def worst_table(cut: ProgramCut, sources: list[Source]) -> Table | None:
    """The blocks that come nearest to a limit, or beyond it."""
    if not cut.worst:
        return None
    return Table(
        caption="The blocks that come nearest to what binds them: the worst of each run of blocks",
        heads=[
            *names("Line", "Tool", "what binds"),
            *numbers(("of the limit", ""), ("blocks alike", ""), ("peak load", "N"),
                     ("feed reached", "mm/min"), ("speed", "rev/min"), ("feed per tooth", "mm"),
                     ("axial depth", "mm"), ("radial depth", "mm"), ("power", "kW"),
                     ("deflection", "µm")),
        ],
        rows=[_worst_row(row, measured=cut.dynamics_measured) for row in cut.worst],
        sources=sources,
    )  # fmt: skip


def _worst_row(row: WorstBlock, *, measured: bool) -> list[Cell]:
    used, binds = row.used, row.binds or NOT_KNOWN
    grave = measured or binds != "stability"
    status = "" if used is None or used <= 1 else "failed" if grave else "attention"
    return cells(
        str(row.line),
        f"T{row.tool}",
        Cell(text=binds, status=status),
        share(used),
        number(row.alike),
        _figure(row.peak_load_N),
        _figure(row.reached_feed_mm_min),
        number(round(row.speed_rpm or 0)),
        _figure(row.feed_per_tooth_mm),
        _figure(row.axial_depth_mm),
        _figure(row.radial_depth_mm),
        _figure(row.power_kW),
        _figure(row.deflection_um),
    )


def warnings_pairs(cut: ProgramCut) -> list[tuple[str, str]]:
    """What to look at before the part is cut: what, and in which lines."""
    found = []
    for row in cut.warnings:
        spans = spans_of(row.lines)
        words = f"Line{'s' if len(spans) > 1 or '–' in ''.join(spans) else ''} " if spans else ""
        words += ", ".join(spans[:MOST_SPANS])
        if len(spans) > MOST_SPANS:
            words += f" and {counted(len(spans) - MOST_SPANS, 'stretch', 'stretches')} more"
        many = "" if row.blocks is None else f" {counted(row.blocks, 'block')}."
        found.append((sentence(row.what), f"{row.do}{many} {words}{'.' if words else ''}".strip()))
    return found


def spans_of(lines: Iterable[int]) -> list[str]:
    """Lines as stretches: ``33``, ``111–118``."""
    spans: list[list[int]] = []
    for line in sorted(set(lines)):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    return [str(a) if a == b else f"{a}–{b}" for a, b in spans]


def sentence(words: str) -> str:
    """The words with a capital at their beginning."""
    return words[:1].upper() + words[1:]


def axes_table(axes: Sequence[AxisInCut], sources: list[Source]) -> Table | None:
    """By axis: how far it is behind and what its motor draws in the cut, beside the same in air."""
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


def basis_table(cut: ProgramCut, sources: list[Source]) -> Table:
    """What the numbers rest on: stock, force law of each tool, limits, what is not known."""
    rows = [cells(row.what, row.value, row.source or NONE) for row in cut.basis]
    heads = [Head(name="What"), Head(name="value"), Head(name="where it comes from")]
    return Table(caption="What these numbers rest on", heads=heads, rows=rows, sources=sources)
