"""Where the axes are at given times, before any filter, compiled."""

from math import cos, sin, sqrt

from pipeline.gcode.moves import METRE, RADIAN
from pipeline.kernels import compiled
from pipeline.machine.geometry import CURVED, arc_length, arc_terms, in_plane, start_of
from pipeline.machine.jerk_ramp import peak_speed, profile_duration, profile_state
from pipeline.machine.motion import Motion

_STILL, _INDEPENDENT = int(Motion.STILL), int(Motion.INDEPENDENT)
_SPEED, _ACCELERATION, _JERK = 0, 2, 6


@compiled
def sample(  # type: ignore[no-untyped-def]
    origin, end, centre, angle, plane, motion, form, length, acceleration, limits, share,
    begin, moving_time, v_out, v_peak, profile, profiles, profile_begin, profile_offset,
    period, first, row, position, distance, rows,
):  # fmt: skip
    """Fill positions [m, rad], distance within the row [m, rad] and row of T samples.

    First stand the columns of ``Moves`` and those of the path, then the limits of the axes and the
    override of rapids for axes that go independently; ``begin`` and ``moving_time``, when a row
    begins and how long it moves [s]; of an S-curve the profile of each row (empty for trapezoids),
    the profiles, when each begins [s], and where each row begins within its profile [m].  ``first``
    is the number of the first sample, ``row`` one that begins before it.  Returns the row of the
    last sample.
    """
    last = motion.shape[0] - 1
    for n in range(position.shape[0]):
        t = (first + n) * period
        while row < last and t >= begin[row + 1]:
            row += 1
        rows[n] = row
        since = t - begin[row]
        distance[n] = 0.0
        if motion[row] == _STILL or since >= moving_time[row]:
            for i in range(6):
                position[n, i] = end[row, i] * (METRE if i < 3 else RADIAN)
            distance[n] = length[row]
            continue
        if motion[row] == _INDEPENDENT:
            _each_axis(
                origin, end, limits, share[row], profile.shape[0] > 0, row, since, position, n
            )
            continue
        if profile.shape[0] > 0:
            p = profile[row]
            s = profile_state(
                profiles[p, 0], profiles[p, 1], profiles[p, 2], profiles[p, 3], profiles[p, 4],
                profiles[p, 5], t - profile_begin[p],
            )[0] - profile_offset[row]  # fmt: skip
        else:
            v_in = v_out[row - 1] if row > 0 else 0.0
            s = _trapezoid(
                v_in,
                v_peak[row],
                v_out[row],
                acceleration[row],
                length[row],
                moving_time[row],
                since,
            )
        s = min(max(s, 0.0), length[row])
        distance[n] = s
        if form[row] == CURVED:
            _on_arc(origin, end, centre, angle, plane, row, s, position, n)
        else:
            _on_line(origin, end, row, s / length[row], position, n)
    return row


@compiled
def _trapezoid(v_in, v_peak, v_out, a, length, duration, t):  # type: ignore[no-untyped-def]
    up = (v_peak - v_in) / a
    if t < up:
        return v_in * t + 0.5 * a * t * t
    rest = duration - t
    if rest < (v_peak - v_out) / a:
        return length - v_out * rest - 0.5 * a * rest * rest
    return 0.5 * (v_in + v_peak) * up + v_peak * (t - up)


@compiled
def _on_line(origin, end, row, part, position, n):  # type: ignore[no-untyped-def]
    for i in range(6):
        begin = start_of(origin, end, row, i)
        position[n, i] = (begin + (end[row, i] - begin) * part) * (METRE if i < 3 else RADIAN)


@compiled
def _on_arc(origin, end, centre, angle, plane, row, s, position, n):  # type: ignore[no-untyped-def]
    phi, r_0, r_1, c_2 = arc_terms(origin, end, centre, angle, plane, row)
    turned = abs(angle[row])
    part = _part_of_arc(r_0, r_1, c_2, turned, s)
    _on_line(origin, end, row, part, position, n)
    a, b, _ = in_plane(plane[row])
    r = r_0 + (r_1 - r_0) * part
    position[n, a] = centre[row, a] * METRE + r * cos(phi + angle[row] * part)
    position[n, b] = centre[row, b] * METRE + r * sin(phi + angle[row] * part)


@compiled
def _part_of_arc(r_0, r_1, c_2, turned, s):  # type: ignore[no-untyped-def]
    """Share of its angle at which a path of length ``s`` [m] has been gone, by Newton's method."""
    total = arc_length(r_0, r_1, c_2, turned)
    part = s / total
    if r_0 == r_1:
        return part
    for _ in range(50):
        r = r_0 + (r_1 - r_0) * part
        gone = arc_length(r_0, r, c_2, turned * part)
        following = part - (gone - s) / (turned * sqrt(r * r + c_2))
        following = min(max(following, 0.0), 1.0)
        if abs(following - part) < 1e-15:
            break
        part = following
    return part


@compiled
def _each_axis(origin, end, limits, share, jerked, row, t, position, n):  # type: ignore[no-untyped-def]
    for i in range(6):
        unit = METRE if i < 3 else RADIAN
        begin = start_of(origin, end, row, i) * unit
        gap = end[row, i] * unit - begin
        position[n, i] = begin
        if gap != 0.0:
            gone = _alone(
                abs(gap), limits[_SPEED, i] * share, limits[_ACCELERATION, i], limits[_JERK, i],
                jerked, t,
            )  # fmt: skip
            position[n, i] += gone if gap > 0.0 else -gone


@compiled
def _alone(length, top, a, jerk, jerked, t):  # type: ignore[no-untyped-def]
    """Path of an axis from standstill to standstill [m]."""
    if jerked:
        top = peak_speed(0.0, 0.0, length, top, a, jerk)
        duration = profile_duration(0.0, 0.0, top, length, a, jerk)
        return length if t >= duration else profile_state(0.0, 0.0, top, length, a, jerk, t)[0]
    top = min(top, sqrt(a * length))
    duration = length / top + top / a
    return length if t >= duration else _trapezoid(0.0, top, 0.0, a, length, duration, t)
