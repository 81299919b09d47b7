"""Cutter radius compensation (G41, G42): from the contour to the path of the tool's centre.

Everything happens in the active plane; a point is the complex number u + iv, with axes that turn
anticlockwise about the plane's normal: X Y in G17, Z X in G18, Y Z in G19.  The caller collects the
moves from the block after G41 or G42 up to the one before G40 as :class:`Element` and hands them
over together, since a corner depends on what follows it.  The move after G40 starts where the last
element ends and goes to its programmed point.

The tool runs beside each element at its radius, and inner corners are cut where the two offset
elements meet; a move that this would turn around is a gouge.  What the dialects do differently
stands in :data:`RULES`.

Source: LinuxCNC 2.9 user manual, "Cutter Compensation"; Fanuc series 16/18/160/180 model C
operator's manual, "Details of cutter compensation C"; Sinumerik 840D sl programming manual
fundamentals, "Tool radius compensation" (NORM, G450).
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

from pipeline.gcode.compensation_corner import Joint, Rules, joint
from pipeline.gcode.compensation_element import (
    CompensationError,
    Element,
    offset,
    swept,
    trimmed,
)
from pipeline.gcode.compensation_entry import next_entry, own_entry

__all__ = ["RULES", "CompensationError", "Element", "compensate"]

RULES = {
    "linuxcnc": Rules(entry="own", outer="arc", tangent=0.05, back=0.05, recount=True),
    "fanuc": Rules(entry="next", outer="lines", tangent=0.0, back=1e-9, recount=False),
    "siemens": Rules(entry="next", outer="arc", tangent=0.0, back=1e-9, recount=False),
}
"""What each dialect does where the contour begins and at its corners."""


def compensate(elements: list[Element], *, side: int, radius: float, dialect: str) -> list[Element]:
    """Path of the tool's centre beside a contour.

    Parameters
    ----------
    elements : list of Element
        From the first move after G41 or G42 (which enters: it starts where the tool stands, off the
        contour) to the last one before G40.  Each starts where the one before ends.
    side : int
        1 for G41, left of the contour; -1 for G42, right of it.
    radius : float
        Of the tool [mm]; a negative one changes the side.
    dialect : str
        A key of :data:`RULES`.

    Returns
    -------
    list of Element
        Each starts where the one before ends; one for each that was given, in their order, and
        before it those inserted to get there, with its row.

    Raises
    ------
    CompensationError
        The tool is too big for an arc, a corner or a move between two corners, or cannot enter.
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
    moved: list[Element] = []
    for element in elements:
        if element.planar:
            way, beside = next(path)
            moved.extend(replace(piece, normal=moved[-1].normal) for piece in way)
            moved.append(beside)
        else:
            here = moved[-1].end if moved else element.start
            moved.append(replace(element, start=here, end=here))
    return moved


def _path(
    contour: list[Element], rules: Rules, shift: float
) -> Iterator[tuple[list[Element], Element]]:
    """What leads to each element, and what runs beside it."""
    if not contour:
        return
    beside = [offset(element, shift) for element in contour[1:]]
    first, joints = _entered(contour, beside, rules, shift)
    joints += [
        joint((a, b), (c, d), rules=rules, shift=shift)
        for (a, b), (c, d) in zip(pairwise(contour[1:]), pairwise(beside), strict=True)
    ]
    yield [], first
    ends = [*(made.end for made in joints[1:]), *(last.end for last in beside[-1:])]
    for element, whole, made, end in zip(contour[1:], beside, joints, ends, strict=True):
        yield _way(made, element), _part(element, whole, (made.start, end), rules, shift)


def _entered(
    contour: list[Element], beside: list[Element], rules: Rules, shift: float
) -> tuple[Element, list[Joint]]:
    """The first move, and its joint with the second where there is one."""
    first = contour[0]
    if rules.entry == "next":
        first = next_entry(first, contour[1] if beside else None, shift)
        return first, [Joint(end=first.end, start=first.end)] if beside else []
    first = own_entry(first, shift)
    if not beside:
        return first, []
    along = first if first.centre is not None else offset(contour[0], shift)
    made = joint((contour[0], contour[1]), (along, beside[0]), rules=rules, shift=shift)
    if first.centre is None:
        return replace(first, end=made.end), [made]
    return _part(contour[0], first, (first.start, made.end), rules, shift), [made]


def _part(
    programmed: Element, beside: Element, ends: tuple[complex, complex], rules: Rules, shift: float
) -> Element:
    """What corners leave of an element."""
    part = trimmed(beside, *ends)
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


def _way(made: Joint, element: Element) -> list[Element]:
    """Inserted moves from the end of the one before to the start of an element."""
    ends = (made.start,) if made.angle else made.lines
    arc = made.angle != 0 and not element.rapid
    return [
        replace(
            element,
            start=start,
            end=end,
            centre=element.start if arc else None,
            angle=made.angle if arc else 0.0,
            inserted=True,
        )
        for start, end in pairwise((made.end, *ends))
    ]
