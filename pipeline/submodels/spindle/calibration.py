"""Calibration of a spindle's prediction intervals on training days left out.

Each group of days is predicted by a network, and a forest where one is used, that were fitted on
the other days only, in the same windows and free runs in which the model is judged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.interval import AdaptiveSettings
from pipeline.signals.windows import StateSegment
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import Residuals, bands, chosen_step, splits
from pipeline.submodels.spindle.days import FREE_RUN, WINDOWS, Run, runs_of
from pipeline.submodels.spindle.fit import Problem, SpindleFitSettings, excited, solve, structure_of
from pipeline.submodels.spindle.intervals import IntervalSettings
from pipeline.submodels.spindle.residual import ForestSettings, examples, fitted_forest
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.residual import ResidualForest
from pipeline.twin.spindle import SpindleIntervals, SpindleModel, SpindleRecords


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How the model that is to be calibrated was made of its days.

    Parameters
    ----------
    records : SpindleRecords
        Signals that it looks at.
    network : SpindleFitSettings
        Of the network's fit.
    forest : ForestSettings
        Of the forest.
    forest_used : bool
        Whether the forest corrects the network.
    whole : SpindleThermalParameters
        The network of all days, from which those of fewer days start.
    """

    records: SpindleRecords
    network: SpindleFitSettings
    forest: ForestSettings
    forest_used: bool
    whole: SpindleThermalParameters

    def model_of(self, pieces: Sequence[StateSegment]) -> SpindleModel:
        """The model of some stretches, with the nodes and sources of the whole one."""
        sources = excited(pieces, list(self.whole.heating))
        problem = Problem(pieces, self.records, self.network, sources, structure_of(self.whole))
        found = solve(problem, [problem.position(self.whole)]).parameters
        model = SpindleModel(network=found, records=self.records, step_s=self.network.step_s)
        if not self.forest_used:
            return model
        data = examples(pieces, self.records, found, self.forest)
        forest = ResidualForest(
            forest=fitted_forest(data.x, data.error, self.forest),
            sources=tuple(self.records.sources), extra=tuple(self.records.extra),
        )  # fmt: skip
        return replace(model, forest=forest)


def calibrated(
    cases: Sequence[Case],
    pieces: Sequence[StateSegment],
    recipe: Recipe,
    settings: IntervalSettings,
) -> SpindleIntervals | None:
    """Prediction intervals by state and horizon; None with fewer than two training days.

    Parameters
    ----------
    cases : sequence of Case
        Training days.
    pieces : sequence of StateSegment
        Their stretches, as the model was fitted on.
    recipe : Recipe
        How the model was made.
    settings : IntervalSettings
        How the intervals are made.
    """
    days = sorted({piece.day for piece in pieces})
    if len(days) < 2:
        return None
    how = SpindleIntervals(
        trend_s=settings.trend_s, steady_K_h=settings.steady_K_h,
        windows_horizons_s=settings.windows_horizons_s,
        free_run_horizons_s=settings.free_run_horizons_s,
    )  # fmt: skip
    tables = {case.name: case for case in cases}
    window_s, bridge_s = recipe.network.window_s, recipe.network.bridge_s

    parts: dict[str, list[Residuals]] = {WINDOWS: [], FREE_RUN: []}
    for fitted, left in splits(days, settings.folds):
        model = recipe.model_of([piece for piece in pieces if piece.day in fitted])
        for day in left:
            runs = runs_of(
                model, tables[day].load(), day, window_s=window_s, bridge_s=bridge_s,
                intervals=how,
            )  # fmt: skip
            if runs is not None:
                parts[WINDOWS].append(_residuals(runs.windows, day))
                parts[FREE_RUN].append(_residuals(runs.free_run, day))
    in_windows = Residuals.joined(parts[WINDOWS])
    windows = bands(in_windows)
    step = chosen_step(in_windows, windows, settings.steps, window_s)
    return replace(
        how, windows=windows, free_run=bands(Residuals.joined(parts[FREE_RUN])),
        follow=AdaptiveSettings(step=step, delay_s=window_s),
    )  # fmt: skip


def _residuals(run: Run, day: str) -> Residuals:
    error = run.measured - run.predicted
    known = np.isfinite(error)
    return Residuals(
        error=error[known], regime=run.regime[known], group=np.full(int(known.sum()), day),
        t=run.seconds[known],
    )  # fmt: skip
