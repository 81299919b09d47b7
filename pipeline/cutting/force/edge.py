"""Elements of the cutting edge and its motion; chip and force on one of them, compiled.

Seen along its meridian an edge has a face (of a flat end straight across, of a drill its lip), a
corner (an arc of radius r_c, up to the whole of a ball) and the side, a cylinder.  On each element

    b = length of the meridian,   h = f_z (cos(slope) sin(phi) sin(kappa) - sin(slope) cos(kappa)),

with kappa the angle of the envelope's normal from the tool's axis: 90 degrees on the side, 0 on a
flat face.  At a height z above the tip the edge lags its tip by z tan(helix) / R; a face has no
lag.
"""

from math import acos, cos, expm1, pi, sin, sqrt
from typing import cast

import numpy as np

from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats

FACE, CORNER, SIDE = 0, 1, 2
RADIUS, CORNER_RADIUS, LAG, CONE_COS, CONE_SIN, FACE_HEIGHT = range(6)
"""Columns of ``shape``: R, r_c [m], lag for each height [rad/m], cosine and sine of half of the
face's point angle, height of the face [m]."""
PART, FROM, TO, LAG_FROM, LAG_TO, Z_FROM, Z_TO = range(7)
"""Columns of ``elements``; FROM and TO are lengths along the meridian [m]."""
COS_LAG, SIN_LAG, SIN_KAPPA, COS_KAPPA, ARM = range(5)
"""Columns of a point of the edge."""
GAUSS = 1 / sqrt(3.0)
ARC = pi / 2


@compiled
def place(part, p, shape, point):  # type: ignore[no-untyped-def]
    """Fill the columns of the edge's point at length ``p`` of a part; returns its height [m]."""
    point[SIN_KAPPA], point[COS_KAPPA], point[ARM], z, lag = where(part, p, shape)
    point[COS_LAG], point[SIN_LAG] = cos(lag), sin(lag)
    return z


@compiled
def where(part, p, shape):  # type: ignore[no-untyped-def]
    """Sine and cosine of kappa, distance from the axis, height [m] and lag at a place."""
    if part == FACE:
        z, arm = p * shape[CONE_COS], p * shape[CONE_SIN]
        return shape[CONE_COS], shape[CONE_SIN], arm, z, 0.0
    if part == CORNER:
        corner = shape[CORNER_RADIUS]
        sk, ck = sin(p / corner), cos(p / corner)
        z = corner * (1.0 - ck)
        return sk, ck, shape[RADIUS] - corner * (1.0 - sk), z, shape[LAG] * z
    return 1.0, 0.0, shape[RADIUS], p, shape[LAG] * (p - shape[FACE_HEIGHT])


@compiled
def place_pair(part, begin, end, shape, pair):  # type: ignore[no-untyped-def]
    """Fill both Gauss points of a stretch of the edge."""
    middle, half = 0.5 * (begin + end), 0.5 * GAUSS * (end - begin)
    place(part, middle - half, shape, pair[0])
    place(part, middle + half, shape, pair[1])


@compiled
def along(part, z, shape):  # type: ignore[no-untyped-def]
    """Length along the meridian at a height of a corner or of the side [m]."""
    if part == CORNER:
        return shape[CORNER_RADIUS] * acos(max(1.0 - z / shape[CORNER_RADIUS], 0.0))
    return z


@compiled
def divide(shape, low, high, many, elements, pairs):  # type: ignore[no-untyped-def]
    """Divide the edge between two heights into elements; how many there are.

    ``many`` holds how many of face, corner and side; ``elements`` has shape (n, 7) and ``pairs``
    (n, 2, 5), both large enough for all of them.
    """
    n = 0
    corner, face = shape[CORNER_RADIUS], shape[FACE_HEIGHT]
    rim = shape[RADIUS] - corner
    if rim > 0.0 and low <= face:
        begin, end = 0.0, rim
        if face > 0.0:
            begin = max(low, 0.0) / shape[CONE_COS]
            end = min(high, face) / shape[CONE_COS]
        else:
            end = rim / shape[CONE_SIN]
        n = _parts(FACE, begin, end, many[FACE], shape, n, elements, pairs)
    if corner > 0.0 and low < corner:
        begin = along(CORNER, max(low, 0.0), shape)
        end = along(CORNER, min(high, corner), shape)
        n = _parts(CORNER, begin, end, many[CORNER], shape, n, elements, pairs)
    bottom = max(low, max(corner, face))
    if high > bottom:
        n = _parts(SIDE, bottom, high, many[SIDE], shape, n, elements, pairs)
    return n


@compiled
def _parts(part, begin, end, many, shape, n, elements, pairs):  # type: ignore[no-untyped-def]
    if not end > begin:
        return n
    for k in range(many):
        one = elements[n]
        one[PART] = part
        one[FROM] = begin + (end - begin) * k / many
        one[TO] = begin + (end - begin) * (k + 1) / many
        point = pairs[n, 0]
        one[Z_FROM] = place(part, one[FROM], shape, point)
        one[Z_TO] = place(part, one[TO], shape, point)
        one[LAG_FROM] = one[LAG_TO] = 0.0
        if part != FACE:
            one[LAG_FROM] = shape[LAG] * (one[Z_FROM] - shape[FACE_HEIGHT])
            one[LAG_TO] = shape[LAG] * (one[Z_TO] - shape[FACE_HEIGHT])
        place_pair(part, one[FROM], one[TO], shape, pairs[n])
        n += 1
    return n


@compiled
def thickness(each, cosine, sine, offset, differences):  # type: ignore[no-untyped-def]
    """Chip of a tooth [m], below 0 where it misses: from it to the surfaces of the last N teeth.

    ``each`` is the chip without runout, ``cosine`` and ``sine`` are of the lag, ``differences``
    of shape (N, 2) those of radius at lag 0, ``offset`` the runout, which bounds them.
    """
    if offset == 0.0 or each <= 0.0:
        return each
    many = differences.shape[0]
    least = many * each
    for m in range(1, many):
        if (m - 1) * each >= 2.0 * offset:  # even a tooth that stands out most is passed
            break
        least = min(least, m * each + differences[m, 0] * cosine - differences[m, 1] * sine)
    return least


@compiled
def cut_part(begin, end, h, after):  # type: ignore[no-untyped-def]
    """Begin and end of a tooth's chip of a nearly straight course; equal where there is none.

    ``h`` and ``after`` are its thickness at the Gauss points between ``begin`` and ``end``.
    """
    middle, rise = 0.5 * (h + after), 0.5 * (after - h) / GAUSS
    if middle >= abs(rise):
        return begin, end
    if middle <= -abs(rise):
        return begin, begin
    size = 0.5 * (1.0 + middle / abs(rise)) * (end - begin)
    if rise > 0.0:
        return end - size, end
    return begin, begin + size


@compiled
def grown(h, growth):  # type: ignore[no-untyped-def]
    """Share of the edge's force that a chip ``h`` has, which grows over ``growth`` [m] of it.

    1 - exp(-h / growth), or below 0 along a straight line up to -``growth``.
    """
    if growth == 0.0:
        return 1.0
    return -expm1(-h / growth) if growth > 0.0 else min(-h / growth, 1.0)


@compiled
def add_force(s, c, sk, ck, arm, h, width, exponent, growth, out):  # type: ignore[no-untyped-def]
    """Add force and torque on a stretch of the edge, for each coefficient; ``out`` is (4, 6).

    ``s`` and ``c`` are sine and cosine of phi, ``sk`` and ``ck`` of kappa.
    """
    area = width * (h if exponent == 1.0 else h**exponent)
    for k in range(2):
        column, weight = (0, area) if k == 0 else (3, width * grown(h, growth))
        out[0, column] -= weight * c
        out[0, column + 1] -= weight * s * sk
        out[0, column + 2] -= weight * s * ck
        out[1, column] += weight * s
        out[1, column + 1] -= weight * c * sk
        out[1, column + 2] -= weight * c * ck
        out[2, column + 1] -= weight * ck
        out[2, column + 2] += weight * sk
        out[3, column] += weight * arm


LIP = 4
"""Number of elements of a drill's lip."""


def edge_shape(tool: Tool) -> Floats:
    """Dimensions of an edge; shape (6,), columns of :mod:`pipeline.cutting.force.edge`."""
    half = tool.point_angle / 2 if tool.kind == "drill" else np.pi / 2
    cosine = 0.0 if half == np.pi / 2 else float(np.cos(half))
    sine = float(np.sin(half))
    lag = float(np.tan(tool.helix)) / tool.radius
    face = tool.radius * cosine / sine
    return np.array([tool.radius, tool.corner_radius, lag, cosine, sine, face])


def radius_differences(tool: Tool) -> Floats:
    """Cosine and sine parts of r_j - r_(j-m), by which tooth j stands out over the m-th before it.

    Shape (N, N, 2) [m]; at a lag the difference is the one times its cosine less the other times
    its sine.
    """
    teeth = np.arange(tool.flutes)
    turned = tool.runout * np.exp(1j * (tool.runout_angle + 2 * np.pi / tool.flutes * teeth))
    out = turned[:, None] - turned[teeth[:, None] - teeth]
    return cast(Floats, out.view(np.float64).reshape(tool.flutes, tool.flutes, 2))


def bin_middles(bins: int) -> Floats:
    """Sine and cosine of the angles of an engagement's bins; shape (F, 2)."""
    phi = (np.arange(bins) + 0.5) * (2 * np.pi / bins)
    return np.stack([np.sin(phi), np.cos(phi)], axis=1)


def piece_buffer(elements: int, shape: Floats, height: float, bins: int) -> Floats:
    """Buffer for all pieces into which bins divide elements of an edge up to a height [m]."""
    *_, lag, _, _, _ = shape
    crossed = int(abs(lag) * height * bins / (2 * np.pi))
    return np.empty((3 * elements + crossed, 9))


def motion(f_z: float, slope: float) -> Floats:
    """Feed for each tooth [m], cosine and sine of the motion's slope; shape (3,)."""
    return np.array([f_z, np.sqrt(1.0 - slope**2), slope])


def edge_elements(
    tool: Tool, depth: tuple[float, float], *, corner: int, side: int, slope: float = 0.0
) -> tuple[Floats, Floats]:
    """Elements of the edge between two heights, so many of its corner and side; Gauss points."""
    many = np.array([LIP if tool.kind == "drill" else int(slope < 0), corner, side])
    elements, pairs = np.empty((many.sum(), 7)), np.empty((many.sum(), 2, 5))
    n = divide(edge_shape(tool), *depth, many, elements, pairs)
    return elements[:n], pairs[:n]
