"""Isolation forest on windows of the known-good days (Liu, Ting, Zhou, ICDM 2008).

It is grown again from the stored windows: the same trees from the same seed, without a pickle.
Its score is -``score_samples``: 0.5 is usual, near 1 is isolated within few splits.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import pyarrow as pa

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.rules import slope
from pipeline.monitoring.windows import RAW, RESIDUALS, Windows
from pipeline.schema.arrays import Floats

SEED = 0
NAMED = 3
"""Features that an event of the forest names: those furthest from their usual values."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownGood:
    """Windows of the known-good days, F features of N windows, and the forest on them."""

    names: tuple[str, ...]
    x: Floats
    """Features; shape (N, F), no NaN."""
    middle: Floats
    """Medians, for windows in which a feature is not known; shape (F,)."""
    trees: int

    @classmethod
    def of(cls, names: tuple[str, ...], x: Floats, settings: IncidentSettings) -> Self:
        """Known-good windows of features ``x`` (N, F), at most as many as the settings say."""
        every = x[:: max(1, -(-len(x) // settings.samples))]
        middle = np.array([np.median(one[np.isfinite(one)]) for one in every.T])
        return cls(names=names, x=np.where(np.isfinite(every), every, middle), middle=middle,
                   trees=settings.trees)  # fmt: skip

    @classmethod
    def of_table(cls, table: pa.Table, settings: IncidentSettings) -> Self:
        """Known-good windows as :meth:`table` has stored them."""
        names = tuple(table.column_names)
        x = np.column_stack([table[name].to_numpy() for name in names])
        return cls(names=names, x=x, middle=np.median(x, axis=0), trees=settings.trees)

    def table(self) -> pa.Table:
        """The windows as a table."""
        return pa.table(dict(zip(self.names, self.x.T, strict=True)))

    @cached_property
    def forest(self) -> Any:
        """The fitted forest."""
        from sklearn.ensemble import IsolationForest

        return IsolationForest(n_estimators=self.trees, random_state=SEED).fit(self.x)

    @cached_property
    def spread(self) -> Floats:
        """Half of the 5 to 95 % range of each feature; shape (F,)."""
        low, high = np.quantile(self.x, [0.05, 0.95], axis=0)
        return np.maximum((high - low) / 2, 1e-9)

    def scores(self, x: Floats) -> Floats:
        """Score of windows (N, F), of which NaN counts as usual; shape (N,)."""
        if not len(x):
            return np.zeros(0)
        known = np.where(np.isfinite(x), x, self.middle)
        return -np.asarray(self.forest.score_samples(known))

    def furthest(self, x: Floats) -> list[int]:
        """Places of the features of one window (F,) that are furthest from their usual values."""
        off = np.abs(np.where(np.isfinite(x), x, self.middle) - self.middle) / self.spread
        return [int(k) for k in np.argsort(-off, kind="stable")[:NAMED]]


def feature_names(windows: Windows, settings: IncidentSettings) -> tuple[str, ...]:
    """Features that a machine's known-good windows have."""
    residuals = [f"{name}_distance" for name in RESIDUALS.values()]
    wanted = [*RAW, "temperature_slope", *(["cutting_power", *residuals, "usual_load_distance"]
                                           if settings.residuals else [])]  # fmt: skip
    wanted += [name for name in windows.values if "vibration" in name] if settings.vibration else []
    have = windows.values
    return tuple(name for name in wanted if name in ("temperature_slope", "usual_load_distance")
                 or np.isfinite(have[name][windows.counts]).any())  # fmt: skip


def features(
    windows: Windows, names: tuple[str, ...], usual: Floats, settings: IncidentSettings
) -> tuple[Floats, Any]:
    """Features (N, F) of the windows that count, and their places; ``usual`` as the rules have it.

    A window counts where its load and speed are known.
    """
    have = {**windows.values, "temperature_slope": slope(windows, settings),
            "usual_load_distance": usual}  # fmt: skip
    none = np.full(len(windows), np.nan)
    good = windows.counts & np.isfinite(have["load"]) & np.isfinite(have["speed"])
    columns = [have.get(name, none)[good] for name in names]
    return np.column_stack(columns) if columns else np.zeros((0, 0)), np.flatnonzero(good)
