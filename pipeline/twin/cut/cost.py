"""Tool life, electricity and cost of a cut, row by row; what is not known is NaN, with a reason."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

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
from pipeline.schema.arrays import Floats
from pipeline.twin.cut.blocks import CutBlocks, StationArcs
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
    share = np.divide(
        plan.motion.time, plan.time, out=np.zeros(len(moves)), where=plan.time > 0
    )  # fmt: skip
    cutting = np.zeros(len(moves))
    busy = np.divide(
        blocks.seconds, plan.time[blocks.row], out=np.zeros(len(blocks)),
        where=plan.time[blocks.row] > 0,
    )  # fmt: skip
    cutting[blocks.row] = blocks.mean_power * busy
    turning = plan.spindle_speed > 0
    no_load = np.where(turning, no_load_power(plan.spindle_speed / 60, drive), 0.0)
    return energy(
        parameters,
        times=plan.time,
        spindle_W=spindle_supply(cutting, no_load, drive),
        moving=np.where(plan.path.motion != Motion.STILL, share, 0.0),
        coolant=coolant_on(cut),
    )


def coolant_on(cut: Cut) -> Floats:
    """1 in rows where coolant is on (M7, M8 to M9 or the end); shape (M,)."""
    moves = cut.plan.path.moves
    code = np.where(moves.kind == Kind.M_CODE, moves.code, -1)
    change = np.where(np.isin(code, COOLANT_ON), 1, np.where(np.isin(code, COOLANT_OFF), 0, -1))
    change = np.where(moves.kind == Kind.END, 0, change)
    last = np.maximum.accumulate(np.where(change >= 0, np.arange(len(change)), -1))
    on: Floats = np.where(last >= 0, change[np.maximum(last, 0)], 0).astype(np.float64)
    return on


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
