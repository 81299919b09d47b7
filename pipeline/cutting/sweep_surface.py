"""The end of a tool as a surface over its axis, and how low it passes over a place, compiled.

A tool that moves straight passes over a place at (along, left) of its start; t is how far it has
come.  Its surface above the place is at slope t + e(r), r^2 = left^2 + (along - t)^2, convex in t.
"""

from math import sqrt

from pipeline.cutting.sweep_room import CONE, FLAT
from pipeline.kernels import compiled

_HALVINGS = 16


@compiled
def end_height(kind, flat, corner, cone, r):  # type: ignore[no-untyped-def]
    """e(r): height of the end's surface above the tip at radius ``r`` within the tool's [m]."""
    if kind == FLAT or r <= flat:
        return 0.0
    if kind == CONE:
        return cone * r
    return corner - sqrt(max(0.0, corner * corner - (r - flat) * (r - flat)))


@compiled
def radius_at(kind, radius, flat, corner, cone, height):  # type: ignore[no-untyped-def]
    """Radius of the tool at a height above its tip [m]."""
    if kind == CONE:
        return min(height / cone, radius)
    if kind == FLAT or height >= corner:
        return radius
    return flat + sqrt(max(0.0, height * (2.0 * corner - height)))


@compiled
def lowest_at(kind, flat, corner, cone, along, left, slope, begin, end):  # type: ignore[no-untyped-def]
    """How far the tool has come, within ``begin`` to ``end``, when it is lowest there [m]."""
    if slope == 0.0:
        return min(max(along, begin), end)
    steep = abs(slope)
    if kind == FLAT or (kind == CONE and steep >= cone):
        return end if slope < 0.0 else begin
    if kind == CONE:
        lag = steep * abs(left) / sqrt(cone * cone - steep * steep)
    elif flat == 0.0:
        lag = steep * sqrt(max(0.0, corner * corner - left * left)) / sqrt(1.0 + steep * steep)
    else:
        lag = _lag_of_torus(flat, corner, abs(left), steep)
    t = along + lag if slope < 0.0 else along - lag
    return min(max(t, begin), end)


@compiled
def _lag_of_torus(flat, corner, left, steep):  # type: ignore[no-untyped-def]
    """How far from abreast of the place a rounded corner is lowest: e'(r) u / r = steep."""
    low, high = max(flat, left), flat + corner
    for _ in range(_HALVINGS):
        r = 0.5 * (low + high)
        out = r - flat
        rise = out * out * (r * r - left * left)
        if rise > steep * steep * r * r * (corner * corner - out * out):
            high = r
        else:
            low = r
    r = 0.5 * (low + high)
    return sqrt(max(0.0, r * r - left * left))
