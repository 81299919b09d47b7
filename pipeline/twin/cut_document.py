"""Document of a program's cut: what ``kerf simulate`` writes, prints and draws."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, no_load_power
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks, StationArcs, cut_blocks, station_arcs
from pipeline.twin.cut_coefficients import ToolCoefficients
from pipeline.twin.cut_cost import cost_of, electricity, tool_life
from pipeline.twin.cut_limits import cut_limits, cut_warnings
from pipeline.twin.cut_stability import Stability, lobe_figures, stability
from pipeline.twin.cut_tables import CutResults, block_rows, by_tool, cut_trace, summary

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
    """Limits, material and prices that a cut is assessed by, with their source; None if unknown.

    Parameters
    ----------
    stock, table : str
        Blank and tool table as they were named.
    material : Material
        Of the blank.
    laws : mapping of int to ToolCoefficients
        Cutting coefficients of each tool, by number.
    limit_load : float or None
        Of the load in the plane [N].
    rates, energy, drive, dynamics
        Of conf/cost/ and of the machine.
    drive_source : str
        Where the drive's values come from.
    """

    stock: str
    table: str
    material: Material
    laws: Mapping[int, ToolCoefficients]
    limit_load: float | None = None
    rates: CostRates | None = None
    energy: EnergyParameters | None = None
    drive: SpindleDrive | None = None
    drive_source: str = ""
    dynamics: TipDynamics | None = None


@dataclass(frozen=True, kw_only=True)
class AssessedCut:
    """A cut with its results, the arcs of its stations and its stability.

    Parameters
    ----------
    found : CutResults
        Blocks, life, energy, limits, cost.
    arcs : Stations
        Of its stations.
    stable : Stability or None
        None where no dynamics are known.
    """

    found: CutResults
    arcs: StationArcs
    stable: Stability | None


def assessed(cut: Cut, basis: CutBasis) -> AssessedCut:
    """The cut assessed by what ``basis`` holds; what that lacks stays unknown."""
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    stable = None if basis.dynamics is None else stability(cut, blocks, basis.dynamics)
    life = tool_life(cut, blocks, arcs, basis.material)
    used = None
    if basis.energy is not None and basis.drive is not None:
        used = electricity(cut, blocks, basis.energy, basis.drive)
    found = CutResults(
        cut=cut, blocks=blocks, life=life, energy=used,
        limits=cut_limits(
            cut, blocks, limit_load=basis.limit_load, drive=basis.drive,
            margin=None if stable is None else stable.margin,
        ),
        cost=None if basis.rates is None else cost_of(cut, basis.rates, life, used),
    )  # fmt: skip
    return AssessedCut(found=found, arcs=arcs, stable=stable)


def document_of(cut: Cut, basis: CutBasis) -> dict[str, Any]:
    """The cut as it stands under ``cut`` in the JSON of ``kerf simulate``."""
    of = assessed(cut, basis)
    found, blocks, arcs, stable = of.found, of.found.blocks, of.arcs, of.stable
    rows = block_rows(found)
    return {
        "stock": {
            "text": basis.stock, "work_offset": cut.path.frame.name,
            "resolution_mm": round(cut.blank.cell * 1e3, 6), "notice": cut.blank.notice or None,
        },
        "material": {"name": basis.material.name},
        "currency": None if basis.rates is None else basis.rates.currency,
        "limits": {"load_N": basis.limit_load},
        "dynamics": None if basis.dynamics is None else basis.dynamics.source,
        "dynamics_measured": basis.dynamics is not None and basis.dynamics.measured,
        "feeds": FEEDS,
        "summary": summary(found),
        "by_tool": by_tool(found),
        "worst": _worst(rows),
        "warnings": [
            *cut_warnings(
                cut, blocks, found.limits, basis.limit_load,
                dynamics=basis.dynamics, drive=basis.drive, stock=basis.stock,
            ),
            *_worn(found),
        ],
        "not_known": not_known(of, basis),
        "left_out": [vars(one) for one in cut.path.left_out],
        "basis": _basis(cut, blocks, basis),
        "notes": notes(of, basis),
        "trace": cut_trace(cut, arcs),
        "lobes": [] if stable is None else lobe_figures(cut, stable),
        "drive": None if basis.drive is None else _drive(blocks, rows, basis.drive),
        "blocks": rows,
    }  # fmt: skip


def _worst(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The worst rows, those nearest to what binds them first, each for all that are alike.

    Alike are rows one after the other that have the same tool and limit, all within or all beyond
    it, and other such runs that come as near.  Where no limit is known the load decides.
    """

    def nearness(row: dict[str, Any]) -> tuple[float, float]:
        return (row["used"] or 0.0, row["peak_load_N"] or 0.0)

    def kind(row: dict[str, Any]) -> tuple[Any, ...]:
        return row["tool"], row["binds"], (row["used"] or 0.0) > 1

    runs = [list(run) for _, run in groupby(rows, kind)]
    worst: list[dict[str, Any]] = []
    for row in sorted(
        (max(run, key=nearness) | {"alike": len(run)} for run in runs), key=nearness, reverse=True
    ):
        same = (one for one in worst if kind(one) == kind(row) and _as_near(one, row))
        if (one := next(same, None)) is not None:
            one["alike"] += row["alike"]
        elif len(worst) < WORST:
            worst.append(row)
    return worst


def _as_near(one: dict[str, Any], other: dict[str, Any]) -> bool:
    pairs = [(one[key] or 0.0, other[key] or 0.0) for key in ("used", "peak_load_N")]
    return all(abs(a - b) <= NEAR * max(a, b) for a, b in pairs)


def _worn(found: CutResults) -> list[dict[str, Any]]:
    warnings: list[dict[str, Any]] = []
    for tool in by_tool(found):
        share = tool["tool_life_share"]
        if share is not None and share > 1:
            warnings.append({
                "what": f"T{tool['tool']} wears out {share:.1f} times in one part",
                "do": "Lower its speed, or take a sister tool.", "lines": [], "blocks": None,
                "grave": False,
            })  # fmt: skip
    return warnings


def not_known(of: AssessedCut, basis: CutBasis) -> list[dict[str, str]]:
    """Quantities that are not known of a cut, with the reason of each."""
    found, stable = of.found, of.stable
    cut = found.cut
    names = {tool: f"T{cut.numbers[tool]}" for tool in np.unique(found.blocks.tool).tolist()}
    unknown = found.life.unknown
    stiff = [names[tool] for tool in names if cut.tools[tool].stickout is None]
    reasons: list[tuple[str, bool, str]] = [
        ("share of the spindle’s drive", basis.drive is None,
         "the machine’s file has no section spindle_drive"),
        ("stability", not np.isfinite(found.limits.margin).any(),
         _why_no_margin(found, basis, stable)),
        ("load, torque and power where the spindle stands",
         bool((found.blocks.spindle_speed <= 0).any()),
         "a tool that does not turn cuts no chip"),
        ("deflection", bool(stiff), f"{', '.join(stiff)} without stickout_mm in the tool table"),
        ("cost", basis.rates is None, "conf/cost/ is not composed: add it to conf/config.yaml"),
        ("energy", found.energy is None,
         "the machine’s file lacks section energy or spindle_drive"),
    ]  # fmt: skip
    for why in dict.fromkeys(unknown.values()):
        alike = ", ".join(names[tool] for tool, reason in unknown.items() if reason == why)
        reasons.append((f"tool life of {alike}", True, why))
    return [{"what": what, "why": why} for what, missing, why in reasons if missing]


def _why_no_margin(found: CutResults, basis: CutBasis, stable: Stability | None) -> str:
    if not len(found.blocks):
        return "nothing is cut"
    if basis.dynamics is None:
        return (
            "the machine’s file has no section dynamics for the tools that cut and no --frf was "
            "given"
        )
    if not (found.blocks.spindle_speed > 0).any():
        return "the spindle stands in every cut"
    if stable is not None and np.isposinf(found.limits.margin).any():
        return "the dynamics of the tips give no limit: a response’s band must hold its modes"
    return "no tool that mills has known dynamics"


def _basis(cut: Cut, blocks: CutBlocks, basis: CutBasis) -> list[dict[str, str]]:
    rows = [
        ("blank", basis.stock, f"in mm, in the work coordinates of {cut.path.frame.name}"),
        ("resolution", f"{cut.blank.cell * 1e3:g} mm", ""),
        ("tools", basis.table, ""),
        ("material", basis.material.name, basis.material.source),
    ]
    alike: dict[tuple[str, str], list[str]] = {}
    for tool in np.unique(blocks.tool).tolist():
        law = basis.laws[cut.numbers[tool]]
        source = "; ".join(filter(None, (law.source, law.caution)))
        alike.setdefault((f"{law.kind}: {_law_words(law)}", source), []).append(
            f"T{cut.numbers[tool]}"
        )
    rows += [(f"forces of {', '.join(named)}", *said) for said, named in alike.items()]
    if basis.limit_load is not None:
        rows.append(("limit of the load", f"{basis.limit_load:g} N", "--limit-load"))
    if basis.drive is not None:
        power = f"{basis.drive.rated_power_kW:g} kW from {basis.drive.base_speed_rpm:g} rev/min on"
        rows.append(("spindle’s drive", power, basis.drive_source))
    if basis.dynamics is not None:
        rows.append(("dynamics of the tools’ tips", "stability lobes", basis.dynamics.source))
    return [{"what": what, "value": value, "source": source} for what, value, source in rows]


def _law_words(coefficients: ToolCoefficients) -> str:
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


def notes(of: AssessedCut, basis: CutBasis) -> list[str]:
    """Notes on the numbers of a cut, for its reader."""
    found, cut = of.found, of.found.cut
    cautions = dict.fromkeys(
        basis.laws[cut.numbers[tool]].caution for tool in np.unique(found.blocks.tool).tolist()
    )
    return [
        FEEDS,
        *(f"Forces: {caution}." for caution in cautions if caution),
        *([f"Blank: {cut.blank.notice}."] if cut.blank.notice else []),
        *(f"T{cut.numbers[tool]} {said}." for tool, said in found.life.beyond.items()),
    ]


def _drive(
    blocks: CutBlocks, rows: list[dict[str, Any]], drive: SpindleDrive
) -> dict[str, Any]:  # fmt: skip
    running = blocks.spindle_speed[blocks.spindle_speed > 0]
    fastest = max(float(running.max(initial=0.0)), drive.top_speed_rpm)
    speeds = np.linspace(min(drive.minimum_speed_rpm, 0.5 * fastest), fastest, SPEEDS)
    power = available_power(speeds / 60, drive) * drive.efficiency
    power = (power - no_load_power(speeds / 60, drive)) / 1e3
    keys = ("line", "tool", "speed_rpm", "power_kW", "drive_share")
    points = sorted(rows, key=lambda row: row["power_kW"] or 0.0, reverse=True)
    return {
        "speeds_rpm": np.round(speeds, 1).tolist(),
        "power_kW": [float(f"{p:.4g}") if np.isfinite(p) else None for p in power.tolist()],
        "points": [{key: row[key] for key in keys} for row in points[: WORST * 10]],
    }
