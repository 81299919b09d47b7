"""Tool life, electricity and cost of a cut by row, and its tables: by block, tool, part and time.

What is not known is NaN, with a reason.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.cost import (
    CostRates,
    Energy,
    EnergyParameters,
    PartCost,
    energy,
    life_price,
    part_cost,
    spindle_supply,
)
from pipeline.cutting.economics.material import (
    Condition,
    Material,
    Taylor,
    cutting_speed,
    wear,
    wear_ends,
)
from pipeline.cutting.economics.spindle_power import SpindleDrive, no_load_power
from pipeline.gcode.moves import Kind
from pipeline.machine.control.path import Motion
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
from pipeline.twin.cut.blocks import CutBlocks, CutLimits, StationArcs
from pipeline.twin.cut.loads import Cut

M_MIN = 60.0
COOLANT_ON, COOLANT_OFF = (7, 8), (9,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Life:
    """Share of its tool's life that each row takes, with the tools whose life is uncertain."""

    wear: Floats
    """Wear [1]; 0 in air, NaN where the tool's life is not known; shape (M,)."""
    interval: Floats
    """Least and greatest wear [1]; NaN where constants have no spread; shape (2, M)."""
    unknown: Mapping[int, str]
    """Tools (their index) whose life is not known: why."""
    beyond: Mapping[int, str]
    """Tools that cut at speeds far from those of the tests."""


def tool_life(cut: Cut, blocks: CutBlocks, arcs: StationArcs, material: Material) -> Life:
    """Life that a cut takes of its tools, by Taylor's constants of the material."""
    spent = np.zeros(cut.engagement.blocks)
    ends = np.zeros((2, cut.engagement.blocks))
    unknown: dict[int, str] = {}
    beyond: dict[int, str] = {}
    conditions = _conditions(cut, arcs)
    for tool in np.unique(blocks.tool).tolist():
        mine = blocks.tool == tool
        rows = blocks.row[mine]
        constants = material.tool_life(cut.tools[tool])
        if constants is None:
            spent[rows] = ends[:, rows] = np.nan
            unknown[tool] = material.no_life(cut.tools[tool])
            continue
        v_c = cutting_speed(blocks.cutting_diameter[mine], blocks.speed[mine])
        given = {name: values[rows] for name, values in conditions.items()}
        spent[rows] = wear(constants, blocks.seconds[mine], v_c, given)
        ends[:, rows] = wear_ends(constants, blocks.seconds[mine], v_c, given)
        if warning := _beyond(constants, v_c):
            beyond[tool] = warning
    return Life(wear=spent, interval=ends, unknown=unknown, beyond=beyond)


def _conditions(cut: Cut, arcs: StationArcs) -> dict[Condition, Floats]:
    """Feed for each tooth, and mean depths of each row over its length in the material [m]."""
    engagement = cut.engagement
    length = np.bincount(engagement.block, engagement.length, minlength=engagement.blocks)
    axial, radial = (
        np.bincount(engagement.block, values * engagement.length, minlength=engagement.blocks)
        / np.where(length > 0, length, 1.0)
        for values in (engagement.axial_depth, arcs.radial)
    )
    return {"f_z": cut.mean_feed_per_tooth, "a_p": axial, "a_e": radial}


def _beyond(constants: Taylor, v_c: Floats) -> str:
    if not constants.speed_range_m_min or not len(v_c):
        return ""
    low, high = constants.speed_range_m_min
    slowest, fastest = M_MIN * float(v_c.min()), M_MIN * float(v_c.max())
    if slowest >= low and fastest <= high:
        return ""
    return (
        f"cuts at {slowest:.0f} to {fastest:.0f} m/min, the constants are of tests at "
        f"{low:g} to {high:g} m/min"
    )


def electricity(
    cut: Cut, blocks: CutBlocks, parameters: EnergyParameters, drive: SpindleDrive
) -> Energy:
    """Electricity of each row [kWh]; arrays of shape (M,)."""
    plan, moves = cut.plan, cut.plan.path.moves
    share = np.divide(plan.motion.time, plan.time, out=np.zeros(len(moves)), where=plan.time > 0)
    cutting = np.zeros(len(moves))
    busy = np.divide(
        blocks.seconds, plan.time[blocks.row], out=np.zeros(len(blocks)),
        where=plan.time[blocks.row] > 0,
    )  # fmt: skip
    cutting[blocks.row] = blocks.mean_power * busy
    turning = plan.spindle_speed > 0
    no_load = np.where(turning, no_load_power(plan.spindle_speed / 60, drive), 0.0)
    return energy(
        parameters, times=plan.time, spindle_W=spindle_supply(cutting, no_load, drive),
        moving=np.where(plan.path.motion != Motion.STILL, share, 0.0), coolant=coolant_on(cut),
    )  # fmt: skip


def coolant_on(cut: Cut) -> Floats:
    """1 in rows where coolant is on (M7, M8 to M9 or the end); shape (M,)."""
    moves = cut.plan.path.moves
    code = np.where(moves.kind == Kind.M_CODE, moves.code, -1)
    change = np.where(np.isin(code, COOLANT_ON), 1, np.where(np.isin(code, COOLANT_OFF), 0, -1))
    change = np.where(moves.kind == Kind.END, 0, change)
    last = np.maximum.accumulate(np.where(change >= 0, np.arange(len(change)), -1))
    return np.where(last >= 0, change[np.maximum(last, 0)], 0).astype(np.float64)


def cost_of(cut: Cut, rates: CostRates, wear: Floats, used: Energy | None) -> PartCost:
    """Cost of each row, NaN without a tool life, for ``wear`` (M,) or ends of it (2, M) [1]."""
    prices = np.array([life_price(tool) for tool in cut.tools])
    return part_cost(
        rates,
        times=cut.plan.time,
        wear=wear,
        life_prices=np.where(cut.tool >= 0, prices[cut.tool], 0.0),
        energy_kWh=0.0 if used is None else used.block,
    )


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

    tool = plan.path.moves.tool
    load, axial, radial = cut.station_loads.peak, engagement.axial_depth * 1e3, arcs.radial * 1e3
    return EngagementTrace(
        total_s=round(total, 3), load_N_low=lowest(load), load_N_high=highest(load),
        axial_depth_mm_low=lowest(axial), axial_depth_mm_high=highest(axial),
        radial_depth_mm_low=lowest(radial), radial_depth_mm_high=highest(radial),
        entry_deg=lowest(np.degrees(arcs.entry)), exit_deg=highest(np.degrees(arcs.exit)),
        tools=tuple(one for one in tool_stretches(tool, begin, total) if one[0] >= 0),
    )  # fmt: skip


def stations_of_columns(low: Rows, high: Rows) -> tuple[Rows, Rows]:
    """Each station once for every column that it lies in: station, column."""
    count = high - low + 1
    station = np.repeat(np.arange(len(low)), count)
    inside = np.arange(len(station)) - np.repeat(np.cumsum(count) - count, count)
    return station, low[station] + inside


def _column(function: np.ufunc, values: Floats, place: Rows, columns: int) -> Curve:
    out = np.full(columns, np.inf if function is np.minimum else -np.inf)
    function.at(out, place, values)
    return tuple(figure(v, 4) for v in out.tolist())


def tool_stretches(
    tool: NDArray[np.integer], begin: Floats, total: float
) -> list[tuple[int, float, float]]:
    """Tool, begin and end of each stretch of one tool, as shares of ``total``.

    ``tool`` and ``begin`` (T,) are those of each row, from the first to the last.
    """
    edges = np.flatnonzero(np.diff(tool, prepend=tool[0] - 1 if len(tool) else 0))
    ends = [*(begin[edges[1:]] / total).tolist(), 1.0]
    return [
        (int(tool[row]), round(float(begin[row] / total), 5), round(end, 5))
        for row, end in zip(edges.tolist(), ends, strict=True)
    ]
