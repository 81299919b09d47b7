"""Stage: judge the spindle's model on the golden week."""

import json
from pathlib import Path

from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.spindle_model import load_spindle_model
from pipeline.validation.spindle import SpindleLimits
from pipeline.validation.verdict import flat_metrics, verdict


def validate(
    manifest: Path,
    clean: Path,
    network: Path,
    residual: Path,
    golden: Path,
    judged: Path,
    predictions: Path,
    metrics: Path,
    *,
    identity: MachineIdentity,
    spindle_limits: SpindleLimits,
) -> None:
    """Judge ``network`` and ``residual`` on ``clean``; write verdict, predictions and metrics."""
    files = json.loads(manifest.read_text())["files"]
    model = load_spindle_model(network, residual)
    frame, document = verdict(
        model, clean, golden / f"{identity.name}.json", files, identity, spindle_limits
    )
    judged.write_text(json.dumps(document, indent=2) + "\n")
    frame.to_parquet(predictions, compression="zstd")
    metrics.write_text(json.dumps(flat_metrics(document), indent=2, sort_keys=True) + "\n")
