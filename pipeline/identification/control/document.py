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

FITTED = "bounded least squares (soft L1) on the durations of blocks in logs of line numbers"
TOLD = "steady speeds in rapids"
NOT_DETERMINED = "not determined by these runs; kept near its value in conf/machine/"


def control_document(
    identity: MachineIdentity, fit: ControlFit, matches: Sequence[Match], files: Sequence[Path]
) -> dict[str, Any]:
    """The content of ``control.json``."""
    fitted = fit.determined & ~fit.told
    return {
        "model": "control",
        "machine": identity.name,
        "origin": identity.origin,
        "parameters": _parameters(fit),
        "control": {
            unit: asdict(control, dict_factory=_without_infinite)
            for unit, control in fit.control.items()
        },
        "runs": {
            "training": [
                {"run": m.run.name, "program": m.program} for m in matches if m.program is not None
            ],
            "left_out": [{"run": m.run.name, "reason": m.reason} for m in matches if m.reason],
        },
        "fit": {
            "rmse_s": _rounded(fit.rmse_s, 4),
            "segments": fit.segments,
            "condition": _rounded(fit.sure.condition, 3),
            "correlation": {
                "names": [one.name for one, f in zip(fit.free, fitted, strict=True) if f],
                "values": np.round(fit.sure.correlation, 3).tolist(),
            },
        },
        "found_from": {path.name: sha256(path.read_bytes()).hexdigest() for path in files},
    }


def _parameters(fit: ControlFit) -> dict[str, dict[str, Any]]:
    found = {}
    for i, one in enumerate(fit.free):
        known = bool(fit.determined[i])
        how = TOLD if fit.told[i] else FITTED
        found[one.name] = {
            "value": _digits(fit.values[i]) if known else None,
            "unit": one.unit,
            "low": _digits(fit.low[i]) if known else None,
            "high": _digits(fit.high[i]) if known else None,
            "determined": known,
            "how": how if known else NOT_DETERMINED,
            "remedy": None if known else one.remedy,
        }
    return found


def _without_infinite(items: list[tuple[str, Any]]) -> dict[str, Any]:
    """What JSON has numbers for: a limit that is infinite is so by default."""
    return {k: v for k, v in items if not (isinstance(v, float) and np.isinf(v))}


def _digits(value: float) -> float | None:
    return float(f"{value:.5g}") if np.isfinite(value) else None


def _rounded(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None
