"""Modal state and modal groups of a control, and its work coordinate systems; lengths in mm.

G codes are kept ten times their number, so that G38.2 is 382 and every code is an integer.  The
transformation from a program's coordinates to the machine's is

    machine = R_w (R_68 (S (p)) + G92 + G52) + work offset + external offset + tool length,

where S scales or mirrors (G51, G51.1) about its centre, R_68 rotates (G68) about its centre and R_w
is the rotation that LinuxCNC keeps with a work offset (G10 L2 R).  Sources: ISO 6983-1; Fanuc 0i-F
operator's manual B-64694EN (group numbers of machining centres); LinuxCNC 2.9 "G-code overview",
tables of modal groups and "order of execution".
"""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import IN_PLANE, FeedMode, Frame, PathMode
from pipeline.gcode.setup import ZERO

FANUC, LINUXCNC, SIEMENS = range(3)
"""Values of ``State.dialect``."""
DIALECTS = ("fanuc", "linuxcnc", "siemens")
CANCELLED = 800
"""Value of ``State.motion`` after G80 where no motion is in force (LinuxCNC)."""

INTS = ("dialect", "motion", "plane", "absolute", "arc_absolute")
"""Fields that a compiled loop reads as integers, in the order of :meth:`State.to_arrays`."""
POSITION, TRANSLATION, FEED, UNIT = 0, 6, 12, 13
"""Indices of the floats of :meth:`State.to_arrays`."""
DIALECT, MOTION, PLANE, ABSOLUTE, ARC_ABSOLUTE = range(len(INTS))


@dataclass(slots=True, kw_only=True)
class State:
    """Modal state between two blocks."""

    position: list[float] = field(default_factory=lambda: [0.0] * 6)
    """X Y Z A B C of the machine [mm, deg]."""
    translation: list[float] = field(default_factory=lambda: [0.0] * 6)
    """Machine = program + translation, where ``transformed`` is 0 [mm, deg]."""
    feed: float = 0.0
    """F [mm/min], [1/min] or [mm/rev] as ``feed_mode`` says; 0 before the first."""
    speed: float = 0.0
    """S [rev/min] or [m/min], kept while the spindle stands."""
    tolerance: float = 0.0
    """Tolerance, P of G64 [mm]."""
    unit: float = 1.0
    """Millimetres in the program's unit of length: 1 (G21) or 25.4 (G20)."""
    dialect: int = FANUC
    """Dialect: ``FANUC``, ``LINUXCNC`` or ``SIEMENS``."""
    motion: int = 0
    """Ten times the G code of group 1 (0, 10, 20, 30, 330, 382, a cycle, ``CANCELLED``)."""
    plane: int = 17
    """Plane: 17, 18 or 19."""
    absolute: int = 1
    arc_absolute: int = 0
    """1 for G90 (G90.1), 0 for G91 (G91.1)."""
    feed_mode: int = FeedMode.PER_MINUTE
    """Feed mode: 93, 94 or 95."""
    path_mode: int = PathMode.CONTINUOUS
    """:class:`~pipeline.gcode.moves.PathMode`."""
    direction: int = 0
    """Direction of the spindle: 1 for M3, -1 for M4, 0 standing."""
    constant_surface_speed: int = 0
    """Constant surface speed: 1 for G96."""
    tool: int = -1
    selected: int = -1
    """Tool in the spindle (-1 before the first) and selected by T (-1 before the first)."""
    frame: int = 0
    """Index of the frame in force in ``Moves.frames``."""
    file: int = 0
    """Index of the file being read."""
    wcs: int = 540
    """Ten times the G code of the work coordinate system in force (540 to 593, 541 for G54.1)."""
    cutter_compensation: int = 0
    """0 for G40, 41 or 42 (cutter radius compensation left, right)."""
    transformed: int = 0
    """1 when positions are more than program + translation: rotation, scaling, mirror, polar
    coordinates, diameter programming, or a modal macro call."""

    def to_arrays(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Floats (14,) and integers (5,) for a compiled loop; ``FEED``, ``MOTION``… name them."""
        floats = [*self.position, *self.translation, self.feed, self.unit]
        integers = [int(getattr(self, name)) for name in INTS]
        return np.array(floats, dtype=np.float64), np.array(integers, dtype=np.int64)

    def from_arrays(self, floats: npt.NDArray[np.float64], integers: npt.NDArray[np.int64]) -> None:
        """Take back what :meth:`to_arrays` gave."""
        values = floats.tolist()
        self.position, self.translation = values[POSITION:TRANSLATION], values[TRANSLATION:FEED]
        self.feed, self.unit = values[FEED:]
        for name, integer in zip(INTS, integers.tolist(), strict=True):
            setattr(self, name, integer)


ALL_DIALECTS = frozenset({"fanuc", "linuxcnc", "siemens"})
FANUC_ONLY = frozenset({"fanuc"})
LINUXCNC_ONLY = frozenset({"linuxcnc"})
SIEMENS_ONLY = frozenset({"siemens"})


@dataclass(frozen=True, kw_only=True)
class Group:
    """Codes of which one is in force."""

    codes: tuple[int, ...]
    """G codes of the group, times ten."""
    step: int
    """When a block carries them out, small first: LinuxCNC's order, which is Fanuc's too where the
    order matters."""
    default: int | None = None
    """G code in force when the control is switched on; 0 in groups without one is G0."""
    dialects: frozenset[str] = ALL_DIALECTS
    """Dialects that have the group."""


GROUPS: dict[str, Group] = {
    "units": Group(codes=(200, 210), step=5, default=210),
    "units of Siemens": Group(
        codes=(700, 710, 7000, 7100), step=5, default=710, dialects=SIEMENS_ONLY
    ),
    "feed_mode": Group(codes=(930, 940, 950), step=10, default=940),
    "spindle_mode": Group(codes=(960, 970), step=25, default=970),
    "plane": Group(codes=(170, 180, 190), step=130, default=170),
    "diameter": Group(codes=(70, 80), step=140, default=80, dialects=LINUXCNC_ONLY),
    "cutter_compensation": Group(codes=(400, 410, 411, 420, 421), step=150, default=400),
    "length": Group(codes=(430, 431, 432, 440, 490), step=160, default=490),
    "wcs": Group(
        codes=(540, 541, 550, 560, 570, 580, 590, 591, 592, 593, 5000), step=170, default=540
    ),
    "path": Group(codes=(610, 611, 620, 630, 640), step=180, default=640),
    "distance": Group(codes=(900, 910), step=120, default=900),
    "arc_distance": Group(codes=(901, 911), step=120, default=911),
    "retract": Group(codes=(980, 990), step=200, default=980),
    "polar": Group(codes=(150, 160), step=202, default=150, dialects=FANUC_ONLY),
    "scaling": Group(codes=(500, 510), step=204, default=500, dialects=FANUC_ONLY),
    "mirror": Group(codes=(501, 511), step=204, default=501, dialects=FANUC_ONLY),
    "rotation": Group(codes=(680, 690), step=206, default=690, dialects=FANUC_ONLY),
    "modal_macro": Group(codes=(660, 661, 670), step=300, default=670, dialects=FANUC_ONLY),
    "cycle": Group(
        codes=(730, 740, 760, 800, 810, 820, 830, 840, 850, 860, 870, 880, 890),
        step=220,
        default=800,
    ),
    "motion": Group(codes=(0, 10, 20, 30, 330, 331, 382, 383, 384, 385), step=220, default=0),
}
"""Name -> group.  ``cycle`` and ``motion`` are one group in LinuxCNC, groups 9 and 1 in Fanuc."""

ONE_SHOT: dict[int, tuple[int, frozenset[str]]] = {
    40: (110, ALL_DIALECTS),
    90: (185, ALL_DIALECTS),
    600: (185, FANUC_ONLY),
    **dict.fromkeys((50, 51, 80, 1030, 1870), (195, FANUC_ONLY)),
    **dict.fromkeys((100, 280, 300, 520, 920, 921), (210, ALL_DIALECTS)),
    **dict.fromkeys((110, 270), (210, FANUC_ONLY)),
    **dict.fromkeys((281, 301, 922, 923), (210, LINUXCNC_ONLY)),
    530: (215, ALL_DIALECTS),
    310: (220, FANUC_ONLY),
    650: (300, FANUC_ONLY),
}
"""G code of one block only (group 0) -> when it is carried out, and the dialects that have it."""

WORD_STEPS = {"F": 20, "S": 30, "T": 40, "D": 149, "H": 159}
"""Words with a meaning of their own -> when they are carried out."""

M_STEPS: dict[str, dict[int, int]] = {
    "linuxcnc": {
        6: 50, 61: 50, 3: 70, 4: 70, 5: 70, 19: 70, 70: 75, 71: 75, 72: 75, 73: 75, 7: 80, 8: 80,
        9: 80, 0: 400, 1: 400, 2: 400, 30: 400, 60: 400, 99: 400,
    },
    "fanuc": {
        3: 70, 4: 70, 13: 70, 14: 70, 7: 80, 8: 80, 29: 80, 19: 310, 5: 320, 9: 330, 6: 340,
        0: 400, 1: 400, 2: 410, 30: 410, 97: 420, 98: 420, 198: 420, 99: 430,
    },
    "siemens": {
        6: 50, 3: 70, 4: 70, 7: 80, 8: 80, 5: 320, 9: 330, 0: 400, 1: 400, 2: 410, 30: 410, 17: 410,
    },
}  # fmt: skip
"""M code -> when it is carried out: on a Fanuc what starts comes before the motion, what ends after
(M6 too, as posts write ``G91 G28 Z0 M6``)."""
OTHER_M_STEP = {"linuxcnc": 90, "fanuc": 350, "siemens": 350}

M_GROUPS: dict[int, str] = {
    **dict.fromkeys((0, 1, 2, 30, 60), "stop"),
    **dict.fromkeys((6, 61), "tool change"),
    **dict.fromkeys((3, 4, 5, 19), "spindle"),
    **dict.fromkeys((7, 8, 9), "coolant"),
    **dict.fromkeys((48, 49), "overrides"),
}
"""M code -> group of which LinuxCNC takes one a block."""

LINUXCNC_UNITS = 135
"""When LinuxCNC carries out G20 and G21: after F, which counts the unit before them."""
GROUP_OF: dict[int, str] = {code: name for name, group in GROUPS.items() for code in group.codes}


def g_code(code: int) -> str:
    """G code in words: ``G54.1`` for 541."""
    return f"G{code // 10}" if code % 10 == 0 else f"G{code // 10}.{code % 10}"


def step_of(code: int, dialect: str) -> int | None:
    """When ``dialect`` carries out a G code; None where it has no such code."""
    if code in ONE_SHOT:
        step, dialects = ONE_SHOT[code]
        if dialect in dialects:
            return step
    if code == CANCELLED:
        return GROUPS["cycle"].step - 1
    if code in (200, 210) and dialect == "linuxcnc":
        return LINUXCNC_UNITS
    group = GROUPS.get(GROUP_OF.get(code, ""))
    if group is None or dialect not in group.dialects:
        return None
    return group.step


def excludes(first: int, second: int) -> bool:
    """Whether LinuxCNC refuses both in a block: of one group, or both take axis words."""
    names = {GROUP_OF.get(first), GROUP_OF.get(second)}
    if CANCELLED in (first, second) and first != second:
        return False  # G80 G0 is no conflict: the motion is what stays in force
    if len(names) == 1 and names != {None}:
        return True
    moves = names & {"cycle", "motion"}
    if len(moves) == 2:
        return True
    return bool({first, second} & AXIS_TAKERS) and (bool(moves) or {first, second} <= AXIS_TAKERS)


AXIS_TAKERS = frozenset({100, 280, 300, 520, 920})
"""Codes of one block that take the axis words for themselves."""


Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(slots=True, kw_only=True)
class Offsets:
    """Offsets, rotations, scaling and mirror of a program's coordinates [mm, deg]."""

    work: dict[str, list[float]]
    """Work offsets by name (``"G54"``, ``"G54.1 P3"``, ``"EXT"``)."""
    rotations: dict[str, float] = field(default_factory=dict)
    """Rotation of a work coordinate system about Z (LinuxCNC) [deg]."""
    active: str = "G54"
    """Name of the work coordinate system in force."""
    g52: list[float] = field(default_factory=lambda: [0.0] * 6)
    g92: list[float] = field(default_factory=lambda: [0.0] * 6)
    """Local system, and the shift by G92."""
    g92_kept: list[float] | None = None
    """Shift that G92.2 put aside."""
    length: list[float] = field(default_factory=lambda: [0.0] * 6)
    """Tool offset in force."""
    rotation: float = 0.0
    centre_of_rotation: tuple[float, float] = (0.0, 0.0)
    plane_of_rotation: int = 17
    """G68: angle [deg], centre and plane; 0 where off."""
    scale: list[float] = field(default_factory=lambda: [1.0] * 3)
    scale_centre: list[float] = field(default_factory=lambda: [0.0] * 3)
    mirror: list[float] = field(default_factory=lambda: [1.0] * 3)
    mirror_centre: list[float] = field(default_factory=lambda: [0.0] * 3)
    """Scales and centre of G51, mirrored axes and centre of G51.1."""
    polar: bool = False
    """Whether polar coordinates, G16, are in force."""

    @property
    def work_rotation(self) -> float:
        """Rotation of the work coordinate system in force [deg]."""
        return self.rotations.get(self.active, 0.0)

    @property
    def is_translation(self) -> bool:
        """Whether machine = program + translation."""
        return (
            self.rotation == 0
            and self.work_rotation == 0
            and self.scale == [1.0] * 3
            and self.mirror == [1.0] * 3
        )

    def transform(self) -> "Transform":
        """Transformation from program to machine that is in force."""
        work, external = self.work.get(self.active, ZERO), self.work.get("EXT", ZERO)
        local = [a + b for a, b in zip(self.g52, self.g92, strict=True)]
        outer = [a + b + c for a, b, c in zip(work, external, self.length, strict=True)]
        translation = [a + b for a, b in zip(outer, local, strict=True)]
        if self.is_translation:
            return Transform(None, translation)
        matrix, shift = _scaling(self)
        turn = _rotation(self.rotation, self.plane_of_rotation)
        first, second, _ = IN_PLANE[self.plane_of_rotation]
        centre_of_rotation = [0.0] * 3
        centre_of_rotation[first], centre_of_rotation[second] = self.centre_of_rotation
        matrix = _product(turn, matrix)
        shift = [
            a + b
            for a, b in zip(_about(turn, centre_of_rotation), _times(turn, shift), strict=True)
        ]
        rotation = _rotation(self.work_rotation, 17)
        shift = [a + b for a, b in zip(shift, local, strict=False)]
        shift = [a + b for a, b in zip(_times(rotation, shift), outer, strict=False)]
        return Transform(_product(rotation, matrix), [*shift, *translation[3:]])

    def frame(self, transform: "Transform") -> Frame:
        """Frame as :class:`~pipeline.gcode.moves.Moves` lists it."""
        marks = (
            ("G52", any(self.g52)),
            ("G92", any(self.g92)),
            ("G43", any(self.length)),
            ("G51", self.scale != [1.0] * 3 or self.mirror != [1.0] * 3),
            ("G68", self.rotation != 0),
        )
        name = "+".join([self.active, *(mark for mark, on in marks if on)])
        x, y, z, a, b, c = transform.translation
        return Frame(
            name=name, translation=(x, y, z, a, b, c), rotation=self.rotation + self.work_rotation
        )


@dataclass(frozen=True, slots=True)
class Transform:
    """machine = matrix · program + translation; ``matrix`` None for the identity."""

    matrix: Matrix | None
    translation: list[float]

    def machine(self, point: list[float]) -> list[float]:
        """Machine's coordinates of a program's point."""
        if self.matrix is None:
            return [a + b for a, b in zip(point, self.translation, strict=True)]
        turned = [*_times(self.matrix, point), *point[3:]]
        return [a + b for a, b in zip(turned, self.translation, strict=True)]

    def program(self, position: list[float]) -> list[float]:
        """Program's coordinates of a point of the machine."""
        shifted = [a - b for a, b in zip(position, self.translation, strict=True)]
        if self.matrix is None:
            return shifted
        return [*_times(_inverse(self.matrix), shifted), *shifted[3:]]


def _scaling(offsets: Offsets) -> tuple[Matrix, list[float]]:
    """Scaling first, then the mirror, each about its centre."""
    factors = [a * b for a, b in zip(offsets.scale, offsets.mirror, strict=True)]
    shift = [
        m_c + m * (s_c - s * s_c - m_c)
        for s, s_c, m, m_c in zip(
            offsets.scale, offsets.scale_centre, offsets.mirror, offsets.mirror_centre, strict=True
        )
    ]
    x, y, z = factors
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)), shift


def _rotation(angle: float, plane: int) -> Matrix:
    if angle == 0:
        return IDENTITY
    first, second, _ = IN_PLANE[plane]
    cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    rows = [list(row) for row in IDENTITY]
    rows[first][first] = rows[second][second] = cosine
    rows[first][second], rows[second][first] = -sine, sine
    x, y, z = ((row[0], row[1], row[2]) for row in rows)
    return x, y, z


def _times(matrix: Matrix, vector: list[float]) -> list[float]:
    x, y, z = vector[:3]
    return [row[0] * x + row[1] * y + row[2] * z for row in matrix]


def _about(matrix: Matrix, centre: list[float]) -> list[float]:
    """Shift that a rotation about ``centre`` adds to one about the origin."""
    return [c - turned for c, turned in zip(centre, _times(matrix, centre), strict=True)]


def _product(left: Matrix, right: Matrix) -> Matrix:
    columns = [_times(left, [row[i] for row in right]) for i in range(3)]
    x, y, z = ((columns[0][i], columns[1][i], columns[2][i]) for i in range(3))
    return x, y, z


def _inverse(m: Matrix) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = m
    minors = (
        (e * i - f * h, c * h - b * i, b * f - c * e),
        (f * g - d * i, a * i - c * g, c * d - a * f),
        (d * h - e * g, b * g - a * h, a * e - b * d),
    )
    determinant = a * minors[0][0] + b * minors[1][0] + c * minors[2][0]
    x, y, z = ((r[0] / determinant, r[1] / determinant, r[2] / determinant) for r in minors)
    return x, y, z
