"""The cut over its program's time, in columns that keep lowest and highest values."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.twin.cut import Cut
from pipeline.twin.cut_stations import Stations

Floats = NDArray[np.float64]

COLUMNS = 900
"""Of equal time; about as many as a page has pixels."""


def cut_trace(cut: Cut, arcs: Stations, columns: int = COLUMNS) -> dict[str, Any]:
    """Lowest and highest load, depths and arc in each column of time.

    A station counts in every column that it lies in, so that neither a short peak nor a long
    stretch is lost.

    Returns
    -------
    dict
        ``total_s``; ``load_N``, ``axial_depth_mm``, ``radial_depth_mm``, each with ``_low`` and
        ``_high``; ``entry_deg``, ``exit_deg``: lists of ``columns`` values, None in air; ``tools``:
        [number, start, end] as shares of the time.
    """
    plan, found = cut.plan, cut.engagement
    total = plan.total
    begin = np.concatenate([[0.0], np.cumsum(plan.time)])[:-1]
    pieces = cut.path.pieces
    before = np.cumsum(pieces.length) - pieces.length
    first = np.searchsorted(pieces.block, np.arange(found.blocks))
    gone = before - before[np.minimum(first, len(pieces) - 1)][pieces.block]
    whole = np.bincount(pieces.block, pieces.length, minlength=found.blocks)
    share = (gone[found.piece] + found.along) / np.maximum(whole[found.block], 1e-12)
    start = begin[found.block] + share * plan.motion.time[found.block]
    scale = columns / max(total, 1e-12)
    low = np.clip((start * scale).astype(np.intp), 0, columns - 1)
    high = np.clip(((start + cut.in_material) * scale).astype(np.intp), low, columns - 1)
    kept = found.feed
    place = _spread(low[kept], high[kept])
    document: dict[str, Any] = {"total_s": round(total, 3)}
    for name, values in (
        ("load_N", cut.station_loads.peak),
        ("axial_depth_mm", found.axial_depth * 1e3),
        ("radial_depth_mm", arcs.radial * 1e3),
    ):
        many = values[kept][place[0]]
        document[f"{name}_low"] = _column(np.minimum, many, place[1], columns)
        document[f"{name}_high"] = _column(np.maximum, many, place[1], columns)
    for name, function, values in (
        ("entry_deg", np.minimum, arcs.entry),
        ("exit_deg", np.maximum, arcs.exit),
    ):
        many = np.degrees(values[kept][place[0]])
        document[name] = _column(function, many, place[1], columns)
    return document | {"tools": _tools(cut, begin, total)}


def _spread(low: NDArray[np.intp], high: NDArray[np.intp]) -> tuple[NDArray[np.intp], ...]:
    """Each station once for every column that it lies in: station, column."""
    count = high - low + 1
    station = np.repeat(np.arange(len(low)), count)
    inside = np.arange(len(station)) - np.repeat(np.cumsum(count) - count, count)
    return station, low[station] + inside


def _column(
    function: np.ufunc, values: Floats, place: NDArray[np.intp], columns: int
) -> list[float | None]:
    out = np.full(columns, np.inf if function is np.minimum else -np.inf)
    function.at(out, place, values)
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in out.tolist()]


def _tools(cut: Cut, begin: Floats, total: float) -> list[list[float]]:
    tool = cut.plan.path.moves.tool
    edges = np.flatnonzero(np.diff(tool, prepend=tool[0] - 1 if len(tool) else 0))
    ends = [*(begin[edges[1:]] / total).tolist(), 1.0]
    return [
        [int(tool[row]), round(float(begin[row] / total), 5), round(end, 5)]
        for row, end in zip(edges.tolist(), ends, strict=True) if tool[row] >= 0
    ]  # fmt: skip
