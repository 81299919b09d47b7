"""What is stored of an identified cut: numbers, intervals, and where they are from."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.choice import Fold
from pipeline.identification.cutting.conditions import MM
from pipeline.identification.cutting.identify import CutFound, rms_error_percent
from pipeline.identification.cutting.known import DIRECTIONS, CuttingKnown
from pipeline.identification.cutting.model import model_of, plain_model, stored
from pipeline.identification.cutting.parameters import Parameter, modes, parameters
from pipeline.identification.cutting.records import CuttingRecording
from pipeline.identification.cutting.remainder import ALIKE, BEYOND, SPEED
from pipeline.identification.cutting.settings import CuttingFitSettings
from pipeline.signals.ingest import MachineIdentity

Floats = NDArray[np.float64]


def cutting_document(
    identity: MachineIdentity,
    known: CuttingKnown,
    found: CutFound,
    settings: CuttingFitSettings,
    spindle: Mapping[str, Any],
) -> dict[str, Any]:
    """The content of ``cutting.json``.

    Parameters
    ----------
    identity : MachineIdentity
        Of the machine.
    known : CuttingKnown
        The tool, and how the dynamometer stands.
    found : CutFound
        What the recordings said.
    settings : CuttingFitSettings
        How it was found.
    spindle : mapping
        What the spindle's load said; empty without records of it.
    """
    return {
        "model": "cutting",
        "machine": identity.name,
        "origin": identity.origin,
        "method": settings.method,
        "reason": found.reason,
        "tool": asdict(known.tool),
        "material": known.material,
        **_fitted(known, found, settings.widest),
        "methods": [dict(one) for one in found.methods],
        "recordings": [recording_row(one) for one in found.recordings],
        "found_from": {one.name: one.sha256 for one in found.learnt},
        "spindle": dict(spindle),
    }


def _fitted(known: CuttingKnown, found: CutFound, widest: float) -> dict[str, Any]:
    """What the fit says; the same keys without one."""
    fit, sure, best, model = found.fit, found.certain, found.chosen, found.model
    if fit is None or sure is None or best is None or model is None:
        empty: dict[str, Any] = {"names": [], "matrix": []}
        return {
            "parameters": {}, "mean_force": {}, "correlation": empty, "fit": None,
            "measuring_chain": {}, "terms": [], "remainder": None, "prediction": None,
            "plain": None, "folds": [],
        }  # fmt: skip
    names = [one.name for one in found.learnt]
    linear = parameters(fit, sure, widest, found.mean_force)
    return {
        "parameters": _told(linear) | kienzle(found, widest),
        "mean_force": _told(found.mean_force),
        "correlation": _correlation(sure.names, sure.covariance),
        "fit": {
            "rms_error_percent": _digits(rms_error_percent(fit)),
            "samples": len(fit.solved.residuals) - fit.problem.linear,
            "revolutions": sum(one.cut[1].count for one in found.learnt),
            "condition": _digits(sure.condition),
            "left_out_N": [_digits(v) for v in np.sqrt(fit.problem.left_out)],
            "zero_N": _digits(float(np.sqrt(fit.problem.zero))),
        },
        "measuring_chain": {
            _channel(known, k): {one.name: _parameter(one) for one in rows}
            for k, rows in modes(fit, sure, widest).items()
        },
        "terms": [dict(one) for one in best.tried],
        "remainder": _remainder(found),
        "prediction": stored(model),
        "plain": stored(plain_model(known.tool, np.array(found.mean_values))),
        "folds": [_fold(one, names, best.over) for one in best.folds],
    }  # fmt: skip


def _fold(fold: Fold, names: Sequence[str], over: bool) -> dict[str, Any]:
    return {
        "left_out": [names[k] for k in fold.left_out],
        "from": [name for k, name in enumerate(names) if k not in fold.left_out],
        "prediction": stored(model_of(fold.fit, over=over)),
    }


def _remainder(found: CutFound) -> dict[str, Any] | None:
    """What is said of what mechanics leave over; None where it is not part of the model."""
    model = found.model
    if model is None or not model.remainders:
        return None
    return {
        "what": "what mechanics leave over, by the angle of the spindle; affine in the feed",
        "conditions": [
            {
                "speed_rpm": _digits(60 * one.conditions.speed),
                "axial_depth_mm": _digits(one.conditions.a_p / MM),
                "entry_deg": _digits(float(np.degrees(one.conditions.phi_st))),
                "exit_deg": _digits(float(np.degrees(one.conditions.phi_ex))),
                "feeds_per_tooth_mm": [_digits(f / MM) for f in one.feeds],
                "holds_for_mm": [
                    _digits(min(one.feeds) / BEYOND / MM), _digits(max(one.feeds) * BEYOND / MM)
                ],
            }
            for one in model.remainders
        ],
        "tolerance": {"speed": SPEED, "axial_depth": ALIKE, "angles_rad": ALIKE},
    }  # fmt: skip


def kienzle(found: CutFound, widest: float) -> dict[str, Any]:
    """Kienzle's constants from the mean tangential forces of three feeds or more."""
    from pipeline.identification.cutting.kienzle import (
        NAMES,
        kienzle_by_force,
        kienzle_document,
    )
    from pipeline.identification.cutting.tangential import mean_tangential

    each = [one.conditions for one in found.cuts]
    force, share = mean_tangential(found.cuts)
    try:
        law = kienzle_by_force(
            force, flutes=[c.flutes for c in each], f_z=[c.f_z for c in each],
            a_p=[c.a_p for c in each], phi_st=[c.phi_st for c in each],
            phi_ex=[c.phi_ex for c in each], known=share,
        )  # fmt: skip
    except ValueError as error:
        nothing = {
            "value": None, "interval_95": None, "determined": False, "reason": str(error),
            "how": "mean tangential forces over the feed",
        }  # fmt: skip
        units = zip(NAMES, ("N/mm^2", "1"), strict=True)
        return {name: {**nothing, "unit": unit} for name, unit in units}
    return kienzle_document(law, widest)


def recording_row(one: CuttingRecording) -> dict[str, Any]:
    """What is said of a recording."""
    row: dict[str, Any] = {
        "recording": one.name, "sha256": one.sha256, "role": one.role, "reason": one.reason,
        "notes": list(one.notes),
    }  # fmt: skip
    return row | conditions_row(one)


def conditions_row(one: CuttingRecording) -> dict[str, Any]:
    """Conditions of a recording in the units of their names, None where they are not known."""
    c, revolution = one.conditions, one.revolution
    speed = None if c is None else c.speed if revolution is None else revolution.speed
    return {
        "speed_rpm": None if speed is None else round(60 * speed, 2),
        "feed_mm_min": None if c is None else _digits(c.feed / MM * 60),
        "feed_per_tooth_mm": None if c is None else _digits(c.f_z / MM),
        "axial_depth_mm": None if c is None else _digits(c.a_p / MM),
        "entry_deg": None if c is None else _digits(float(np.degrees(c.phi_st))),
        "exit_deg": None if c is None else _digits(float(np.degrees(c.phi_ex))),
        "revolutions": 0 if revolution is None else revolution.count,
    }


def _channel(known: CuttingKnown, direction: int) -> str:
    """Letter of the channel that shows a direction."""
    name: str = getattr(known.dynamometer, DIRECTIONS[direction])
    return name.removeprefix("-")


def _told(found: Sequence[Parameter]) -> dict[str, dict[str, Any]]:
    return {one.name: _parameter(one) for one in found}


def _parameter(one: Parameter) -> dict[str, Any]:
    low, high = max(one.value - one.half_width, one.lowest), one.value + one.half_width
    told = one.determined and isfinite(one.value) and isfinite(one.half_width)
    return {
        "value": _digits(one.value) if told else None,
        "unit": one.unit,
        "interval_95": [_digits(low), _digits(high)] if told else None,
        "determined": bool(told),
        "reason": one.reason,
        "how": one.how,
    }


def _correlation(names: Sequence[str], covariance: Floats) -> dict[str, Any]:
    shown = [k for k, name in enumerate(names) if not name.startswith("phase")]
    deviation = np.sqrt(np.diag(covariance))
    share = covariance / np.outer(deviation, deviation)
    return {
        "names": [names[k] for k in shown],
        "matrix": np.round(share[np.ix_(shown, shown)], 3).tolist(),
    }


def _digits(value: float) -> float:
    return float(f"{value:.5g}")
