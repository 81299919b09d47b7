"""Stage: part programs that are faster or cheaper inside their limits."""

import json
from pathlib import Path

from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.setup import Setup
from pipeline.optimisation.document import optimised_document, optimised_text
from pipeline.optimisation.optimise import optimise as optimised
from pipeline.optimisation.part import Parts
from pipeline.optimisation.part_files import part_metrics, write_part
from pipeline.optimisation.part_job import Catalogue, machine_models, part_job
from pipeline.optimisation.settings import OptimisationSettings
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.control import ControlRecords


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
    optimisation: OptimisationSettings,
) -> None:
    """Optimise the parts of a machine with its ``models``; programs and documents, and metrics."""
    known = machine_models(models, control_records.default_unit)
    catalogue = Catalogue(tools=tool, materials=material, rates=cost)
    documents = {}
    for part in parts.programs:
        path = raw / part.program
        result = optimised(part_job(path, part, parts, known, catalogue, setup, optimisation))
        document = optimised_document(
            result, machine=identity.name, origin=identity.origin, control="identified"
        )
        write_part(part.label, path.read_bytes(), optimised_text(result), document, written)
        documents[part.label] = document
    metrics.write_text(json.dumps(part_metrics(documents), indent=2, sort_keys=True) + "\n")
