"""The first move with cutter radius compensation: from off the contour to beside it."""

from dataclasses import replace

from pipeline.gcode.compensation_element import CompensationError, Element, offset, swept


def own_entry(element: Element, shift: float) -> Element:
    """Move to beside the end of the element itself, as LinuxCNC enters.

    A line goes straight to the point at the tool's radius from its end; an arc keeps its tangent
    there, so that its centre moves along the line from its end to its programmed centre.

    Raises
    ------
    CompensationError
        The tool covers the end point from where it stands, or the arc would have to arrive in the
        opposite direction.
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

    Raises
    ------
    CompensationError
        The first move is an arc.
    """
    if element.centre is not None:
        raise CompensationError(
            row=element.row,
            reason="the first move with compensation is an arc; begin with a line (G0 or G1)",
        )
    direction = element.last_direction if following is None else following.first_direction
    return replace(element, end=element.end + 1j * shift * direction)
