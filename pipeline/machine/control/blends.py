"""Corners that a control blends: arcs between tangents, parabolas, and kinks passed at once.

The rules of LinuxCNC's trajectory planner.  Of three ways through a corner the fastest is taken, a
parabola only where it is twice as fast, since it halves the accelerations beside it:

kink      v at which the change of direction, within one cycle T, costs each axis no more than the
          share k of its acceleration: |du_i| (v / T + a) <= k a_i; 1 - k is left beside it.
arc       tangent to both segments, within the tolerance and half of either: R = d tan(theta),
          theta half of the angle between them, v^2 <= s a R, s the share towards the centre.
parabola  the next segment starts while the one before it stops.

Arcs of the program take s a towards their centre too, and what is left of a along the path.

Source: LinuxCNC 2.9, Integrator Information, "Trajectory Control" and [TRAJ] of "INI
Configuration"; held against the planner itself in tests/machine/test_linuxcnc.py.
"""

from math import ceil, cos, inf, isfinite, sin, sqrt, tan
from typing import NamedTuple

import numpy as np

from pipeline.gcode.moves import METRE, RADIAN, Kind, PathMode
from pipeline.kernels import compiled
from pipeline.machine.control.geometry import CURVED, in_plane
from pipeline.machine.control.parameters import Limit
from pipeline.machine.control.path import Binding, Halt, Motion, Path, Segments
from pipeline.machine.spindle import halts
from pipeline.schema.arrays import Floats, Rows

LENGTH, CAP, RATE, RADIUS, END, TURN, BEND_1, BEND_2, THETA, KINK, REACH = range(11)
ARC_SPEED, ARC_RATE, TOLERANCE = range(11, 14)
"""Rows of ``Segments.table``.  Of a segment its length [m], greatest speed [m/s], acceleration,
of arcs along the path and across together [m/s^2], radius of curvature, infinite of lines [m], and
end; of the corner there its turn [rad], curvature of the segments before and after it, positive
towards the turn [1/m], theta [rad], change of direction over the worst axis' acceleration [s^2/m],
length that an arc may take of either [m], speed and acceleration in its plane [m/s], [m/s^2]; and
the programmed tolerance, 0 for none [m].
"""
STANDS, LAST, RUNS_OUT, EXACT, BLENDS = range(5)
"""Ends of a segment: a standstill; one before which the control knew of nothing to come, under G61
and under G64; one unless the next segment goes straight on; and a blend."""
SIZE, TOP, SLOPE, OUT, TIME, COMMANDED, KEPT, OVERLAP = range(8)
"""Rows of the work array of :func:`plan_segments`.  Of pieces, a segment and the arc after it:
length [m], speed on top [m/s], acceleration [m/s^2], speed at the end [m/s], time [s]; of segments
the commanded speed and that of the greatest override [m/s], two shares of their acceleration [1],
the time they share with the next [s].
"""
GREATEST_CHAIN = 100
"""Most lines that a tolerance joins to one."""
SHARPEST = np.radians(2.0)
"""Angle between two segments below which their corner is a standstill [rad]."""
SPAN = 0.5
"""Share of a line that the arc at one of its ends may take [1]."""
NOMINAL_TOLERANCE = 0.25
"""Greatest tolerance of a corner, as a share of the shorter segment's length [1]."""
LEAST_CYCLES, GAP_CYCLES = 1.02, 4.0
"""Cycles that a segment takes at least, and below which a line becomes part of the next arc [1]."""
RAMP_TIME = 0.01
"""Time below which the speed goes from a piece's start straight to its end [s]."""
STRAIGHT = 1e-3
"""Half of a turn below which no tolerance binds [rad]."""
COPLANAR = 1e-6
"""Greatest difference between the planes of a corner and of its arc [1]."""
_TINY = 1e-12


class _Course(NamedTuple):
    """Course of S segments.

    Starts [mm, deg], steps [m, rad], limits of speed and acceleration (2, S, 6); directions at both
    ends and from the centre to them [m] (2, S, 3), axis (S, 3) and angle [rad] of arcs.
    """

    start: Floats
    step: Floats
    limits: Floats
    directions: Floats
    out: Floats
    spin: Floats
    sweep: Floats


def segments_of(path: Path) -> Segments:
    """Segments of a path and the corners between them; once for a program and a control."""
    first, last = _chains(path)
    course = _straight(path, first, last)
    linear = np.linalg.norm(course.step[:, :3], axis=1)
    least = (np.abs(course.step) / course.limits).max(axis=2)
    table = np.zeros((TOLERANCE + 1, len(last)))
    table[RADIUS], table[TOLERANCE] = np.inf, path.moves.tolerance[last] * METRE
    for plane in (17, 18, 19):
        _bend(path, last, course, least, table, plane)
    table[LENGTH] = np.where(first == last, path.length[last], linear)
    table[[CAP, RATE]] = table[LENGTH] / least
    most = np.where(linear > 0, path.control.path_limits[1], np.inf)
    table[RATE] = np.minimum(table[RATE], most)
    table[END] = _ends(path, last)
    if len(last) > 1:
        _join(path, table, course)
    return Segments(first=first, last=last, table=table)


def _straight(path: Path, first: Rows, last: Rows) -> _Course:
    moves, many = path.moves, len(last)
    start = np.where((first > 0)[:, np.newaxis], moves.end[first - 1], moves.origin)
    step = (moves.end[last] - start) * np.array([METRE] * 3 + [RADIAN] * 3)
    group = np.array([[Limit.RAPID_SPEED], [Limit.RAPID_ACCELERATION]], int)
    group = group + (path.motion[last] != Motion.RAPID)
    along = step[:, :3] / np.maximum(np.linalg.norm(step[:, :3], axis=1), _TINY)[:, np.newaxis]
    return _Course(
        start, step, path.control.limits[group], np.array([along, along]),
        np.zeros((2, many, 3)), np.zeros((many, 3)), np.zeros(many),
    )  # fmt: skip


def _bend(
    path: Path, last: Rows, course: _Course, least: Floats, table: Floats, plane: int
) -> None:
    """Fill in the arcs of a plane; their limits are those of the worse axis of it."""
    a, b, n = in_plane(plane)
    arc = np.flatnonzero((path.form[last] == CURVED) & (path.moves.plane[last] == plane))
    rows, rise, sweep = last[arc], course.step[arc, n], path.moves.angle[last[arc]]
    ends = np.array([course.start[arc, :3], path.moves.end[rows, :3]]) - path.moves.centre[rows]
    u, v = METRE * ends[:, :, a], METRE * ends[:, :, b]
    r = np.maximum(np.hypot(u, v), _TINY)
    tight, growth = r.min(axis=0), (r[1] - r[0]) / sweep
    ahead = np.array([growth * u / r - v, growth * v / r + u, 0.0 * u + rise / sweep])
    ahead *= np.sign(sweep) / np.linalg.norm(ahead, axis=0)
    for axis, along, across in zip((a, b, n), ahead, (u, v, 0.0 * u), strict=True):
        course.directions[:, arc, axis], course.out[:, arc, axis] = along, across
    course.spin[arc, n], course.sweep[arc] = 1.0, np.abs(sweep)
    speed, rate = course.limits[:, arc][:, :, [a, b]].min(axis=2)
    inward = np.sqrt(path.control.blend.arc_share * rate * np.hypot(tight, growth))
    times = np.hypot(tight * sweep, r[1] - r[0]) / np.array([np.minimum(speed, inward), rate])
    least[:, arc] = np.maximum(least[:, arc], times)
    flat = (r[0] ** 2 + growth**2) ** 1.5 / (r[0] ** 2 + 2 * growth**2)
    table[RADIUS, arc] = flat + rise**2 / flat


def _ends(path: Path, last: Rows) -> Floats:
    moves = path.moves
    goes_on = moves.path_mode[last] == PathMode.CONTINUOUS
    halted = np.cumsum(halts(moves, path.control.auxiliary) == Halt.STOPS)[last]
    waits = np.append(np.diff(halted) > 0, True)
    stands = path.end_reason[last] == Binding.EXACT_STOP
    standing = np.where(waits, np.where(goes_on, RUNS_OUT, LAST), STANDS)
    return np.where(stands, standing, np.where(goes_on, BLENDS, EXACT))


def _join(path: Path, table: Floats, course: _Course) -> None:
    blend, corner = path.control.blend, table[:, :-1]
    limits, out = course.limits[:, 1:, :3], course.out
    u_1, u_2 = course.directions[1, :-1], course.directions[0, 1:]
    cosine = np.clip((u_1 * u_2).sum(axis=1), -1.0, 1.0)
    theta = np.arccos(-cosine) / 2
    normal = np.cross(u_1, u_2)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), _TINY)[:, np.newaxis]
    within = np.sqrt(np.maximum(1.0 - normal**2, _TINY**2))
    corner[ARC_SPEED], corner[ARC_RATE] = (limits / within).min(axis=2)
    corner[TURN], corner[THETA] = np.pi - 2 * theta, theta
    tolerance = NOMINAL_TOLERANCE * table[LENGTH]
    tolerance = np.where(table[TOLERANCE] > 0, np.minimum(table[TOLERANCE], tolerance), tolerance)
    corner[REACH] = np.minimum(tolerance[:-1], tolerance[1:])
    reach = SPAN * np.minimum(table[LENGTH, :-1], table[LENGTH, 1:])
    arcs = np.isfinite(table[RADIUS])
    for bend, end, of, other, part in (
        (BEND_1, 1, slice(-1), u_2, 2 / 3), (BEND_2, 0, slice(1, None), -u_1, 1 / 3)
    ):  # fmt: skip
        # an arc that bends towards the other segment is taken for the secant of its trim
        arc, radius = arcs[of], np.maximum(np.linalg.norm(out[end, of], axis=1), _TINY)
        towards = (out[end, of] * other).sum(axis=1) < 0
        corner[bend] = np.where(arc, np.where(towards, 1.0, -1.0) / radius, 0.0)
        most = np.minimum(part * course.sweep[of], np.where(towards, theta, np.pi / 2))
        taken = radius * np.where(towards, np.sin(most / 4), most)
        flat = np.abs((normal * course.spin[of]).sum(axis=1)) > 1.0 - COPLANAR
        reach = np.where(arc, np.minimum(reach, np.where(flat, taken, 0.0)), reach)
        lower = np.where(arc & towards, theta - most / 4, theta)
        corner[THETA] = np.minimum(corner[THETA], lower)
    deepest = corner[REACH] * np.cos(corner[THETA]) / np.maximum(1 - np.sin(corner[THETA]), _TINY)
    turning = (course.step[:, 3:] != 0).any(axis=1)
    turning = turning[:-1] | turning[1:]
    corner[REACH] = np.where(turning, 0.0, np.minimum(reach, deepest))
    kink = (np.abs(u_2 - u_1) / limits[1]).max(axis=1)
    kink /= np.where(arcs[:-1] | arcs[1:], sqrt(1.0 - blend.arc_share**2), 1.0)
    corner[KINK] = np.where(turning, np.inf, kink)
    sharp = (2 + 2 * cosine < SHARPEST**2) & ~turning & blend.arcs & (corner[END] >= EXACT)
    corner[END, sharp] = STANDS


def _chains(path: Path) -> tuple[Rows, Rows]:
    """First and last row of each segment: lines within the tolerance of their chord are one."""
    moves, rows = path.moves, np.flatnonzero(path.moving)
    joined = (moves.kind[rows] == Kind.FEED) & (moves.tolerance[rows] > 0)
    joined &= moves.path_mode[rows] == PathMode.CONTINUOUS
    joined &= (np.diff(moves.end[rows, 3:], axis=0, prepend=[moves.origin[3:]]) == 0).all(axis=1)
    joined[1:] &= joined[:-1] & (np.diff(rows) == 1)
    joined[1:] &= path.end_reason[rows[:-1]] != Binding.EXACT_STOP
    for column in (moves.feed, moves.feed_mode, moves.tolerance):
        joined[1:] &= column[rows[1:]] == column[rows[:-1]]
    joined[:1] = False
    points = np.concatenate([np.atleast_2d(moves.origin), moves.end])[:, :3]
    join_lines(rows, points, moves.tolerance, joined)
    heads = np.flatnonzero(~joined)
    return rows[heads], rows[np.append(heads[1:], len(rows))[: len(heads)] - 1]


@compiled
def join_lines(rows, points, tolerance, joined):  # type: ignore[no-untyped-def]
    """Leave marked the rows that belong to the line before; ``points`` are those before rows."""
    head = 0
    for k in range(rows.shape[0]):
        joined[k] = joined[k] and k - head <= GREATEST_CHAIN
        for m in range(head, k):
            gap = _apart(points, rows[head], rows[k] + 1, rows[m] + 1)
            joined[k] = joined[k] and gap <= tolerance[rows[k]]
        if not joined[k]:
            head = k


@compiled
def _apart(points, a, b, p):  # type: ignore[no-untyped-def]
    """Distance of point p from the line from a to b."""
    along, size, total = 0.0, 0.0, 0.0
    for i in range(3):
        along += (points[b, i] - points[a, i]) * (points[p, i] - points[a, i])
        size += (points[b, i] - points[a, i]) ** 2
    part = min(max(along / size, 0.0), 1.0) if size > 0.0 else inf
    for i in range(3):
        total += (points[p, i] - points[a, i] - part * (points[b, i] - points[a, i])) ** 2
    return sqrt(total)


@compiled
def plan_segments(  # type: ignore[no-untyped-def]
    table, commanded, cap, ramps, cycle, arcs, share, ratio, scale, work, v_out, v_peak, time
):
    """Fill the speed at the end of each segment, the greatest in it [m/s], and its time [s].

    ``commanded`` is the speed of the program and ``cap`` its limit [m/s], ``ramps`` where a short
    piece goes straight to the speed at its end, ``cycle`` the interpolation period [s]; then those
    of ``BlendParameters``.  ``work`` has shape (8, 2 S), its columns two a segment.
    """
    many = table.shape[1]
    rest = sqrt(1.0 - share * share)
    for s in range(many):
        length = table[LENGTH, s]
        work[COMMANDED, s] = min(commanded[s], min(cap[s], length / cycle))
        work[COMMANDED, many + s] = min(scale * commanded[s], min(cap[s], length / cycle))
        work[KEPT, s], work[KEPT, many + s], work[OVERLAP, s] = 1.0, 1.0, 0.0
        work[SIZE, 2 * s], work[SIZE, 2 * s + 1] = length, 0.0
        work[OUT, 2 * s], work[OUT, 2 * s + 1] = 0.0, inf
    for s in range(many):
        if table[END, s] == RUNS_OUT:
            work[KEPT, many + s] = 0.5
        elif table[END, s] >= EXACT:
            _pass_corner(table, s, cycle, arcs, share, rest, ratio, work)
    for s in range(many):
        kept, radius = table[RATE, s] * work[KEPT, s] * work[KEPT, many + s], table[RADIUS, s]
        top, a = min(work[COMMANDED, s], work[SIZE, 2 * s] / (LEAST_CYCLES * cycle)), kept
        final = table[END, s] == RUNS_OUT or table[END, s] == LAST
        if isfinite(radius) and final:
            a = kept * rest
        elif isfinite(radius):
            inward = min(table[CAP, s] ** 2 / radius, share * kept)
            top, a = min(top, sqrt(inward * radius)), sqrt(kept * kept - inward * inward)
        work[TOP, 2 * s], work[SLOPE, 2 * s] = top, a
        if final and s > 0:
            before = 2 * s - 1 if work[SIZE, 2 * s - 1] > 0.0 else 2 * s - 2
            work[OUT, before] = min(work[OUT, before], sqrt(a * work[SIZE, 2 * s]))
    _along(work, ramps, cycle)
    for s in range(many):
        v_out[s], v_peak[s] = work[OUT, 2 * s], max(work[TOP, 2 * s], work[TOP, 2 * s + 1])
        own, arc, shared = work[TIME, 2 * s], work[TIME, 2 * s + 1], work[OVERLAP, s]
        if s > 0:
            v_peak[s] = max(v_peak[s], work[TOP, 2 * s - 1])
            arc, shared = arc + work[TIME, 2 * s - 1], shared + work[OVERLAP, s - 1]
        time[s] = max(own - 0.5 * shared, min(own, cycle)) + 0.5 * arc


@compiled
def _pass_corner(table, s, cycle, arcs, share, rest, ratio, work):  # type: ignore[no-untyped-def]
    """Choose how the corner after segment s is passed."""
    many, n, kink = table.shape[1], s + 1, table[KINK, s]
    v_1, v_2 = work[COMMANDED, many + s], work[COMMANDED, many + n]
    cost = kink * (min(v_1, v_2) / cycle + table[RATE, n])
    if arcs and cost < ratio:
        _keep_kink(s, min(v_1, v_2), 1.0 - cost, work)
        return
    if table[END, s] == EXACT:
        _keep_kink(s, 0.0, 1.0 - ratio if arcs else 1.0, work)
        return
    v_kink, v_arc, trim_1, trim_2, size = 0.0, 0.0, 0.0, 0.0, 0.0
    if arcs:
        v_kink = min(v_1, v_2) * ratio / cost
        v_arc, trim_1, trim_2, size = _arc(table, s, share, min(max(v_1, v_2), table[ARC_SPEED, s]))
    # without arcs only what ends in a parabola goes with half of the acceleration
    halved = 0.5 if arcs or table[END, n] in (RUNS_OUT, BLENDS) else 1.0
    a_1 = 0.5 * table[RATE, s] * (rest if isfinite(table[RADIUS, s]) else 1.0)
    a_2 = halved * table[RATE, n] * (rest if isfinite(table[RADIUS, n]) else 1.0)
    b_1, b_2 = _parabola(table, s, a_1 * (1.0 - ratio), a_2 * (1.0 - ratio), v_1, v_2, 0.5)
    if not arcs or 0.25 * cos(0.5 * table[TURN, s]) * (b_1 + b_2) >= max(v_kink, v_arc):
        work[KEPT, many + s], work[KEPT, many + n] = 0.5, halved
        v_1 = min(work[COMMANDED, s], sqrt(0.5 * share * table[RATE, s] * table[RADIUS, s]))
        v_2 = min(work[COMMANDED, n], sqrt(halved * share * table[RATE, n] * table[RADIUS, n]))
        work[OVERLAP, s] = _parabola(table, s, a_1, a_2, v_1, v_2, 1.0)[0] / a_1
    elif v_kink >= v_arc:
        _keep_kink(s, v_kink, 1.0 - ratio, work)
    else:
        work[OUT, 2 * s] = inf
        work[SIZE, 2 * s] -= trim_1
        work[SIZE, 2 * n] -= trim_2
        work[TOP, 2 * s + 1] = min(v_arc, max(work[COMMANDED, s], work[COMMANDED, n]))
        work[SLOPE, 2 * s + 1] = table[ARC_RATE, s] * rest
        if table[BEND_1, s] == 0.0 and work[SIZE, 2 * s] < GAP_CYCLES * cycle * v_arc:
            size += max(work[SIZE, 2 * s], 0.0)
            work[SIZE, 2 * s] = 0.0
        work[SIZE, 2 * s + 1] = size


@compiled
def _keep_kink(s, v, kept, work):  # type: ignore[no-untyped-def]
    work[OUT, 2 * s] = v
    work[KEPT, s], work[KEPT, s + 1] = min(work[KEPT, s], kept), kept


@compiled
def _arc(table, s, share, goal):  # type: ignore[no-untyped-def]
    """Speed of the arc after segment s, 0 for none [m/s], its share of both [m], its length [m]."""
    theta, reach, a = table[THETA, s], table[REACH, s], table[ARC_RATE, s]
    if reach <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    v = min(sqrt(share * a * tan(theta) * reach), goal)
    turn, k_1, k_2 = table[TURN, s], table[BEND_1, s], table[BEND_2, s]
    wide = 2.0 * min(sqrt(a * reach), v) * v / (a * (np.pi - 2.0 * theta))
    r = max(v * v / (share * a), min(wide, tan(theta) * reach))
    # centre of the arc from the corner, x along the first segment and y to the side of the turn:
    # |O|^2 - r^2 = 2 (O n - r) / k of each segment, a line where its curvature k is 0
    c, d = cos(turn), sin(turn)
    x, y = -r * tan(0.5 * turn), r
    for _ in range(20 if k_1 != 0.0 or k_2 != 0.0 else 0):
        half = 0.5 * (x * x + y * y - r * r)
        f_1, f_2 = y - r - k_1 * half, c * y - d * x - r - k_2 * half
        a_x, a_y, b_x, b_y = -k_1 * x, 1.0 - k_1 * y, -d - k_2 * x, c - k_2 * y
        pivot = a_x * b_y - a_y * b_x
        if pivot == 0.0:
            return 0.0, 0.0, 0.0, 0.0
        x, y = x - (f_1 * b_y - f_2 * a_y) / pivot, y - (f_2 * a_x - f_1 * b_x) / pivot
    trim_1 = _trim(k_1, -x, y, r)
    trim_2 = _trim(k_2, c * x + d * y, c * y - d * x, r)
    if not 0.0 <= trim_1 < table[LENGTH, s] or not 0.0 <= trim_2 < table[LENGTH, s + 1]:
        return 0.0, 0.0, 0.0, 0.0
    return v, trim_1, trim_2, r * (turn + k_1 * trim_1 + k_2 * trim_2)


@compiled
def _trim(k, along, aside, r):  # type: ignore[no-untyped-def]
    """Path of a segment from the corner to where an arc touches it whose centre is there."""
    if k == 0.0:
        return along
    # from the centre of the segment's circle the corner lies at (0, -1 / k)
    return np.arctan2(k * along, 1.0 - k * aside) / k if k * r < 1.0 else -1.0


@compiled
def _parabola(table, s, a_1, a_2, v_1, v_2, part):  # type: ignore[no-untyped-def]
    """Speeds at which segment s begins to stop into the next, and that the next then reaches.

    ``part`` of the lengths is left beside the blends at their other ends [1].
    """
    v_1 = min(sqrt(a_1 * part * table[LENGTH, s]), v_1)
    v_2 = min(sqrt(a_2 * part * table[LENGTH, s + 1]), v_2)
    time = min(table[LENGTH, s] / v_1, table[LENGTH, s + 1] / v_2)
    time = min(time, max(v_1 / a_1, v_2 / a_2))
    v_1, v_2 = min(v_1, time * a_1), min(v_2, time * a_2)
    bend = sin(0.5 * table[TURN, s])
    if table[TOLERANCE, s] > 0.0 and bend > STRAIGHT:
        most = 2.0 * sqrt(a_1 * table[TOLERANCE, s] / bend)
        v_1, v_2 = min(v_1, most), min(v_2, most)
    return v_1, v_2


@compiled
def _along(work, ramps, cycle):  # type: ignore[no-untyped-def]
    """Look-ahead over the pieces: end speeds and times; standstills lie at whole cycles."""
    within, after, v_in, passed = 0.0, 0.0, 0.0, 0.0
    for k in range(work.shape[1] - 1, -1, -1):
        if work[SIZE, k] > 0.0:
            v = min(min(work[OUT, k], work[TOP, k]), min(after, sqrt(within)))
            work[OUT, k], after = v, work[TOP, k]
            within = v * v + 2.0 * work[SLOPE, k] * work[SIZE, k]
    for k in range(work.shape[1]):
        a, size, time, v, out = work[SLOPE, k], work[SIZE, k], 0.0, v_in, v_in
        if size > 0.0:
            out = min(work[OUT, k], sqrt(v_in * v_in + 2.0 * a * size))
            v = min(work[TOP, k], sqrt(0.5 * (v_in * v_in + out * out) + a * size))
            if ramps[k // 2] and out > 0.0 and 2.0 * size < RAMP_TIME * (v_in + out):
                v, time = max(v_in, out), 2.0 * size / (v_in + out)
            else:
                time = size / v + ((v - v_in) ** 2 + (v - out) ** 2) / (2.0 * v * a)
        passed += time
        if out == 0.0 and size > 0.0 and work[OVERLAP, k // 2] == 0.0:
            whole = cycle * ceil(passed / cycle - 1e-6)
            time, passed = time + whole - passed, 0.0
        work[OUT, k], work[TOP, k], work[TIME, k] = out, v, time
        v_in = out
