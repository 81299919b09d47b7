"""Moves that a part program commands, one row each, in the machine's frame [mm, deg].

:data:`METRE` and its like are the factors to SI.  A row that does not move (a dwell, an M code)
repeats the position.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, get_args, get_type_hints

import numpy as np
import numpy.typing as npt

AXES = "XYZABC"
METRE = 1e-3
"""Metres in a millimetre."""
RADIAN = np.pi / 180
"""Radians in a degree."""
METRE_PER_SECOND = 1e-3 / 60
"""Metres per second in a millimetre/minute."""
INCH = 25.4
"""Millimetres in an inch."""
IN_PLANE = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""Plane -> indices of its first and second axis, in the order in which arcs turn anticlockwise,
and of its normal."""
INCREMENT = {False: 1e-3, True: 1e-4}
"""Least input increment [mm] and, where the program speaks inches, [inch] (IS-B)."""


class Kind(IntEnum):
    """Kind of a row."""

    RAPID = 0
    FEED = 1
    ARC = 2  # G2, G3: arc, helix, full circles or spiral
    DWELL = 3  # G4: ``value`` seconds (``code`` 0) or revolutions of the spindle (``code`` 1)
    TOOL_CHANGE = 4  # M6: ``tool`` is in the spindle afterwards
    SPINDLE = 5  # M3, M4, M5, M19, or an S word while it rotates
    STOP = 6  # M0, M1
    END = 7  # M2, M30
    M_CODE = 8  # any other M code, ``code`` is its number
    PROBE = 9  # G38, G31: a feed that may end early
    THREAD = 10  # G33 and the passes of G76: a feed bound to the spindle's angle


class FeedMode(IntEnum):
    """Meaning of F."""

    PER_MINUTE = 94  # millimetre/minute (of the rotary axes degree/minute)
    INVERSE_TIME = 93  # 1/minute: the block takes 1/F minutes
    PER_REVOLUTION = 95  # millimetre/revolution of the spindle


class PathMode(IntEnum):
    """Path control mode at the end of a block."""

    CONTINUOUS = 0  # G64: corners as the control rounds them, within ``tolerance`` if > 0
    EXACT_STOP = 1  # G61, G9: standing still at the end
    EXACT_PATH = 2  # G61 of LinuxCNC: through the end, standing still unless it goes straight on


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A work coordinate system in force: machine = rotate(program) + translation."""

    name: str = "G54"
    """``"G54"``, ``"G54.1 P3"``, with what lies on it (``"G54+G92"``)."""
    translation: tuple[float, float, float, float, float, float] = (0, 0, 0, 0, 0, 0)
    """Translation [mm, deg]; offsets, G52, G92 and tool length together."""
    rotation: float = 0.0
    """G68 about the axis normal to the plane [deg]."""


@dataclass(frozen=True, kw_only=True)
class CutterRadius:
    """Radius that a G41 or G42 took of a register."""

    word: str
    """``"G41"`` or ``"G42"``."""
    line: int
    file: int
    """Line and file, as in :class:`Moves`."""
    tool: int
    """Tool in the spindle; -1 before the first tool change."""
    register: int
    """Number of the register."""
    radius: float
    """Radius in the register, wear included [mm]; 0 where the set-up does not have it."""


@dataclass(frozen=True, kw_only=True)
class Moves:
    """M rows; every array has M as its first axis."""

    origin: npt.NDArray[np.float64]
    """Position of the machine before the first row [mm, deg]."""
    kind: npt.NDArray[np.uint8]
    """Kind of each row, :class:`Kind`."""
    line: npt.NDArray[np.int32]
    """Line that the row comes from, counting from 1, in ``files[file]``."""
    file: npt.NDArray[np.int16]
    """Index into ``files`` (subprograms may lie in other files)."""
    end: npt.NDArray[np.float64]
    """X Y Z A B C in the machine's frame [mm, deg], tool length included."""
    centre: npt.NDArray[np.float64]
    """Centre of an arc, in the machine's frame [mm]; its coordinate along the plane's normal is
    that of the start.  NaN in other rows."""
    angle: npt.NDArray[np.float64]
    """Angle an arc sweeps about the normal of its plane, anticlockwise positive, full turns
    included [rad].  Radius goes linearly with the angle from start to end (a spiral where they
    differ), and so do the other axes (a helix).  0 in other rows."""
    plane: npt.NDArray[np.uint8]
    """Plane: 17 (XY), 18 (ZX) or 19 (YZ)."""
    feed: npt.NDArray[np.float64]
    """Feed, as ``feed_mode`` says: [mm/min], [1/min] or [mm/rev]."""
    feed_mode: npt.NDArray[np.uint8]
    """Feed mode, :class:`FeedMode`."""
    speed: npt.NDArray[np.float64]
    """S: [rev/min], or [m/min] where ``constant_surface_speed``; 0 when the spindle stands."""
    direction: npt.NDArray[np.int8]
    """Direction of the spindle: 1 for M3, -1 for M4, 0 when it stands."""
    constant_surface_speed: npt.NDArray[np.bool_]
    """Whether G96 is in force."""
    tool: npt.NDArray[np.int32]
    """Tool in the spindle, after the row; -1 before the first tool change."""
    frame: npt.NDArray[np.int32]
    """Frame of each row, an index into ``frames``."""
    path_mode: npt.NDArray[np.uint8]
    """Path mode, :class:`PathMode`."""
    tolerance: npt.NDArray[np.float64]
    """Tolerance of G64 P [mm]; 0 for the control's own."""
    code: npt.NDArray[np.int32]
    """Number of an M_CODE; 0 for seconds, 1 for revolutions of a DWELL; G code of the canned cycle,
    as 81, of what moves in one."""
    value: npt.NDArray[np.float64]
    """Length of a DWELL [s] or [rev]; P of an M_CODE, or 0."""
    files: tuple[str, ...]
    """The program's file and those of its subprograms."""
    frames: tuple[Frame, ...] = (Frame(),)
    """Work coordinate systems used."""
    cutter_radii: tuple[CutterRadius, ...] = ()
    """Radii of each G41 and G42 that took one of a register, in their order."""
    notices: tuple[str, ...] = ()
    """Notices to the user on the program up to here: words not read, assumptions."""

    def __post_init__(self) -> None:
        for name, array in self.columns():
            if len(array) != len(self.kind):
                raise ValueError(
                    f"{name} has {len(array)} rows, kind has {len(self.kind)}: "
                    "every column of Moves has one row a move"
                )

    def __len__(self) -> int:
        return len(self.kind)

    def columns(self) -> Iterator[tuple[str, npt.NDArray[np.generic]]]:
        """Name and array of each column."""
        return ((name, getattr(self, name)) for name in COLUMNS)

    def part(self, first: int, last: int) -> "Moves":
        """Rows from ``first`` to before ``last``, which begin where the row before them ends."""
        columns: dict[str, Any] = {name: array[first:last] for name, array in self.columns()}
        origin = self.end[first - 1] if first else self.origin
        return replace(self, origin=origin, **columns)

    @property
    def start(self) -> npt.NDArray[np.float64]:
        """Start of each row [mm, deg]; shape (M, 6)."""
        return np.vstack([self.origin, self.end[:-1]]) if len(self) else self.end

    @property
    def length(self) -> npt.NDArray[np.float64]:
        """Path of X, Y, Z in each row [mm]; shape (M,).  Of a spiral to 1e-12 of it."""
        step = self.end[:, :3] - self.start[:, :3]
        length = np.sqrt((step**2).sum(axis=1))
        arcs = np.flatnonzero(self.kind == Kind.ARC)
        if len(arcs):
            length[arcs] = self._arc_length(arcs, step[arcs])
        return length

    def _arc_length(
        self, rows: npt.NDArray[np.intp], step: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        normal = _AXES[self.plane[rows], 2]
        axial = np.take_along_axis(step, normal[:, None], axis=1)[:, 0]
        r_0, r_1 = self.radii(rows)
        # ds² = (r² + r'² + h²) dφ² with r linear in φ: Gauss-Legendre, exact for r constant
        angle = np.abs(self.angle[rows])
        slope = np.divide(r_1 - r_0, angle, out=np.zeros_like(angle), where=angle > 0)
        pitch = np.divide(axial, angle, out=np.zeros_like(angle), where=angle > 0)
        x, w = np.polynomial.legendre.leggauss(16)
        r = r_0[:, None] + (r_1 - r_0)[:, None] * (x + 1) / 2
        speed = np.sqrt(r**2 + slope[:, None] ** 2 + pitch[:, None] ** 2)
        return angle * (speed @ w) / 2

    def radii(
        self, rows: npt.NDArray[np.intp]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Radius at the start and at the end of the arcs ``rows`` [mm]."""
        first, second, _ = _AXES[self.plane[rows]].T
        index = np.arange(len(rows))
        ends = []
        for point in (self.start[rows], self.end[rows]):
            u = point[index, first] - self.centre[rows][index, first]
            v = point[index, second] - self.centre[rows][index, second]
            ends.append(np.hypot(u, v))
        return ends[0], ends[1]


_AXES = np.zeros((20, 3), dtype=np.intp)
_AXES[list(IN_PLANE)] = list(IN_PLANE.values())

_WIDTHS = {"end": 6, "centre": 3}
COLUMNS: dict[str, tuple[type[Any], int]] = {
    name: (get_args(get_args(hint)[1])[0], _WIDTHS.get(name, 0))
    for name, hint in get_type_hints(Moves).items()
    if name not in ("origin", "files", "frames", "cutter_radii", "notices")
}
"""Name -> type, and the length of its second axis (0 where there is none)."""
NO_CENTRE = (np.nan, np.nan, np.nan)


class Rows:
    """Growing columns of ``count`` rows; unwritten pages cost no memory, and hold zeros."""

    def __init__(self, capacity: int) -> None:
        self.count = 0
        self.capacity = max(capacity, 16)
        self.arrays: dict[str, npt.NDArray[Any]] = {
            name: np.zeros((self.capacity, width) if width else self.capacity, dtype=kind)
            for name, (kind, width) in COLUMNS.items()
        }

    def reserve(self, rows: int) -> None:
        """Grow the columns for ``rows`` more."""
        if self.count + rows <= self.capacity:
            return
        self.capacity = max(self.count + rows, self.capacity * 2)
        for name, array in self.arrays.items():
            larger = np.zeros((self.capacity, *array.shape[1:]), dtype=array.dtype)
            larger[: self.count] = array[: self.count]
            self.arrays[name] = larger

    def append(self, row: tuple[Any, ...]) -> None:
        """One row more: a value for each of :data:`COLUMNS`, in their order."""
        if self.count == self.capacity:
            self.reserve(1)
        count = self.count
        for array, item in zip(self.arrays.values(), row, strict=True):
            array[count] = item
        self.count = count + 1

    def cut(self, first: int) -> "Rows":
        """Take the rows from ``first`` on away and return them."""
        tail = Rows(0)
        tail.arrays = {
            name: array[first : self.count].copy() for name, array in self.arrays.items()
        }
        tail.count = tail.capacity = self.count - first
        self.count = first
        return tail

    def moves(
        self, origin: list[float], files: tuple[str, ...], frames: tuple[Frame, ...],
        cutter_radii: tuple[CutterRadius, ...] = (),
    ) -> Moves:  # fmt: skip
        """Rows written so far, as :class:`Moves`."""
        columns: dict[str, Any] = {name: a[: self.count] for name, a in self.arrays.items()}
        start = np.array(origin, dtype=np.float64)
        return Moves(origin=start, files=files, frames=frames, cutter_radii=cutter_radii, **columns)
