"""Stage: plans of the report's programs by the identified control."""

from pathlib import Path

from pipeline.gcode.setup import Setup
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import read_json
from pipeline.submodels.contract import submodel
from pipeline.twin.control import ControlModelFile, ControlRecords, control_of_unit
from pipeline.twin.simulation import simulate_files


def simulate_programs(
    raw: Path,
    model: Path,
    programs: Path,
    *,
    identity: MachineIdentity,
    setup: Setup,
    control_records: ControlRecords,
) -> None:
    """Simulate programs of ``raw`` with the control in ``model``; a JSON and a Parquet each."""
    programs.mkdir(parents=True, exist_ok=True)
    if not model.exists():
        return
    stored = read_json(model, ControlModelFile)
    control = control_of_unit(stored.control, control_records.default_unit)
    files = control_records.shown(raw)
    unknown = submodel("control").unknown_columns(model.parent)
    simulate_files(
        files,
        raw,
        control,
        setup,
        programs,
        machine=identity.name,
        origin=identity.origin,
        intervals={} if unknown else stored.intervals,
        learnt=stored.conditions,
        ends=stored.ends.get(control_records.default_unit, ()),
    )
