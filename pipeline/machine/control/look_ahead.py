"""Look-ahead with constant acceleration: speeds at the corners, and the time of each row, compiled.

Backward the speed at the end of a row is bounded by its own cap and feed, those of the next row,
the corner, and what the next row can brake from; forward by what the row can accelerate to,
v_out^2 <= v_in^2 + 2 a L.  Within a row the speed goes up to v_peak, stays, and goes down.
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
