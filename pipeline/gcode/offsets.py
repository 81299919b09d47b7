"""Work coordinate systems: the transformation from a program's coordinates to the machine's.

machine = R_w (R_68 (S (p)) + G92 + G52) + work offset + external offset + tool length, where S
scales or mirrors (G51, G51.1) about its centre, R_68 rotates (G68) about its centre and R_w is the
rotation that LinuxCNC keeps with a work offset (G10 L2 R).
"""

import math
from dataclasses import dataclass, field

from pipeline.gcode.moves import Frame
from pipeline.gcode.setup import ZERO

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
IN_PLANE = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""Plane -> indices of its first and second axis and of its normal."""


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
