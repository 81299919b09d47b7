"""Cut of a program on the command line: from options to loads, stability and cost."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, cast, get_args

from pipeline.app.output import aligned, between, many, rounded
from pipeline.app.programs import Controlled, machine_residual
from pipeline.app.tables import read_material, read_tools, section
from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import DIRECTIONS, TipDynamics, TipModes
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.moves import Moves
from pipeline.optimisation.job import JobRequest, Workshop, job_request
from pipeline.optimisation.settings import OptimisationSettings, Part
from pipeline.parameters import structure
from pipeline.schema.limits import BY_TOOL, CutLimit, limit_options
from pipeline.schema.part import Objective
from pipeline.schema.program_cut import (
    CutCost,
    CutTotals,
    CutWarning,
    ForceInterval,
    ProgramCut,
    ToolEdge,
)
from pipeline.twin.cut.coefficients import ToolWear, WearRule

REMEDY = {
    "stock": "give the blank, box:X0,X1,Y0,Y1,Z0,Z1 in mm, cylinder:X,Y,DIAMETER,Z0,Z1 or an .stl",
    "tool_table": "name a table of conf/tool/ or a YAML file",
    "material": "name a material of conf/material/",
}


TOOL_VALUE = re.compile(r"[Tt]?(\d{1,9})=(\d{1,9}(?:\.\d*)?|\.\d+)")
"""Number of a tool and a value of it, as ``T5=300``."""
ToolLimits = Mapping[int, Mapping[str, Any]]
"""Fields of tools that options give, by the tool's number."""
LIMIT_OPTION = {name: words.option for name, _, words in limit_options()}
"""Option of the command line by the limit that it gives."""
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


def _limits(given: Mapping[str, Any]) -> tuple[CutLimit, ToolLimits]:
    of_part, by_tool = dict(given), dict[int, dict[str, Any]]()
    for name in BY_TOOL:
        if given.get(name) is not None:
            others, own = _by_tool(LIMIT_OPTION[name], given[name])
            of_part[name] = _of_all(LIMIT_OPTION[name], others)
            for number, value in own.items():
                by_tool.setdefault(number, {})[f"limit_{name}"] = value
    return CutLimit.of_options(of_part), by_tool


def _by_tool(option: str, words: Sequence[str]) -> tuple[list[str], dict[int, float]]:
    """Words of an option that name no tool, and values by tool, as ``T5=300`` gives them."""
    others, values = [], dict[int, float]()
    for word in words:
        found = TOOL_VALUE.fullmatch(word)
        if found is None:
            others.append(word)
        elif int(found[1]) in values:
            raise ValueError(f"{option} gives T{int(found[1])} twice: leave one out")
        else:
            values[int(found[1])] = float(found[2])
    return others, values


def _of_all(option: str, words: Sequence[str]) -> float | None:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [0.0, 0.0]
    if len(values) > 1:
        raise ValueError(
            f"{option} {' '.join(words)} is not one number: give one for all tools, and T5=300 "
            "for one of them"
        )
    return values[0] if values else None


def requested_wear(words: Sequence[str]) -> ToolWear:
    """Wear that ``--wear`` requests: ``sharp``, ``criterion``, ``known`` or ``T26=120`` [um]."""
    rules, given = _by_tool("--wear", words)
    for word in rules:
        if word not in get_args(WearRule):
            raise ValueError(
                f"--wear {word} is no wear of a tool: give T26=120 for 120 um on T26, or one "
                f"of {', '.join(get_args(WearRule))} for all tools"
            )
    if len(rules) > 1:
        raise ValueError(f"--wear {rules[1]} is given beside --wear {rules[0]}: give one")
    if not rules:
        return ToolWear(given=given)
    return ToolWear(rule=cast(WearRule, rules[0]), requested=True, given=given)


@dataclass(frozen=True, kw_only=True)
class CutOptions:
    """Cut as the options of ``kerf simulate`` and ``kerf optimise`` describe it."""

    part: Part
    """Blank, tool table, material, limits and objective."""
    tool_limits: ToolLimits
    """Limits of single tools in place of the tool table's."""
    frf: tuple[str, ...]
    """Files of the frequency response at the tools' tips, ``x=TIP.csv`` or ``TIP.uff``."""
    wear: ToolWear
    """Wear of the tools that was requested."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that are read for the cut; no output may replace them."""
        named = [word for word in (self.part.stock, self.part.tool_table, self.part.material)
                 if word.lower().endswith((".stl", ".yaml", ".yml"))]  # fmt: skip
        return tuple(Path(word) for word in (*named, *(w.rpartition("=")[2] for w in self.frf)))


def cut_options(
    *, limits: Mapping[str, Any], frf: Sequence[str] | None, wear: Sequence[str] | None,
    resolution: float | None, page: Path | None = None, objective: Objective = "time",
    alone: bool = True, **words: str | None,
) -> CutOptions:  # fmt: skip
    """Options of a cut, limits by the names of their fields.

    ``words`` are stock, tool_table, material and work_offset; with ``alone`` the first three are
    needed for another of the options that is given.
    """
    other = {LIMIT_OPTION[name]: value for name, value in limits.items()} | {
        "--resolution": resolution, "--work-offset": words["work_offset"], "--frf": frf or None,
        "--wear": wear or None, "--page": page,
    }  # fmt: skip
    given = {_option(name): words[name] for name in REMEDY} | other
    said = next((option for option, value in given.items() if value is not None), "")
    for name, remedy in REMEDY.items():
        if words[name] is None:
            why = (
                f"{said} is given without {_option(name)}"
                if alone
                else f"{_option(name)} is missing"
            )
            raise ValueError(f"{why}: {remedy}")
    of_part, by_tool = _limits(limits)
    cell = {} if resolution is None else {"resolution_mm": resolution}
    part = Part(program="part.nc", objective=objective, limits=of_part, **words, **cell)  # type: ignore[arg-type]
    return CutOptions(
        part=part, tool_limits=by_tool, frf=tuple(frf or ()), wear=requested_wear(wear or ())
    )


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def request_of(
    on: Controlled, program: Path, options: CutOptions, settings: OptimisationSettings,
    moves: Moves | None = None,
) -> JobRequest:  # fmt: skip
    """Job of a program by the options and the machine's file."""
    part, models = options.part, on.identified_models
    if settings.with_residual:
        residual, name = machine_residual(on)
        models = replace(models, residual=residual, residual_name=name)
    workshop = Workshop(
        table=_limited(read_tools(part.tool_table), options.tool_limits),
        material=read_material(part.material),
        rates=section(on.parameters, "cost", CostRates),
        drive=section(on.sections, "spindle_drive", SpindleDrive),
        drive_source=f"conf/machine/{on.machine}.yaml",
        energy=section(on.sections, "energy", EnergyParameters),
        dynamics=_measured(options.frf) or section(on.sections, "dynamics", TipModes),
        catalogue=structure(on.parameters, "catalogue", CuttingCatalogue),
        wear=options.wear,
    )
    return job_request(
        program, part, workshop, models, setup=on.setup, settings=settings, moves=moves
    )


def _limited(table: ToolTable, given: ToolLimits) -> ToolTable:
    missing = sorted(given.keys() - table.tools.keys())
    if missing:
        there = ", ".join(f"T{number}" for number in sorted(table.tools))
        raise ValueError(
            f"a limit is given for T{missing[0]}, which the tool table does not have: it has "
            f"{there}"
        )
    own = {number: replace(table.tools[number], **of) for number, of in given.items()}
    return replace(table, tools={**table.tools, **own})


def _measured(frf: Sequence[str]) -> TipDynamics | None:
    """Tip dynamics fitted to the responses of ``--frf``; None without any."""
    if not frf:
        return None
    from pipeline.cutting.stability.modal_fit import fit_modes
    from pipeline.cutting.stability.tip_dynamics import joined_responses, read_frf

    parts = []
    for word in frf:
        direction, said, name = word.rpartition("=")
        path = Path(name)
        if not path.is_file():
            raise ValueError(
                f"--frf {word}: {path} does not exist: name a frequency response, as "
                "x=TIP.csv or TIP.uff"
            )
        parts.append(read_frf(path, direction=direction if said else None))  # type: ignore[arg-type]
    names = ", ".join(Path(word.rpartition("=")[2]).name for word in frf)
    whole = joined_responses(parts)
    if rigid := [d for k, d in enumerate(DIRECTIONS) if not whole.receptance[:, k, k].any()]:
        raise ValueError(
            f"--frf {names}: nothing is measured along {' and '.join(rigid)}, which would "
            f"count as rigid: give --frf {rigid[0]}=FILE too, the same file where the tip "
            "gives way alike"
        )
    try:
        fit = fit_modes(parts)
    except ValueError as error:
        raise ValueError(f"--frf {names}: {error}") from error
    return TipDynamics(
        source=f"modes fitted to the measured response {names}, error {100 * fit.error:.1f} %, "
        "taken for every tool",
        every=fit.modes, caution=fit.caution,
    )  # fmt: skip


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
