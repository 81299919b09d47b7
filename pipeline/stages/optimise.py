"""Stage: part programs that are faster or cheaper inside their limits."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.setup import Setup
from pipeline.optimisation.document import (
    optimised_part,
    optimised_text,
    part_metrics,
    write_as_written,
    write_program,
)
from pipeline.optimisation.job import Workshop, job_request, machine_models
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import OptimisationSettings, Parts
from pipeline.schema.bundle import MODEL
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import write_json
from pipeline.submodels.wear.machine_wear import machine_wear
from pipeline.twin.control import ControlRecords, control_of_unit, read_controls

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
    control = control_of_unit(controls, control_records.default_unit)
    known = machine_models(models, control, machine_wear(models))
    written_parts = {}
    for part in parts.programs:
        workshop = Workshop(
            table=named(tool, part.tool_table, "tool"),
            material=named(material, part.material, "material"),
            rates=cost, drive=parts.drive, drive_source="section parts of the machine",
            energy=parts.energy, dynamics=parts.dynamics, catalogue=catalogue,
        )  # fmt: skip
        result = optimise_worn(
            job_request(
                raw / part.program, part, workshop, known, setup=setup, settings=optimisation
            )
        )
        document = optimised_part(
            result, machine=identity.name, origin=identity.origin, control="identified"
        )
        program = result.job.program.data
        write_program(part.label, program, optimised_text(result), document, written)
        write_as_written(part, result, document, written)
        written_parts[part.label] = document
    write_json(dict(sorted(part_metrics(written_parts).items())), metrics)


def named(known: Mapping[str, T], name: str, folder: str) -> T:
    """The tool table or the material that a part names."""
    if name not in known:
        there = ", ".join(sorted(known)) or "none"
        raise ValueError(f"conf/{folder}/ does not have {name!r}, which is named: it has {there}")
    return known[name]
