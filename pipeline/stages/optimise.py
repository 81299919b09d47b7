"""Stage: part programs that are faster or cheaper inside their limits."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.setup import Setup
from pipeline.optimisation.document import (
    optimised_part,
    optimised_text,
    part_metrics,
    write_program,
)
from pipeline.optimisation.job import JobRequest, Workshop, machine_models, part_program
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import OptimisationSettings, Parts
from pipeline.schema.bundle import MODEL
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import write_json
from pipeline.submodels.wear.machine_wear import machine_wear
from pipeline.twin.control import ControlRecords, control_of_unit, read_controls
from pipeline.twin.cut.coefficients import ToolWear

T = TypeVar("T")


def optimise(
    raw: Path,
    models: Path,
    written: Path,
    metrics: Path,
    *,
    identity: MachineIdentity,
    setup: Setup,
    control_records: ControlRecords,
    parts: Parts,
    tool: dict[str, ToolTable],
    material: dict[str, Material],
    cost: CostRates,
    catalogue: CuttingCatalogue,
    optimisation: OptimisationSettings,
) -> None:
    """Optimise the parts of a machine with its ``models``; programs, documents and metrics."""
    written.mkdir(parents=True, exist_ok=True)
    if not (models / "control" / MODEL).exists():
        write_json({}, metrics)
        return
    controls = read_controls(models / "control" / MODEL)
    known = machine_models(models, control_of_unit(controls, control_records.default_unit))
    wear = ToolWear(machine=machine_wear(models), rule=optimisation.wear)
    dynamics = None if parts.dynamics is None else TipDynamics.of_modes(parts.dynamics)
    written_parts = {}
    for part in parts.programs:
        program, beside = part_program(raw / part.program, setup)
        workshop = Workshop(
            table=named(tool, part.tool_table, "tool"),
            material=named(material, part.material, "material"),
            rates=cost, drive=parts.drive, drive_source="section parts of the machine",
            energy=parts.energy, dynamics=dynamics, catalogue=catalogue, wear=wear,
        )  # fmt: skip
        request = JobRequest(
            program=program, part=part, models=known, setup=beside, settings=optimisation
        )
        result = optimise_worn(request, workshop)
        document = optimised_part(
            result, machine=identity.name, origin=identity.origin, control="identified"
        )
        write_program(part.label, program.data, optimised_text(result), document, written)
        written_parts[part.label] = document
    write_json(dict(sorted(part_metrics(written_parts).items())), metrics)


def named(known: Mapping[str, T], name: str, folder: str) -> T:
    """The tool table or the material that a part names."""
    if name not in known:
        there = ", ".join(sorted(known)) or "none"
        raise ValueError(f"parts name {name!r}, which conf/{folder}/ does not have: it has {there}")
    return known[name]
