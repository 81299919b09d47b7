"""Isolation forest on windows of the known-good days (Liu, Ting, Zhou, ICDM 2008).

It is grown again from the stored windows: the same trees from the same seed, without a pickle.
Its score is -``score_samples``: 0.5 is usual, near 1 is isolated within few splits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import pyarrow as pa

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.windows import RAW, RESIDUALS, Windows
from pipeline.schema.arrays import Bools, Floats

SEED = 0
NAMED = 3
"""Features that an event of the forest names: those furthest from their usual values."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownGood:
    """Windows of the known-good days, F features of N windows, and the forest on them."""

    names: tuple[str, ...]
    x: Floats
    """Features; shape (N, F), no NaN: the median where one is not known."""
    trees: int

    @classmethod
    def of(
        cls, windows: Windows, values: Mapping[str, Floats], settings: IncidentSettings
    ) -> Self | None:
        """Known-good windows, with ``values`` of the rules; None without any that counts."""
        names = feature_names(windows, settings)
        x = _features(windows, values, names)[_counts(windows)][:: max(1, -(
            -int(_counts(windows).sum()) // settings.samples))]  # fmt: skip
        known = np.isfinite(x).any(axis=0)
        if not len(x) or not known.any():
            return None
        middle = np.nanmedian(x[:, known], axis=0)
        return cls(names=tuple(np.array(names)[known].tolist()), trees=settings.trees,
                   x=np.where(np.isfinite(x[:, known]), x[:, known], middle))  # fmt: skip

    @classmethod
    def of_table(cls, table: pa.Table, settings: IncidentSettings) -> Self:
        """Known-good windows as :meth:`table` has stored them."""
        x = np.column_stack([one.to_numpy() for one in table.columns])
        return cls(names=tuple(table.column_names), x=x, trees=settings.trees)

    def table(self) -> pa.Table:
        """The windows as a table."""
        return pa.table(dict(zip(self.names, self.x.T, strict=True)))

    @cached_property
    def forest(self) -> Any:
        """The fitted forest."""
        from sklearn.ensemble import IsolationForest

        return IsolationForest(n_estimators=self.trees, random_state=SEED).fit(self.x)

    @cached_property
    def middle(self) -> Floats:
        """Median of each feature, which counts where one is not known; shape (F,)."""
        return np.median(self.x, axis=0)

    def scores(self, x: Floats) -> Floats:
        """Score of windows (N, F); shape (N,)."""
        known = np.where(np.isfinite(x), x, self.middle)
        return -np.asarray(self.forest.score_samples(known)) if len(x) else np.zeros(0)

    def windows(self, windows: Windows, values: Mapping[str, Floats]) -> Floats:
        """Score of each window, NaN where it does not count; shape (W,)."""
        found, counts = np.full(len(windows), np.nan), _counts(windows)
        found[counts] = self.scores(_features(windows, values, self.names)[counts])
        return found

    def furthest(self, windows: Windows, values: Mapping[str, Floats], place: int) -> list[str]:
        """Features of one window that are furthest from their usual values, in spreads."""
        x = _features(windows, values, self.names)[place]
        low, high = np.quantile(self.x, [0.05, 0.95], axis=0)
        off = np.abs(np.where(np.isfinite(x), x - self.middle, 0.0)) / np.maximum(high - low, 1e-9)
        return [self.names[k] for k in np.argsort(-off, kind="stable")[:NAMED]]


def feature_names(windows: Windows, settings: IncidentSettings) -> tuple[str, ...]:
    """Features by what the settings want of residuals and vibration."""
    residuals = [f"{name}_distance" for name in RESIDUALS.values()]
    wanted = [*RAW, "temperature_slope"]
    wanted += ["cutting_power", *residuals, "cut_load_high"] if settings.residuals else []
    vibration = [name for name in windows.values if "vibration" in name]
    return (*wanted, *(vibration if settings.vibration else []))


def _features(windows: Windows, values: Mapping[str, Floats], names: tuple[str, ...]) -> Floats:
    have, none = {**windows.values, **values}, np.full(len(windows), np.nan)
    return np.column_stack([have.get(name, none) for name in names])


def _counts(windows: Windows) -> Bools:
    """Whether a window counts: its rows do, and their load and speed are known; shape (W,)."""
    have = windows.values
    return windows.counts & np.isfinite(have["load"]) & np.isfinite(have["speed"])
