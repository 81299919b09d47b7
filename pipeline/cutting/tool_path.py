"""The way of the tool through its stock: straight pieces, in the stock's frame."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolPath:
    """Q straight pieces, in the order in which they are cut; the tool's axis is parallel to z.

    Arcs come as chords.  The same pieces hold whatever F and S are.

    Parameters
    ----------
    start, end : ndarray, shape (Q, 3)
        Of the tool's tip [m].
    block : ndarray of int32, shape (Q,)
        Which block of the program each belongs to, never falling.
    tool : ndarray of int32, shape (Q,)
        Index into the tools that go with the path.
    feed : ndarray of bool, shape (Q,)
        Whether it moves at feed; False for rapids.
    direction : ndarray of int8, shape (Q,)
        Of the spindle: 1 clockwise seen from above (M3), -1 anticlockwise (M4), 0 when it stands.
    """

    start: Floats
    end: Floats
    block: Indices
    tool: Indices
    feed: NDArray[np.bool_]
    direction: NDArray[np.int8]

    def __post_init__(self) -> None:
        for item in fields(self):
            if len(getattr(self, item.name)) != len(self.start):
                raise ValueError(
                    f"tool path: {item.name} has {len(getattr(self, item.name))} rows, start has "
                    f"{len(self.start)}: each piece has one"
                )
        if not (np.isfinite(self.start).all() and np.isfinite(self.end).all()):
            raise ValueError("tool path: a position is not finite")

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> Floats:
        """Of each piece [m]; shape (Q,)."""
        length: Floats = np.linalg.norm(self.end - self.start, axis=1)
        return length
