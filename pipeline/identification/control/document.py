"""What is stored of an identified control: numbers, intervals, and what they were found from."""

from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.identification.control.fit import ControlFit
from pipeline.identification.control.programs import Match
from pipeline.signals.ingest import MachineIdentity

HOW = "bounded least squares (soft L1) on the durations of blocks in logs of line numbers"


def control_document(
    identity: MachineIdentity, fit: ControlFit, matches: Sequence[Match], files: Sequence[Path]
) -> dict[str, Any]:
    """The content of ``control.json``."""
    names = [f.name for f, d in zip(fit.free, fit.determined, strict=True) if d]
    return {
        "model": "control",
        "machine": identity.name,
        "origin": identity.origin,
        "parameters": _parameters(fit),
        "control": {unit: asdict(control) for unit, control in fit.control.items()},
        "runs": {
            "training": [
                {"run": m.run.name, "program": m.program} for m in matches if m.program is not None
            ],
            "left_out": [{"run": m.run.name, "reason": m.reason} for m in matches if m.reason],
        },
        "fit": {
            "rmse_s": round(fit.rmse_s, 4),
            "segments": fit.segments,
            "condition": _finite(fit.sure.condition),
            "correlation": {"names": names, "values": np.round(fit.sure.correlation, 3).tolist()},
        },
        "found_from": {path.name: sha256(path.read_bytes()).hexdigest() for path in files},
    }


def _parameters(fit: ControlFit) -> dict[str, dict[str, Any]]:
    found = {}
    for i, one in enumerate(fit.free):
        known = bool(fit.determined[i])
        found[one.name] = {
            "value": _digits(fit.values[i]) if known else None,
            "unit": one.unit,
            "low": _digits(fit.low[i]) if known else None,
            "high": _digits(fit.high[i]) if known else None,
            "determined": known,
            "how": HOW if known else "not determined by these runs; as in conf/machine/",
            "remedy": None if known else one.remedy,
        }
    return found


def _digits(value: float) -> float | None:
    return float(f"{value:.5g}") if np.isfinite(value) else None


def _finite(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
