"""G2 and G3: from end point and I J K or R to an arc, helix, full circles or spiral."""

import math

from pipeline.gcode.block import Block
from pipeline.gcode.geometry import (
    NO_CHORD,
    NO_RADIUS,
    OK,
    TOO_FAR,
    centre_of_radius,
    distance,
    radii_agree,
    sweep,
)
from pipeline.gcode.motion import check_feed, programmed, target
from pipeline.gcode.moves import INCH
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.run import Run
from pipeline.gcode.state import FANUC, LINUXCNC
from pipeline.gcode.statements import WordItem

CENTRE_WORDS = "IJK"
RELATIVE_RADIUS = 1e-3
"""Radii of start and end of an arc may differ by this part in LinuxCNC (0.1 %)."""
LINUXCNC_TOLERANCE = 0.02 * math.sqrt(2)
"""Difference of radii that LinuxCNC always takes [mm]; measured on rs274 2.9."""
LINUXCNC_INCH_TOLERANCE = 0.002 * math.sqrt(2) * INCH
"""The same where the program counts inches [mm]."""
LINUXCNC_R_TOLERANCE = 0.00127
"""By which half a chord may pass R in LinuxCNC [mm] (0.00005 inch)."""


def arc(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G2 and G3: arc, helix, full circles or spiral."""
    check_feed(run, block, code, item)
    state = run.state
    turn = -1 if code == 20 else 1
    first, second, _ = IN_PLANE[state.plane]
    start = run.point if state.transformed else state.position.copy()
    centre = _centre_words(run, block, start)
    radius = block.take("R")
    turns = 1
    if state.dialect == LINUXCNC and "P" in block.words:
        turns = block.whole("P", block.words.pop("P"), 1, 1_000_000)
    end = programmed(run, block) if state.transformed else target(run, block)
    word = item or block.any_item()
    if centre is not None and (radius is None or state.dialect == LINUXCNC):
        if radius is not None:
            raise block.error(word, "R and I J K exclude each other: keep one of them")
        _check_radii(run, block, word, start, end, centre)
    elif radius is not None:
        centre = _centre_of_r(run, block, word, (start, end, radius * state.unit, turn))
    else:
        raise block.error(word, "the arc has neither I J K nor R: add the centre or the radius")
    u_c, v_c = centre
    angle = sweep(start[first], start[second], end[first], end[second], u_c, v_c, turn, turns)
    middle = start.copy()
    middle[first], middle[second] = u_c, v_c
    if state.transformed:
        angle *= _handedness(run, block, word)
        middle, end = run.mapping.machine(middle), run.mapping.machine(end)
    run.go_round(block.line, end, (middle[0], middle[1], middle[2]), angle)


def _centre_words(run: Run, block: Block, start: list[float]) -> tuple[float, float] | None:
    """Centre in the plane, where I, J or K says so [mm]."""
    state = run.state
    axes = IN_PLANE[state.plane][:2]
    given = [block.take(CENTRE_WORDS[axis]) for axis in axes]
    if given[0] is None and given[1] is None:
        return None
    centre = []
    for axis, value in zip(axes, given, strict=True):
        if state.arc_absolute:
            if value is None:
                letter = CENTRE_WORDS[axis]
                raise block.error(
                    block.any_item(), f"G90.1 is in force and {letter} is missing: add it"
                )
            shift = 0.0 if state.transformed else state.translation[axis]
            centre.append(value * state.unit + shift)
        else:
            centre.append(start[axis] + (value or 0.0) * state.unit)
    return centre[0], centre[1]


def _check_radii(
    run: Run,
    block: Block,
    word: WordItem | None,
    start: list[float],
    end: list[float],
    centre: tuple[float, float],
) -> None:
    first, second, _ = IN_PLANE[run.state.plane]
    u_c, v_c = centre
    tolerance, relative = arc_tolerances(run)
    verdict = radii_agree(
        start[first], start[second], end[first], end[second], u_c, v_c, tolerance, relative
    )
    if verdict == OK:
        return
    r_0 = distance(start[first] - u_c, start[second] - v_c)
    r_1 = distance(end[first] - u_c, end[second] - v_c)
    if verdict == NO_RADIUS:
        raise block.error(word, "the arc has radius 0: correct I, J, K or the end point")
    raise block.error(
        word,
        f"the arc starts {r_0:.6g} mm from its centre and ends {r_1:.6g} mm from it, more than "
        f"{tolerance:g} mm apart: correct the end point or I, J, K",
    )


def arc_tolerances(run: Run) -> tuple[float, float]:
    """By how much the radii of an arc's start and end may differ: [mm] and relative [1]."""
    if run.state.dialect == LINUXCNC:
        inch = run.state.unit != 1.0
        return LINUXCNC_INCH_TOLERANCE if inch else LINUXCNC_TOLERANCE, RELATIVE_RADIUS
    return run.setup.arc_tolerance, 0.0


def _centre_of_r(
    run: Run,
    block: Block,
    word: WordItem | None,
    arc: tuple[list[float], list[float], float, int],
) -> tuple[float, float]:
    start, end, radius, turn = arc
    first, second, _ = IN_PLANE[run.state.plane]
    tolerance = LINUXCNC_R_TOLERANCE
    if run.state.dialect == FANUC:
        tolerance = run.setup.arc_tolerance
    verdict, u_c, v_c = centre_of_radius(
        start[first], start[second], end[first], end[second], radius, turn, tolerance
    )
    if verdict == NO_CHORD:
        raise block.error(
            word, "an arc given by R starts and ends in one point: give I J K for a full circle"
        )
    if verdict == TOO_FAR:
        half = distance(end[first] - start[first], end[second] - start[second]) / 2
        raise block.error(
            word,
            f"R is {abs(radius):.6g} mm and half the chord {half:.6g} mm: R must not be shorter",
        )
    return u_c, v_c


def _handedness(run: Run, block: Block, word: WordItem | None) -> int:
    """-1 where the arc's plane is mirrored; an error where the arc is no arc any more."""
    matrix = run.mapping.matrix
    if matrix is None:
        return 1
    first, second, normal = IN_PLANE[run.state.plane]
    tilt = max(abs(matrix[normal][i]) + abs(matrix[i][normal]) for i in (first, second))
    if tilt > 1e-12:
        raise block.error(word, "an arc would leave its plane by rotation: rotate about its axis")
    a, b = matrix[first][first], matrix[first][second]
    c, d = matrix[second][first], matrix[second][second]
    if abs(a * a + c * c - b * b - d * d) > 1e-9 or abs(a * b + c * d) > 1e-9:
        raise block.error(word, "an arc would become an ellipse by scaling: scale both axes alike")
    return 1 if a * d - b * c > 0 else -1
