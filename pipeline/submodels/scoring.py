"""Errors of predictions against measurements and baselines: figures, scores, skills."""

from math import isfinite
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.predictions import AGAIN, BASELINE
from pipeline.schema.verdict import Figures, Role, Score, Skill, significant
from pipeline.submodels.contract import Target
from pipeline.submodels.statistics import grid_step, left_open, spread_of

DRAWS = 2000
"""Bootstrap samples of the groups."""
FEWEST_GROUPS = 3
"""Groups below which a bootstrap over them says nothing."""
STEP = "step"
"""Column of a prediction: resolution of the recorded signal that it is derived from."""
ALL = "all"
"""Group of a score over all groups of one role."""


def figures(predicted: Floats, measured: Floats) -> Figures:
    """Errors of a prediction where both have a value, to six significant digits.

    Examples
    --------
    >>> found = figures(np.array([20.0, 24.0]), np.array([21.0, 21.0]))
    >>> found.mae, found.rmse, found.max, found.bias
    (2.0, 2.23607, 3.0, 1.0)
    """
    known = np.isfinite(predicted) & np.isfinite(measured)
    predicted, measured = predicted[known], measured[known]
    if not len(measured):
        return Figures()
    error = predicted - measured
    rms, most = float(np.sqrt(np.mean(measured**2))), float(np.abs(measured).max())
    rmse, largest = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    mean, peak = float(measured.mean()), float(measured.max())
    return Figures(
        mae=rounded(float(np.abs(error).mean())),
        rmse=rounded(rmse),
        max=rounded(largest),
        bias=rounded(float(error.mean())),
        relative_percent=_percent(rmse, rms),
        max_percent=_percent(largest, most),
        peak_percent=_percent(float(predicted.max()) - peak, abs(peak)),
        mean_percent=_percent(float(predicted.mean()) - mean, abs(mean)),
    )


def rounded(value: float) -> float | None:
    """A number to six significant digits; None when it is not finite."""
    return significant(value) if isfinite(value) else None


def _percent(part: float, whole: float) -> float | None:
    return rounded(100 * part / whole) if whole > 0 else None


def scored_rows(frame: pd.DataFrame, target: Target) -> pd.DataFrame:
    """Rows of a target with measurement, prediction and baselines."""
    if not len(frame):
        return frame
    rows = frame[(frame["quantity"] == target.quantity) & (frame["regime"] == target.regime)]
    names = [BASELINE + name for name in target.must_beat if BASELINE + name in rows.columns]
    known = rows["scored"].to_numpy(bool).copy()
    for name in ("measured", "predicted", *names):
        values = rows[name].to_numpy(float)
        # a baseline that a whole case has not is none of that case
        absent = np.zeros(len(rows), dtype=bool)
        if name in names:
            empty = rows[name].isna().groupby(rows["case"]).transform("all")
            absent = empty.to_numpy(bool)
        known &= np.isfinite(values) | absent
    return rows[known]


def score_of(rows: pd.DataFrame, target: Target, group: str, role: Any) -> Score:
    """Errors of some rows, and those of the baselines on them."""
    measured = rows["measured"].to_numpy(float)
    others = {
        name: figures(rows[BASELINE + name].to_numpy(float), measured)
        for name in target.baselines if BASELINE + name in rows.columns
    }  # fmt: skip
    return Score(
        quantity=target.quantity,
        unit=target.unit,
        group=group,
        regime=target.regime,
        role=role,
        n=len(rows),
        baselines={name: one for name, one in others.items() if one.mae is not None},
        limits=target.limits if group != ALL else {},
        rounding=_rounding(rows, target) if others else {},
        half_width=rounded(float((rows["high"] - rows["low"]).astype(float).mean()) / 2),
        **_figures(rows, "predicted"),
    )


def _figures(rows: pd.DataFrame, name: str) -> dict[str, Any]:
    """Figures of one prediction by their names in a score; the interval moves along with it."""
    measured, predicted, served, low, high = (
        rows[column].to_numpy(float) for column in ("measured", name, "predicted", "low", "high")
    )
    bounded = np.isfinite(low) & np.isfinite(high)
    error = (measured - (predicted - served))[bounded]
    inside = (low[bounded] <= error) & (error <= high[bounded])
    share = rounded(float(inside.mean())) if bounded.any() else None
    return vars(figures(predicted, measured)) | {"coverage_90": share}


def spread_over(rows: pd.DataFrame) -> dict[str, float]:
    """Spread of each figure over the trainings whose predictions are there for all rows."""
    again = trained_again(rows)
    if len(again) < 2:
        return {}
    found = pd.DataFrame([_figures(rows, name) for name in again], dtype=float).dropna(axis=1)
    return {str(name): spread_of(values.to_numpy()) for name, values in found.items()}


def trained_again(rows: pd.DataFrame) -> list[str]:
    """Columns of the trainings with other seeds whose predictions are there for all rows."""
    return [n for n in map(str, rows) if n.startswith(AGAIN) and rows[n].notna().all()]


def _rounding(rows: pd.DataFrame, target: Target) -> dict[str, Figures]:
    """Uncertainty of the difference to the baseline from the sensor's resolution."""
    step = target.resolution or _recorded_step(rows, target)
    if step <= 0:
        return {}
    measured, predicted = (rows[name].to_numpy(float) for name in ("measured", "predicted"))
    _, groups = np.unique(rows["group"].to_numpy(str), return_inverse=True)
    return {
        name: left_open(predicted, rows[BASELINE + name].to_numpy(float), measured, groups, step)
        for name in target.must_beat
        if BASELINE + name in rows.columns and rows[BASELINE + name].notna().all()
    }


def _recorded_step(rows: pd.DataFrame, target: Target) -> float:
    """Resolution of the recorded signal: of the prediction's column, else of the grid of values."""
    if not target.must_beat:
        return 0.0
    if STEP in rows:
        known = rows[STEP].to_numpy(float)
        return float(np.nanmax(known, initial=0.0))
    return grid_step(rows["measured"].to_numpy(float))


def skills(frame: pd.DataFrame, target: Target, deciding: Role) -> list[Skill]:
    """Skill against each baseline over the groups that decide, with bootstrapped intervals."""
    rows = scored_rows(frame, target)
    rows = rows[rows["role"] == deciding] if len(rows) else rows
    found = []
    for name in target.baselines:
        column = BASELINE + name
        if not len(rows) or column not in rows.columns:
            continue
        part = rows[rows[column].notna()]
        if not len(part):
            continue
        error = (part["predicted"] - part["measured"]).to_numpy(float)
        other = (part[column] - part["measured"]).to_numpy(float)
        _, group = np.unique(part["group"].to_numpy(str), return_inverse=True)
        count = int(group.max()) + 1
        sums = np.stack(
            [
                np.bincount(group, weights=w, minlength=count)
                for w in (np.abs(error), np.abs(other), error**2, other**2)
            ]
        )
        mae, rmse = _skill(sums.sum(axis=1))
        low_high: list[tuple[float, float] | None] = [None, None]
        if count >= FEWEST_GROUPS:
            draws = np.random.default_rng(0).integers(0, count, (DRAWS, count))
            drawn = _skill(sums[:, draws].sum(axis=2))
            low_high = [_interval(values) for values in drawn]
        found.append(
            Skill(
                quantity=target.quantity, regime=target.regime, baseline=name, groups=count,
                mae=rounded(float(mae)), mae_interval_95=low_high[0],
                rmse=rounded(float(rmse)), rmse_interval_95=low_high[1],
            )
        )  # fmt: skip
    return found


def _skill(sums: Floats) -> tuple[Any, Any]:
    """Skill on MAE and on RMSE from sums of (|e|, |b|, e^2, b^2) in the first axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1 - sums[0] / sums[1], 1 - np.sqrt(sums[2] / sums[3])


def _interval(values: Floats) -> tuple[float, float] | None:
    if not np.isfinite(values).all():
        return None
    low, high = np.quantile(values, [0.025, 0.975])
    return significant(low), significant(high)
