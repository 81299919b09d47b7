"""Facts about the spindle's thermal model: parameters, judgement on the golden week, curves."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.sources import Shelf, dig
from pipeline.report.folders import MachineFolders
from pipeline.report.reading import NS, nanoseconds

CURVES = ("measured", "model_window", "model_free")


@dataclass(frozen=True, kw_only=True)
class Curves:
    """One golden day: ``seconds`` of the day (T,), ``values`` [°C] (T,) by name, NaN not known."""

    day: str
    seconds: np.ndarray
    values: dict[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Modelled:
    """What is known of the model; None where the file that would say it is absent."""

    thermal: dict[str, Any] | None
    residual: dict[str, Any] | None
    validation: dict[str, Any] | None
    golden: dict[str, Any] | None
    truth: dict[str, Any] | None
    curves: list[Curves]

    @property
    def golden_days(self) -> list[str]:
        """Days of the golden week, first to last, as frozen or else as judged."""
        week = dig(self.golden, "week") or dig(self.validation, "golden")
        ends = (dig(week, "from") or dig(week, "first"), dig(week, "to") or dig(week, "last"))
        try:
            first, last = (np.datetime64(str(end)[:10], "D") for end in ends)
        except ValueError:
            return []
        return [str(d) for d in np.arange(first, last + 1)]

    @property
    def training_days(self) -> list[str]:
        """Days that the parameters were found from."""
        days = dig(self.thermal, "training_days")
        return [str(d)[:10] for d in days] if isinstance(days, list) else []

    @property
    def leaked_days(self) -> list[str]:
        """Days that stand both in training and in the golden week."""
        return sorted(set(self.training_days) & set(self.golden_days))


def modelled(folders: MachineFolders, shelf: Shelf) -> Modelled:
    """What the model's files, the golden week and, if simulated, the truth say."""
    clean = "data/clean state table of the training days"
    judged = "the model and the golden week’s state table"
    models = folders.models
    return Modelled(
        thermal=shelf.document(models / "spindle_thermal.json", clean),
        residual=shelf.document(models / "residual" / "features.json", clean),
        validation=shelf.document(models / "validation.json", judged),
        golden=shelf.document(folders.golden, "the raw files of that week, frozen by hash"),
        truth=_truth(folders, shelf),
        curves=_curves(folders, shelf, judged),
    )


def _truth(folders: MachineFolders, shelf: Shelf) -> dict[str, Any] | None:
    if folders.truth is None:
        return None
    return shelf.document(folders.truth, "the simulated shop floor")


def spindle_prefix(validation: dict[str, Any] | None) -> str:
    """Which spindle the judged temperature is of, as the prefix of the canonical names."""
    signal = str(dig(validation, "signal") or "")
    return "second_" if signal.startswith("second_") else ""


def _curves(folders: MachineFolders, shelf: Shelf, made_from: str) -> list[Curves]:
    path = folders.models / "predictions.parquet"
    table = shelf.table(path, ("time", "day", *CURVES), made_from, all_of=False)
    if table is None or not {"time", "measured"} <= set(table.column_names):
        return []
    whole = nanoseconds(table.column("time")) / NS
    values = {
        name: pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy()
        for name in CURVES if name in table.column_names
    }  # fmt: skip
    days = np.floor(whole / 86_400)
    found = []
    for number in np.unique(days):
        here = days == number
        day = str(np.datetime64(int(number), "D"))
        of_day = {name: v[here] for name, v in values.items()}
        found.append(Curves(day=day, seconds=whole[here] - number * 86_400, values=of_day))
    return found
