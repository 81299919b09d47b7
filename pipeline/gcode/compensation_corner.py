"""From one offset element to the next: the corners of a compensated contour."""

import cmath
import math
from dataclasses import dataclass
from typing import Literal

from pipeline.gcode.compensation_element import CompensationError, Element, meeting

NEARLY_TANGENT = math.radians(1)
"""Up to this a corner with an arc may stem from rounding in the program [rad]."""
SMALLEST_GAP = 1e-3
"""Between nearly tangent elements; a smaller one is not closed by a move of its own [mm]."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What a dialect does where the contour begins and at its corners.

    Parameters
    ----------
    entry : str
        Where the first move ends, perpendicular to its end point: beside its ``own`` line or arc
        (LinuxCNC) or beside the ``next`` element (Fanuc type A, Siemens NORM).
    outer : str
        Around outer corners: an ``arc`` about the corner, or ``lines``: the two offset lines
        (tangents of arcs) are lengthened until they meet, in corners sharper than 90° by the tool's
        radius only.
    tangent : float
        Up to this turn no corner is made: the second element starts where the first ends [rad].
    back : float
        A turn that is so near to 180° is a turn back, outside or inside as an arc bends [rad].
    recount : bool
        An arc keeps its number of turns begun whatever corners do to its ends; so a full circle
        that starts past its end, after a nearly tangent corner, becomes the rest of it.
    """

    entry: Literal["own", "next"]
    outer: Literal["arc", "lines"]
    tangent: float
    back: float
    recount: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """Where the first element ends, what lies between, and where the second starts.

    Parameters
    ----------
    end, start : complex
        [mm]
    lines : tuple of complex
        End points of inserted lines [mm]; the last one is ``start``.
    angle : float
        Swept by an inserted arc about the corner [rad]; 0 for none.
    """

    end: complex
    start: complex
    lines: tuple[complex, ...] = ()
    angle: float = 0.0


def joint(
    programmed: tuple[Element, Element],
    beside: tuple[Element, Element],
    *,
    rules: Rules,
    shift: float,
) -> Joint:
    """Joint of two elements, given as programmed and as offset by ``shift`` to the left [mm].

    Raises
    ------
    CompensationError
        An inner corner into which the tool does not fit.
    """
    turn = cmath.phase(programmed[1].first_direction / programmed[0].last_direction)
    end, start = beside[0].end, beside[1].start
    if abs(turn) <= rules.tangent or turn == 0:
        return Joint(end=end, start=end)
    if _inside(programmed, turn, rules, shift):
        return _inner(programmed, beside, abs(turn), abs(shift))
    straight = all(element.centre is None for element in beside)
    if (rules.outer == "lines" and straight) or not _negligible(abs(turn), abs(start - end)):
        return _outer(beside, turn, shift, rules)
    return Joint(end=end, start=end)


def _inside(programmed: tuple[Element, Element], turn: float, rules: Rules, shift: float) -> bool:
    if math.pi - abs(turn) > rules.back:
        return turn * shift > 0
    # the angle does not tell: the tool is inside where the later arc bends towards it
    bends = [element.angle for element in reversed(programmed) if element.centre is not None]
    return bool(bends) and bends[0] * shift < 0


def _negligible(turn: float, gap: float) -> bool:
    return turn <= NEARLY_TANGENT and gap <= SMALLEST_GAP


def _inner(
    programmed: tuple[Element, Element],
    beside: tuple[Element, Element],
    turn: float,
    radius: float,
) -> Joint:
    end, gap = beside[0].end, abs(beside[1].start - beside[0].end)
    if all(element.centre is None for element in beside):
        point: complex | None = end - programmed[0].last_direction * radius * math.tan(turn / 2)
    else:
        point = meeting(*beside)
        if turn <= NEARLY_TANGENT and (point is None or abs(point - end) > 2 * gap):
            return Joint(end=end, start=end)
    if point is None:
        raise CompensationError(
            row=programmed[1].row,
            reason=f"a tool of radius {radius:.6g} mm does not fit into the inner corner where "
            "this move begins; use a smaller tool",
        )
    return Joint(end=point, start=point)


def _outer(beside: tuple[Element, Element], turn: float, shift: float, rules: Rules) -> Joint:
    end, start = beside[0].end, beside[1].start
    if rules.outer == "arc":
        away = turn if turn * shift < 0 else turn - math.copysign(math.tau, turn)
        return Joint(end=end, start=start, angle=away)
    sharp = abs(turn) > math.pi / 2
    reach = abs(shift) * (1.0 if sharp else math.tan(abs(turn) / 2))
    tip = end + beside[0].last_direction * reach
    back = start - beside[1].first_direction * reach
    points = [end, tip, back, start] if sharp else [end, tip, start]
    # a line is itself lengthened; an arc gets a line along its tangent
    points = points[beside[0].centre is None : len(points) - (beside[1].centre is None)]
    return Joint(end=points[0], start=points[-1], lines=tuple(points[1:]))
