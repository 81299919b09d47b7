"""Printed lines of a program's cut: tools, forces, cost, warnings, what is not known."""

from collections.abc import Iterator, Sequence
from math import isfinite

from pipeline.app.lines import aligned, between, many, rounded
from pipeline.schema.program_cut import (
    CutCost,
    CutTotals,
    CutWarning,
    ForceInterval,
    ProgramCut,
    ToolEdge,
)


def cut_lines(cut: ProgramCut) -> Iterator[str]:
    """Lines of ``kerf simulate`` on a cut: tools, cost, warnings, unknown quantities."""
    total = cut.summary
    yield (
        f"cut of {cut.stock.text} mm ({cut.stock.work_offset}) in {cut.material.name}: "
        f"{rounded(total.volume_cm3)} cm3 removed, {_percent(total.air_share)} of the time at "
        "feed in air"
    )
    for row in cut.basis:
        if row.what.startswith(("forces of", "dynamics of", "tool life of")):
            yield f"  {row.what}: {row.value} ({row.source})"
    yield from edge_lines(cut.edges)
    yield from _table(cut)
    yield from force_lines(cut.forces)
    if total.cost is not None:
        causes = ("time", "tools", "energy", "sum")
        parts = ", ".join(f"{name} {rounded(getattr(total.cost, name))}" for name in causes)
        ends = between(total.cost.sum_low, total.cost.sum_high)
        yield f"  cost of the part, {cut.currency}: {parts}{ends}"
    if ends := between(total.tool_life_share_low, total.tool_life_share_high, 100):
        yield f"  tool life of the part, %: {rounded(total.tool_life_share, 100)}{ends}"
    for axis in cut.axes:
        width = axis.half_width_um
        within = f" ± {rounded(width)} um" if isfinite(width) else ""
        yield (
            f"  axis {axis.axis} in the cut: behind by up to {rounded(axis.following_um)} um"
            f"{within} in line {axis.following_line} (in air {rounded(axis.following_air_um)}), "
            f"draws up to {rounded(axis.command)} {axis.command_unit} in line "
            f"{axis.command_line} (in air {rounded(axis.command_air)})"
        )
    yield from warning_lines(cut.warnings)
    for moves in cut.left_out:
        held = many(moves.rows, "move")
        yield f"  left out: {moves.reason}, {held}, the first in {moves.first}"
    for one in cut.not_known:
        yield f"  not known: {one.what}, {one.why}"


def edge_lines(edges: Sequence[ToolEdge]) -> Iterator[str]:
    """Wear of each tool, and its force sharp and worn, in lines."""
    for one in edges:
        caution = f" ({one.caution})" if one.caution and one.wear_um else ""
        yield f"  wear of T{one.tool}: {one.edge}{caution}"
        if (of := one.forces) is not None:
            what = "worn" if one.wear_um else f"at {rounded(of.wear_um)} um"
            ends = f"{rounded(of.peak_load_low_N)} to {rounded(of.peak_load_high_N)}"
            yield (
                f"    load sharp {rounded(of.peak_load_sharp_N)} N, {what} "
                f"{rounded(of.peak_load_N)} N ({ends}, 95 %); power "
                f"{rounded(of.power_sharp_kW)} and {rounded(of.power_kW)} kW"
            )


def force_lines(forces: Sequence[ForceInterval]) -> Iterator[str]:
    """Peak and mean force of each tool with its 90 % interval, and what was not learnt."""
    for one in forces:
        runout = f"; runout {one.runout}" if one.runout else ""
        yield (
            f"  force of T{one.tool}: peak {rounded(one.peak_load_N)} N "
            f"({rounded(one.peak_load_low_N)} to {rounded(one.peak_load_high_N)}, 90 %), mean "
            f"{rounded(one.mean_load_N)} N ({rounded(one.mean_load_low_N)} to "
            f"{rounded(one.mean_load_high_N)}){runout}"
        )
        if one.outside:
            yield f"    outside of what was learnt: {'; '.join(one.outside)}"


def warning_lines(warnings: Sequence[CutWarning]) -> Iterator[str]:
    """One line a warning, with the lines of the program; what is grave is in capitals."""
    for one in warnings:
        lines = ", ".join(map(str, one.lines[:MOST_LINES]))
        more = ", ..." if len(one.lines) > MOST_LINES else ""
        blocks = "" if one.blocks is None else f", {many(one.blocks, 'block')}"
        where = f"{blocks}, line {lines}{more}" if lines else ""
        yield f"  {'WARNING' if one.grave else 'warning'}: {one.what}{where}. {one.do}"


MOST_LINES = 6
"""Lines of the program that a warning names, at most."""
COLUMNS: tuple[tuple[str, str, str, float], ...] = (
    ("f_z", "mm", "feed_per_tooth_mm", 1),
    ("a_p", "mm", "axial_depth_mm", 1),
    ("a_e", "mm", "radial_depth_mm", 1),
    ("load", "N", "peak_load_N", 1),
    ("axial", "N", "axial_force_N", 1),
    ("torque", "N m", "torque_Nm", 1),
    ("power", "kW", "power_kW", 1),
    ("drive", "%", "drive_share", 100),
    ("deflection", "um", "deflection_um", 1),
    ("stability", "%", "stability_margin", 100),
    ("rate", "cm3/min", "removal_rate_cm3_min", 1),
    ("air", "%", "air_share", 100),
    ("life", "%", "tool_life_share", 100),
    ("energy", "kWh", "energy_kWh", 1),
    ("cost", "", "cost", 1),
)
"""Head, unit, key and factor of what is said of each tool."""


def _table(cut: ProgramCut) -> Iterator[str]:
    heads = ["tool", *(head for head, *_ in COLUMNS)]
    units = ["", *(unit for _, unit, *_ in COLUMNS[:-1]), cut.currency or ""]
    rows = [
        [name, *(rounded(_value(row, key), factor) for *_, key, factor in COLUMNS)]
        for name, row in (
            *((f"T{row.tool}", row) for row in cut.by_tool),
            ("part", cut.summary),
        )
    ]
    yield from (f"  {line}" for line in aligned([heads, units, *rows], words=0))


def _value(row: CutTotals, key: str) -> float | None:
    value: float | CutCost | None = getattr(row, key)
    return value.sum if isinstance(value, CutCost) else value


def _percent(value: float | None) -> str:
    return "an unknown share" if value is None else f"{100 * value:.0f} %"
