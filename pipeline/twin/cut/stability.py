"""Stability of a program's blocks, and the lobes of each tool's least stable engagement."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import Immersions, immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.margins import (
    MOST,
    NEAR,
    CutClass,
    StabilityTable,
    margin,
    stability_table,
)
from pipeline.cutting.stability.semi_discretisation import least_depth, stiffness
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics
from pipeline.gcode.moves import RADIAN
from pipeline.schema.arrays import Floats
from pipeline.schema.program_cut import LobePoint, Lobes
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import figure

SLOWEST, FASTEST = 0.5, 1.3
"""Range of the lobes drawn, over the least and the greatest spindle speed of the program."""
NODE = 1.01
"""Ratio of two speeds at which lobes are drawn; all powers of it, so that programs share them."""
DEEP = 6.0
"""Depth up to which lobes are drawn, over the least of the zero-order solution."""
MOST_POINTS = 200
"""Greatest number of blocks of a tool that are drawn, the least margins first."""
LEAST = 1e-6
"""Chip thickness at which a force law is linearised where a tool cuts none [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stability:
    """Margin of each row, shape (M,): limit over depth, less 1; inf in air, NaN unknown."""

    margin: Floats
    table: StabilityTable
    stations: Immersions
    dynamics: tuple[Sequence[Mode] | None, ...]


def stability(cut: Cut, blocks: CutBlocks, dynamics: TipDynamics) -> Stability | None:
    """Stability of a cut; None where no tool that cuts has known dynamics, or nothing is milled."""
    table = table_of(cut, blocks, dynamics)
    if table is None:
        return None
    return Stability(
        margin=table[0].margins(_clipped(cut, table[0])), table=table[0], stations=table[1],
        dynamics=tuple(_milling(cut, dynamics)),
    )  # fmt: skip


def _milling(cut: Cut, dynamics: TipDynamics) -> list[Sequence[Mode] | None]:
    """Dynamics of each tool that mills: lobes of milling say nothing of a drill, or of a thread."""
    tips = zip(dynamics.of(cut.numbers), cut.tools, strict=True)
    return [None if tool.kind == "drill" or not tool.load_known else tip for tip, tool in tips]


def _clipped(cut: Cut, table: StabilityTable) -> Floats:
    """Speed of each row [rev/min], within the table."""
    ends = 60 * table.nodes[[0, -1]]
    return np.clip(cut.plan.spindle_speed, *ends)


def table_of(
    cut: Cut, blocks: CutBlocks, dynamics: TipDynamics, nodes_rpm: Floats | None = None,
    most: float = MOST,
) -> tuple[StabilityTable, Immersions] | None:  # fmt: skip
    """Table of stability of a cut at ``nodes_rpm``, by default the speeds of the program.

    Margins above ``most`` are not resolved; None where no tool that cuts has known dynamics.
    """
    tips = _milling(cut, dynamics)
    turning = blocks.spindle_speed[blocks.spindle_speed > 0]
    if not len(turning) or not any(tips[tool] is not None for tool in np.unique(blocks.tool)):
        return None
    milled = immersions(cut.path.pieces, cut.engagement)
    # the tips move along the machine's axes, the path lies in those of the work offset
    rotation = cut.path.frame.rotation * RADIAN
    milled = replace(milled, feed_direction=milled.feed_direction + rotation)
    force_laws = tuple(
        linearised(law, _chip(blocks, tool)) for tool, law in enumerate(cut.force_laws)
    )
    nodes = np.unique(turning) if nodes_rpm is None else nodes_rpm
    return stability_table(milled, tips, force_laws, cut.tools, nodes_rpm=nodes, most=most), milled


def _chip(blocks: CutBlocks, tool: int) -> float:
    thickness = blocks.thickness[(blocks.tool == tool) & (blocks.thickness > 0)]
    return float(np.median(thickness)) if len(thickness) else LEAST


def linearised(law: ForceLaw, thickness: float) -> ForceLaw:
    """Linear force law with the slope of ``law`` at a chip of that thickness."""
    tangential, radial = stiffness(law, thickness)
    slope = tangential / law.K_tc if law.K_tc else 1.0
    return ForceLaw(K_tc=tangential, K_rc=radial, K_ac=law.K_ac * slope, K_te=law.K_te)


def stability_lobes(cut: Cut, result: Stability) -> tuple[Lobes, ...]:
    """Lobes of the least stable engagement of each tool, and its blocks with that engagement."""
    table, stations = result.table, result.stations
    known = np.array([one is not None for one in result.dynamics])
    kept = np.flatnonzero(known[stations.tool])  # the stations that the table has
    spindle = _clipped(cut, table)[table.block]
    node = np.searchsorted(60 * table.nodes, spindle * (1 - NEAR))
    margins = margin(table.depth, table.limit[table.kind, node])
    lobes = []
    for tool in np.unique(stations.tool[kept]).tolist():
        mine = np.flatnonzero((stations.tool[kept] == tool) & (spindle > 0))
        if not len(mine):
            continue
        worst = int(mine[np.argmin(margins[mine])])
        same = mine[table.kind[mine] == table.kind[worst]]
        nodes, limit = _drawn(table.classes[int(table.kind[worst])], spindle[mine])
        lobes.append(
            Lobes(
                tool=cut.numbers[tool],
                label=f"T{cut.numbers[tool]} {cut.tools[tool].name}".strip(),
                line=int(cut.plan.path.moves.line[table.block[worst]]),
                entry_deg=round(float(np.degrees(stations.entry[kept[worst]])), 1),
                exit_deg=round(float(np.degrees(stations.exit[kept[worst]])), 1),
                speeds_rpm=tuple(np.round(nodes, 1).tolist()),
                depth_limit_mm=tuple(figure(v, 4) for v in (limit * 1e3).tolist()),
                points=_points(cut, result, same[np.argsort(margins[same])], margins),
            )
        )
    return tuple(lobes)


def _drawn(of: CutClass, spindle: Floats) -> tuple[Floats, Floats]:
    """Speeds around those of a tool [rev/min], and the limit of the depth there [m]."""
    low, high = SLOWEST * float(spindle.min()), FASTEST * float(spindle.max())
    powers = np.arange(ceil(log(low, NODE)), floor(log(high, NODE)) + 1, dtype=np.float64)
    nodes: Floats = NODE**powers
    deep = replace(of, highest=max(of.highest, DEEP * least_depth(of.dynamics, of.cut)))
    return nodes, deep.limits(nodes / 60)


def _points(
    cut: Cut, found: Stability, entries: NDArray[np.intp], margins: Floats
) -> tuple[LobePoint, ...]:
    """Speed and depth of the blocks of the table's ``entries``, each block once."""
    table = found.table
    _, first = np.unique(table.block[entries], return_index=True)
    return tuple(
        LobePoint(
            line=int(cut.plan.path.moves.line[table.block[e]]),
            speed_rpm=round(float(cut.plan.spindle_speed[table.block[e]]), 1),
            axial_depth_mm=float(f"{table.depth[e] * 1e3:.4g}"),
            margin=figure(margins[e], 4),
        )
        for e in entries[np.sort(first)][:MOST_POINTS].tolist()
    )
