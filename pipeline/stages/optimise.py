"""Stage: part programs that are faster or cheaper inside their limits."""

import json
import re
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
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.wear.due import IN_USE, READ, READ_AT, TIME
from pipeline.submodels.wear.edge_growth import NAMES, PASCAL, EdgeGrowth
from pipeline.submodels.wear.model import WearModel
from pipeline.twin.control import ControlRecords, control_of_unit, read_controls
from pipeline.twin.cut_wear import NOT_RECORDED, KnownWear, LandGrowth, MachineWear, ToolWear

NUMBER = re.compile(r"T?(\d+)", re.IGNORECASE)
"""Name of a tool that is its number."""


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
    """Optimise the parts of a machine with its ``models``; programs and documents, and metrics."""
    controls = read_controls(models / "control/model.json")
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
    metrics.write_text(json.dumps(part_metrics(written_parts), indent=2, sort_keys=True) + "\n")


def machine_wear(models: Path) -> MachineWear:
    """Growth of the forces with wear, the criterion and the wear of tools in use of a machine.

    Parameters
    ----------
    models : Path
        ``data/champion/<machine>``.

    Raises
    ------
    StoreError
        When a file is broken or of another form.
    """
    folder = models / "wear"
    if not (folder / "model.json").exists():
        return MachineWear()
    lasting = read_json(folder / "model.json", WearModel).lasting
    growth, reason = _growth(lasting.edges)
    return MachineWear(
        growth=growth,
        reason=reason if lasting.edges is not None or not lasting.reasons else lasting.reasons[-1],
        criterion_um=None if lasting.life is None else lasting.life.criterion_um,
        in_use=_in_use(folder / "verdict.json"),
    )


def _growth(edges: EdgeGrowth | None) -> tuple[LandGrowth | None, str]:
    """The growth in SI, or why there is none."""
    if edges is None:
        return None, NOT_RECORDED
    found = []
    for name in NAMES:
        one = edges.parameters[name]
        if one.value is None or one.interval_95 is None:
            return None, f"{NOT_RECORDED}: {one.method}"
        low, high = one.interval_95
        found.append((one.value * PASCAL, 0.5 * (high - low) * PASCAL))
    (K_te, half_te), (K_re, half_re) = found
    return LandGrowth(
        K_te=K_te, K_re=K_re, half_te=half_te, half_re=half_re, learnt_um=edges.wear_um,
        material=edges.material, basis=f"{edges.recordings} cuts with {edges.tools} tools",
    ), ""  # fmt: skip


def _in_use(path: Path) -> dict[int, KnownWear]:
    """Last reading of the flank wear of each tool in use, by its number."""
    if not path.exists():
        return {}
    found = {}
    for case in read_json(path, Verdict).cases:
        number, read = NUMBER.fullmatch(case.case), case.facts.get(READ)
        if IN_USE not in case.facts or number is None or read is None:
            continue
        at, now = (
            case.facts[name].value if name in case.facts else None for name in (READ_AT, TIME)
        )
        if isinstance(read.value, int | float):
            found[int(number[1])] = KnownWear(
                wear_um=float(read.value),
                source=f"as last read, at {at} of its {now} min in the cut until now",
            )
    return found
