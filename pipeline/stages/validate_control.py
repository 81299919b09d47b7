"""Stage: judge the control on runs that it was not identified from."""

import json
from pathlib import Path

from pipeline.gcode.setup import Setup
from pipeline.identification.control.fit import ControlFitSettings
from pipeline.identification.control.records import (
    ControlRecords,
    observations,
    read_matches,
    read_programs,
)
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.control import read_controls
from pipeline.validation.control import ControlLimits, control_metrics, control_verdict


def validate_control(
    signals: Path,
    raw: Path,
    model: Path,
    judged: Path,
    metrics: Path,
    *,
    identity: MachineIdentity,
    mapping: CleanMachine,
    setup: Setup,
    control_records: ControlRecords,
    control_fit: ControlFitSettings,
    control_limits: ControlLimits,
) -> None:
    """Judge ``model`` on the runs in ``signals``; write verdict and metrics."""
    programs = read_programs(raw, control_records, setup)
    matches = read_matches(signals, control_records, mapping.signals, programs.moves)
    observed = observations(matches, control_records, programs.moves, control_fit.shortest_s)
    document = control_verdict(
        matches, observed, read_controls(model), control_records, identity, control_limits
    )
    judged.write_text(json.dumps(document, indent=2) + "\n")
    metrics.write_text(json.dumps(control_metrics(document), indent=2, sort_keys=True) + "\n")
