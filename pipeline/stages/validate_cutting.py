"""Stage: judge a cut's force model on recordings that it was not identified from."""

import json
from pathlib import Path

import pyarrow.parquet as pq

from pipeline.identification.cutting.records import (
    CuttingFitSettings,
    CuttingKnown,
    CuttingRecords,
    read_recordings,
)
from pipeline.signals.ingest import MachineIdentity
from pipeline.validation.cutting import CuttingLimits, cutting_metrics, cutting_verdict


def validate_cutting(
    signals: Path,
    model: Path,
    judged: Path,
    traces: Path,
    metrics: Path,
    *,
    identity: MachineIdentity,
    cutting: CuttingKnown,
    cutting_records: CuttingRecords,
    cutting_fit: CuttingFitSettings,
    cutting_limits: CuttingLimits,
) -> None:
    """Judge ``model`` on the recordings in ``signals``; write verdict, traces and metrics."""
    recordings = read_recordings(signals, cutting_records, cutting, cutting_fit)
    found = json.loads(model.read_text())
    document, shown = cutting_verdict(
        found, recordings, identity, cutting, cutting_fit, cutting_limits
    )
    judged.write_text(json.dumps(document, indent=2) + "\n")
    pq.write_table(shown, traces, compression="zstd")
    metrics.write_text(json.dumps(cutting_metrics(document), indent=2, sort_keys=True) + "\n")
