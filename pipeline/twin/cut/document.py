"""Document of a program's cut: what ``kerf simulate`` writes, prints and draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np

from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, no_load_power
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.cutting.tool import LEAD_ANGLE
from pipeline.schema.limits import by_tool_words
from pipeline.schema.program_cut import (
    BasisRow,
    Blank,
    CutBlock,
    CutWarning,
    DriveCurve,
    DrivePoint,
    LoadLimit,
    MaterialName,
    NotKnown,
    ProgramCut,
    ToolTotals,
    WorstBlock,
)
from pipeline.twin.cut.blocks import CutBlocks, StationArcs, cut_blocks, cut_limits, station_arcs
from pipeline.twin.cut.coefficients import ToolCoefficients, ToolWear, tool_edges
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.stability import Stability, stability, stability_lobes
from pipeline.twin.cut.tables import (
    CutResults,
    block_rows,
    by_tool,
    cost_of,
    cut_trace,
    electricity,
    figure,
    summary,
    tool_life,
)
from pipeline.twin.cut.warnings import cut_warnings, setup_warnings
from pipeline.twin.preflight import clearance_not_checked

WORST = 15
"""Number of blocks in the table of those nearest to their limit."""
NEAR = 0.1
"""Relative difference up to which runs of blocks are listed as one [1]."""
SPEEDS = 200  # along the drive's curve

FEEDS = (
    "Peaks (force, torque, power, chip, deflection) are those of the highest feed that the control "
    "reaches in a block; mean load, removal rate, tool life and energy those of its mean feed."
)


@dataclass(frozen=True, kw_only=True)
class CutBasis:
    """Limits, material and prices that a cut is assessed by, with their source; None if unknown."""

    stock: str
    table: str
    """Blank and tool table, as they were named."""
    material: Material
    coefficients: Mapping[int, ToolCoefficients]
    """Cutting coefficients of each tool, by number."""
    limit_load: float | None = None
    """Limit of the load in the plane [N]."""
    rates: CostRates | None = None
    energy: EnergyParameters | None = None
    drive: SpindleDrive | None = None
    drive_source: str = ""
    dynamics: TipDynamics | None = None
    wear: ToolWear = field(default_factory=ToolWear)
    """Wear that the coefficients hold for."""


@dataclass(frozen=True, kw_only=True)
class AssessedCut:
    """A cut with its results, the arcs of its stations and its stability."""

    results: CutResults
    """Blocks, life, energy, limits, cost."""
    arcs: StationArcs
    """Arcs of its stations."""
    stable: Stability | None
    """Stability; None where no dynamics are known."""


def assessed(cut: Cut, basis: CutBasis) -> AssessedCut:
    """The cut assessed by what ``basis`` holds; what that lacks stays unknown."""
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    stable = None if basis.dynamics is None else stability(cut, blocks, basis.dynamics)
    life = tool_life(cut, blocks, arcs, basis.material)
    used = None
    if basis.energy is not None and basis.drive is not None:
        used = electricity(cut, blocks, basis.energy, basis.drive)
    results = CutResults(
        cut=cut, blocks=blocks, life=life, energy=used,
        limits=cut_limits(
            cut, blocks, limit_load=basis.limit_load, drive=basis.drive,
            margin=None if stable is None else stable.margin,
        ),
        cost=None if basis.rates is None else cost_of(cut, basis.rates, life.wear, used),
        cost_ends=None if basis.rates is None else cost_of(cut, basis.rates, life.interval, used),
    )  # fmt: skip
    return AssessedCut(results=results, arcs=arcs, stable=stable)


def document_of(cut: Cut, basis: CutBasis) -> ProgramCut:
    """The cut as it stands under ``cut`` in the JSON of ``kerf simulate``."""
    of = assessed(cut, basis)
    results, stable = of.results, of.stable
    rows, tools = block_rows(results), by_tool(results)
    return ProgramCut(
        stock=Blank(
            text=basis.stock,
            work_offset=cut.path.frame.name,
            resolution_mm=round(cut.blank.cell * 1e3, 6),
            notice=cut.blank.notice or None,
        ),
        material=MaterialName(name=basis.material.name),
        currency=None if basis.rates is None else basis.rates.currency,
        limits=LoadLimit(load_N=basis.limit_load),
        dynamics=None if basis.dynamics is None else basis.dynamics.source,
        dynamics_measured=basis.dynamics is not None and basis.dynamics.measured,
        feeds=FEEDS,
        summary=summary(results),
        by_tool=tools,
        worst=_worst(rows),
        warnings=warnings_of(of, basis),
        not_known=not_known(of, basis),
        left_out=cut.path.left_out,
        basis=_basis(cut, results.blocks, basis),
        notes=notes(of, basis),
        trace=cut_trace(cut, of.arcs),
        lobes=() if stable is None else stability_lobes(cut, stable),
        drive=None if basis.drive is None else _drive(results.blocks, rows, basis.drive),
        blocks=rows,
        edges=tool_edges(cut, of.arcs, basis.coefficients),
    )


def _worst(rows: Sequence[CutBlock]) -> tuple[WorstBlock, ...]:
    """The worst blocks, the greatest utilisation first, each for all that are alike.

    Alike are blocks one after the other that have the same tool and limit, all within or all beyond
    it, and other such runs with nearly the same utilisation and load.  Where no limit is known the
    load decides.
    """

    def utilisation(row: CutBlock) -> tuple[float, float]:
        return (row.used or 0.0, row.peak_load_N or 0.0)

    def kind(row: CutBlock) -> tuple[Any, ...]:
        return row.tool, row.binds, (row.used or 0.0) > 1

    def close(one: CutBlock, other: CutBlock) -> bool:
        pairs = zip(utilisation(one), utilisation(other), strict=True)
        return kind(one) == kind(other) and all(abs(a - b) <= NEAR * max(a, b) for a, b in pairs)

    runs = [list(run) for _, run in groupby(rows, kind)]
    peaks = [WorstBlock(**vars(max(run, key=utilisation)), alike=len(run)) for run in runs]
    worst: list[WorstBlock] = []
    for row in sorted(peaks, key=utilisation, reverse=True):
        same = next((k for k, one in enumerate(worst) if close(one, row)), None)
        if same is not None:
            worst[same] = replace(worst[same], alike=worst[same].alike + row.alike)
        elif len(worst) < WORST:
            worst.append(row)
    return tuple(worst)


def warnings_of(of: AssessedCut, basis: CutBasis) -> tuple[CutWarning, ...]:
    """Warnings before the part is cut, grave ones first."""
    results = of.results
    warnings = cut_warnings(
        results.cut, results.blocks, results.limits, basis.limit_load,
        dynamics=basis.dynamics, drive=basis.drive, stock=basis.stock,
    )  # fmt: skip
    every = (*setup_warnings(results.cut, basis.table), *warnings, *_worn(by_tool(results)))
    return tuple(sorted(every, key=lambda one: not one.grave))


def _worn(tools: Sequence[ToolTotals]) -> list[CutWarning]:
    return [
        CutWarning(
            what=f"T{one.tool} wears out {share:.1f} times in one part",
            do="Lower its speed, or take a sister tool.",
        )
        for one in tools
        if (share := one.tool_life_share) is not None and share > 1
    ]


def not_known(of: AssessedCut, basis: CutBasis) -> tuple[NotKnown, ...]:
    """Quantities that are not known of a cut, with the reason of each."""
    results, stable = of.results, of.stable
    cut = results.cut
    names = {tool: f"T{cut.numbers[tool]}" for tool in np.unique(results.blocks.tool).tolist()}
    unknown = results.life.unknown
    stiff = [names[tool] for tool in names if cut.tools[tool].stickout is None]
    profiled = [names[tool] for tool in names if not cut.tools[tool].load_known]
    tools = dict(zip(cut.numbers, cut.tools, strict=True))
    unlisted = clearance_not_checked(cut.plan.path.moves, tools)
    reasons: list[tuple[str, bool, str]] = [
        ("share of the spindle’s drive", basis.drive is None,
         "the machine’s file has no section spindle_drive"),
        ("stability", not np.isfinite(results.limits.margin).any(),
         _why_no_margin(results, basis, stable)),
        ("load, torque and power where the spindle stands",
         bool((results.blocks.spindle_speed <= 0).any()),
         "a tool that does not turn cuts no chip"),
        (f"load, deflection, torque and power of {', '.join(profiled)}", bool(profiled),
         "the contact of a thread mill’s profile is not computed, and no limit of them holds for "
         "it"),
        ("deflection", bool(stiff), f"{', '.join(stiff)} without stickout_mm in the tool table"),
        ("contact of the tools’ bodies with the part", bool(unlisted),
         f"not listed: {'; '.join(unlisted)}"),
        ("cost", basis.rates is None, "conf/cost/ is not composed: add it to conf/config.yaml"),
        ("energy", results.energy is None,
         "the machine’s file lacks section energy or spindle_drive"),
    ]  # fmt: skip
    known = {names[k]: basis.material.tool_life(cut.tools[k]) for k in names}
    single = [name for name, life in known.items() if life is not None and len(life.ends) == 1]
    why = "Taylor’s constants are those of a source that states no spread"
    reasons.append((f"interval of the tool life of {', '.join(single)}", bool(single), why))
    for why in dict.fromkeys(unknown.values()):
        alike = ", ".join(names[tool] for tool, reason in unknown.items() if reason == why)
        reasons.append((f"tool life of {alike}", True, why))
    return tuple(NotKnown(what=what, why=why) for what, missing, why in reasons if missing)


def _why_no_margin(results: CutResults, basis: CutBasis, stable: Stability | None) -> str:
    if not len(results.blocks):
        return "nothing is cut"
    if basis.dynamics is None:
        return (
            "the machine’s file has no section dynamics for the tools that cut and no --frf was "
            "given"
        )
    if not (results.blocks.spindle_speed > 0).any():
        return "the spindle stands in every cut"
    return "no tool that mills has known dynamics"


def _basis(cut: Cut, blocks: CutBlocks, basis: CutBasis) -> tuple[BasisRow, ...]:
    rows = [
        ("blank", basis.stock, f"in mm, in the work coordinates of {cut.path.frame.name}"),
        ("resolution", f"{cut.blank.cell * 1e3:g} mm", ""),
        ("tools", basis.table, ""),
        ("material", basis.material.name, basis.material.source),
    ]
    alike: dict[tuple[str, str], list[str]] = {}
    for tool in np.unique(blocks.tool).tolist():
        law = basis.coefficients[cut.numbers[tool]]
        source = "; ".join(filter(None, (law.source, law.caution)))
        alike.setdefault((f"{law.kind}: {_coefficient_words(law)}", source), []).append(
            f"T{cut.numbers[tool]}"
        )
    rows += [(f"forces of {', '.join(named)}", *said) for said, named in alike.items()]
    rows += life_sources(cut, basis.material)
    used = np.unique(blocks.tool).tolist()
    own = {cut.numbers[tool]: cut.tools[tool].limit_load_N for tool in used}
    if said := by_tool_words(basis.limit_load, own, "N"):
        rows.append(("limit of the load", said, "the limits of the part, or the tool table"))
    if basis.drive is not None:
        power = f"{basis.drive.rated_power_kW:g} kW from {basis.drive.base_speed_rpm:g} rev/min on"
        rows.append(("spindle’s drive", power, basis.drive_source))
    if basis.dynamics is not None:
        rows.append(("dynamics of the tools’ tips", "stability lobes", basis.dynamics.source))
    return tuple(BasisRow(what=what, value=value, source=why) for what, value, why in rows)


def life_sources(cut: Cut, material: Material) -> list[tuple[str, str, str]]:
    """Sources of the cutting tools' lives, with the constants in words."""
    alike: dict[tuple[str, str], list[str]] = {}
    for index in np.unique(cut.tool[cut.tool >= 0]).tolist():
        if (life := material.tool_life(cut.tools[index])) is not None:
            alike.setdefault((life.words, life.source), []).append(f"T{cut.numbers[index]}")
    return [(f"tool life of {', '.join(named)}", *said) for said, named in alike.items()]


def _coefficient_words(coefficients: ToolCoefficients) -> str:
    law = coefficients.law
    if law.m_c > 0:
        specific = law.K_tc / 1e6 * 1e-3**-law.m_c
        return (
            f"k_c1.1 {specific:.0f} N/mm², m_c {law.m_c:g}, radial {law.K_rc / law.K_tc:.2g} of it"
        )
    return (
        f"K_tc {law.K_tc / 1e6:.0f}, K_rc {law.K_rc / 1e6:.0f}, K_ac {law.K_ac / 1e6:.0f} N/mm², "
        f"K_te {law.K_te / 1e3:.3g}, K_re {law.K_re / 1e3:.3g}, K_ae {law.K_ae / 1e3:.3g} N/mm"
    )


def notes(of: AssessedCut, basis: CutBasis) -> tuple[str, ...]:
    """Notes on the numbers of a cut, for its reader."""
    results, cut = of.results, of.results.cut
    cautions = dict.fromkeys(
        basis.coefficients[cut.numbers[tool]].caution
        for tool in np.unique(results.blocks.tool).tolist()
    )
    worn = dict.fromkeys(
        f"T{cut.numbers[tool]} counts as {given.edge}{f'; {caution}' if caution else ''}."
        for tool in np.unique(results.blocks.tool).tolist()
        if (given := basis.coefficients[cut.numbers[tool]]).sharp is not None
        for caution in [given.land.caution if given.land else ""]
    )
    lead = [
        f"T{cut.numbers[tool]} is a face mill without cutting_edge_angle_deg in the tool table: "
        f"its chip is that of the usual {LEAD_ANGLE:g} degrees."
        for tool in np.unique(results.blocks.tool).tolist()
        if cut.tools[tool].role == "face_mill" and cut.tools[tool].cutting_edge_angle_deg is None
    ]
    return (
        FEEDS,
        *(f"{notice[:1].upper()}{notice[1:]}." for notice in cut.plan.path.moves.notices),
        *worn,
        *lead,
        *(f"Forces: {caution}." for caution in cautions if caution),
        *([f"Blank: {cut.blank.notice}."] if cut.blank.notice else []),
        *(f"T{cut.numbers[tool]} {why}." for tool, why in results.life.beyond.items()),
    )


def _drive(blocks: CutBlocks, rows: Sequence[CutBlock], drive: SpindleDrive) -> DriveCurve:
    running = blocks.spindle_speed[blocks.spindle_speed > 0]
    fastest = max(float(running.max(initial=0.0)), drive.top_speed_rpm)
    speeds = np.linspace(min(drive.minimum_speed_rpm, 0.5 * fastest), fastest, SPEEDS)
    power = available_power(speeds / 60, drive) * drive.efficiency
    power = (power - no_load_power(speeds / 60, drive)) / 1e3
    points = sorted(rows, key=lambda row: row.power_kW or 0.0, reverse=True)
    return DriveCurve(
        speeds_rpm=tuple(np.round(speeds, 1).tolist()),
        power_kW=tuple(figure(p, 4) for p in power.tolist()),
        points=tuple(
            DrivePoint(
                line=row.line, tool=row.tool, speed_rpm=row.speed_rpm, power_kW=row.power_kW,
                drive_share=row.drive_share,
            )
            for row in points[: WORST * 10]
        ),
    )  # fmt: skip
