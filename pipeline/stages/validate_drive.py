"""Stage: judge the feed drives on recordings that they were not identified from."""

import json
from pathlib import Path

import pyarrow.parquet as pq

from pipeline.identification.drive.records import (
    DriveFitSettings,
    DriveKnown,
    DriveRecords,
    read_recordings,
)
from pipeline.signals.ingest import MachineIdentity
from pipeline.validation.drive import DriveLimits, drive_metrics, drive_verdict


def validate_drive(
    signals: Path,
    model: Path,
    judged: Path,
    traces: Path,
    metrics: Path,
    *,
    identity: MachineIdentity,
    drive: DriveKnown,
    drive_records: DriveRecords,
    drive_fit: DriveFitSettings,
    drive_limits: DriveLimits,
) -> None:
    """Judge ``model`` on the recordings in ``signals``; write verdict, traces and metrics."""
    recordings = read_recordings(signals, drive_records, drive)
    found = json.loads(model.read_text())
    document, shown = drive_verdict(found, recordings, identity, drive_fit, drive_limits)
    judged.write_text(json.dumps(document, indent=2) + "\n")
    pq.write_table(shown, traces, compression="zstd")
    metrics.write_text(json.dumps(drive_metrics(document), indent=2, sort_keys=True) + "\n")
