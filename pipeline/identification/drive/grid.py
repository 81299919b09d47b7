"""Rows of a recorder on a uniform grid: what time stamps of real records make of it.

A row whose stamp repeats that of the row before belongs in the gap behind it, if there is one, and
is a copy otherwise.  Missing rows are filled by straight lines up to ``BRIDGE`` of them, marked as
filled; a longer gap, or a clock that jumps back, ends the piece.  Stamps that stray from the grid
by less than ``JITTER`` of a period are rounding: their rows are taken as if evenly spaced.  Where
they stray more, the samples themselves were taken unevenly and are interpolated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Whole = NDArray[np.int64]

BRIDGE = 3
"""Rows that may be missing in a row."""
JITTER = 0.1
"""Stray of time stamps (standard deviation) that counts as rounding, in periods."""
COARSE = 0.1
"""Share of repeated stamps from which on the clock ticks slower than the rows come."""
SHORTEST = 32
"""Rows of a piece; what is shorter is left out."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One stretch of rows on a grid of T places.

    Parameters
    ----------
    start : float
        Time of the first place [s].
    period : float
        From place to place [s].
    rows : ndarray of int, shape (R,)
        Rows of the record that stand in it.
    places : ndarray, shape (R,)
        Where each stands on the grid, in periods; whole numbers where stamps are only rounded.
    """

    start: float
    period: float
    rows: Whole
    places: Floats

    @property
    def samples(self) -> int:
        """T."""
        return int(np.floor(self.places[-1] + 1e-9)) + 1

    @property
    def filled(self) -> Flags:
        """Places without a row within half a period; shape (T,)."""
        known = np.zeros(self.samples, bool)
        near = np.rint(self.places).astype(np.int64)
        known[np.clip(near, 0, self.samples - 1)] = True
        return ~known

    def on_grid(self, values: Floats) -> Floats:
        """Values of all rows of the record, on the grid; shape (T,)."""
        resampled: Floats = np.interp(np.arange(self.samples), self.places, values[self.rows])
        return resampled


def sampling_period(t: Floats) -> float:
    """Period of the samples [s], from their stamps; shape (N,) of ``t``, N at least 2.

    Raises
    ------
    ValueError
        When no stamp is later than the one before.
    """
    steps = np.diff(t)
    forward = steps[steps > 0]
    if not len(forward):
        raise ValueError("its time never goes forward")
    if np.mean(steps == 0) > COARSE:  # several rows share each tick of the clock
        return float(forward.sum() / np.count_nonzero(steps >= 0))
    return float(np.median(forward))


def uniform_pieces(t: Floats) -> list[Piece]:
    """Pieces of a record on uniform grids, and what stands between them left out.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Time stamps [s], in the order of the rows.

    Raises
    ------
    ValueError
        When the stamps tell no period.
    """
    if len(t) < SHORTEST:
        raise ValueError(f"it has {len(t)} rows, {SHORTEST} are the least that tell anything")
    period = sampling_period(t)
    if np.mean(np.diff(t) == 0) > COARSE:
        t = t[0] + period * np.arange(len(t))  # evenly spaced below the clock's tick
    steps = np.rint(np.diff(t) / period).astype(np.int64)
    cuts = np.flatnonzero((steps < 0) | (steps > BRIDGE + 1)) + 1
    pieces = [
        _piece(t, rows, period) for rows in np.split(np.arange(len(t)), cuts) if len(rows) > 1
    ]
    return [piece for piece in pieces if len(piece.rows) >= SHORTEST]


def _piece(t: Floats, rows: Whole, period: float) -> Piece:
    """The rows from one gap to the next on their grid, of the period that fits their stamps."""
    steps = np.rint(np.diff(t[rows]) / period).astype(np.int64)
    late = np.flatnonzero((steps[:-1] == 0) & (steps[1:] > 1))
    steps[late] += 1  # its stamp repeats, the gap behind it is its own
    steps[late + 1] -= 1
    kept = np.r_[True, steps > 0]
    places = np.r_[0, np.cumsum(steps)][kept].astype(np.float64)
    stamps = t[rows[kept]]
    if len(places) < 2:
        return Piece(start=float(t[rows[0]]), period=period, rows=rows[kept], places=places)
    slope, start = np.polyfit(places, stamps, 1)
    stray = (stamps - start - slope * places) / slope
    if np.std(stray) > JITTER:
        even = (stamps - stamps[0]) / slope
        forward = np.r_[True, np.diff(even) > 0]
        return Piece(
            start=float(stamps[0]), period=float(slope), rows=rows[kept][forward],
            places=even[forward],
        )  # fmt: skip
    return Piece(start=float(start), period=float(slope), rows=rows[kept], places=places)
