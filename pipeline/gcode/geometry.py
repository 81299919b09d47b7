"""Arcs in a plane with axes ``(u, v)`` that turn anticlockwise about its normal.

Compiled and interpreted they give the same bits.  Source: ISO 6983-1, 7.2; LinuxCNC 2.9 "G2, G3 Arc
Move".
"""

import math

from pipeline.gcode.moves import INCH

OK, NO_RADIUS, UNEQUAL_RADII, TOO_FAR, NO_CHORD = range(5)
"""Verdicts on an arc: valid, radius zero, radii of start and end differ, the radius does
not reach from start to end, start and end coincide so that R leaves the centre open."""

ZERO_RADIUS = 1e-9
"""Shorter is no radius [mm]."""
SAME_DIRECTION = 1e-12
"""An arc that would sweep less is a full circle [rad]: rounding of coordinates of some metres."""
SEMICIRCLE = 1e-9
"""A half chord this much (relative) below the radius counts as a semicircle."""


def distance(u: float, v: float) -> float:
    """Length of a vector; not ``hypot``, whose last bit differs from library to library."""
    return math.sqrt(u * u + v * v)


def sweep(
    u_0: float, v_0: float, u_1: float, v_1: float, u_c: float, v_c: float, turn: int, turns: int
) -> float:
    """Angle from start to end about the centre, positive anticlockwise [rad].

    Start 0, end 1 and centre c [mm]; ``turn`` is 1 anticlockwise (G3), -1 clockwise (G2); ``turns``
    counts the full circles begun.  A full circle where start and end lie in one direction.
    """
    start = math.atan2(v_0 - v_c, u_0 - u_c)
    end = math.atan2(v_1 - v_c, u_1 - u_c)
    angle = (end - start) * turn
    if angle <= SAME_DIRECTION:
        angle += 2 * math.pi
    if angle <= SAME_DIRECTION:
        angle += 2 * math.pi
    return turn * (angle + 2 * math.pi * (turns - 1))


def radii_agree(
    u_0: float, v_0: float, u_1: float, v_1: float, u_c: float, v_c: float, tolerance: float,
    relative: float,
) -> int:  # fmt: skip
    """Verdict on the radii of start 0 and end 1 about centre c [mm]: OK, NO_RADIUS, UNEQUAL_RADII.

    Radii may differ by ``tolerance`` [mm], and further up to the part ``relative`` [1] of the
    radius and 100 ``tolerance``.
    """
    r_0 = distance(u_0 - u_c, v_0 - v_c)
    r_1 = distance(u_1 - u_c, v_1 - v_c)
    if r_0 < ZERO_RADIUS or r_1 < ZERO_RADIUS:
        return NO_RADIUS
    difference = abs(r_0 - r_1)
    if difference > tolerance and (
        difference > 100 * tolerance or difference > relative * max(r_0, r_1)
    ):
        return UNEQUAL_RADII
    return OK


def centre_of_radius(
    u_0: float, v_0: float, u_1: float, v_1: float, radius: float, turn: int, tolerance: float
) -> tuple[int, float, float]:
    """Verdict (``OK``, ``TOO_FAR`` or ``NO_CHORD``) and centre [mm] of an arc given by R.

    Start 0 and end 1 [mm]; a negative ``radius`` [mm] is that of more than a semicircle; ``turn``
    as in :func:`sweep`; half of the chord may exceed the radius by ``tolerance`` [mm].
    """
    chord_u, chord_v = u_1 - u_0, v_1 - v_0
    half = distance(chord_u, chord_v) / 2
    u_m, v_m = (u_0 + u_1) / 2, (v_0 + v_1) / 2
    if half == 0:
        return NO_CHORD, u_m, v_m
    reach = abs(radius)
    if half - reach > tolerance:
        return TOO_FAR, u_m, v_m
    if half >= reach * (1 - SEMICIRCLE):
        return OK, u_m, v_m
    height = math.sqrt(reach * reach - half * half)
    side = turn if radius > 0 else -turn
    ratio = side * height / (2 * half)
    # left of the chord for the short anticlockwise arc
    return OK, u_m - ratio * chord_v, v_m + ratio * chord_u


RELATIVE_RADIUS = 1e-3
"""Radii of start and end of an arc may differ by this part in LinuxCNC (0.1 %)."""
LINUXCNC_TOLERANCE = 0.02 * math.sqrt(2)
"""Difference of radii that LinuxCNC always takes [mm]; measured on rs274 2.9."""
LINUXCNC_INCH_TOLERANCE = 0.002 * math.sqrt(2) * INCH
"""Difference of radii that LinuxCNC takes where the program counts inches [mm]."""
LINUXCNC_R_TOLERANCE = 0.00127
"""Length by which half a chord may exceed R in LinuxCNC [mm] (0.00005 inch)."""
