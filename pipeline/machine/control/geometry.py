"""Geometry of lines and arcs: length and bounds of the derivatives along the path, compiled.

The path of a block is the length of X, Y, Z [m]; where only rotary axes move it is the length of
their vector [rad].  The motion of an axis along it is bounded over the whole block: by the
derivative dq/ds and the curvature d2q/ds2 of each axis.  An arc's radius r changes linearly with
its angle, and the other axes too: with r' = dr/dpsi, h of the normal axis and
w = sqrt(r^2 + r'^2 + h^2),

    dq/ds = (r' e_r + r e_phi) / w,   |d2q/ds2| <= (r e_r + 2 r') / w^2 + r r' / w^3,
    |d3q/ds3| <= (r e_phi + 3 r') / w^3 + 3 (r + 2 r') r r' / w^5 + 3 (r r')^2 / w^6 + r'^2 / w^4

with the greatest r and the least w of the block; exact for arcs and helices.
"""

from math import atan2, ceil, cos, hypot, log, pi, sin, sqrt

from pipeline.gcode.moves import METRE, RADIAN, Kind
from pipeline.kernels import compiled

BEGIN, FINISH, STEEPEST, CURVATURE, THIRD = range(5)
"""Rows of a block's frame: dq/ds at its start and end; bounds of |dq/ds|, |d2q/ds2|, |d3q/ds3|."""

STILL, STRAIGHT, ROTARY, CURVED = range(4)
"""Form of a block: without motion, a line, a line of rotary axes alone, an arc."""

_ARC = int(Kind.ARC)


@compiled
def shape(kind, origin, end, centre, angle, plane, k, frame) -> tuple[int, float]:  # type: ignore[no-untyped-def]
    """Form of row k and its length [m, rad]; fills its frame, the first rows of ``frame``."""
    if kind[k] == _ARC:
        return _arc(origin, end, centre, angle, plane, k, frame)
    return _line(origin, end, k, frame)


@compiled
def start_of(origin, end, k, i):  # type: ignore[no-untyped-def]
    """Position of axis i before row k [mm, deg]."""
    return end[k - 1, i] if k > 0 else origin[i]


@compiled
def _line(origin, end, k, frame):  # type: ignore[no-untyped-def]
    linear = 0.0
    rotary = 0.0
    for i in range(6):
        step = (end[k, i] - start_of(origin, end, k, i)) * (METRE if i < 3 else RADIAN)
        frame[BEGIN, i] = step
        if i < 3:
            linear += step * step
        else:
            rotary += step * step
    if linear == 0.0 and rotary == 0.0:
        return STILL, 0.0
    length = sqrt(linear) if linear > 0.0 else sqrt(rotary)
    for i in range(6):
        slope = frame[BEGIN, i] / length
        frame[BEGIN, i] = slope
        frame[FINISH, i] = slope
        frame[STEEPEST, i] = abs(slope)
        frame[CURVATURE, i] = 0.0
        frame[THIRD, i] = 0.0
    return (STRAIGHT if linear > 0.0 else ROTARY), length


@compiled
def in_plane(plane):  # type: ignore[no-untyped-def]
    """First, second and normal axis of plane 17, 18 or 19."""
    if plane == 17:
        return 0, 1, 2
    if plane == 18:
        return 2, 0, 1
    return 1, 2, 0


@compiled
def arc_terms(origin, end, centre, angle, plane, k):  # type: ignore[no-untyped-def]
    """Start angle [rad], radius at start and end [m], and by angle c^2 of w^2 = r^2 + c^2 [m^2]."""
    a, b, n = in_plane(plane[k])
    u = (start_of(origin, end, k, a) - centre[k, a]) * METRE
    v = (start_of(origin, end, k, b) - centre[k, b]) * METRE
    r_0 = hypot(u, v)
    r_1 = hypot((end[k, a] - centre[k, a]) * METRE, (end[k, b] - centre[k, b]) * METRE)
    turned = abs(angle[k])
    slope = (r_1 - r_0) / turned
    pitch = (end[k, n] - start_of(origin, end, k, n)) * METRE / turned
    return atan2(v, u), r_0, r_1, slope * slope + pitch * pitch


@compiled
def arc_length(r_0, r_1, c_2, turned):  # type: ignore[no-untyped-def]
    """Length of a path of ``turned`` rad whose radius goes from r_0 to r_1 [m].

    Closed form of the integral of sqrt(r^2 + c^2); by its midpoint where the radius hardly changes,
    since the closed form is a difference there.
    """
    change = r_1 - r_0
    middle = (r_0 + r_1) / 2
    w_2 = middle * middle + c_2
    if w_2 == 0.0:
        return 0.0
    if change * change < 1e-8 * w_2:
        # the integrand's second derivative is c^2 / w^3, its fourth is smaller by (change / w)^2
        return turned * sqrt(w_2) * (1.0 + change * change * c_2 / (24.0 * w_2 * w_2))
    return turned / change * (_primitive(r_1, c_2) - _primitive(r_0, c_2))


@compiled
def _primitive(r, c_2):  # type: ignore[no-untyped-def]
    w = sqrt(r * r + c_2)
    logarithm = c_2 * log((r + w) / sqrt(c_2)) if c_2 > 0.0 else 0.0
    return (r * w + logarithm) / 2.0


@compiled
def _arc(origin, end, centre, angle, plane, k, frame):  # type: ignore[no-untyped-def]
    a, b, _ = in_plane(plane[k])
    turned = abs(angle[k])
    if turned == 0.0:
        return _line(origin, end, k, frame)
    sign = 1.0 if angle[k] > 0.0 else -1.0
    phi, r_0, r_1, c_2 = arc_terms(origin, end, centre, angle, plane, k)
    length = arc_length(r_0, r_1, c_2, turned)
    if length == 0.0:
        return _line(origin, end, k, frame)
    slope = (r_1 - r_0) / turned
    w_0, w_1 = sqrt(r_0 * r_0 + c_2), sqrt(r_1 * r_1 + c_2)
    for i in range(6):
        rate = (end[k, i] - start_of(origin, end, k, i)) * (METRE if i < 3 else RADIAN) / turned
        frame[BEGIN, i] = rate / w_0
        frame[FINISH, i] = rate / w_1
        _bound_proportional(frame, i, abs(rate), max(r_0, r_1) * abs(slope), min(w_0, w_1), slope)
    for i, shift in ((a, 0.0), (b, -pi / 2)):
        # e_r has cos(phi + shift) along this axis, e_phi its derivative
        first, last = phi + shift, phi + shift + angle[k]
        frame[BEGIN, i] = (slope * cos(first) - sign * r_0 * sin(first)) / w_0
        frame[FINISH, i] = (slope * cos(last) - sign * r_1 * sin(last)) / w_1
        radial = _greatest_cosine(first, last)
        across = _greatest_cosine(first + pi / 2, last + pi / 2)
        steepest = max(r_0, r_1) * across / max(w_0, w_1) + abs(slope) / min(w_0, w_1)
        frame[STEEPEST, i] = min(1.0, steepest)
        _bound_plane(frame, i, max(r_0, r_1), abs(slope), min(w_0, w_1), radial, across)
    return CURVED, length


@compiled
def _bound_proportional(frame, i, rate, product, w, slope):  # type: ignore[no-untyped-def]
    """Bounds of an axis that goes linearly with the angle; ``product`` is r r'."""
    frame[STEEPEST, i] = rate / w
    frame[CURVATURE, i] = rate * product / w**4
    frame[THIRD, i] = rate * (3 * product**2 / w**7 + slope**2 / w**5)


@compiled
def _bound_plane(frame, i, r, slope, w, radial, across):  # type: ignore[no-untyped-def]
    """Bounds of an axis of the arc's plane; ``radial`` and ``across`` of e_r and e_phi."""
    frame[CURVATURE, i] = (r * radial + 2 * slope) / w**2 + r * slope / w**3
    frame[THIRD, i] = (
        (r * across + 3 * slope) / w**3
        + 3 * (r + 2 * slope) * r * slope / w**5
        + 3 * (r * slope) ** 2 / w**6
        + slope**2 / w**4
    )


@compiled
def _greatest_cosine(first, last):  # type: ignore[no-untyped-def]
    """Greatest |cos| between two angles."""
    low, high = min(first, last), max(first, last)
    if ceil(low / pi) * pi <= high:
        return 1.0
    return max(abs(cos(low)), abs(cos(high)))
