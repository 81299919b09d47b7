"""Traces of the drives: each axis in each recording, measured and modelled."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.sources import Shelf, shown
from pipeline.report.folders import MachineFolders

JUDGED = "drive.json and records of the servo drives"
NAMES = ("axis", "recording", "role")
MOST = 1e12  # in any unit of the shop; a larger number is no reading, and no pixel
CURVES = ("velocity_mm_s", "following_measured_um", "following_modelled_um",
          "command_measured", "command_modelled")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class DriveTrace:
    """One axis in one recording: ``seconds`` (T,), ``values`` (T,) by name, NaN not known."""

    axis: str
    recording: str
    seconds: np.ndarray
    values: dict[str, np.ndarray]


def drive_traces(folders: MachineFolders, shelf: Shelf) -> list[DriveTrace]:
    """The traces of every axis and recording; none where they are absent or broken."""
    path = folders.models / "drive_traces.parquet"
    table = shelf.table(path, (*NAMES, "time_s", *CURVES), JUDGED, all_of=False)
    if table is None:
        return []
    lacking = {"axis", "recording", "time_s"} - set(table.column_names)
    if lacking:
        shelf.broken[shown(path)] = f"has no column {', '.join(sorted(lacking))}"
        return []
    try:
        return _split(table)
    except pa.ArrowException as error:
        shelf.broken[shown(path)] = f"its columns are not those of traces: {error}"
        return []


def _split(table: pa.Table) -> list[DriveTrace]:
    """One trace an axis and recording, in order of time; a row without a time is left out."""
    values = {
        name: readings(pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy())
        for name in ("time_s", *CURVES) if name in table.column_names
    }  # fmt: skip
    words = [pc.fill_null(table.column(n).cast(pa.string()), "").to_pylist() for n in NAMES[:2]]
    places: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(*words, strict=True)):
        if np.isfinite(values["time_s"][row]):
            places.setdefault(key, []).append(row)
    traces = []
    for (axis, recording), rows in sorted(places.items()):
        order = np.array(rows)[np.argsort(values["time_s"][rows], kind="stable")]
        curves = {name: values[name][order] for name in CURVES if name in values}
        traces.append(DriveTrace(axis=axis, recording=recording,
                                 seconds=values["time_s"][order], values=curves))  # fmt: skip
    return traces


def readings(values: np.ndarray) -> np.ndarray:
    """Values (T,) with NaN for what no drive can have shown: infinite or beyond :data:`MOST`."""
    with np.errstate(invalid="ignore"):
        known: np.ndarray = np.where(np.abs(values) <= MOST, values, np.nan)
    return known
