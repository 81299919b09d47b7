"""Cutting coefficients of each tool of a cut: identified, measured elsewhere, or of a catalogue."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.cutting.economics.material import Material
from pipeline.cutting.force.force_law import N_MM, N_MM2, ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CuttingModel

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
    tools: Mapping[int, Tool],
    name: str,
    material: Material,
    identified: IdentifiedCoefficients | None,
) -> dict[int, ToolCoefficients]:
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
