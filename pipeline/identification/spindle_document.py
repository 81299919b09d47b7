"""What is stored of an identified spindle: numbers, intervals, and what they were found from."""

from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.identification.spindle import SpindleFit, SpindleFitSettings, is_determined
from pipeline.signals.ingest import MachineIdentity
from pipeline.signals.windows import Stretch, state_days
from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import SpindleRecords, spindle_stretches
from pipeline.twin.spindle_model import network_document

HOW = "bounded least squares (soft L1) on free runs over the training days"

REMEDY = {
    "bearing_friction": "record the spindle turning free at several speeds, 20 minutes each",
    "load_speed": "record cuts at several loads and speeds of some minutes each",
    "copper": "record heavy cuts of some minutes, or the motor's current",
    "windage": "record the spindle near its highest speed, 20 minutes",
    "position_hold": "record the spindle held in position (C axis) for 20 minutes",
}


def training_stretches(
    clean: Path, records: SpindleRecords, settings: SpindleFitSettings
) -> tuple[list[Stretch], list[Path]]:
    """Stretches of the training days in ``clean``, and the files they come from."""
    days = state_days(clean, records.training_from, records.training_to)
    pieces = [
        piece
        for day in days
        for piece in spindle_stretches(
            clean,
            day,
            records,
            step=settings.step_s,
            bridge_s=settings.bridge_s,
            shortest_s=settings.shortest_s,
        )
    ]
    return pieces, [clean / "state" / f"{day}.parquet" for day in sorted({p.day for p in pieces})]


def spindle_document(
    identity: MachineIdentity,
    records: SpindleRecords,
    settings: SpindleFitSettings,
    fit: SpindleFit,
    scores: dict[int, float],
    pieces: Sequence[Stretch],
    files: Sequence[Path],
) -> dict[str, Any]:
    """The content of ``spindle_thermal.json``."""
    return {
        "model": "spindle_thermal_network",
        "machine": identity.name,
        "origin": identity.origin,
        "network": network_document(fit.parameters),
        "records": asdict(records),
        "parameters": {**_found(fit), **_left_out(fit, records)},
        "fit": {
            "step_s": settings.step_s,
            "nodes": fit.parameters.nodes,
            "rmse_K": round(fit.rmse_K, 4),
            "rmse_days_left_out_K": {str(n): round(s, 4) for n, s in scores.items()},
            "condition": round(fit.sure.condition, 3) if np.isfinite(fit.sure.condition) else None,
            "correlation": {
                "names": list(fit.names),
                "values": np.round(fit.sure.correlation, 3).tolist(),
            },
            "evaluations": fit.evaluations,
            "seconds": round(sum(len(p.frame) * p.step for p in pieces)),
            "bridged_s": round(sum(p.bridged * p.step for p in pieces)),
        },
        "training_days": sorted({p.day for p in pieces}),
        "found_from": [
            {"file": f"{f.parent.name}/{f.name}", "sha256": sha256(f.read_bytes()).hexdigest()}
            for f in files
        ],
    }


def _found(fit: SpindleFit) -> dict[str, Any]:
    """Each fitted parameter with its unit and 95 % interval."""
    logs = {"cooling_rate", "coupling_rate", "body_cooling_rate", "capacity_ratio"}
    units = {"capacity_ratio": "1", "ambient": "CELSIUS", "ambient_offset": "K"}
    found = {}
    for i, name in enumerate(fit.names):
        value, width = float(fit.values[i]), min(float(fit.sure.half_width[i]), 50.0)
        if name in logs:
            low, high, value = np.exp([value - width, value + width, value]).tolist()
        elif name in SOURCES:
            scale = fit.parameters.heating[name] / value
            low, high, value = (value - width) * scale, (value + width) * scale, value * scale
        else:
            low, high = value - width, value + width
        entry: dict[str, Any] = {"unit": SOURCES.get(name, units.get(name, "1/s")), "how": HOW}
        if is_determined(fit, name):
            interval = [float(f"{low:.4g}"), float(f"{high:.4g}")]
            entry |= {"value": float(f"{value:.5g}"), "interval_95": interval, "determined": True}
        else:
            why = (
                "at a bound or with a 95 % interval wider than the model bears, "
                f"{low:.2g} to {high:.2g}"
            )
            entry |= {"value": None, "interval_95": None, "determined": False, "how": why}
        found[name] = entry
    return found


def _left_out(fit: SpindleFit, records: SpindleRecords) -> dict[str, Any]:
    """The sources that the records do not determine, with what to record."""
    return {
        name: {
            "value": None,
            "unit": SOURCES[name],
            "interval_95": None,
            "determined": False,
            "how": f"{why}; {REMEDY[name]}",
        }
        for name, why in fit.left_out.items()
        if name in records.sources
    }
