"""Windows from a table of samples: what the registry's predictor and the command are given."""

from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Ints
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.wear.model import WearModel

PROGRESS = "progress"
"""Column of the use of the tool, in the unit that was learnt."""


def windows_of_table(table: pd.DataFrame, file: WearModel) -> tuple[WearWindows, Ints]:
    """Windows of a table, one after the other, and the window of each row, shape (T,).

    Rows that are too few for a window of their own belong to the last one.
    """
    wanted = [*file.channels, *file.known.numbers, *file.known.words]
    if missing := [name for name in wanted if name not in table.columns]:
        raise ValueError(f"the input has no column {missing[0]!r}: give {', '.join(wanted)}")
    many = len(table) // file.length
    if not many:
        raise ValueError(
            f"the input has {len(table)} rows, a window has {file.length} at {file.rate_Hz:g} Hz: "
            "give at least as many"
        )
    used = table.iloc[: many * file.length]
    samples = used[list(file.channels)].to_numpy(float)
    if not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0]
        raise ValueError(
            f"{file.channels[column]} holds no finite value in row {row + 1}: leave such rows out"
        )
    starts = np.arange(many) * file.length
    conditions: dict[str, Any] = {
        name: used[name].to_numpy(float)[starts] for name in file.known.numbers
    }
    conditions |= {name: used[name].to_numpy(str)[starts] for name in file.known.words}
    for name in file.known.numbers:
        if not np.isfinite(conditions[name]).all():
            raise ValueError(
                f"condition {name} is not known: give it in {file.condition_units[name]}"
            )
    nothing = np.full(many, np.nan)
    progress = used[PROGRESS].to_numpy(float)[starts] if PROGRESS in used.columns else nothing
    windows = WearWindows(
        values=samples.reshape(many, file.length, -1).transpose(0, 2, 1).astype(np.float32),
        channels=file.channels, units=file.units, rate_Hz=file.rate_Hz, wear=nothing,
        wear_unit=file.wear_unit, measured=np.zeros(many, bool), conditions=conditions,
        condition_units={n: file.condition_units[n] for n in file.known.numbers},
        tool=np.full(many, ""), recording=np.full(many, ""), time=starts / file.rate_Hz,
        progress=progress, progress_unit=file.progress_unit,
    )  # fmt: skip
    return windows, np.minimum(np.arange(len(table)) // file.length, many - 1)
