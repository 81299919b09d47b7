"""Contours for cutter radius compensation: lines and arcs in the active plane, made of rows.

A point is the complex number u + iv [mm].
"""

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.gcode.moves import NO_CENTRE, Kind, Rows
from pipeline.gcode.offsets import IN_PLANE

SAME_ANGLE = 1e-7
"""Arcs that differ by less are taken as equal, since their ends are rounded [rev]."""

SAME_POINT = 1e-7
"""Points nearer to each other are taken as equal [mm]."""


class CompensationError(ValueError):
    """A contour that the tool cannot follow.

    ``row`` is the :attr:`Element.row` of the element.
    """

    def __init__(self, *, row: int, reason: str) -> None:
        self.row, self.reason = row, reason
        super().__init__(reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class Element:
    """A line, an arc, or a move along the plane's normal only."""

    start: complex
    end: complex
    """End in the plane, u + iv [mm]."""
    normal: float
    """Coordinate along the plane's normal at the end [mm]."""
    row: int
    """The caller's number of the move; what is made of one keeps it."""
    centre: complex | None = None
    """Centre of an arc [mm]."""
    angle: float = 0.0
    """Angle of an arc, anticlockwise positive, full turns included [rad]."""
    rapid: bool = False
    """Whether the move is a rapid, G0."""
    inserted: bool = False
    """Leads around an outer corner before the move of its row."""

    @property
    def planar(self) -> bool:
        """Moves in the plane."""
        return self.start != self.end or self.angle != 0

    @property
    def first_direction(self) -> complex:
        """Unit tangent at the start."""
        return self._direction(self.start)

    @property
    def last_direction(self) -> complex:
        """Unit tangent at the end."""
        return self._direction(self.end)

    def _direction(self, point: complex) -> complex:
        if self.centre is None:
            along = self.end - self.start
        else:
            along = (point - self.centre) * (1j if self.angle > 0 else -1j)
        return along / abs(along)


def offset(element: Element, shift: float) -> Element:
    """Offset of an element by ``shift`` to its left [mm].

    Raises CompensationError where the centre of an arc lies within ``shift``.
    """
    centre = element.centre
    if centre is not None:
        radius = min(abs(element.start - centre), abs(element.end - centre))
        if radius == 0 or (element.angle * shift > 0 and radius <= abs(shift)):
            raise CompensationError(
                row=element.row,
                reason=f"the arc's radius of {radius:.6g} mm is not greater than the tool's "
                f"{abs(shift):.6g} mm, which runs on its inside; use a smaller tool",
            )
    return replace(
        element,
        start=element.start + 1j * shift * element.first_direction,
        end=element.end + 1j * shift * element.last_direction,
    )


def trimmed(element: Element, start: complex, end: complex) -> Element | None:
    """The element between two points of its line or circle; None if that runs backwards."""
    if element.centre is None:
        along = ((end - start) * (element.end - element.start).conjugate()).real
        return replace(element, start=start, end=end) if along >= 0 else None
    centre = element.centre
    skipped = cmath.phase((start - centre) / (element.start - centre))
    added = cmath.phase((end - centre) / (element.end - centre))
    angle = element.angle - skipped + added
    if angle * element.angle < 0:
        return None
    return replace(element, start=start, end=end, angle=angle)


def swept(start: complex, end: complex, centre: complex, like: float) -> float:
    """Angle from start to end with the sense and the number of turns begun of another [rad]."""
    sense = math.copysign(1.0, like)
    turns = math.ceil(abs(like) / math.tau - SAME_ANGLE)
    part = sense * cmath.phase((end - centre) / (start - centre)) % math.tau
    if part < math.tau * SAME_ANGLE:
        part = math.tau
    return sense * (part + math.tau * (turns - 1))


def meeting(first: Element, second: Element) -> complex | None:
    """Point common to the lines or circles of two elements [mm].

    Of two points the one that lies back along the first element and ahead along the second.
    """
    if first.centre is None and second.centre is not None:
        points = _line_circle(first, second.centre, abs(second.start - second.centre))
    elif first.centre is not None and second.centre is None:
        points = _line_circle(second, first.centre, abs(first.end - first.centre))
    elif first.centre is not None and second.centre is not None:
        r_1, r_2 = abs(first.end - first.centre), abs(second.start - second.centre)
        points = _circle_circle(first.centre, r_1, second.centre, r_2)
    back, ahead = -first.last_direction, second.first_direction

    def rank(point: complex) -> tuple[bool, float]:
        along = ((point - first.end) * back.conjugate()).real
        onward = ((point - second.start) * ahead.conjugate()).real
        return min(along, onward) < -SAME_POINT, abs(point - first.end)

    return min(points, key=rank, default=None)


def _line_circle(line: Element, centre: complex, radius: float) -> list[complex]:
    direction = line.first_direction
    to_centre = (centre - line.start) * direction.conjugate()
    half = (radius - to_centre.imag) * (radius + to_centre.imag)
    if half < 0:
        return []
    foot, half = line.start + direction * to_centre.real, math.sqrt(half)
    return [foot - direction * half, foot + direction * half]


def _circle_circle(c_1: complex, r_1: float, c_2: complex, r_2: float) -> list[complex]:
    distance = abs(c_2 - c_1)
    if distance == 0:
        return []
    along = (distance + (r_1 - r_2) * (r_1 + r_2) / distance) / 2
    half = (r_1 - along) * (r_1 + along)
    if half < 0:
        return []
    axis = (c_2 - c_1) / distance
    half = math.sqrt(half)
    return [c_1 + axis * complex(along, half), c_1 + axis * complex(along, -half)]


MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC)


def elements_of(rows: Rows, start: tuple[float, ...], plane: int) -> list[Element]:
    """Elements of the rows that move, from a machine position ``start`` [mm, deg] on."""
    first, second, normal = IN_PLANE[plane]
    here = complex(start[first], start[second])
    elements = []
    for row in np.flatnonzero(np.isin(rows.arrays["kind"][: rows.count], MOVING)).tolist():
        kind, end, centre, angle = (
            rows.arrays[name][row].tolist() for name in ("kind", "end", "centre", "angle")
        )
        there = complex(end[first], end[second])
        elements.append(
            Element(
                start=here,
                end=there,
                normal=end[normal],
                row=row,
                centre=complex(centre[first], centre[second]) if kind == Kind.ARC else None,
                angle=angle,
                rapid=kind == Kind.RAPID,
            )
        )
        here = there
    return elements


def append_path(
    rows: Rows, path: list[Element], programmed: Rows, start: tuple[float, ...], plane: int
) -> None:
    """Append the moves of a path, and between them, in place, the rows that do not move.

    Elements of ``path`` have rows of ``programmed``; ``start``: machine position before [mm, deg];
    ``plane``: 17, 18 or 19.
    """
    first, second, normal = IN_PLANE[plane]
    here = list(start)
    pieces = iter(path)
    piece = next(pieces, None)
    for row in range(programmed.count):
        columns = tuple(array[row] for array in programmed.arrays.values())
        if programmed.arrays["kind"][row] not in MOVING:
            rows.append(columns)
            rows.arrays["end"][rows.count - 1] = here
            continue
        while piece is not None and piece.row == row:
            level = here[normal]
            if not piece.inserted:
                here = programmed.arrays["end"][row].tolist()
            here[first], here[second] = piece.end.real, piece.end.imag
            here[normal] = piece.normal
            rows.append(columns)
            _reshape(rows, here, piece, plane, level)
            piece = next(pieces, None)


def _reshape(rows: Rows, end: list[float], piece: Element, plane: int, level: float) -> None:
    """Give the last row the shape of a piece; ``level`` is where it starts along the normal."""
    last = rows.count - 1
    first, second, normal = IN_PLANE[plane]
    centre = list(NO_CENTRE)
    if piece.centre is not None:
        centre[first], centre[second] = piece.centre.real, piece.centre.imag
        centre[normal] = level
    straight = Kind.RAPID if piece.rapid else Kind.FEED
    rows.arrays["end"][last] = end
    rows.arrays["centre"][last] = centre
    rows.arrays["angle"][last] = piece.angle if piece.centre is not None else 0.0
    rows.arrays["kind"][last] = Kind.ARC if piece.centre is not None else straight
