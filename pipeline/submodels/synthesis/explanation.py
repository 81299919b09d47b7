"""Diagnosis by the generator: wear and noise that explain recorded windows best.

The result is a profile of the distance over the wear.  Its width is no confidence interval: how
far it is off on tools that were held out has to be measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.nets.latent_search import Explained, LatentSearch, explain
from pipeline.schema.arrays import Floats
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.synthesis.model import WEAR, Synthesis

AS_GOOD = 0.05
"""Wears whose distance is within this share of the least explain a window as well [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Explanation of recorded windows by the generator."""

    windows: tuple[Explained, ...]
    """Each of them."""
    wear: Floats
    distance: Floats
    """Wears, and the mean over the windows of the least distance at each [1]; shape (V,)."""
    unit: str
    """Unit of the wear."""

    @property
    def best(self) -> float:
        """Wear at the least distance."""
        return float(self.wear[self.distance.argmin()])

    @property
    def as_good(self) -> tuple[float, float]:
        """Least and greatest wear that explain the windows about as well."""
        near = self.wear[self.distance <= (1.0 + AS_GOOD) * self.distance.min()]
        return float(near.min()), float(near.max())

    @property
    def document(self) -> dict[str, Any]:
        """Document for JSON."""
        return {
            "wear": self.best, "as_good": list(self.as_good), "unit": self.unit,
            "profile": [
                {"wear": float(w), "distance": float(d)}
                for w, d in zip(self.wear, self.distance, strict=True)
            ],
            "windows": len(self.windows),
            "typical_distance": float(np.mean([one.typical for one in self.windows])),
        }  # fmt: skip


def explanation(
    served: Synthesis, windows: Sequence[Floats], given: Mapping[str, Any],
    settings: LatentSearch | None = None,
) -> Explanation:  # fmt: skip
    """Wear that explains recorded windows best.

    ``windows`` (C, L) in the units of the channels; ``given`` are known conditions, without the
    wear. ValueError when there is no window, its shape does not fit, or a condition was not learnt.
    """
    if not windows:
        raise ValueError("there is no window to explain: give one at least")
    space = served.gan.space
    constant = {c.name: c.low for c in space.continuous if c.low == c.high and c.name != WEAR}
    found = tuple(
        explain(served.gan, one, WEAR, constant | dict(given), settings) for one in windows
    )
    return Explanation(
        windows=found, wear=found[0].values,
        distance=np.mean([one.distance for one in found], axis=0), unit=found[0].unit,
    )  # fmt: skip


def read_windows(path: Path, served: Synthesis, most: int = 2) -> list[Floats]:
    """Windows of a table that has the channels as columns, CSV or Parquet, evenly spread.

    The rows are samples at the model's rate, in its units; a unit may stand in brackets behind a
    name. Where there is a column ``window``, windows do not reach over its steps. ValueError when
    the file is no table, lacks a channel, or is shorter than a window.
    """
    file = served.file
    try:
        parquet = path.suffix == ".parquet"
        table = pd.read_parquet(path) if parquet else pd.read_csv(path, comment="#")
    except (OSError, ValueError) as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path} is no table of CSV or Parquet: {said}") from error
    table = table.rename(columns=lambda name: str(name).partition(" [")[0])
    for channel in file.channels:
        if channel not in table.columns:
            raise ValueError(
                f"{path} has no column {channel}: this generator needs {', '.join(file.channels)}"
            )
    parts = [part for _, part in table.groupby("window")] if "window" in table else [table]
    found = []
    for part in parts:
        values = part[list(file.channels)].to_numpy(float).T
        for k in range(0, values.shape[1] - file.length + 1, file.length):
            found.append(values[:, k : k + file.length])
    if not found:
        raise ValueError(
            f"{path} has {len(table)} rows, a window {file.length}: record at {file.rate_Hz:g} Hz "
            f"for {file.length / file.rate_Hz:g} s or longer"
        )
    rows = np.unique(np.linspace(0, len(found) - 1, min(most, len(found))).round().astype(int))
    return [found[k] for k in rows]


def explained_windows(
    served: Synthesis, windows: WearWindows, settings: LatentSearch | None = None
) -> tuple[list[Explanation], pd.DataFrame]:
    """Explanation of each of some recorded windows, and a table of measured and explained wear.

    Windows out of the conditions that were learnt are left out of both.
    """
    conditions = served.known(windows)
    found, rows = [], []
    for k in np.flatnonzero(served.inside(conditions)):
        given = {name: values[k] for name, values in conditions.items() if name != WEAR}
        one = explanation(served, [np.asarray(windows.values[k], float)], given, settings)
        low, high = one.as_good
        found.append(one)
        rows.append({
            "tool": str(windows.tool[k]), "recorded": float(windows.wear[k]), "best": one.best,
            "low": low, "high": high, "distance": float(one.distance.min()),
            "typical distance": one.windows[0].typical,
        })  # fmt: skip
    return found, pd.DataFrame(rows)
