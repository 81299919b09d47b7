"""Look-ahead with constant acceleration: speeds at the corners, and the time of each row, compiled.

Backward the speed at the end of a row is bounded by its own cap and feed, those of the next row,
the corner, and what the next row can brake from; forward by what the row can accelerate to,
v_out^2 <= v_in^2 + 2 a L.  Within a row the speed goes up to v_peak, stays, and goes down.
Populations whose total time alone counts run in SIMD lanes.
"""

from math import inf, sqrt

from pipeline.gcode.moves import Kind
from pipeline.kernels import compiled
from pipeline.machine.control.path import Binding, Motion

_CUTTING, _PER_TURN = int(Motion.CUTTING), int(Motion.PER_TURN)
_STILL, _INDEPENDENT = int(Motion.STILL), int(Motion.INDEPENDENT)
_THREAD = int(Kind.THREAD)
_NOTHING, _FEED, _RAPID = int(Binding.NOTHING), int(Binding.FEED), int(Binding.RAPID)
_ACCELERATION = int(Binding.ACCELERATION)
LANES = 16
"""Individuals that the processor works on together."""
CARRIED = 5
"""Quantities that are carried from row to row."""
_REACH, _V_IN, _TOTAL, _WITHIN, _AFTER = range(CARRIED)


@compiled
def scale_feeds(motion, kind, feeds, feed_share, rapid_share, out):  # type: ignore[no-untyped-def]
    """Fill feeds with their overrides, shape (P, M); the first row without valid F, or -1."""
    for p in range(feeds.shape[0]):
        for k in range(motion.shape[0]):
            if motion[k] == _CUTTING or motion[k] == _PER_TURN:
                if not 0.0 < feeds[p, k] < inf:
                    return k
                out[p, k] = feeds[p, k] * (1.0 if kind[k] == _THREAD else feed_share[k])
            else:
                out[p, k] = rapid_share[k]
    return -1


@compiled
def commanded_speed(motion, factor, feed, spindle, p, k):  # type: ignore[no-untyped-def]
    """Speed along the path that the program commands in row k of individual p [m/s]."""
    v = feed[p, k] * factor[k]
    if motion[k] == _PER_TURN:
        v *= spindle[min(p, spindle.shape[0] - 1), k]
    return v


@compiled
def plan_rows(  # type: ignore[no-untyped-def]
    motion, length, factor, cap, acceleration, corner, feed, spindle, p, v_out, v_peak, time
):
    """Fill speeds at the end of the rows, greatest in them [m/s], and the time that they move [s].

    The arguments before ``feed`` are those of :class:`pipeline.machine.control.path.Path`.
    ``feed`` and ``spindle`` have shape (P, M): in the program's units (the override in rapids), and
    [rev/min], the last row of ``spindle`` for all that follow; individual ``p`` is planned.
    """
    within = 0.0
    speed_after = 0.0
    for k in range(motion.shape[0] - 1, -1, -1):
        if motion[k] == _STILL or motion[k] == _INDEPENDENT:
            continue
        v = min(commanded_speed(motion, factor, feed, spindle, p, k), cap[k])
        # squares until the forward pass
        end = min(min(corner[k], v), speed_after)
        end = min(end * end, within)
        v_out[k] = end
        v_peak[k] = v
        within = end + 2.0 * acceleration[k] * length[k]
        speed_after = v
    reach = 0.0
    v_in = 0.0
    for k in range(motion.shape[0]):
        if motion[k] == _STILL or motion[k] == _INDEPENDENT:
            v_out[k] = v_in
            v_peak[k] = 0.0
            continue
        a, size, v = acceleration[k], length[k], v_peak[k]
        end = min(v_out[k], reach + 2.0 * a * size)
        peak = 0.5 * (reach + end) + a * size
        if peak < v * v:
            v = sqrt(peak)
            v_peak[k] = v
        out = sqrt(end)
        ramps = 2.0 * v * v - reach - end
        time[k] = (2.0 * v - v_in - out) / a + (size - ramps / (2.0 * a)) / v
        v_out[k] = out
        reach, v_in = end, out


@compiled
def binding(  # type: ignore[no-untyped-def]
    motion, factor, cap, reason, corner, end_reason, feed, spindle, v_out, v_peak, out
):
    """Limit that binds each row, :class:`pipeline.machine.control.path.Binding`.

    A row that reaches its speed limit is bound by that limit; another by its
    ends where one is as fast as its corner allows, else by acceleration.
    """
    near = 1.0 - 1e-9
    last = -1
    for k in range(motion.shape[0]):
        out[k] = _NOTHING
        if motion[k] == _STILL:
            continue
        if motion[k] == _INDEPENDENT:
            out[k] = _RAPID
        elif v_peak[k] >= near * min(commanded_speed(motion, factor, feed, spindle, 0, k), cap[k]):
            by_feed = _FEED if motion[k] == _CUTTING or motion[k] == _PER_TURN else _RAPID
            commanded = commanded_speed(motion, factor, feed, spindle, 0, k)
            out[k] = by_feed if commanded <= cap[k] else reason[k]
        else:
            out[k] = _ACCELERATION
            if v_out[k] >= near * corner[k]:
                out[k] = end_reason[k]
            elif last >= 0 and v_out[last] >= near * corner[last]:
                out[k] = end_reason[last]
        last = k


@compiled
def plan_population(  # type: ignore[no-untyped-def]
    motion, length, factor, cap, acceleration, corner, feed, spindle, v_out, v_peak, time
):
    """Plan the rows of each individual; ``time`` has shape (P, M), the speeds are work arrays."""
    for p in range(feed.shape[0]):
        plan_rows(
            motion, length, factor, cap, acceleration, corner, feed, spindle, p,
            v_out, v_peak, time[p],
        )  # fmt: skip


@compiled
def total_times(  # type: ignore[no-untyped-def]
    motion, length, factor, cap, acceleration, corner, feed, spindle, speed, square, carried, out
):
    """Fill ``out``, the time for which each individual moves [s]; shape (P,).

    The arguments before ``speed`` are those of :func:`plan_rows`.  ``speed`` and ``square`` of
    shape (M, LANES) and ``carried`` of (CARRIED, LANES) are work arrays.
    """
    many = out.shape[0]
    for first in range(0, many, LANES):
        for lane in range(LANES):
            # what is left of the lanes repeats the last individual
            p = min(first + lane, many - 1)
            for k in range(motion.shape[0]):
                if motion[k] != _STILL and motion[k] != _INDEPENDENT:
                    v = commanded_speed(motion, factor, feed, spindle, p, k)
                    speed[k, lane] = min(v, cap[k])
        _plan_lanes(motion, length, acceleration, corner, speed, square, carried)
        for lane in range(min(LANES, many - first)):
            out[first + lane] = carried[_TOTAL, lane]


@compiled
def _plan_lanes(motion, length, acceleration, corner, speed, square, carried):  # type: ignore[no-untyped-def]
    for row in range(CARRIED):
        for lane in range(LANES):
            carried[row, lane] = 0.0
    for k in range(motion.shape[0] - 1, -1, -1):
        if motion[k] == _STILL or motion[k] == _INDEPENDENT:
            continue
        top, gain = corner[k], 2.0 * acceleration[k] * length[k]
        for lane in range(LANES):
            v = speed[k, lane]
            end = min(min(top, v), carried[_AFTER, lane])
            end = min(end * end, carried[_WITHIN, lane])
            square[k, lane] = end
            carried[_WITHIN, lane] = end + gain
            carried[_AFTER, lane] = v
    for k in range(motion.shape[0]):
        if motion[k] == _STILL or motion[k] == _INDEPENDENT:
            continue
        a, size = acceleration[k], length[k]
        gain, slowness = 2.0 * a * size, 1.0 / a
        for lane in range(LANES):
            reach, v = carried[_REACH, lane], speed[k, lane]
            end = min(square[k, lane], reach + gain)
            peak = min(0.5 * (reach + end + gain), v * v)
            v, v_out = sqrt(peak), sqrt(end)
            ramps = (2.0 * v - carried[_V_IN, lane] - v_out) * slowness
            cruise = (size - (peak - 0.5 * (reach + end)) * slowness) / v
            carried[_TOTAL, lane] += ramps + cruise
            carried[_REACH, lane] = end
            carried[_V_IN, lane] = v_out
