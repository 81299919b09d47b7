"""Stage: identify the feed drives from recordings of the servo."""

import json
from pathlib import Path

from pipeline.identification.drive.document import drive_document
from pipeline.identification.drive.identify import identify_drives
from pipeline.identification.drive.records import (
    DriveFitSettings,
    DriveKnown,
    DriveRecords,
    read_recordings,
)
from pipeline.signals.ingest import MachineIdentity


def identify_drive(
    signals: Path,
    model: Path,
    *,
    identity: MachineIdentity,
    drive: DriveKnown,
    drive_records: DriveRecords,
    drive_fit: DriveFitSettings,
) -> None:
    """Read the recordings in ``signals``, write ``model`` (JSON)."""
    recordings = read_recordings(signals, drive_records, drive)
    found = identify_drives(recordings, drive_records, drive, drive_fit)
    model.write_text(json.dumps(drive_document(identity, found), indent=2) + "\n")
