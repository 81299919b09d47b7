"""Traces of the cut: the mean revolution of each recording, measured and modelled."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.bands import readings
from pipeline.charts.sources import Shelf, shown
from pipeline.report.folders import MachineFolders

JUDGED = "cutting.json and recordings of forces"
AXES = ("x", "y", "z")
KINDS = ("measured", "low", "high", "modelled", "plain")
CURVES = tuple(f"{kind}_{axis}" for kind in KINDS for axis in AXES)


@dataclass(frozen=True, kw_only=True)
class CutTrace:
    """One mean revolution: ``angle`` [deg] (T,) ascending, ``values`` [N] (T,) by name."""

    recording: str
    angle: np.ndarray
    values: dict[str, np.ndarray]

    def known(self, kind: str, axis: str) -> np.ndarray | None:
        """A curve (T,); None where it is absent or nowhere known."""
        values = self.values.get(f"{kind}_{axis}")
        return values if values is not None and np.isfinite(values).any() else None

    @property
    def axes(self) -> list[str]:
        """Components with a measured and a modelled curve."""
        return [a for a in AXES if all(self.known(k, a) is not None for k in KINDS[::3])]


def cut_traces(folders: MachineFolders, shelf: Shelf) -> list[CutTrace]:
    """The traces by recording; none where they are absent or broken."""
    path = folders.models / "cutting_traces.parquet"
    table = shelf.table(path, ("recording", "angle_deg", *CURVES), JUDGED, all_of=False)
    if table is None:
        return []
    lacking = {"recording", "angle_deg"} - set(table.column_names)
    if lacking:
        shelf.broken[shown(path)] = f"has no column {', '.join(sorted(lacking))}"
        return []
    try:
        return _split(table)
    except pa.ArrowException as error:
        shelf.broken[shown(path)] = f"its columns are not those of traces: {error}"
        return []


def _split(table: pa.Table) -> list[CutTrace]:
    """One trace a recording, by angle; a row without an angle is left out."""
    values = {
        name: readings(pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy())
        for name in ("angle_deg", *CURVES) if name in table.column_names
    }  # fmt: skip
    angle = values.pop("angle_deg")
    recordings = pc.fill_null(table.column("recording").cast(pa.string()), "").to_pylist()
    places: dict[str, list[int]] = {}
    for row, recording in enumerate(recordings):
        if np.isfinite(angle[row]):
            places.setdefault(recording, []).append(row)
    traces = []
    for recording, rows in sorted(places.items()):
        order = np.array(rows)[np.argsort(angle[rows], kind="stable")]
        curves = {name: v[order] for name, v in values.items()}
        traces.append(CutTrace(recording=recording, angle=angle[order], values=curves))
    return traces
