"""Stage: identify the control from logs of line numbers and the programs that ran."""

import json
from pathlib import Path

from pipeline.gcode.setup import Setup
from pipeline.identification.control.document import control_document
from pipeline.identification.control.fit import ControlFitSettings
from pipeline.identification.control.fit import identify_control as fit_control
from pipeline.identification.control.records import (
    ControlRecords,
    observations,
    read_matches,
    read_programs,
)
from pipeline.machine.control import ControlParameters
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.ingest import MachineIdentity


def identify_control(
    signals: Path,
    raw: Path,
    model: Path,
    *,
    identity: MachineIdentity,
    mapping: CleanMachine,
    control: ControlParameters,
    setup: Setup,
    control_records: ControlRecords,
    control_fit: ControlFitSettings,
) -> None:
    """Read the runs in ``signals`` and the programs in ``raw``, write ``model`` (JSON)."""
    programs = read_programs(raw, control_records, setup)
    matches = read_matches(signals, control_records, mapping.signals, programs.moves)
    training = [m for m in matches if control_records.is_training(m.run.recording)]
    observed = observations(training, control_records, programs.moves, control_fit.shortest_s)
    fit = fit_control([one for _, one in observed], control, control_fit)
    files = [raw / m.run.recording for m in training]
    document = control_document(identity, fit, training, sorted(set(files)))
    model.write_text(json.dumps(document, indent=2) + "\n")
