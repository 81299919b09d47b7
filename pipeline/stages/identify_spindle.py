"""Stage: identify the spindle's thermal network from the training week."""

import json
from pathlib import Path

from pipeline.identification.spindle import SpindleFitSettings, identify_spindle_network
from pipeline.identification.spindle_document import spindle_document, training_stretches
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.spindle import SpindleRecords


def identify_spindle(
    clean: Path,
    model: Path,
    *,
    identity: MachineIdentity,
    spindle: SpindleRecords,
    spindle_fit: SpindleFitSettings,
) -> None:
    """Read ``clean``, write ``model`` (JSON)."""
    pieces, files = training_stretches(clean, spindle, spindle_fit)
    fit, scores = identify_spindle_network(pieces, spindle, spindle_fit)
    document = spindle_document(identity, spindle, spindle_fit, fit, scores, pieces, files)
    model.write_text(json.dumps(document, indent=2) + "\n")
