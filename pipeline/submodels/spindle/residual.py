"""Random forest on the residual of the spindle's network: its settings, examples and fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.signals.windows import StateSegment
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import (
    TARGET,
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
        x.append(
            features(
                inputs.iloc[rows[known]],
                physics[known],
                np.broadcast_to(measured[starts, None], physics.shape)[known],
                after[known] * piece.step,
                records.sources,
                records.extra,
            )
        )
        error.append((measured[rows] - physics)[known])
    if not sum(map(len, error)):
        raise ValueError("no window starts from a measured temperature: record a working day")
    return Examples(x=np.concatenate(x), error=np.concatenate(error))


def fitted_forest(data: Examples, settings: ForestSettings) -> "Trees":
    """A forest fitted on examples."""
    from sklearn.ensemble import RandomForestRegressor

    from pipeline.schema.forest import Trees

    forest = RandomForestRegressor(
        n_estimators=settings.trees,
        max_depth=settings.depth,
        min_samples_leaf=settings.leaf,
        max_features=1 / 3,
        random_state=settings.seed,
    )
    return Trees.of(forest.fit(data.x, data.error))
