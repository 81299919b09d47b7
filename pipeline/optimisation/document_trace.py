"""The load along the way at feed, in columns that keep the highest value."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

COLUMNS = 900
"""Of equal way; about as many as a page has pixels."""
MM = 1e3


def load_trace(cut: Cut, columns: int = COLUMNS) -> dict[str, Any]:
    """Highest load in each column of the way at feed.

    The way does not depend on F and S, so that columns of a program before and after belong to the
    same places.  A station counts in every column that it lies in.

    Returns
    -------
    dict
        ``total_mm``; ``way_mm`` where each column begins; ``load_N``, None in air; ``line`` of the
        program there: lists of ``columns`` values.
    """
    pieces, found = cut.path.pieces, cut.engagement
    begin, total = _way(cut)
    scale = columns / max(total, 1e-12)
    kept = found.feed
    start = begin[found.piece[kept]] + found.along[kept]
    low = np.clip((start * scale).astype(np.intp), 0, columns - 1)
    end = (start + found.length[kept]) * scale
    high = np.clip(np.ceil(end - 1e-9).astype(np.intp) - 1, low, columns - 1)
    load = np.full(columns, -np.inf)
    station, column = _spread(low, high)
    np.maximum.at(load, column, cut.station_loads.peak[kept][station])
    edges = np.arange(columns) / scale
    fed = np.flatnonzero(pieces.feed)
    place = np.searchsorted(begin[fed], edges + 1e-12, side="right") - 1 if len(fed) else fed
    line = cut.plan.path.moves.line[pieces.block[fed[np.maximum(place, 0)]]] if len(fed) else place
    return {
        "total_mm": round(total * MM, 3),
        "way_mm": [round(v, 3) for v in (edges * MM).tolist()],
        "load_N": [float(f"{v:.4g}") if np.isfinite(v) else None for v in load.tolist()],
        "line": line.tolist(),
    }


def tool_spans(cut: Cut) -> list[list[float]]:
    """[number, start, end] of each stretch of one tool, as shares of the way at feed."""
    begin, total = _way(cut)
    pieces = cut.path.pieces
    fed = np.flatnonzero(pieces.feed)
    if not len(fed) or total <= 0:
        return []
    tool = pieces.tool[fed]
    edges = np.flatnonzero(np.diff(tool, prepend=tool[0] - 1))
    ends = [*(begin[fed[edges[1:]]] / total).tolist(), 1.0]
    return [
        [cut.numbers[int(tool[k])], round(float(begin[fed[k]] / total), 5), round(end, 5)]
        for k, end in zip(edges.tolist(), ends, strict=True)
    ]


def _way(cut: Cut) -> tuple[Floats, float]:
    """Way at feed before each piece, shape (Q,), and in all [m]."""
    pieces = cut.path.pieces
    length = np.where(pieces.feed, pieces.length, 0.0)
    gone = np.cumsum(length)
    return gone - length, float(gone[-1]) if len(gone) else 0.0


def _spread(low: Rows, high: Rows) -> tuple[Rows, Rows]:
    """Each station once for every column that it lies in: station, column."""
    count = high - low + 1
    station = np.repeat(np.arange(len(low)), count)
    inside = np.arange(len(station)) - np.repeat(np.cumsum(count) - count, count)
    return station, low[station] + inside
