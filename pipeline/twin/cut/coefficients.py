"""Cutting coefficients of each tool of a cut, sharp and worn.

Those of a sharp edge are identified, measured elsewhere, or of a catalogue.  Pressure and friction
on the land of a worn flank add to the edge forces, K_te + k_t VB and K_re + k_r VB (Smithey,
Kapoor, DeVor 2000), with k_t and k_r fitted on one material in milling: on another material they
count only where a wear is given, with a caution; a drill has none.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from pipeline.cutting.economics.material import Material
from pipeline.cutting.force.force_law import N_MM, N_MM2, ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.program_cut import CutWarning, EdgeForces, ToolEdge
from pipeline.schema.si import UM
from pipeline.twin.cut.blocks import StationArcs, cut_blocks
from pipeline.twin.cut.loads import Cut, with_force_laws
from pipeline.twin.cut.tables import KW, figure

CATALOGUE = "catalogue values of k_c1.1 scatter by 20 to 30 %"
NO_LOAD = ("p0", "p1", "p2")
COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
SCALES = np.array([N_MM2] * 3 + [N_MM] * 3)
"""Units in which these are said, over SI: N/mm^2 of cutting, N/mm of edges."""
ALIKE = 0.01
"""Relative difference of diameters up to which tools count as alike [1]."""


@dataclass(frozen=True, kw_only=True)
class WornLand:
    """Edge coefficients added by the land of a worn flank."""

    wear_um: float
    """Width of the land VB [um]."""
    source: str
    caution: str
    """Origin of the land; caution on the figures."""
    K_te: float
    K_re: float
    """Added to the coefficients of the sharp edge [N/m]."""
    half_te: float
    half_re: float
    """Half of their 95 % intervals [N/m]."""


@dataclass(frozen=True, kw_only=True)
class ToolCoefficients:
    """Force law of one tool with its source and a caution."""

    law: ForceLaw
    """Force law that counts."""
    kind: str
    """"identified", "measured" (by others, with another tool) or "catalogue"."""
    source: str
    caution: str = ""
    """Origin of the law; what speaks against it."""
    sharp: ForceLaw | None = None
    """Force law of the sharp edge where ``law`` is that of a worn one."""
    land: WornLand | None = None
    """Land of the worn edge; where ``sharp`` is None that which a sharp tool is compared with."""
    edge: str = "sharp"
    """Whether the edge is sharp or worn, and why."""


@dataclass(frozen=True, kw_only=True)
class IdentifiedCoefficients:
    """Force law of an identified cut, its material and tool; ``open`` coefficients undetermined."""

    law: ForceLaw
    material: str
    tool: Mapping[str, Any]
    open: tuple[str, ...] = ()


def identified_coefficients(model: CuttingModel | None) -> IdentifiedCoefficients | None:
    """Law of an identified cut; None where the tangential coefficient was not determined.

    Another undetermined coefficient has the value of the fit; its interval then holds zero.
    """
    found = {} if model is None else model.coefficients
    values = {
        name: p.value if (p := found.get(name)) is not None and p.determined else None
        for name in COEFFICIENTS
    }
    if model is None or values["K_tc"] is None:
        return None
    fitted = dict(zip(COEFFICIENTS, (fitted_coefficients(model) / SCALES).tolist(), strict=True))
    return IdentifiedCoefficients(
        law=ForceLaw.linear(**{
            name: max(0.0, fitted[name]) if value is None else value
            for name, value in values.items()
        }),
        material=model.material, tool=model.tool,
        open=tuple(name for name, value in values.items() if value is None),
    )  # fmt: skip


def fitted_coefficients(model: CuttingModel | None) -> Floats:
    """The six coefficients of the predicting fit over the recorded cuts, SI; 0 if unknown."""
    if model is None or model.prediction is None:
        return np.zeros(len(COEFFICIENTS))
    taken = model.prediction.line or model.prediction.values[: len(COEFFICIENTS)]
    values = np.array(taken, dtype=np.float64)
    return np.pad(values, (0, len(COEFFICIENTS) - len(values)))


def identified_no_load(model: CuttingModel | None) -> tuple[float, ...] | None:
    """Coefficients of the no-load power P_0(n) of an identified cut [W, W s, W s^2], or None."""
    found = {} if model is None else model.spindle_parameters
    values = [found[name].value if name in found else None for name in NO_LOAD]
    known = [value for value in values if value is not None]
    return tuple(known) if len(known) == len(NO_LOAD) else None


def tool_coefficients(
    tools: Mapping[int, Tool], name: str, material: Material,
    identified: IdentifiedCoefficients | None,
) -> dict[int, ToolCoefficients]:  # fmt: skip
    """Force law of each tool in a material, ``name`` in conf/material/.

    The ``identified`` law of the machine holds for tools of its kind, diameter and flutes in its
    material.
    """
    other = _of_material(material)
    if identified is None or identified.material not in (name, material.name):
        return dict.fromkeys(tools, other)
    caution = (
        f"{', '.join(identified.open)} not determined by the records: as the fit took it"
        if identified.open else ""
    )  # fmt: skip
    own = ToolCoefficients(
        law=identified.law, kind="identified", source="identified on this machine", caution=caution
    )
    return {
        number: own if _is_like(tool, identified.tool) else other for number, tool in tools.items()
    }


def _of_material(material: Material) -> ToolCoefficients:
    if material.coefficients is None:
        return ToolCoefficients(
            law=material.force_law(), kind="catalogue", source=material.force_source,
            caution=CATALOGUE,
        )  # fmt: skip
    return ToolCoefficients(
        law=material.force_law(), kind="measured", source=material.force_source,
        caution="measured elsewhere with another tool",
    )  # fmt: skip


def _is_like(tool: Tool, recorded: Mapping[str, Any]) -> bool:
    diameter = recorded.get("diameter_mm")
    near = not isinstance(diameter, int | float) or (
        abs(diameter - tool.diameter_mm) <= ALIKE * tool.diameter_mm
    )
    return (
        recorded.get("kind", tool.kind) == tool.kind
        and recorded.get("flutes", tool.flutes) == tool.flutes
        and near
    )


WearRule = Literal["known", "criterion", "sharp"]
"""Wear of tools of which none is given: what is known of them, the criterion, or none."""
NOT_RECORDED = "the growth of edge forces with wear was not identified on this machine"


@dataclass(frozen=True, kw_only=True)
class LandGrowth:
    """Growth of the edge coefficients with the width of the land."""

    K_te: float
    K_re: float
    """k_t and k_r [N/m for each m of land]."""
    half_te: float
    half_re: float
    """Half of their 95 % intervals, in the same unit."""
    learnt_um: tuple[float, float]
    """Least and greatest wear that they were fitted on [um]."""
    material: str
    """Material cut, of conf/material/; empty where not stated."""
    basis: str
    """Records that they were fitted on."""

    def land(self, wear_um: float, source: str, caution: str) -> WornLand:
        """Edge coefficients added by a land of that width [um]."""
        width = wear_um * UM
        return WornLand(
            wear_um=wear_um, source=source, caution=caution,
            K_te=self.K_te * width, K_re=self.K_re * width,
            half_te=self.half_te * width, half_re=self.half_re * width,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class KnownWear:
    """Flank wear of a tool in use [um], and where it is from."""

    wear_um: float
    source: str


@dataclass(frozen=True, kw_only=True)
class MachineWear:
    """Wear of a machine's tools by its sub-model."""

    growth: LandGrowth | None = None
    """Growth of the edge forces."""
    reason: str = NOT_RECORDED
    """Reason why there is no growth."""
    criterion_um: float | None = None
    """Flank wear at which a tool is changed [um]."""
    in_use: Mapping[int, KnownWear] = field(default_factory=dict)
    """Tools in the machine, by number."""


@dataclass(frozen=True, kw_only=True)
class ToolWear:
    """Wear that the tools of a cut are taken to have."""

    machine: MachineWear = field(default_factory=MachineWear)
    """Wear data of the machine."""
    rule: WearRule = "known"
    """Rule for tools whose wear is not given."""
    requested: bool = False
    """Whether the rule was requested; else it is the default, and a criterion holds for the
    material alone that the growth was fitted on."""
    given: Mapping[int, float] = field(default_factory=dict)
    """Flank wear by the tool's number [um]."""
    share: float = 1.0
    """Share of the criterion that tools are worn to [1]."""


def worn_coefficients(
    coefficients: Mapping[int, ToolCoefficients], tools: Mapping[int, Tool], wear: ToolWear,
    material: tuple[str, str],
) -> dict[int, ToolCoefficients]:  # fmt: skip
    """Coefficients of sharp tools, by number, with what the land of each adds.

    ``material`` is its name in conf/material/, and its own.  Raises ValueError when a wear is given
    of a tool that is not there or is a drill, beyond what was learnt, or without a known growth.
    """
    for number, value in wear.given.items():
        _check_given(number, value, tools, wear.machine)
    return {
        number: _worn(one, number, tools[number], wear, material)
        for number, one in coefficients.items()
    }


def _check_given(
    number: int, value: float, tools: Mapping[int, Tool], machine: MachineWear
) -> None:
    said = f"--wear T{number}={value:g}"
    if number not in tools:
        known = ", ".join(f"T{one}" for one in sorted(tools))
        raise ValueError(f"{said}: the tool table has no T{number}, it has {known}")
    if value == 0:
        return
    if machine.growth is None:
        raise ValueError(f"{said}: {machine.reason}: leave it out, the tool counts as sharp")
    if tools[number].kind == "drill":
        raise ValueError(
            f"{said}: T{number} is a drill, and the growth of edge forces was fitted on end mills: "
            "leave it out"
        )
    low, high = machine.growth.learnt_um
    if value > high:
        raise ValueError(
            f"{said} um is beyond the {low:g} to {high:g} um that the growth of edge forces was "
            f"fitted on: give at most {high:g}"
        )


def _worn(
    one: ToolCoefficients, number: int, tool: Tool, wear: ToolWear, material: tuple[str, str]
) -> ToolCoefficients:
    machine, growth = wear.machine, wear.machine.growth
    if growth is None:
        return replace(one, edge=f"sharp: {machine.reason}")
    if tool.kind == "drill":
        return replace(one, edge="sharp: the growth of edge forces was fitted on end mills")
    same = growth.material in material
    value, source = _wear_of(number, tool, wear)
    held = wear.rule == "criterion" and number not in wear.given and not wear.requested
    cautions = [] if same else [
        f"the growth of edge forces was fitted in {growth.material or 'a material not named'}, "
        f"not in {material[0]}"
    ]  # fmt: skip
    shown = value or machine.criterion_um or 0.0
    if shown > growth.learnt_um[1]:
        cautions.append(f"its wear is beyond the {growth.learnt_um[1]:g} um that was fitted")
    land = growth.land(shown, source, "; ".join(cautions)) if shown else None
    if value and held and not same:
        return replace(one, land=land, edge=f"sharp: {cautions[0]}; give a wear to count it")
    if land is None or not value:
        return replace(one, land=land, edge=f"sharp: {source}")
    said = f"worn to {value:g} um: {source}"
    return replace(one, law=worn_law(one.law, land), sharp=one.law, land=land, edge=said)


def _wear_of(number: int, tool: Tool, wear: ToolWear) -> tuple[float, str]:
    """Flank wear of a tool [um], 0 for a sharp one, and its source."""
    machine, table = wear.machine, tool.flank_wear_um
    if number in wear.given:
        return wear.given[number], "as given"
    if wear.rule == "sharp":
        return 0.0, "as asked for"
    if wear.rule == "criterion" and machine.criterion_um is not None:
        worn = wear.share * machine.criterion_um
        if table is not None and table > worn:
            return table, f"as in the tool table, where limits hold for {worn:g} um and more"
        if wear.share < 1:
            return worn, f"no F and S keep the limits at the criterion, {machine.criterion_um:g} um"
        return worn, "at the criterion of this machine, when it is changed"
    if table is not None:
        return table, "as in the tool table"
    if number in machine.in_use:
        known = machine.in_use[number]
        return known.wear_um, known.source
    if wear.rule == "criterion":
        return 0.0, "no criterion of wear is known of this machine"
    return 0.0, "nothing is said of its wear"


def worn_law(law: ForceLaw, land: WornLand, halves: float = 0.0) -> ForceLaw:
    """The law with a land; ``halves`` of the interval beside its mean, -1 to 1."""
    return replace(
        law,
        K_te=max(law.K_te + land.K_te + halves * land.half_te, 0.0),
        K_re=law.K_re + land.K_re + halves * land.half_re,
    )


def changed_earlier(wear: ToolWear) -> list[CutWarning]:
    """A warning where limits hold for less wear than the criterion; none elsewhere."""
    criterion = wear.machine.criterion_um
    if wear.share >= 1 or criterion is None:
        return []
    most = wear.share * criterion
    until = f"up to a flank wear of {most:g} um" if most else "with sharp tools"
    return [
        CutWarning(
            what=f"limits are kept {until} only: at the criterion of {criterion:g} um no F and S "
            "keep them",
            do="Change tools by then, raise the limits, or cut less deep.",
        )
    ]


def tool_edges(
    cut: Cut, arcs: StationArcs, coefficients: Mapping[int, ToolCoefficients]
) -> tuple[ToolEdge, ...]:
    """Edges of the tools that cut, with their force sharp and worn, in the order of the program."""
    order = list(dict.fromkeys(cut.tool[cut.tool >= 0].tolist()))
    given = [coefficients[number] for number in cut.numbers]
    forces: dict[int, EdgeForces] = {}
    loaded = [index for index in order if cut.tools[index].load_known]
    if any(given[index].land is not None for index in loaded):
        forces = _forces(cut, arcs, given, loaded)
    return tuple(
        ToolEdge(
            tool=cut.numbers[index], name=cut.tools[index].name,
            wear_um=0.0 if one.sharp is None or one.land is None else one.land.wear_um,
            edge=one.edge, caution="" if one.land is None else one.land.caution,
            forces=forces.get(index),
        )
        for index, one in ((index, given[index]) for index in order)
    )  # fmt: skip


def _forces(
    cut: Cut, arcs: StationArcs, given: list[ToolCoefficients], order: list[int]
) -> dict[int, EdgeForces]:
    """Greatest peak load [N] and power [kW] of each tool: sharp, worn, at the interval's ends."""

    def laws(halves: float | None) -> tuple[ForceLaw, ...]:
        return tuple(
            bare if halves is None or one.land is None else worn_law(bare, one.land, halves)
            for one, bare in ((one, one.sharp or one.law) for one in given)
        )

    found = []
    for halves in (None, 0.0, -1.0, 1.0):
        blocks = cut_blocks(with_force_laws(cut, laws(halves)), arcs)
        turning = blocks.spindle_speed > 0
        rows = [np.flatnonzero(turning & (blocks.tool == index)) for index in order]
        found.append([
            (float(blocks.peak[mine].max(initial=0.0)), float(blocks.power[mine].max(initial=0.0)))
            for mine in rows
        ])  # fmt: skip
    sharp, worn, low, high = found
    return {
        index: EdgeForces(
            wear_um=land.wear_um, peak_load_sharp_N=figure(sharp[k][0]),
            peak_load_N=figure(worn[k][0]), peak_load_low_N=figure(low[k][0]),
            peak_load_high_N=figure(high[k][0]), power_sharp_kW=figure(sharp[k][1] * KW),
            power_kW=figure(worn[k][1] * KW),
        )
        for k, index in enumerate(order) if (land := given[index].land) is not None
    }  # fmt: skip
