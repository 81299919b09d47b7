"""The cut by tool and as a whole: worst values, sums, costs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.cost import PartCost
from pipeline.cutting.energy import Energy
from pipeline.machine.spindle import CUTTING
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks
from pipeline.twin.cut_cost import Life
from pipeline.twin.cut_limits import CutLimits

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

MM, UM, CM3, KW = 1e3, 1e6, 1e6, 1e-3
CM3_MIN = CM3 * 60


@dataclass(frozen=True, kw_only=True)
class Found:
    """Everything that was found of a cut; what is not known is None."""

    cut: Cut
    blocks: CutBlocks
    limits: CutLimits
    life: Life
    energy: Energy | None
    cost: PartCost | None


def figure(value: float, digits: int = 6) -> float | None:
    """A finite number with so many digits; None for one that is not known."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None


def by_tool(found: Found) -> list[dict[str, Any]]:
    """Each tool that cuts, in the order of the program."""
    cut, blocks = found.cut, found.blocks
    order = dict.fromkeys(blocks.tool.tolist())
    number = cut.plan.path.moves.tool
    return [
        {
            "tool": cut.numbers[tool],
            "name": cut.tools[tool].name,
            **_values(found, blocks.tool == tool, number == cut.numbers[tool]),
        }
        for tool in order
    ]


def summary(found: Found) -> dict[str, Any]:
    """The part as a whole; rows without a tool that cuts count too."""
    every = np.ones(len(found.blocks), dtype=bool)
    rows = np.ones(found.cut.engagement.blocks, dtype=bool)
    worst = int(np.argmax(found.blocks.peak)) if len(found.blocks) else 0
    line = int(found.blocks.line[worst]) if len(found.blocks) else None
    return {
        **_values(found, every, rows),
        "peak_line": line,
        "blank_cm3": figure(found.cut.blank.volume * CM3),
        "left_cm3": figure(found.cut.left.volume * CM3),
    }


def _values(found: Found, mine: Flags, rows: Flags) -> dict[str, Any]:
    """Worst values of the blocks ``mine`` (K,) and sums over the ``rows`` (M,)."""
    b, limits, plan = found.blocks, found.limits, found.cut.plan
    turning = b.turns > 0
    fed = rows & np.isin(plan.path.moves.kind, CUTTING)
    at_feed, inside = float(plan.motion.time[fed].sum()), float(b.seconds[mine].sum())
    volume = float(b.volume[mine].sum())

    def most(values: Floats, factor: float = 1.0, of: Callable[..., Any] = np.max) -> float | None:
        known = values[mine & ~np.isnan(values)]
        return figure(factor * float(of(known))) if len(known) else None

    return {
        "blocks": int(mine.sum()),
        "time_s": figure(float(plan.time[rows].sum())),
        "at_feed_s": figure(at_feed),
        "in_material_s": figure(inside),
        "air_share": figure(max(0.0, 1 - inside / at_feed)) if at_feed > 0 else None,
        "feed_per_tooth_mm": most(_turning(b, b.feed_per_tooth), MM),
        "chip_thickness_mm": most(_turning(b, b.thickness), MM),
        "axial_depth_mm": most(b.axial_depth, MM),
        "radial_depth_mm": most(b.radial_depth, MM),
        "peak_load_N": most(_turning(b, b.peak)),
        "mean_load_N": _mean(b.mean[mine & turning], b.seconds[mine & turning]),
        "axial_force_N": most(_turning(b, b.axial)),
        "torque_Nm": most(_turning(b, b.torque)),
        "peak_torque_Nm": most(_turning(b, b.peak_torque)),
        "power_kW": most(_turning(b, b.power), KW),
        "drive_share": most(limits.drive),
        "deflection_um": most(limits.deflection, UM),
        "stability_margin": most(limits.margin, of=np.min),
        "volume_cm3": figure(volume * CM3),
        "removal_rate_cm3_min": figure(volume * CM3_MIN / inside) if inside > 0 else None,
        "highest_removal_rate_cm3_min": most(b.rate, CM3_MIN),
        "tool_life_share": figure(float(found.life.wear[rows].sum())),
        "energy_kWh": None if found.energy is None else figure(_sum(found.energy.block, rows)),
        "cost": None if found.cost is None else _cost(found.cost, rows, found.energy is not None),
    }


def _turning(blocks: CutBlocks, values: Floats) -> Floats:
    """NaN where the spindle stands: what goes into the material then is no chip."""
    return np.where(blocks.turns > 0, values, np.nan)


def _mean(values: Floats, seconds: Floats) -> float | None:
    total = float(seconds.sum())
    return figure(float(values @ seconds) / total) if total > 0 else None


def _sum(values: Floats, rows: Flags) -> float:
    return float(values[rows].sum())


def _cost(cost: PartCost, rows: Flags, energy: bool) -> dict[str, float | None]:
    """Time, tools with their changes, energy, and the sum of what is known."""
    tools = figure(_sum(cost.tool + cost.change, rows))
    parts = {
        "time": figure(_sum(cost.time, rows)),
        "tools": tools,
        "energy": figure(_sum(cost.energy, rows)) if energy else None,
    }
    known = [_sum(cost.time, rows), _sum(cost.energy, rows)]
    whole = None if tools is None else figure(sum(known) + _sum(cost.tool + cost.change, rows))
    return {**parts, "sum": whole}


def block_rows(found: Found) -> list[dict[str, Any]]:
    """Every block that cuts, in the order of the program."""
    b, limits, cut = found.blocks, found.limits, found.cut
    columns: dict[str, list[Any]] = {
        "line": b.line.tolist(),
        "row": b.row.tolist(),
        "tool": [cut.numbers[tool] for tool in b.tool.tolist()],
        "binds": [str(word) or None for word in limits.binds.tolist()],
    }
    wear = found.life.wear[b.row]
    for name, values in (
        ("used", limits.used),
        ("speed_rpm", b.turns),
        ("reached_feed_mm_min", b.feed),
        ("feed_per_tooth_mm", _turning(b, b.feed_per_tooth) * MM),
        ("chip_thickness_mm", _turning(b, b.thickness) * MM),
        ("axial_depth_mm", b.axial_depth * MM),
        ("radial_depth_mm", b.radial_depth * MM),
        ("entry_deg", np.degrees(b.entry)),
        ("exit_deg", np.degrees(b.exit)),
        ("peak_load_N", _turning(b, b.peak)),
        ("mean_load_N", _turning(b, b.mean)),
        ("axial_force_N", _turning(b, b.axial)),
        ("torque_Nm", _turning(b, b.torque)),
        ("peak_torque_Nm", _turning(b, b.peak_torque)),
        ("power_kW", _turning(b, b.power) * KW),
        ("drive_share", limits.drive),
        ("deflection_um", limits.deflection * UM),
        ("stability_margin", limits.margin),
        ("in_material_s", b.seconds),
        ("volume_cm3", b.volume * CM3),
        ("removal_rate_cm3_min", b.rate * CM3_MIN),
        ("tool_life_share", wear),
        ("energy_kWh", np.nan if found.energy is None else found.energy.block[b.row]),
        ("cost", np.nan if found.cost is None else found.cost.block[b.row]),
    ):
        spread = np.broadcast_to(values, len(b)).tolist()
        columns[name] = [figure(value) for value in spread]
    return [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
