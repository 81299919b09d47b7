"""Stage: identify a cut from recordings of a dynamometer, and of the load that a spindle shows."""

import json
from pathlib import Path

from pipeline.identification.cutting.document import cutting_document
from pipeline.identification.cutting.identify import identify_cut
from pipeline.identification.cutting.records import (
    CuttingFitSettings,
    CuttingKnown,
    CuttingRecords,
    read_recordings,
)
from pipeline.identification.cutting.spindle_load import spindle_load
from pipeline.signals.ingest import MachineIdentity


def identify_cutting(
    signals: Path,
    raw: Path,
    model: Path,
    *,
    identity: MachineIdentity,
    cutting: CuttingKnown,
    cutting_records: CuttingRecords,
    cutting_fit: CuttingFitSettings,
) -> None:
    """Read the recordings in ``signals`` and the programs in ``raw``, write ``model`` (JSON)."""
    recordings = read_recordings(signals, cutting_records, cutting, cutting_fit)
    found = identify_cut(recordings, cutting, cutting_fit)
    spindle = spindle_load(signals, raw, cutting_records.spindle, cutting_fit.widest)
    document = cutting_document(identity, cutting, found, cutting_fit, spindle)
    model.write_text(json.dumps(document, indent=2) + "\n")
