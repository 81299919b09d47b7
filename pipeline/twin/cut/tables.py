"""Tables of a cut: block by block, tool by tool, as a whole, and over the program's time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.cutting.economics.cost import Energy, PartCost
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.program_cut import (
    Curve,
    CutBlock,
    CutCost,
    EngagementTrace,
    PartTotals,
    ToolTotals,
)
from pipeline.twin.cut.blocks import CutBlocks, StationArcs
from pipeline.twin.cut.cost import Life
from pipeline.twin.cut.limits import CutLimits
from pipeline.twin.cut.loads import Cut

MM, UM, CM3, KW = 1e3, 1e6, 1e6, 1e-3
CM3_MIN = CM3 * 60


@dataclass(frozen=True, kw_only=True)
class CutResults:
    """Blocks, limits, tool life, electricity and cost of a cut; None where not known."""

    cut: Cut
    blocks: CutBlocks
    limits: CutLimits
    life: Life
    energy: Energy | None
    cost: PartCost | None
    cost_ends: PartCost | None
    """Cost at the ends of the tools' lives; shape (2, M)."""


def figure(value: float, digits: int = 6) -> float | None:
    """Finite number rounded to so many digits; None for one that is not known."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None


def by_tool(results: CutResults) -> tuple[ToolTotals, ...]:
    """Each tool that cuts, in the order of the program."""
    cut = results.cut
    number = cut.plan.path.moves.tool
    order = dict.fromkeys(cut.numbers[tool] for tool in results.blocks.tool.tolist())
    return tuple(tool_totals(results, tool, number == tool) for tool in order)


def tool_totals(results: CutResults, tool: int, rows: Bools) -> ToolTotals:
    """Totals of the ``rows`` (M,) of one tool, by its number."""
    cut, blocks = results.cut, results.blocks
    index = cut.numbers.index(tool)
    mine = (blocks.tool == index) & rows[blocks.row]
    return ToolTotals(tool=tool, name=cut.tools[index].name, **_totals(results, mine, rows))


def summary(results: CutResults) -> PartTotals:
    """The part as a whole; rows without a tool that cuts count too."""
    every = np.ones(len(results.blocks), dtype=bool)
    rows = np.ones(results.cut.engagement.blocks, dtype=bool)
    worst = int(np.argmax(results.blocks.peak)) if len(results.blocks) else 0
    line = int(results.blocks.line[worst]) if len(results.blocks) else None
    return PartTotals(
        peak_line=line,
        blank_cm3=figure(results.cut.blank.volume * CM3),
        left_cm3=figure(results.cut.left.volume * CM3),
        **_totals(results, every, rows),
    )


def _quantities(found: CutResults) -> dict[str, Floats]:
    """Quantities common to a block and a total, each (K,), in the units of their names."""
    b, limits = found.blocks, found.limits
    turning = np.where(b.spindle_speed > 0, 1.0, np.nan)  # without turning there is no chip
    loaded = np.where(b.load_known, 1.0, np.nan)
    energy = found.energy
    return {
        "feed_per_tooth_mm": turning * b.feed_per_tooth * MM,
        "chip_thickness_mm": turning * b.thickness * MM,
        "cutting_speed_m_min": turning * np.pi * b.cutting_diameter * b.spindle_speed,
        "axial_depth_mm": b.axial_depth * MM,
        "radial_depth_mm": b.radial_depth * MM,
        "peak_load_N": loaded * b.peak,
        "mean_load_N": loaded * b.mean,
        "axial_force_N": loaded * b.axial,
        "torque_Nm": loaded * b.torque,
        "peak_torque_Nm": loaded * b.peak_torque,
        "power_kW": loaded * b.power * KW,
        "drive_share": limits.drive,
        "deflection_um": limits.deflection * UM,
        "stability_margin": limits.margin,
        "in_material_s": b.seconds,
        "volume_cm3": b.volume * CM3,
        "removal_rate_cm3_min": b.rate * CM3_MIN,
        "tool_life_share": found.life.wear[b.row],
        "energy_kWh": np.full(len(b), np.nan) if energy is None else energy.block[b.row],
    }


def _totals(found: CutResults, mine: Bools, rows: Bools) -> dict[str, Any]:
    """Worst values of the blocks ``mine`` (K,) and sums over the ``rows`` (M,)."""
    b, plan = found.blocks, found.cut.plan
    fed = rows & np.isin(plan.path.moves.kind, CUTTING)
    at_feed, inside = float(plan.motion.time[fed].sum()), float(b.seconds[mine].sum())
    volume = float(b.volume[mine].sum())
    worst = {
        name: _worst(values[mine], np.min if name == "stability_margin" else np.max)
        for name, values in _quantities(found).items()
    }
    return worst | {
        "blocks": int(mine.sum()),
        "time_s": figure(float(plan.time[rows].sum())),
        "at_feed_s": figure(at_feed),
        "in_material_s": figure(inside),
        "air_share": figure(max(0.0, 1 - inside / at_feed)) if at_feed > 0 else None,
        "mean_load_N": _mean(b.mean[mine & b.load_known], b.seconds[mine & b.load_known]),
        "volume_cm3": figure(volume * CM3),
        "removal_rate_cm3_min": figure(volume * CM3_MIN / inside) if inside > 0 else None,
        "highest_removal_rate_cm3_min": worst["removal_rate_cm3_min"],
        "tool_life_share": figure(float(found.life.wear[rows].sum())),
        **_ends("tool_life_share", found.life.interval, rows),
        "energy_kWh": None if found.energy is None else figure(_sum(found.energy.block, rows)),
        "cost": None if found.cost is None else _cost(found, found.cost, rows),
    }


def _worst(values: Floats, of: Callable[[Floats], Any]) -> float | None:
    known = values[~np.isnan(values)]
    return figure(float(of(known))) if len(known) else None


def _mean(values: Floats, seconds: Floats) -> float | None:
    total = float(seconds.sum())
    return figure(float(values @ seconds) / total) if total > 0 else None


def _sum(values: Floats, rows: Bools) -> float:
    return float(values[rows].sum())


def _ends(name: str, values: Floats, rows: Bools) -> dict[str, float | None]:
    low, high = values[:, rows].sum(axis=1).tolist()
    return {f"{name}_low": figure(low), f"{name}_high": figure(high)}


def _cost(found: CutResults, cost: PartCost, rows: Bools) -> CutCost:
    time, used, worn = (_sum(c, rows) for c in (cost.time, cost.energy, cost.tool + cost.change))
    return CutCost(
        time=figure(time), tools=figure(worn),
        energy=None if found.energy is None else figure(used), sum=figure(time + used + worn),
        **({} if found.cost_ends is None else _ends("sum", found.cost_ends.block, rows)),
    )  # fmt: skip


def block_rows(results: CutResults) -> tuple[CutBlock, ...]:
    """Every block that cuts, in the order of the program."""
    b, limits, cut = results.blocks, results.limits, results.cut
    figures = _quantities(results) | {
        "used": limits.used,
        "speed_rpm": b.spindle_speed,
        "reached_feed_mm_min": b.feed,
        "entry_deg": np.degrees(b.entry),
        "exit_deg": np.degrees(b.exit),
        "cost": np.full(len(b), np.nan) if results.cost is None else results.cost.block[b.row],
    }
    columns: dict[str, list[Any]] = {
        "line": b.line.tolist(),
        "row": b.row.tolist(),
        "tool": [cut.numbers[tool] for tool in b.tool.tolist()],
        "binds": [str(word) or None for word in limits.binds.tolist()],
        **{name: [figure(value) for value in values.tolist()] for name, values in figures.items()},
    }
    return tuple(
        CutBlock(**dict(zip(columns, values, strict=True)))
        for values in zip(*columns.values(), strict=True)
    )


COLUMNS = 900
"""Columns of equal time; about as many as a page has pixels."""


def cut_trace(cut: Cut, arcs: StationArcs, columns: int = COLUMNS) -> EngagementTrace:
    """Lowest and highest load, depths and arc of the stations in each column of time."""
    plan, engagement = cut.plan, cut.engagement
    total = plan.total
    # time at which each station begins, by its share of its row's path
    begin = np.concatenate([[0.0], np.cumsum(plan.time)])[:-1]
    pieces = cut.path.pieces
    before = np.cumsum(pieces.length) - pieces.length
    first = np.searchsorted(pieces.block, np.arange(engagement.blocks))
    gone = before - before[np.minimum(first, len(pieces) - 1)][pieces.block]
    whole = np.bincount(pieces.block, pieces.length, minlength=engagement.blocks)
    share = (gone[engagement.piece] + engagement.along) / np.maximum(whole[engagement.block], 1e-12)
    start = begin[engagement.block] + share * plan.motion.time[engagement.block]
    # columns of time that each station lies in
    scale = columns / max(total, 1e-12)
    low = np.clip((start * scale).astype(np.intp), 0, columns - 1)
    high = np.clip(((start + cut.in_material) * scale).astype(np.intp), low, columns - 1)
    kept = engagement.feed
    station, column = stations_of_columns(low[kept], high[kept])

    def lowest(values: Floats) -> Curve:
        return _column(np.minimum, values[kept][station], column, columns)

    def highest(values: Floats) -> Curve:
        return _column(np.maximum, values[kept][station], column, columns)

    load, axial, radial = cut.station_loads.peak, engagement.axial_depth * 1e3, arcs.radial * 1e3
    return EngagementTrace(
        total_s=round(total, 3),
        load_N_low=lowest(load),
        load_N_high=highest(load),
        axial_depth_mm_low=lowest(axial),
        axial_depth_mm_high=highest(axial),
        radial_depth_mm_low=lowest(radial),
        radial_depth_mm_high=highest(radial),
        entry_deg=lowest(np.degrees(arcs.entry)),
        exit_deg=highest(np.degrees(arcs.exit)),
        tools=_tools(cut, begin, total),
    )


def stations_of_columns(low: Rows, high: Rows) -> tuple[Rows, Rows]:
    """Each station once for every column that it lies in: station, column."""
    count = high - low + 1
    station = np.repeat(np.arange(len(low)), count)
    inside = np.arange(len(station)) - np.repeat(np.cumsum(count) - count, count)
    return station, low[station] + inside


def _column(
    function: np.ufunc, values: Floats, place: Rows, columns: int
) -> Curve:  # fmt: skip
    out = np.full(columns, np.inf if function is np.minimum else -np.inf)
    function.at(out, place, values)
    return tuple(figure(v, 4) for v in out.tolist())


def _tools(
    cut: Cut, begin: Floats, total: float
) -> tuple[tuple[int, float, float], ...]:  # fmt: skip
    tool = cut.plan.path.moves.tool
    edges = np.flatnonzero(np.diff(tool, prepend=tool[0] - 1 if len(tool) else 0))
    ends = [*(begin[edges[1:]] / total).tolist(), 1.0]
    return tuple(
        (int(tool[row]), round(float(begin[row] / total), 5), round(end, 5))
        for row, end in zip(edges.tolist(), ends, strict=True) if tool[row] >= 0
    )  # fmt: skip
