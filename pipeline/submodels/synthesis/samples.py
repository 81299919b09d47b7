"""Uses of a generator: windows as a file, and the wear that explains recorded windows best.

Files are Parquet or CSV, with units in the columns and the label synthetic.

A row is a sample of a window: ``window`` and ``sample`` count from 0, ``time`` is that in the
window [s], then the conditions and the channels.  What the windows rest on stands in the metadata
of the Parquet, and in the first lines of the CSV.

An explanation is a profile of the distance over the wear.  Its width is no confidence interval: how
far it is off on tools that were held out has to be measured.
"""

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.nets.latent_search import Explained, LatentSearch, explain
from pipeline.schema.arrays import Floats
from pipeline.schema.files import replacing
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.synthesis.model import SYNTHETIC, WEAR, Synthesis

DIGITS = 7
"""Significant digits of a number in CSV: those of single precision."""
WINDOW, SAMPLE, TIME = "window", "sample", "time"


@dataclass(frozen=True, kw_only=True, eq=False)
class Generated:
    """Windows at one set of conditions."""

    values: Floats
    """Values in the units of the channels; shape (N, C, L)."""
    conditions: Mapping[str, Any]
    """Conditions that all of them have; the empty word is an unspecified one."""
    seed: int
    """Seed of the noise."""
    served: Synthesis
    """The generator."""

    @property
    def head(self) -> dict[str, Any]:
        """Description of the windows and their basis."""
        file = self.served.file
        units = {one.name: one.unit for one in self.served.gan.space.continuous}
        return {
            "origin": SYNTHETIC,
            "trained_on": f"{file.origin} records of {file.machine}",
            "machine": file.machine,
            "conditions": {
                name: {"value": value, "unit": units.get(name, "")}
                for name, value in self.conditions.items()
            },
            "windows": len(self.values),
            "rate_Hz": file.rate_Hz,
            "seed": self.seed,
        }


def generated(served: Synthesis, given: Mapping[str, Any], many: int, seed: int = 0) -> Generated:
    """Windows at conditions; a condition that had one value in training has it without being given.

    ValueError when there is no window to make, or a condition is missing, was not learnt, or lies
    outside of what was.
    """
    if many < 1:
        raise ValueError(f"{many} windows are none: ask for one at least")
    space = served.gan.space
    conditions = {c.name: c.low for c in space.continuous if c.low == c.high} | dict(given)
    conditions |= {d.name: "" for d in space.discrete if d.name not in conditions}
    in_order = [name for name in space.names if name in conditions]
    conditions = {name: conditions[name] for name in dict.fromkeys([*in_order, *conditions])}
    values = served.gan.sample(
        {name: np.full(many, value) for name, value in conditions.items()}, seed=seed
    )
    return Generated(values=values, conditions=conditions, seed=seed, served=served)


def conditions_of_words(served: Synthesis, words: Mapping[str, str]) -> dict[str, Any]:
    """Conditions from text, numbers or words; ValueError for an invalid or unknown one."""
    space = served.gan.space
    numbers = {one.name: one for one in space.continuous}
    found: dict[str, Any] = {}
    for name, text in words.items():
        if name not in space.names:
            raise ValueError(
                f"{name} is no condition of this model: it has {', '.join(space.names)}"
            )
        if name not in numbers:
            found[name] = text
            continue
        try:
            found[name] = float(text)
        except ValueError as error:
            one = numbers[name]
            raise ValueError(
                f"{name} = {text!r} is no number: give one from {one.low:g} to {one.high:g} "
                f"{one.unit}".rstrip()
            ) from error
    return found


def write_generated(made: Generated, out: Path) -> int:
    """Store windows as Parquet, or as CSV by the end of the name; the number of rows."""
    file = made.served.file
    many, _, length = made.values.shape
    units = {TIME: "s", **{k: v["unit"] for k, v in made.head["conditions"].items()}}
    columns: dict[str, Any] = {
        WINDOW: np.repeat(np.arange(many), length),
        SAMPLE: np.tile(np.arange(length), many),
        TIME: np.tile(np.arange(length) / file.rate_Hz, many),
        **{name: np.full(many * length, value) for name, value in made.conditions.items()},
    }
    for k, (channel, unit) in enumerate(zip(file.channels, file.units, strict=True)):
        columns[channel] = made.values[:, k].ravel()
        units[channel] = unit
    frame = pd.DataFrame(columns)
    with replacing(out) as part:
        if out.suffix == ".parquet":
            _write_parquet(frame, units, made.head, part)
        else:
            _write_csv(frame, units, made.head, part)
    return len(frame)


def _write_parquet(
    frame: pd.DataFrame, units: Mapping[str, str], head: Mapping[str, Any], path: Path
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.Table.from_pandas(frame, preserve_index=False)
    fields = [one.with_metadata({"unit": units.get(one.name, "")}) for one in table.schema]
    schema = pa.schema(fields, metadata={"kerf": json.dumps(head)})
    pq.write_table(table.cast(schema), path, compression="zstd")


def _write_csv(
    frame: pd.DataFrame, units: Mapping[str, str], head: Mapping[str, Any], path: Path
) -> None:
    told = {name: f"{name} [{unit}]" for name, unit in units.items() if unit}
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {head['origin']}: generated, not recorded; {head['trained_on']}\n")
        file.write(f"# {json.dumps(head, ensure_ascii=False)}\n")
        frame.rename(columns=told).to_csv(file, index=False, float_format=f"%.{DIGITS}g")


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
    except (OSError, ValueError, EOFError, zlib.error) as error:
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
