"""Generated windows as a file: Parquet or CSV, with units in the columns and the label synthetic.

A row is a sample of a window: ``window`` and ``sample`` count from 0, ``time`` is that in the
window [s], then the conditions and the channels.  What the windows rest on stands in the metadata
of the Parquet, and in the first lines of the CSV.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.files import replacing
from pipeline.submodels.synthesis.model import SYNTHETIC, Synthesis

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
