"""Stage: part programs that are faster or cheaper inside their limits."""

from functools import partial
from pathlib import Path

from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.setup import Setup
from pipeline.optimisation.document import (
    optimised_part,
    optimised_text,
    part_metrics,
    write_program,
)
from pipeline.optimisation.job import Supplies, machine_models, part_job, part_program
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import OptimisationSettings, Parts
from pipeline.schema.bundle import MODEL
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import write_json
from pipeline.submodels.wear.machine_wear import machine_wear
from pipeline.twin.control import ControlRecords, control_of_unit, read_controls
from pipeline.twin.cut.wear import ToolWear


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
    """Optimise the parts of a machine with its ``models``; programs and documents, and metrics.

    None where the bundle that serves has no control.
    """
    written.mkdir(parents=True, exist_ok=True)
    if not (models / "control" / MODEL).exists():
        write_json({}, metrics)
        return
    controls = read_controls(models / "control" / MODEL)
    known = machine_models(models, control_of_unit(controls, control_records.default_unit))
    supplies = Supplies(tools=tool, materials=material, rates=cost, cutting_data=catalogue)
    wear = ToolWear(machine=machine_wear(models), rule=optimisation.wear)
    written_parts = {}
    for part in parts.programs:
        program, whose = part_program(raw / part.program, setup)
        workshop = supplies.workshop(part, parts, wear)
        job = partial(part_job, program, part, models=known, setup=whose, settings=optimisation)
        result = optimise_worn(workshop, job)
        document = optimised_part(
            result, machine=identity.name, origin=identity.origin, control="identified"
        )
        write_program(part.label, program.data, optimised_text(result), document, written)
        written_parts[part.label] = document
    write_json(dict(sorted(part_metrics(written_parts).items())), metrics)
