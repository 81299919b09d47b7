"""Path of a program under one control, the same for every feed and spindle speed.

Rows are those of the program's moves; each has a kind of motion, a length, and limits of speed,
acceleration and jerk along the path, with the reason of each limit.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import Moves
from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.arrays import Bools, Floats, Rows

Codes = npt.NDArray[np.uint8]
"""Code of each row, one of the following."""


class Motion(IntEnum):
    """Kind of motion of a row."""

    STILL = 0
    RAPID = 1
    CUTTING = 2
    PER_TURN = 3  # cutting, feed per revolution of the spindle
    INDEPENDENT = 4  # a rapid whose axes each go as fast as they can


class Binding(IntEnum):
    """Limit that keeps a row from being faster."""

    NOTHING = 0  # it does not move
    FEED = 1
    RAPID = 2  # the speed of rapids, by the override
    AXIS_SPEED = 3
    ARC = 4  # centripetal acceleration
    CURVE = 5  # the corners of a curve made of chords
    TOLERANCE = 6
    CORNER = 7  # the jump of speed at one of its ends
    EXACT_STOP = 8  # a standstill at one of its ends
    ACCELERATION = 9  # too short to reach its speed from that of its neighbours


class Halt(IntEnum):
    """Whether the motion before a row must come to a standstill."""

    NONE = 0
    STOPS = 1  # a standstill


@dataclass(frozen=True, kw_only=True)
class Segments:
    """S segments of a path whose corners are blended: rows, or lines that are taken for one."""

    first: Rows = field(repr=False)
    last: Rows = field(repr=False)
    """Rows that a segment begins and ends with."""
    table: Floats = field(repr=False)
    """Segments and corners after them, (14, S); rows as :mod:`pipeline.machine.control.blends`."""


@dataclass(frozen=True, kw_only=True)
class Path:
    """Path of M rows; every array has one entry a row, zero where the row does not move."""

    moves: Moves = field(repr=False)
    """Program that runs along the path."""
    control: ControlParameters
    """Control whose limits hold."""
    motion: Codes = field(repr=False)
    """:class:`Motion`."""
    form: Codes = field(repr=False)
    """STRAIGHT, ROTARY or CURVED of :mod:`pipeline.machine.control.geometry`, of rows that move."""
    length: Floats = field(repr=False)
    """Path length of X, Y, Z [m]; where only rotary axes move, of these [rad]."""
    factor: Floats = field(repr=False)
    """Speed [m/s] (or [rad/s]) for one unit of F, of rapids for an override of 1, of
    ``Motion.PER_TURN`` for one unit of F and 1 rev/min."""
    cap: Floats = field(repr=False)
    """Speed not to be passed, by the axes' speed, arcs, and the corners of curves [m/s]."""
    acceleration: Floats = field(repr=False)
    jerk: Floats = field(repr=False)
    """Acceleration [m/s^2] and jerk [m/s^3] along the path; ``jerk`` is empty for a trapezoid."""
    corner: Floats = field(repr=False)
    """Speed not to be passed at the row's end [m/s]; infinite where it runs on straight."""
    pause: Floats = field(repr=False)
    """Standstill after the row: the filters run empty, and the check of position [s]."""
    reason: Codes = field(repr=False)
    end_reason: Codes = field(repr=False)
    """:class:`Binding` of ``cap`` and of ``corner``."""
    segments: Segments | None = field(default=None, repr=False)
    """Segments of a control that blends its corners; ``corner`` is then 0 or infinite."""

    def __len__(self) -> int:
        return len(self.motion)

    @property
    def moving(self) -> Bools:
        """Flags of rows that move; shape (M,)."""
        return self.motion != Motion.STILL


def where(moves: Moves, row: int) -> str:
    """File and line of a row, as messages name it."""
    return f"{moves.files[moves.file[row]]}:{moves.line[row]}"
