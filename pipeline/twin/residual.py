"""Random forest on the residual of the spindle's network: its features, its file, its prediction.

Features are the network's own answer, the temperature and age of its start, the heat sources
smoothed over several time constants, and extra signals of the machine.  An unknown value stays
unknown (the trees have a branch for it); it is never filled with zeros.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.store import read_json, write_json

if TYPE_CHECKING:
    from pipeline.schema.forest import Trees

SMOOTHING_S = (120.0, 600.0, 3600.0)
"""Time constants [s] over which sources and extra signals are smoothed."""

NODES = "forest.json"
"""File of the trees, beside ``model.json``."""


@dataclass(frozen=True, kw_only=True)
class Forest:
    """A trained forest as ``model.json`` describes it."""

    used: bool
    """Whether it lowers the error of days left out, and corrects the network."""
    why: str
    """Reason of its use or not."""
    sources: tuple[str, ...]
    extra: tuple[str, ...]
    """Heat sources and further signals that it looks at."""
    smoothing_s: tuple[float, ...] = SMOOTHING_S
    """Time constants of its features [s]."""
    days: tuple[str, ...]
    """Training days."""
    examples: int
    """Samples that it was trained on."""
    rmse_days_left_out_K: float | None
    rmse_without_K: float | None
    """Over days left out, with the forest and without it [K]."""


@dataclass(frozen=True, kw_only=True)
class ResidualForest:
    """A trained forest with the features it wants."""

    forest: "Trees"
    """Fitted on the features in the order of :func:`feature_names`."""
    sources: tuple[str, ...]
    extra: tuple[str, ...]
    """Heat sources and further signals that it looks at."""
    draws: int = 0
    """Forests of trees drawn with replacement whose corrections stand beside the forest's own."""

    def correction(
        self, inputs: pd.DataFrame, physics: Floats, start: float | Floats, at: Floats
    ) -> Floats:
        """Temperature to add to the network's [K], (1 + draws, T); see :func:`features`."""
        x = features(inputs, physics, start, at, self.sources, self.extra)
        return self.forest.drawn(x, self.draws)


def feature_names(sources: Sequence[str], extra: Sequence[str]) -> list[str]:
    """Names of the features, in order."""
    smoothed = [f"{s}_over_{tau:g}_s" for s in (*sources, *extra) for tau in SMOOTHING_S]
    return ["physics", "start_temperature", "horizon_s", *smoothed]


def smoothed_inputs(frame: pd.DataFrame, step: float, names: Sequence[str]) -> pd.DataFrame:
    """Exponential means of ``names`` over each time constant, from the past only.

    An unknown signal has nan; after a gap its mean goes on.  Raises ValueError when a signal is no
    column of ``frame``.
    """
    missing = [name for name in names if name not in frame.columns]
    if missing:
        raise ValueError(
            f"the forest needs {missing[0]}, which the records do not have; "
            "record it, or train again without it (spindle.extra in the machine's file)"
        )
    return pd.DataFrame(
        {
            # pandas carries the last mean into a gap, as if the signal had been known there
            f"{name}_over_{tau:g}_s": frame[name]
            .ewm(alpha=-np.expm1(-step / tau))
            .mean()
            .where(frame[name].notna())
            for name in names
            for tau in SMOOTHING_S
        }
    )


def features(
    inputs: pd.DataFrame,
    physics: Floats,
    start: float | Floats,
    at: Floats,
    sources: Sequence[str],
    extra: Sequence[str],
) -> Floats:
    """Feature matrix, shape (T, features), in the order of :func:`feature_names`.

    ``inputs``: rows of :func:`smoothed_inputs`; ``physics`` (T,): the network's temperature;
    ``start``: the measured one of its start [degC]; ``at`` (T,): time since [s].
    """
    names = feature_names(sources, extra)
    columns = [physics, np.broadcast_to(start, len(physics)), at]
    return np.column_stack([*columns, inputs[names[3:]].to_numpy(float)])


def save_forest(forest: "Trees", folder: Path) -> None:
    """Write the trees into a folder; the same forest gives the same bytes."""
    write_json(forest.document(), folder / NODES)


def load_forest(folder: Path, about: Forest, draws: int = 0) -> ResidualForest | None:
    """Forest in ``folder``, None when training found that it does not help.

    Raises ValueError when its features are those of another version, or its file cannot be read.
    """
    if not about.used:
        return None
    if about.smoothing_s != SMOOTHING_S:
        raise ValueError(
            f"{folder}: the forest was trained on means over {list(about.smoothing_s)} s, this "
            f"version takes {list(SMOOTHING_S)} s: train it again with `dvc repro`"
        )
    from pipeline.schema.forest import Trees

    trees = Trees.restored(read_json(folder / NODES, dict[str, str]))
    return ResidualForest(forest=trees, sources=about.sources, extra=about.extra, draws=draws)
