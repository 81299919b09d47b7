"""Random forest on the residual of the network, and cross-validation over training days.

Each group of days is predicted by a network and a forest that were fitted on the other days only,
in the same windows and free runs in which the model is judged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.model import AdaptiveSettings
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.signals.windows import StateSegment
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import Residuals, bands, chosen_step, splits
from pipeline.submodels.spindle.days import DayRuns, IntervalSettings, Run, runs_of
from pipeline.submodels.spindle.fit import (
    Given,
    Problem,
    SpindleFitSettings,
    excited,
    solve,
    structure_of,
)
from pipeline.submodels.statistics import gains
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import (
    TARGET,
    Forest,
    ResidualForest,
    SpindleIntervals,
    SpindleModel,
    SpindleRecords,
    features,
    free_run,
    from_measured,
    smoothed_inputs,
)

if TYPE_CHECKING:
    from pipeline.schema.forest import Trees


@dataclass(frozen=True, kw_only=True)
class ForestSettings(Ranged, section="residual_forest"):
    """Training of the forest (Twin2026: 300 trees, depth 14, leaf 5)."""

    trees: Count = 300
    depth: Count = 14
    leaf: Count = 5
    """Size of the forest."""
    window_s: Positive = 3600.0
    """Length of the windows that start from a measured temperature [s]."""
    every_s: Positive = 600.0
    """A window starts this often [s]."""
    sample_s: Positive = 60.0
    """Time between the samples taken of a window [s]."""
    seed: Annotated[int, Range(least=0)] = 0
    """Seed of the forest."""


@dataclass(frozen=True, kw_only=True)
class Examples:
    """Training examples: ``x`` (N, features), ``error`` (N,) measured minus network [K]."""

    x: Floats
    error: Floats


def examples(
    pieces: Sequence[StateSegment],
    records: SpindleRecords,
    network: SpindleThermalParameters,
    settings: ForestSettings,
) -> Examples:
    """Windows of every stretch, each started from a measured temperature."""
    x, error = [], []
    for piece in pieces:
        inputs = smoothed_inputs(piece.frame, piece.step, [*records.sources, *records.extra])
        nodes = free_run(piece, records, network)
        measured = piece.frame[TARGET].to_numpy(float)
        length = max(round(settings.window_s / piece.step), 1)
        take = max(round(settings.sample_s / piece.step), 1)
        starts = np.arange(0, len(measured), max(round(settings.every_s / piece.step), 1))
        starts = starts[np.isfinite(measured[starts])]
        physics = from_measured(piece, starts, length, records, network, nodes)[:, take::take]
        after = np.broadcast_to(np.arange(length)[take::take], physics.shape)
        rows = np.minimum(starts[:, None] + after, len(measured) - 1)
        known = (starts[:, None] + after < len(measured)) & np.isfinite(measured[rows])
        start = np.broadcast_to(measured[starts, None], physics.shape)[known]
        x.append(features(
            inputs.iloc[rows[known]], physics[known], start, after[known] * piece.step,
            records.sources, records.extra,
        ))  # fmt: skip
        error.append((measured[rows] - physics)[known])
    if not sum(map(len, error)):
        raise ValueError("no window starts from a measured temperature: record a working day")
    return Examples(x=np.concatenate(x), error=np.concatenate(error))


def fitted_forest(data: Examples, settings: ForestSettings) -> "Trees":
    """A forest fitted on examples."""
    from sklearn.ensemble import RandomForestRegressor

    from pipeline.schema.forest import Trees

    forest = RandomForestRegressor(
        n_estimators=settings.trees, max_depth=settings.depth, min_samples_leaf=settings.leaf,
        max_features=1 / 3, random_state=settings.seed,
    )  # fmt: skip
    return Trees.of(forest.fit(data.x, data.error))


@dataclass(frozen=True)
class Recipe:
    """Making of the model to be calibrated from its days."""

    records: SpindleRecords
    """Signals that it looks at."""
    network: SpindleFitSettings
    """Settings of the network's fit."""
    forest: ForestSettings
    """Settings of the forest."""
    whole: SpindleThermalParameters
    """The network of all days, from which those of fewer days start."""

    def model_of(self, pieces: Sequence[StateSegment]) -> SpindleModel:
        """The model of some stretches, with the nodes and sources of the whole one."""
        sources = excited(pieces, list(self.whole.heating))
        given = Given(pieces, self.records, self.network)
        problem = Problem(given, sources, structure_of(self.whole))
        found = solve(problem, [problem.position(self.whole)]).parameters
        data = examples(pieces, self.records, found, self.forest)
        forest = ResidualForest(
            forest=fitted_forest(data, self.forest),
            sources=tuple(self.records.sources), extra=tuple(self.records.extra),
        )  # fmt: skip
        return SpindleModel(
            network=found, records=self.records, step_s=self.network.step_s, forest=forest
        )


def days_left_out(
    cases: Sequence[Case],
    pieces: Sequence[StateSegment],
    recipe: Recipe,
    settings: IntervalSettings,
) -> dict[str, DayRuns]:
    """Each training day as models of the others predict it; empty with fewer than two days.

    ``pieces`` are the stretches of the training days as the model was fitted on them.
    """
    groups = list(splits(sorted({piece.day for piece in pieces}), settings.folds))
    models = mapped(
        recipe.model_of,
        [[piece for piece in pieces if piece.day in fitted] for fitted, _ in groups],
        compute=recipe.network.compute,
    )
    tables = {case.name: case for case in cases}
    found = {}
    for model, (_, left) in zip(models, groups, strict=True):
        for day in left:
            runs = runs_of(
                model, tables[day].load(), day, window_s=recipe.network.window_s,
                bridge_s=recipe.network.bridge_s, intervals=_without_bands(settings),
            )  # fmt: skip
            if runs is not None:
                found[day] = runs
    return found


def forest_of(
    days: Mapping[str, DayRuns], used: Sequence[str], data: Examples, records: SpindleRecords
) -> Forest:
    """Whether the forest is used, and why, by days left out.

    It has to lower the squared error in windows of these days significantly
    (:func:`~pipeline.submodels.statistics.gains`).
    """
    runs = [day.windows for day in days.values()]
    with_forest = _squares(runs, [run.predicted for run in runs])
    without = _squares(runs, [run.physics for run in runs])
    helps = gains(without, with_forest)
    if len(runs) < 2:
        why = f"only {len(used)} day to learn from: nothing says whether it would hold on another"
    elif helps:
        why = "it lowers the error of days left out, significantly at 5 %"
    else:
        why = "it does not lower the error of days left out significantly at 5 %"
    return Forest(
        used=helps, why=why, sources=tuple(records.sources), extra=tuple(records.extra),
        days=tuple(used), examples=len(data.error),
        rmse_days_left_out_K=_rmse(with_forest), rmse_without_K=_rmse(without),
    )  # fmt: skip


def _squares(runs: Sequence[Run], predicted: Sequence[Floats]) -> Floats:
    """Mean squared error of each day [K^2]."""
    pairs = zip(runs, predicted, strict=True)
    return np.array([np.nanmean((run.measured - values) ** 2) for run, values in pairs])


def _rmse(by_day: Floats) -> float | None:
    """Root of the mean over days [K]; None when no day was left out."""
    return round(float(np.sqrt(np.mean(by_day))), 4) if len(by_day) else None


def calibrated(
    days: Mapping[str, DayRuns], settings: IntervalSettings, window_s: float, *, forest_used: bool
) -> SpindleIntervals | None:
    """Prediction intervals by state and horizon; None with fewer than two training days.

    ``window_s`` [s] is the length of a window, after which a measured temperature is available.
    """
    if len(days) < 2:
        return None

    def residuals(name: str) -> Residuals:
        parts = [(day, getattr(runs, name)) for day, runs in days.items()]
        return Residuals.joined(_residuals(run, day, forest_used) for day, run in parts)

    in_windows = residuals("windows")
    windows = bands(in_windows)
    step = chosen_step(in_windows, windows, settings.steps, window_s)
    return replace(
        _without_bands(settings), windows=windows,
        free_run=bands(residuals("free_run")),
        follow=AdaptiveSettings(step=step, delay_s=window_s),
    )  # fmt: skip


def _without_bands(settings: IntervalSettings) -> SpindleIntervals:
    return SpindleIntervals(
        trend_s=settings.trend_s, steady_K_h=settings.steady_K_h,
        windows_horizons_s=settings.windows_horizons_s,
        free_run_horizons_s=settings.free_run_horizons_s,
    )  # fmt: skip


def _residuals(run: Run, day: str, forest_used: bool) -> Residuals:
    error = run.measured - (run.predicted if forest_used else run.physics)
    known = np.isfinite(error)
    return Residuals(
        error=error[known], regime=run.regime[known], group=np.full(int(known.sum()), day),
        t=run.seconds[known],
    )  # fmt: skip
