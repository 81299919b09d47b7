"""Rows between G41 or G42 and G40: from the programmed contour to the path of the tool's centre."""

from dataclasses import dataclass

from pipeline.gcode.compensation import CompensationError, Element, compensate
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import Kind
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.rows import COLUMNS, NO_CENTRE, Rows

MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC)
KIND, LINE, FILE, END, CENTRE, ANGLE = (
    list(COLUMNS).index(name) for name in ("kind", "line", "file", "end", "centre", "angle")
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contour:
    """What G41 or G42 opened.

    Parameters
    ----------
    side : int
        1 for left, -1 for right.
    radius : float
        Of the tool [mm].
    plane : int
        17, 18 or 19.
    first : int
        Row that the contour begins with.
    start : tuple of 6 floats
        Where the machine stood [mm, deg].
    word : str
        That opened it, for errors.
    """

    side: int
    radius: float
    plane: int
    first: int
    start: tuple[float, ...]
    word: str


def lay(contour: Contour, rows: Rows, dialect: str, files: list[str]) -> None:
    """Replace the contour's moves by those of the tool's centre.

    Raises
    ------
    GcodeError
        The tool cannot follow; the error names the line of the move.
    """
    tail = rows.cut(contour.first)
    try:
        path = compensate(
            _elements(contour, tail), side=contour.side, radius=contour.radius, dialect=dialect
        )
    except CompensationError as error:
        raise GcodeError(
            file=files[int(tail.arrays[FILE][error.row])],
            line=int(tail.arrays[LINE][error.row]),
            column=1,
            word=contour.word,
            reason=error.reason,
        ) from None
    _write(contour, tail, path, rows)


def _elements(contour: Contour, rows: Rows) -> list[Element]:
    """The rows that move, in the plane's coordinates."""
    first, second, normal = IN_PLANE[contour.plane]
    kinds, ends, centres = rows.arrays[KIND], rows.arrays[END], rows.arrays[CENTRE]
    here = complex(contour.start[first], contour.start[second])
    elements = []
    for row in range(rows.count):
        kind = kinds[row]
        if kind not in MOVING:
            continue
        end = ends[row].tolist()
        centre = centres[row].tolist() if kind == Kind.ARC else None
        there = complex(end[first], end[second])
        elements.append(
            Element(
                start=here,
                end=there,
                normal=end[normal],
                row=row,
                centre=None if centre is None else complex(centre[first], centre[second]),
                angle=float(rows.arrays[ANGLE][row]),
                rapid=bool(kind == Kind.RAPID),
            )
        )
        here = there
    return elements


def _write(contour: Contour, tail: Rows, path: list[Element], rows: Rows) -> None:
    """Moves of the path, and between them, in place, the rows that do not move."""
    first, second, normal = IN_PLANE[contour.plane]
    here = list(contour.start)
    pieces = iter(path)
    piece = next(pieces, None)
    for row in range(tail.count):
        if tail.arrays[KIND][row] not in MOVING:
            rows.copy(tail, range(row, row + 1))
            rows.arrays[END][rows.count - 1] = here
            continue
        while piece is not None and piece.row == row:
            level = here[normal]
            if not piece.inserted:
                here = tail.arrays[END][row].tolist()
            here[first], here[second] = piece.end.real, piece.end.imag
            here[normal] = piece.normal
            rows.copy(tail, range(row, row + 1))
            _reshape(rows, here, piece, contour.plane, level)
            piece = next(pieces, None)


def _reshape(rows: Rows, end: list[float], piece: Element, plane: int, level: float) -> None:
    """Give the last row the shape of a piece; ``level`` is where it starts along the normal."""
    last = rows.count - 1
    first, second, normal = IN_PLANE[plane]
    centre = list(NO_CENTRE)
    if piece.centre is not None:
        centre[first], centre[second] = piece.centre.real, piece.centre.imag
        centre[normal] = level
    rows.arrays[END][last] = end
    rows.arrays[CENTRE][last] = centre
    rows.arrays[ANGLE][last] = piece.angle if piece.centre is not None else 0.0
    straight = Kind.RAPID if piece.rapid else Kind.FEED
    rows.arrays[KIND][last] = Kind.ARC if piece.centre is not None else straight
