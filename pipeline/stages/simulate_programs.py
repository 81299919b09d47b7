"""Stage: what the control makes of the programs that the report shows."""

from pathlib import Path

from pipeline.gcode.setup import Setup
from pipeline.schema.identity import MachineIdentity
from pipeline.twin.control import ControlRecords, control_of_unit, read_controls
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
    control = control_of_unit(read_controls(model), control_records.default_unit)
    files = control_records.shown(raw)
    simulate_files(
        files, raw, control, setup, programs, machine=identity.name, origin=identity.origin
    )
