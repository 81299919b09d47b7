"""Modal state: what stays in force from block to block, and where the machine stands.

Lengths are in mm, as in :mod:`pipeline.gcode.moves`, whatever the program speaks.  G codes are kept
ten times their number, so that G38.2 is 382 and every code is an integer.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import FeedMode, PathMode

FANUC, LINUXCNC, SIEMENS = range(3)
"""Values of ``State.dialect``."""
DIALECTS = ("fanuc", "linuxcnc", "siemens")
CANCELLED = 800
"""``State.motion`` after G80 where that leaves no motion in force (LinuxCNC)."""

FLOATS = ("feed", "speed", "tolerance", "unit")
"""Scalars behind the 6 of ``position`` and the 6 of ``translation`` in :meth:`State.to_arrays`."""
INTS = (
    "dialect", "motion", "plane", "absolute", "arc_absolute", "feed_mode", "path_mode",
    "direction", "constant_surface_speed", "tool", "selected", "frame", "file", "wcs",
    "compensation", "transformed",
)  # fmt: skip
"""Order of the integers of :meth:`State.to_arrays`."""

POSITION, TRANSLATION, FEED, SPEED, TOLERANCE, UNIT = 0, 6, 12, 13, 14, 15
"""Where they stand in the floats of :meth:`State.to_arrays`."""
(
    DIALECT, MOTION, PLANE, ABSOLUTE, ARC_ABSOLUTE, FEED_MODE, PATH_MODE,
    DIRECTION, CONSTANT_SURFACE_SPEED, TOOL, SELECTED, FRAME, FILE, WCS,
    COMPENSATION, TRANSFORMED,
) = range(16)  # fmt: skip


@dataclass(slots=True, kw_only=True)
class State:
    """What is in force between two blocks.

    Parameters
    ----------
    position : list of 6 floats
        X Y Z A B C of the machine [mm, deg].
    translation : list of 6 floats
        Machine = program + translation, where ``transformed`` is 0 [mm, deg].
    feed : float
        F [mm/min], [1/min] or [mm/rev] as ``feed_mode`` says; 0 before the first.
    speed : float
        S [rev/min] or [m/min], kept while the spindle stands.
    tolerance : float
        P of G64 [mm].
    unit : float
        Millimetres in the program's unit of length: 1 (G21) or 25.4 (G20).
    dialect : int
        ``FANUC``, ``LINUXCNC`` or ``SIEMENS``.
    motion : int
        Ten times the G code of group 1 (0, 10, 20, 30, 330, 382, a cycle, ``CANCELLED``).
    plane : int
        17, 18 or 19.
    absolute, arc_absolute : int
        1 for G90 (G90.1), 0 for G91 (G91.1).
    feed_mode : int
        93, 94 or 95.
    path_mode : int
        :class:`~pipeline.gcode.moves.PathMode`.
    direction : int
        Of the spindle: 1 for M3, -1 for M4, 0 standing.
    constant_surface_speed : int
        1 for G96.
    tool, selected : int
        In the spindle (-1 before the first) and asked for by T (-1 before the first).
    frame : int
        Index of the frame in force in ``Moves.frames``.
    file : int
        Index of the file being read.
    wcs : int
        Ten times the G code of the work coordinate system in force (540 to 593, 541 for G54.1).
    compensation : int
        0 for G40, 41 or 42 (cutter radius compensation left, right).
    transformed : int
        1 when positions are more than program + translation: rotation, scaling, mirror, polar
        coordinates, diameter programming, or a modal macro call.
    """

    position: list[float] = field(default_factory=lambda: [0.0] * 6)
    translation: list[float] = field(default_factory=lambda: [0.0] * 6)
    feed: float = 0.0
    speed: float = 0.0
    tolerance: float = 0.0
    unit: float = 1.0
    dialect: int = FANUC
    motion: int = 0
    plane: int = 17
    absolute: int = 1
    arc_absolute: int = 0
    feed_mode: int = FeedMode.PER_MINUTE
    path_mode: int = PathMode.CONTINUOUS
    direction: int = 0
    constant_surface_speed: int = 0
    tool: int = -1
    selected: int = -1
    frame: int = 0
    file: int = 0
    wcs: int = 540
    compensation: int = 0
    transformed: int = 0

    def to_arrays(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Floats (16,) and integers (16,) for a compiled loop; ``FEED``, ``MOTION``… name them."""
        floats = [*self.position, *self.translation, *(getattr(self, name) for name in FLOATS)]
        integers = [int(getattr(self, name)) for name in INTS]
        return np.array(floats, dtype=np.float64), np.array(integers, dtype=np.int64)

    def from_arrays(self, floats: npt.NDArray[np.float64], integers: npt.NDArray[np.int64]) -> None:
        """Take back what :meth:`to_arrays` gave."""
        values = floats.tolist()
        self.position, self.translation = values[POSITION:TRANSLATION], values[TRANSLATION:FEED]
        for name, value in zip(FLOATS, values[FEED:], strict=True):
            setattr(self, name, value)
        for name, integer in zip(INTS, integers.tolist(), strict=True):
            setattr(self, name, integer)
