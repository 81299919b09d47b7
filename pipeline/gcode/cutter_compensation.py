"""Cutter radius compensation (G41, G42): from the contour to the path of the tool's centre.

A point in the active plane is the complex number u + iv, with axes that turn anticlockwise about
the plane's normal: X Y in G17, Z X in G18, Y Z in G19.  The tool runs beside each element at its
radius, and inner corners are cut where the two offset elements meet; a move that this would turn
around is a gouge.  :data:`RULES` holds the differences of the dialects.

Source: LinuxCNC 2.9 user manual, "Cutter Compensation"; Fanuc series 16/18/160/180 model C
operator's manual, "Details of cutter compensation C"; Sinumerik 840D sl programming manual
fundamentals, "Tool radius compensation" (NORM, G450).
"""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import IN_PLANE, NO_CENTRE, Kind, Rows
from pipeline.gcode.run import Run

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


NEARLY_TANGENT = math.radians(1)
"""Turn up to which a corner with an arc may stem from rounding in the program [rad]."""
SMALLEST_GAP = 1e-3
"""Gap between nearly tangent elements below which no move closes it [mm]."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Rules of a dialect for entering a contour and for its corners."""

    entry: Literal["own", "next"]
    """End of the first move, perpendicular to its end point: beside its ``own`` line or arc
    (LinuxCNC) or beside the ``next`` element (Fanuc type A, Siemens NORM)."""
    outer: Literal["arc", "lines"]
    """Around outer corners: an ``arc`` about the corner, or ``lines``: the two offset lines
    (tangents of arcs) are lengthened until they meet, in corners sharper than 90° by the tool's
    radius only."""
    tangent: float
    """Turn up to which no corner is made: the second element starts where the first ends [rad]."""
    back: float
    """A turn that is so near to 180° is a turn back, outside or inside as an arc bends [rad]."""
    recount: bool
    """An arc keeps its number of turns begun whatever corners do to its ends; so a full circle that
    starts past its end, after a nearly tangent corner, becomes the rest of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """Corner between two elements: end of the first, inserted moves, start of the second."""

    end: complex
    start: complex
    """End of the first element and start of the second [mm]."""
    lines: tuple[complex, ...] = ()
    """End points of inserted lines [mm]; the last one is ``start``."""
    angle: float = 0.0
    """Angle of an inserted arc about the corner [rad]; 0 for none."""


RULES = {
    "linuxcnc": Rules(entry="own", outer="arc", tangent=0.05, back=0.05, recount=True),
    "fanuc": Rules(entry="next", outer="lines", tangent=0.0, back=1e-9, recount=False),
    "siemens": Rules(entry="next", outer="arc", tangent=0.0, back=1e-9, recount=False),
}
"""Rules of each dialect for entering a contour and for its corners."""


def close_contour(run: Run) -> None:
    """Replace the moves of the contour that G41 or G42 opened by those of the tool's centre.

    Raises GcodeError where the tool cannot follow, with the line of the move.
    """
    contour, run.contour = run.contour, None
    run.state.cutter_compensation = 0
    if contour is None or run.rows.count <= contour.first:
        return
    programmed = run.rows.cut(contour.first)
    elements = elements_of(programmed, contour.start, contour.plane)
    try:
        path = compensate(elements, side=contour.side, radius=contour.radius, dialect=run.dialect)
    except CompensationError as error:
        file = run.files[int(programmed.arrays["file"][error.row])]
        line = int(programmed.arrays["line"][error.row])
        raise GcodeError(file, line, 1, contour.word, error.reason) from None
    append_path(run.rows, path, programmed, contour.start, contour.plane)
    last = run.rows.arrays["end"][run.rows.count - 1].tolist()
    if last != run.state.position:
        run.compensated_position = last


def compensate(elements: list[Element], *, side: int, radius: float, dialect: str) -> list[Element]:
    """Path of the tool's centre beside a contour.

    The first of ``elements`` is the first move after G41 or G42, which enters from where the tool
    stands; the last is the one before G40.  ``side`` is 1 for G41, left of the contour, -1 for G42;
    a negative ``radius`` [mm] changes it; ``dialect`` is a key of :data:`RULES`.

    Each element of the result starts where the one before ends; inserted ones have the row of the
    element that they lead to.  Raises CompensationError where the tool is too big for an arc, a
    corner or a move between two corners, or cannot enter.
    """
    if radius == 0:
        return list(elements)
    rules, shift = RULES[dialect], side * radius
    contour = [element for element in elements if element.planar]
    if rules.entry == "own" and elements and not elements[0].planar:
        raise CompensationError(
            row=elements[0].row,
            reason="the first move with compensation does not move in the plane; "
            "move in the plane first, by more than the tool's radius",
        )
    path = iter(_path(contour, rules, shift))
    compensated: list[Element] = []
    for element in elements:
        if element.planar:
            inserted, shifted = next(path)
            compensated.extend(replace(piece, normal=compensated[-1].normal) for piece in inserted)
            compensated.append(shifted)
        else:
            here = compensated[-1].end if compensated else element.start
            compensated.append(replace(element, start=here, end=here))
    return compensated


def _path(
    contour: list[Element], rules: Rules, shift: float
) -> Iterator[tuple[list[Element], Element]]:
    """Inserted moves that lead to each element, and the offset element beside it."""
    if not contour:
        return
    shifted = [offset(element, shift) for element in contour[1:]]
    first, corners = _with_entry(contour, shifted, rules, shift)
    corners += [
        corner_between((a, b), (c, d), rules=rules, shift=shift)
        for (a, b), (c, d) in zip(pairwise(contour[1:]), pairwise(shifted), strict=True)
    ]
    yield [], first
    ends = [*(corner.end for corner in corners[1:]), *(last.end for last in shifted[-1:])]
    for element, whole, corner, end in zip(contour[1:], shifted, corners, ends, strict=True):
        yield (
            _inserted(corner, element),
            _trimmed_part(element, whole, (corner.start, end), rules, shift),
        )


def _with_entry(
    contour: list[Element], shifted: list[Element], rules: Rules, shift: float
) -> tuple[Element, list[Corner]]:
    """The first move, and its corner with the second where there is one."""
    first = contour[0]
    if rules.entry == "next":
        first = next_entry(first, contour[1] if shifted else None, shift)
        return first, [Corner(end=first.end, start=first.end)] if shifted else []
    first = own_entry(first, shift)
    if not shifted:
        return first, []
    along = first if first.centre is not None else offset(contour[0], shift)
    corner = corner_between((contour[0], contour[1]), (along, shifted[0]), rules=rules, shift=shift)
    if first.centre is None:
        return replace(first, end=corner.end), [corner]
    return _trimmed_part(contour[0], first, (first.start, corner.end), rules, shift), [corner]


def _trimmed_part(
    programmed: Element, shifted: Element, ends: tuple[complex, complex], rules: Rules, shift: float
) -> Element:
    part = trimmed(shifted, *ends)
    if part is None:
        raise CompensationError(
            row=programmed.row,
            reason=f"a tool of radius {abs(shift):.6g} mm would run backwards along this move, "
            "since the inner corners at its ends leave no room for it; use a smaller tool",
        )
    if rules.recount and part.centre is not None:
        angle = swept(part.start, part.end, part.centre, like=programmed.angle)
        return replace(part, angle=angle)
    return part


def _inserted(corner: Corner, element: Element) -> list[Element]:
    ends = (corner.start,) if corner.angle else corner.lines
    arc = corner.angle != 0 and not element.rapid
    return [
        replace(
            element,
            start=start,
            end=end,
            centre=element.start if arc else None,
            angle=corner.angle if arc else 0.0,
            inserted=True,
        )
        for start, end in pairwise((corner.end, *ends))
    ]


def own_entry(element: Element, shift: float) -> Element:
    """Move to beside the end of the element itself, as LinuxCNC enters.

    A line goes straight to the point at the tool's radius from its end; an arc keeps its tangent
    there. Raises CompensationError where the tool covers the end point, or would arrive reversed on
    an arc.
    """
    length = abs(element.end - element.start)
    if length <= abs(shift):
        raise CompensationError(
            row=element.row,
            reason=f"the first move with compensation ends {length:.6g} mm from where it starts, "
            f"not more than the tool's radius of {abs(shift):.6g} mm; begin farther away",
        )
    end = offset(element, shift).end
    if element.centre is None:
        return replace(element, end=end)
    inward = (element.centre - element.end) / abs(element.centre - element.end)
    chord = (end - element.start) * inward.conjugate()
    if chord.real >= 0:
        raise CompensationError(
            row=element.row,
            reason="the first move with compensation is an arc that no arc can follow to the "
            "tool's place beside its end: it is too short for the tool's radius of "
            f"{abs(shift):.6g} mm; begin farther away or with a line",
        )
    # equal distances from start and end: |chord|² = -2 radius chord·inward
    centre = end - inward * abs(chord) ** 2 / (2 * chord.real)
    angle = swept(element.start, end, centre, like=element.angle)
    return replace(element, end=end, centre=centre, angle=angle)


def next_entry(element: Element, following: Element | None, shift: float) -> Element:
    """Move to beside the start of the following element (Fanuc type A, Siemens NORM).

    Raises CompensationError where the first move is an arc.
    """
    if element.centre is not None:
        raise CompensationError(
            row=element.row,
            reason="the first move with compensation is an arc; begin with a line (G0 or G1)",
        )
    direction = element.last_direction if following is None else following.first_direction
    return replace(element, end=element.end + 1j * shift * direction)


def corner_between(
    programmed: tuple[Element, Element], shifted: tuple[Element, Element], *, rules: Rules,
    shift: float,
) -> Corner:  # fmt: skip
    """Corner of two elements, given as programmed and as offset by ``shift`` to the left [mm].

    Raises CompensationError at an inner corner into which the tool does not fit.
    """
    turn = cmath.phase(programmed[1].first_direction / programmed[0].last_direction)
    end, start = shifted[0].end, shifted[1].start
    if abs(turn) <= rules.tangent or turn == 0:
        return Corner(end=end, start=end)
    if _inside(programmed, turn, rules, shift):
        return _inner(programmed, shifted, abs(turn), abs(shift))
    straight = all(element.centre is None for element in shifted)
    negligible = abs(turn) <= NEARLY_TANGENT and abs(start - end) <= SMALLEST_GAP
    if (rules.outer == "lines" and straight) or not negligible:
        return _outer(shifted, turn, shift, rules)
    return Corner(end=end, start=end)


def _inside(programmed: tuple[Element, Element], turn: float, rules: Rules, shift: float) -> bool:
    if math.pi - abs(turn) > rules.back:
        return turn * shift > 0
    # the angle does not decide: the tool is inside where the later arc bends towards it
    bends = [element.angle for element in reversed(programmed) if element.centre is not None]
    return bool(bends) and bends[0] * shift < 0


def _inner(
    programmed: tuple[Element, Element], shifted: tuple[Element, Element], turn: float,
    radius: float,
) -> Corner:  # fmt: skip
    end, gap = shifted[0].end, abs(shifted[1].start - shifted[0].end)
    if all(element.centre is None for element in shifted):
        point: complex | None = end - programmed[0].last_direction * radius * math.tan(turn / 2)
    else:
        point = meeting(*shifted)
        if turn <= NEARLY_TANGENT and (point is None or abs(point - end) > 2 * gap):
            return Corner(end=end, start=end)
    if point is None:
        raise CompensationError(
            row=programmed[1].row,
            reason=f"a tool of radius {radius:.6g} mm does not fit into the inner corner where "
            "this move begins; use a smaller tool",
        )
    return Corner(end=point, start=point)


def _outer(shifted: tuple[Element, Element], turn: float, shift: float, rules: Rules) -> Corner:
    end, start = shifted[0].end, shifted[1].start
    if rules.outer == "arc":
        away = turn if turn * shift < 0 else turn - math.copysign(math.tau, turn)
        return Corner(end=end, start=start, angle=away)
    sharp = abs(turn) > math.pi / 2
    reach = abs(shift) * (1.0 if sharp else math.tan(abs(turn) / 2))
    tip = end + shifted[0].last_direction * reach
    back = start - shifted[1].first_direction * reach
    points = [end, tip, back, start] if sharp else [end, tip, start]
    # a line is itself lengthened; an arc gets a line along its tangent
    points = points[shifted[0].centre is None : len(points) - (shifted[1].centre is None)]
    return Corner(end=points[0], start=points[-1], lines=tuple(points[1:]))
