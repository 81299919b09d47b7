"""Random forest on the residual of the spindle's network, split by day."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.signals.windows import StateSegment
from pipeline.submodels.statistics import gains
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.residual import Forest, features, smoothed_inputs
from pipeline.twin.spindle import TARGET, SpindleRecords, free_run, from_measured

if TYPE_CHECKING:
    from sklearn.ensemble import RandomForestRegressor


@dataclass(frozen=True, kw_only=True)
class ForestSettings(Ranged, section="residual_forest"):
    """How the forest is trained (Twin2026: 300 trees, depth 14, leaf 5).

    Parameters
    ----------
    trees, depth, leaf : int
        Size of the forest.
    folds : int
        Groups of days that are left out in turn, at most one group a day; two at least, since a
        forest is judged on days that it did not learn from.
    window_s : float
        Length of the windows that start from a measured temperature [s].
    every_s : float
        A window starts this often [s].
    sample_s : float
        Time between the samples taken of a window [s].
    seed : int
        Of the forest.
    """

    trees: Count = 300
    depth: Count = 14
    leaf: Count = 5
    folds: Annotated[int, Range(least=2)] = 10
    window_s: Positive = 3600.0
    every_s: Positive = 600.0
    sample_s: Positive = 60.0
    seed: Annotated[int, Range(least=0)] = 0


@dataclass(frozen=True, kw_only=True)
class Examples:
    """Training examples.

    ``x`` (N, features), ``error`` (N,) measured minus network [K], ``day`` (N,).
    """

    x: Floats
    error: Floats
    day: np.ndarray


def examples(
    pieces: Sequence[StateSegment],
    records: SpindleRecords,
    network: SpindleThermalParameters,
    settings: ForestSettings,
) -> Examples:
    """Windows of every stretch, each started from a measured temperature."""
    x, error, day = [], [], []
    for piece in pieces:
        inputs = smoothed_inputs(piece.frame, piece.step, [*records.sources, *records.extra])
        nodes = free_run(piece, records, network)
        measured = piece.frame[TARGET].to_numpy(float)
        length = max(round(settings.window_s / piece.step), 1)
        take = max(round(settings.sample_s / piece.step), 1)
        for start in range(0, len(measured), max(round(settings.every_s / piece.step), 1)):
            if np.isnan(measured[start]):
                continue
            physics = from_measured(piece, start, length, records, network, nodes)[take::take]
            rows = np.arange(start, min(start + length, len(measured)))[take::take]
            found = features(
                inputs.iloc[rows],
                physics,
                measured[start],
                (rows - start).astype(float) * piece.step,
                records.sources,
                records.extra,
            )
            known = np.isfinite(measured[rows])
            x.append(found[known])
            error.append((measured[rows] - physics)[known])
            day.append(np.full(int(known.sum()), piece.day))
    if not sum(map(len, error)):
        raise ValueError("no window starts from a measured temperature: record a working day")
    return Examples(x=np.concatenate(x), error=np.concatenate(error), day=np.concatenate(day))


def fitted_forest(x: Floats, error: Floats, settings: ForestSettings) -> "RandomForestRegressor":
    """A forest fitted by all cores that predicts on one.

    Threads that predict add the trees up in the order in which they happen to finish, so that the
    last bits of a prediction would differ from run to run.
    """
    from sklearn.ensemble import RandomForestRegressor

    forest = RandomForestRegressor(
        n_estimators=settings.trees,
        max_depth=settings.depth,
        min_samples_leaf=settings.leaf,
        max_features=1 / 3,
        random_state=settings.seed,
        n_jobs=-1,
    )
    return forest.fit(x, error).set_params(n_jobs=1)


def _days_left_out(
    data: Examples, days: Sequence[str], settings: ForestSettings
) -> tuple[Floats, Floats]:
    """Mean squared error [K^2] of each day with a forest that did not see it, and without one."""
    if len(days) < 2:
        return np.array([]), np.array([])
    groups = np.array_split(np.array(days), min(settings.folds, len(days)))
    left = np.empty(len(data.error))
    for group in groups:
        judged = np.isin(data.day, group)
        forest = fitted_forest(data.x[~judged], data.error[~judged], settings)
        left[judged] = data.error[judged] - forest.predict(data.x[judged])
    with_forest = [np.mean(left[data.day == day] ** 2) for day in days]
    without = [np.mean(data.error[data.day == day] ** 2) for day in days]
    return np.array(with_forest), np.array(without)


def train_residual_forest(
    data: Examples, records: SpindleRecords, settings: ForestSettings
) -> tuple["RandomForestRegressor", Forest]:
    """Train on all days, and tell from days left out whether the forest helps.

    It is used only when it lowers the squared error of days left out, significantly over the days
    (:func:`~pipeline.submodels.statistics.gains`).

    Returns
    -------
    forest : RandomForestRegressor
        Fitted on all examples.
    about : Forest
        Whether it is used and why, and its errors on days left out.
    """
    days = sorted(set(data.day))
    with_forest, without = _days_left_out(data, days, settings)
    used = gains(without, with_forest)
    if len(days) < 2:
        why = f"only {len(days)} day to learn from: nothing says whether it would hold on another"
    elif used:
        why = "it lowers the error of days left out, significantly at 5 %"
    else:
        why = "it does not lower the error of days left out significantly at 5 %"
    return fitted_forest(data.x, data.error, settings), Forest(
        used=used,
        why=why,
        sources=tuple(records.sources),
        extra=tuple(records.extra),
        days=tuple(str(d) for d in days),
        examples=len(data.error),
        rmse_days_left_out_K=_rmse(with_forest),
        rmse_without_K=_rmse(without),
    )


def _rmse(by_day: Floats) -> float | None:
    """Root of the mean over days [K]; None when no day was left out."""
    return round(float(np.sqrt(np.mean(by_day))), 4) if len(by_day) else None
