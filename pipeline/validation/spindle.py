"""The verdict on a spindle's model: one-hour windows and free runs over the golden week."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.signals.windows import Stretch
from pipeline.twin.spindle import TARGET, spindle_stretches
from pipeline.twin.spindle_model import SpindleModel
from pipeline.validation.metrics import Floats, errors

PREDICTORS = ("model", "physics", "persistence", "day_mean")


@dataclass(frozen=True, kw_only=True)
class SpindleLimits:
    """What the golden week asks of a spindle's model (Twin2026).

    Parameters
    ----------
    window_s : float
        Length of the windows that start from a measured temperature [s].
    mae_K, rmse_K : float
        Limits on every working day, in windows.
    working_day_s : float
        A day is a working day when this much of it is known [s].
    bridge_s : float
        In windows, unknown inputs are held this long [s].
    """

    window_s: float = 3600.0
    mae_K: float = 2.0
    rmse_K: float = 3.0
    working_day_s: float = 3600.0
    bridge_s: float = 600.0

    def __post_init__(self) -> None:
        for name in ("window_s", "mae_K", "rmse_K", "working_day_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"spindle_limits.{name} = {getattr(self, name)} must be positive")


def predictions(
    model: SpindleModel, clean: Path, days: Sequence[str], limits: SpindleLimits
) -> pd.DataFrame:
    """Measured and predicted temperatures of each working day, one row a step.

    Columns: ``time``, ``day``, ``measured``, ``model_window``, ``physics_window``,
    ``persistence_window``, ``model_free``, ``physics_free`` and ``day_mean`` [CELSIUS].
    """
    frames = [f for day in days if (f := _day(model, clean, day, limits)) is not None]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def _day(model: SpindleModel, clean: Path, day: str, limits: SpindleLimits) -> pd.DataFrame | None:
    def cut(bridge_s: float, shortest_s: float) -> list[Stretch]:
        return list(
            spindle_stretches(
                clean, day, model.records, step=model.step_s, bridge_s=bridge_s,
                shortest_s=shortest_s,
            )
        )  # fmt: skip

    whole = cut(np.inf, 0.0)
    known = sum((len(s.frame) - s.bridged) * s.step for s in whole)
    if not whole or known < limits.working_day_s:
        return None
    free = whole[0]
    physics, corrected = model.free_run(free)
    frame = pd.DataFrame(
        {
            "time": free.frame.index,
            "day": day,
            "measured": free.frame[TARGET].to_numpy(),
            "model_free": corrected,
            "physics_free": physics,
            "day_mean": float(free.frame[TARGET].mean()),
        }
    ).set_index("time")
    for name in ("model_window", "physics_window", "persistence_window"):
        frame[name] = np.nan
    for stretch in cut(limits.bridge_s, 0.0):
        physics, corrected, persistence = model.windows(stretch, limits.window_s)
        frame.loc[stretch.frame.index, "model_window"] = corrected
        frame.loc[stretch.frame.index, "physics_window"] = physics
        frame.loc[stretch.frame.index, "persistence_window"] = persistence
    return frame.reset_index()


def _scores(frame: pd.DataFrame, kind: str, step: float, window_s: float) -> dict[str, Any]:
    """Errors of every predictor where all of them and the measurement are known."""
    start = "measured" if kind == "free" else "persistence_window"
    known = frame["measured"].notna() & frame[f"model_{kind}"].notna() & frame[start].notna()
    judged = frame[known]
    measured = judged["measured"].to_numpy(float)
    if kind == "free":
        first = judged.groupby("day")["measured"].transform("first")
    else:
        first = judged["persistence_window"]
    found: dict[str, Floats] = {
        "model": judged[f"model_{kind}"].to_numpy(float),
        "physics": judged[f"physics_{kind}"].to_numpy(float),
        "persistence": first.to_numpy(float),
        "day_mean": judged["day_mean"].to_numpy(float),
    }
    scores: dict[str, Any] = {name: errors(found[name], measured) for name in PREDICTORS}
    seconds = len(judged) * step
    scores["n_seconds"] = round(seconds)
    if kind == "window":
        scores["n_windows"] = int(np.ceil(seconds / window_s))
    model, persistence = scores["model"]["rmse_K"], scores["persistence"]["rmse_K"]
    scores["better_than_persistence"] = model is not None and model < persistence
    return scores


def judge(frame: pd.DataFrame, step: float, limits: SpindleLimits) -> dict[str, Any]:
    """The ``windows``, ``free_run``, ``verdict`` and ``reasons`` of ``validation.json``."""
    document: dict[str, Any] = {}
    for section, kind in (("windows", "window"), ("free_run", "free")):
        days = []
        for day, rows in frame.groupby("day") if len(frame) else []:
            scores = {"day": day, **_scores(rows, kind, step, limits.window_s)}
            if kind == "window":
                scores["passed"] = _passed(scores, limits)
            days.append(scores)
        everything = _scores(frame, kind, step, limits.window_s) if len(frame) else None
        document[section] = {"days": days, "all": everything}
    document["windows"]["length_s"] = limits.window_s
    reasons = [r for scores in document["windows"]["days"] for r in _reasons(scores, limits)]
    if not document["windows"]["days"]:
        reasons = ["the golden week has no working day with speed, load and temperature"]
        return {**document, "verdict": "not judged", "reasons": reasons}
    return {**document, "verdict": "failed" if reasons else "passed", "reasons": reasons}


def _passed(scores: dict[str, Any], limits: SpindleLimits) -> bool:
    return not _reasons(scores, limits)


def _reasons(scores: dict[str, Any], limits: SpindleLimits) -> list[str]:
    """Why a day was not passed, one sentence a reason."""
    day, model, persistence = scores["day"], scores["model"], scores["persistence"]
    if model["mae_K"] is None:
        return [f"{day}: no window starts from a measured temperature"]
    found = [
        f"{day}: {label} {model[key]:.2f} K is not below {limit:g} K"
        for key, label, limit in (
            ("mae_K", "mean error", limits.mae_K),
            ("rmse_K", "RMSE", limits.rmse_K),
        )
        if not model[key] < limit
    ]
    if not scores["better_than_persistence"]:
        found.append(
            f"{day}: RMSE {model['rmse_K']:.2f} K is not below that of persistence, "
            f"{persistence['rmse_K']:.2f} K"
        )
    return found
