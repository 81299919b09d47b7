"""What a cut does over its program's time, in columns that keep lowest and highest values."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.charts.numbers import real
from pipeline.charts.sources import dig

Floats = np.ndarray

BANDS = ("load_N", "axial_depth_mm", "radial_depth_mm")
"""Quantities of which a column holds the lowest and the highest value."""


@dataclass(frozen=True, kw_only=True)
class CutTrace:
    """N columns of equal time; NaN where nothing is cut.

    Parameters
    ----------
    total : float
        Time of the program [s].
    low, high : dict of str to array (N,)
        Lowest and highest value in each column, by the names of :data:`BANDS`.
    entry, exit : array (N,)
        Least angle of entry and greatest of exit [deg].
    tools : list of (number, start, end)
        Spans of one tool as shares of the time [1].
    """

    total: float
    low: dict[str, Floats]
    high: dict[str, Floats]
    entry: Floats
    exit: Floats
    tools: list[tuple[int, float, float]]

    def __len__(self) -> int:
        return len(self.entry)

    @property
    def cut(self) -> Floats:
        """Which columns cut; shape (N,)."""
        found: Floats = np.isfinite(self.entry)
        return found


def cut_trace(document: dict[str, Any]) -> CutTrace | None:
    """The trace of a document of ``kerf simulate``; None when it has none that can be drawn."""
    found = dig(document, "cut", "trace")
    total = real(dig(found, "total_s"))
    entry = _column(dig(found, "entry_deg"))
    if total is None or total <= 0 or not np.isfinite(entry).any():
        return None
    low = {name: _column(dig(found, f"{name}_low")) for name in BANDS}
    high = {name: _column(dig(found, f"{name}_high")) for name in BANDS}
    leave = _column(dig(found, "exit_deg"))
    if any(len(c) != len(entry) for c in (*low.values(), *high.values(), leave)):
        return None
    return CutTrace(
        total=total, low=low, high=high, entry=entry, exit=leave, tools=_tools(dig(found, "tools"))
    )


def _column(values: Any) -> Floats:
    known = values if isinstance(values, list) else []
    return np.array([np.nan if real(v) is None else float(v) for v in known])


def _tools(spans: Any) -> list[tuple[int, float, float]]:
    known = spans if isinstance(spans, list) else []
    return [
        (int(number), float(start), float(end))
        for number, start, end in (s for s in known if isinstance(s, list) and len(s) == 3)
        if None not in (real(number), real(start), real(end))
    ]
