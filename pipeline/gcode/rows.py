"""The columns of :class:`~pipeline.gcode.moves.Moves` while they grow."""

from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import Frame, Moves
from pipeline.gcode.state import State

COLUMNS: dict[str, tuple[type[Any], int]] = {
    "kind": (np.uint8, 0),
    "line": (np.int32, 0),
    "file": (np.int16, 0),
    "end": (np.float64, 6),
    "centre": (np.float64, 3),
    "angle": (np.float64, 0),
    "plane": (np.uint8, 0),
    "feed": (np.float64, 0),
    "feed_mode": (np.uint8, 0),
    "speed": (np.float64, 0),
    "direction": (np.int8, 0),
    "constant_surface_speed": (np.bool_, 0),
    "tool": (np.int32, 0),
    "frame": (np.int32, 0),
    "path_mode": (np.uint8, 0),
    "tolerance": (np.float64, 0),
    "code": (np.int32, 0),
    "value": (np.float64, 0),
}
"""Name -> type, and the length of its second axis (0 where there is none)."""
NO_CENTRE = (np.nan, np.nan, np.nan)


class Rows:
    """Growing columns; ``count`` rows of ``capacity`` are written.

    Parameters
    ----------
    capacity : int
        Rows to make room for (pages that nobody writes to cost no memory).
    """

    def __init__(self, capacity: int) -> None:
        self.count = 0
        self.capacity = max(capacity, 16)
        self.arrays: tuple[npt.NDArray[Any], ...] = tuple(
            np.empty((self.capacity, width) if width else self.capacity, dtype=kind)
            for kind, width in COLUMNS.values()
        )

    def reserve(self, rows: int) -> None:
        """Make room for ``rows`` more."""
        if self.count + rows <= self.capacity:
            return
        self.capacity = max(self.count + rows, self.capacity * 2)
        grown = []
        for array in self.arrays:
            larger = np.empty((self.capacity, *array.shape[1:]), dtype=array.dtype)
            larger[: self.count] = array[: self.count]
            grown.append(larger)
        self.arrays = tuple(grown)

    def append(
        self,
        state: State,
        kind: int,
        line: int,
        *,
        centre: tuple[float, float, float] = NO_CENTRE,
        angle: float = 0.0,
        code: int = 0,
        value: float = 0.0,
    ) -> None:
        """One row more, ending where ``state`` stands."""
        if self.count == self.capacity:
            self.reserve(1)
        row = (
            kind, line, state.file, state.position, centre, angle, state.plane, state.feed,
            state.feed_mode, state.speed if state.direction else 0.0, state.direction,
            state.constant_surface_speed, state.tool, state.frame, state.path_mode,
            state.tolerance, code, value,
        )  # fmt: skip
        count = self.count
        for array, item in zip(self.arrays, row, strict=True):
            array[count] = item
        self.count = count + 1

    def copy(self, other: "Rows", rows: range) -> None:
        """Append rows of another."""
        self.reserve(len(rows))
        for array, source in zip(self.arrays, other.arrays, strict=True):
            array[self.count : self.count + len(rows)] = source[rows.start : rows.stop]
        self.count += len(rows)

    def cut(self, first: int) -> "Rows":
        """Take the rows from ``first`` on away and return them."""
        tail = Rows(self.count - first)
        tail.copy(self, range(first, self.count))
        self.count = first
        return tail

    def moves(
        self, origin: list[float], files: tuple[str, ...], frames: tuple[Frame, ...]
    ) -> Moves:
        """What was written, as :class:`~pipeline.gcode.moves.Moves`."""
        columns: dict[str, Any] = {
            name: array[: self.count] for name, array in zip(COLUMNS, self.arrays, strict=True)
        }
        start = np.array(origin, dtype=np.float64)
        return Moves(origin=start, files=files, frames=frames, **columns)
