"""The verdict as it is stored, with what it was reached on."""

from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.signals.ingest import MachineIdentity
from pipeline.signals.windows import state_days
from pipeline.twin.spindle import TARGET
from pipeline.twin.spindle_model import SpindleModel
from pipeline.validation.golden import changes, read_golden
from pipeline.validation.spindle import SpindleLimits, judge, predictions


def verdict(
    model: SpindleModel,
    clean: Path,
    golden: Path,
    manifest: dict[str, dict[str, Any]],
    identity: MachineIdentity,
    limits: SpindleLimits,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Predictions over the golden week, and the content of ``validation.json``.

    A model is not judged when no week was frozen, and fails when the week's files are no longer
    those that were frozen, are another machine's, or a training day lies in it.
    """
    head: dict[str, Any] = {
        "machine": identity.name,
        "origin": identity.origin,
        "signal": TARGET,
        "unit": "CELSIUS",
        "limits": {"mae_K": limits.mae_K, "rmse_K": limits.rmse_K},
    }
    try:
        frozen = read_golden(golden)
    except ValueError as error:
        nothing: dict[str, Any] = {"days": [], "all": None}
        empty = {"golden": None, "windows": {**nothing, "length_s": limits.window_s}}
        reason = {"free_run": nothing, "verdict": "not judged", "reasons": [str(error)]}
        return pd.DataFrame(), {**head, **empty, **reason}
    week = frozen.week
    head["golden"] = {"from": week.first, "to": week.last, "sha256": frozen.sha256}
    days = state_days(clean, week.first, week.last)
    frame = predictions(model, clean, days, limits)
    document = {**head, **judge(frame, model.step_s, limits)}
    broken = list(changes(frozen, manifest))
    if frozen.machine != identity.name:
        broken.append(f"the golden week is one of {frozen.machine}, not of {identity.name}")
    if week.first <= model.records.training_to and model.records.training_from <= week.last:
        broken.append(
            f"the golden week {week.first} to {week.last} overlaps the training days "
            f"{model.records.training_from} to {model.records.training_to}"
        )
    if broken:
        document |= {"verdict": "failed", "reasons": [*broken, *document["reasons"]]}
    return frame, document


def flat_metrics(document: dict[str, Any]) -> dict[str, float | int | str]:
    """Key figures of a verdict, flat, for ``dvc metrics``."""
    found: dict[str, float | int | str] = {"verdict": document["verdict"]}
    for section in ("windows", "free_run"):
        scores = document[section]["all"] or {}
        for predictor in ("model", "physics", "persistence", "day_mean"):
            for name, value in scores.get(predictor, {}).items():
                if value is not None:
                    found[f"{section}.{predictor}.{name}"] = round(value, 3)
    days = document["windows"]["days"]
    found["windows.days"] = len(days)
    found["windows.days_passed"] = sum(d["passed"] for d in days)
    return found
