"""Look-ahead by trapezoids and with bounded jerk: speeds at corners, time of each row, compiled.

With constant acceleration: backward the speed at the end of a row is bounded by its own cap and
feed, those of the next row, the corner, and what the next row can brake from; forward by what the
row can accelerate to, v_out^2 <= v_in^2 + 2 a L.  Within a row the speed goes up to v_peak, stays,
and goes down.

With bounded jerk: a ramp changes the speed with bounded acceleration and jerk, without acceleration
before and after.  Up by d from v0: jerk J for t_j = min(sqrt(d / J), a / J), constant acceleration,
jerk -J; the acceleration is symmetric in time, so that the mean speed is that of both ends.

A stretch between two standstills is one profile (up, cruise, down) where every limit along it
allows that.  Where a row or a corner does not, the worst of them becomes critical: it is passed
with its own speed and without acceleration, and splits the profile.  This ends at the latest when
every corner is critical, which is always possible; it is not the fastest motion, but no limit can
be passed.
"""

from math import inf, sqrt

from pipeline.gcode.moves import Kind
from pipeline.kernels import compiled
from pipeline.machine.control.path import Binding, Motion

V_0, V_1, TOP, LENGTH, ACCELERATION, JERK, CAP, KEEPS_LIMITS, CHECKED_V_0, CHECKED_V_1 = range(10)
"""Columns of a profile: speeds at its ends and on top [m/s], length [m], acceleration [m/s^2],
jerk [m/s^3]; and for planning its greatest feed [m/s], whether it keeps all limits, and the speeds
at its ends for which that was checked.
"""
COLUMNS = 10
"""Number of columns of a profile while it is planned."""
WITHIN = 1.0 + 1e-9
"""Factor on a limit that counts as kept: rounding is no violation [1]."""


@compiled
def ramp_duration(change, a, jerk):  # type: ignore[no-untyped-def]
    """Time to change the speed by ``change`` >= 0 [s]."""
    if change * jerk <= a * a:
        return 2.0 * sqrt(change / jerk)
    return change / a + a / jerk


@compiled
def ramp_length(low, high, a, jerk):  # type: ignore[no-untyped-def]
    """Path length of the change between two speeds [m]."""
    return 0.5 * (low + high) * ramp_duration(high - low, a, jerk)


@compiled
def ramp_state(low, high, a, jerk, t):  # type: ignore[no-untyped-def]
    """Path length and speed at time t of the ramp up [m], [m/s]."""
    change = high - low
    duration = ramp_duration(change, a, jerk)
    t_jerk = min(0.5 * duration, a / jerk)
    if t < t_jerk:
        return low * t + jerk * t**3 / 6.0, low + 0.5 * jerk * t * t
    rest = duration - t
    if rest < t_jerk:
        length = 0.5 * (low + high) * duration
        return length - high * rest + jerk * rest**3 / 6.0, high - 0.5 * jerk * rest * rest
    t -= t_jerk
    top = jerk * t_jerk
    v = low + 0.5 * top * t_jerk
    return low * t_jerk + jerk * t_jerk**3 / 6.0 + v * t + 0.5 * top * t * t, v + top * t


@compiled
def reachable(low, length, a, jerk):  # type: ignore[no-untyped-def]
    """Greatest speed that is reached from ``low`` over a path length [m/s]."""
    blunt = a * a / jerk
    if (low + 0.5 * blunt) * 2.0 * a / jerk >= length:
        # without constant acceleration: x^3 + 2 low x = length sqrt(J) with x = sqrt(change);
        # convex and above the root, so that Newton's steps only go down
        p, q = 2.0 * low, length * sqrt(jerk)
        x = q ** (1.0 / 3.0)
        if p * x > q:
            x = q / p
        for _ in range(60):
            lower = x - (x**3 + p * x - q) / (3.0 * x * x + p) if x > 0.0 else 0.0
            if not lower < x:
                break
            x = lower
        return low + x * x
    # (low + change / 2) (change / a + a / J) = length
    b = 2.0 * low + blunt
    c = 2.0 * (low * blunt - length * a)
    return low - 2.0 * c / (b + sqrt(b * b - 4.0 * c))


@compiled
def peak_speed(v_0, v_1, length, top, a, jerk):  # type: ignore[no-untyped-def]
    """Greatest speed, at most ``top``, between two end speeds on a path of this length [m/s]."""
    excess = ramp_length(v_0, top, a, jerk) + ramp_length(v_1, top, a, jerk) - length
    if excess <= 0.0:
        return top
    low, high = max(v_0, v_1), top
    lack = ramp_length(v_0, low, a, jerk) + ramp_length(v_1, low, a, jerk) - length
    side = 0
    for _ in range(200):
        # false position; an end that stays twice is given half of its weight (Illinois)
        v = high - excess * (high - low) / (excess - lack)
        if not low < v < high or high - low <= 1e-15 * high:
            break
        surplus = ramp_length(v_0, v, a, jerk) + ramp_length(v_1, v, a, jerk) - length
        if surplus <= 0.0:
            low, lack = v, surplus
            excess *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            high, excess = v, surplus
            lack *= 0.5 if side > 0 else 1.0
            side = 1
        if lack == 0.0:
            break
    return low


@compiled
def profile_state(v_0, v_1, top, length, a, jerk, t):  # type: ignore[no-untyped-def]
    """Path length and speed at time t of up, cruise, down [m], [m/s]."""
    up = ramp_duration(top - v_0, a, jerk)
    if t < up:
        return ramp_state(v_0, top, a, jerk, t)
    rest = profile_duration(v_0, v_1, top, length, a, jerk) - t
    if rest < ramp_duration(top - v_1, a, jerk):
        left, v = ramp_state(v_1, top, a, jerk, max(rest, 0.0))
        return length - left, v
    return ramp_length(v_0, top, a, jerk) + top * (t - up), top


@compiled
def profile_duration(v_0, v_1, top, length, a, jerk):  # type: ignore[no-untyped-def]
    """Time of up, cruise, down [s]."""
    cruise = length - ramp_length(v_0, top, a, jerk) - ramp_length(v_1, top, a, jerk)
    ramps = ramp_duration(top - v_0, a, jerk) + ramp_duration(top - v_1, a, jerk)
    return ramps + max(cruise, 0.0) / top


@compiled
def profile_time(v_0, v_1, top, length, a, jerk, s):  # type: ignore[no-untyped-def]
    """Time at which the profile has travelled ``s`` [s]."""
    low, high = 0.0, profile_duration(v_0, v_1, top, length, a, jerk)
    if s >= length:
        return high
    t = high * s / length
    for _ in range(200):
        travelled, v = profile_state(v_0, v_1, top, length, a, jerk, t)
        if travelled > s:
            high = t
        else:
            low = t
        step = t - (travelled - s) / v if v > 0.0 else -1.0
        following = step if low < step < high else 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * high or not low < following < high:
            break
        t = following
    return t


@compiled
def plan_profiles(  # type: ignore[no-untyped-def]
    length, speed, acceleration, jerk, corner, critical, v_out, v_peak, time, profile, profiles
):
    """Plan N rows that all move: fill ``v_out``, ``v_peak``, ``time``, ``profile``, ``profiles``.

    ``speed`` is the cap with the feed, ``corner`` the speed not to be passed at the row's end, 0 at
    the last; ``critical`` is a work array: whether a profile ends with the row.  ``profile`` takes
    the row that begins the profile that a row belongs to, ``profiles`` (N, COLUMNS), zeros before,
    the profiles in the rows that begin them.
    """
    first = 0
    for k in range(length.shape[0]):
        after = speed[k + 1] if k + 1 < length.shape[0] else 0.0
        v_out[k] = min(min(corner[k], speed[k]), after)
        critical[k] = v_out[k] == 0.0
        if critical[k]:
            split = True
            while split:
                _extend(first, k, length, speed, acceleration, jerk, critical, profile, profiles)
                _reach(first, k, v_out, profile, profiles)
                split = _split(first, k, length, speed, critical, v_out, profile, profiles)
            _settle(first, k, length, v_out, v_peak, time, profile, profiles)
            first = k + 1


@compiled
def _extend(  # type: ignore[no-untyped-def]
    first, last, length, speed, acceleration, jerk, critical, profile, profiles
):
    """Make one profile of the rows between two critical corners."""
    p = first
    for k in range(first, last + 1):
        if k == p:
            length_before = profiles[p, LENGTH]
            profiles[p, LENGTH] = 0.0
            profiles[p, CAP] = 0.0
            profiles[p, ACCELERATION] = acceleration[k]
            profiles[p, JERK] = jerk[k]
        profiles[p, LENGTH] += length[k]
        profiles[p, CAP] = max(profiles[p, CAP], speed[k])
        profiles[p, ACCELERATION] = min(profiles[p, ACCELERATION], acceleration[k])
        profiles[p, JERK] = min(profiles[p, JERK], jerk[k])
        profile[k] = p
        if critical[k]:
            if profiles[p, LENGTH] != length_before:
                profiles[p, KEEPS_LIMITS] = 0.0
                profiles[p, CHECKED_V_0] = -1.0
            p = k + 1


@compiled
def _reach(first, last, limit, profile, profiles):  # type: ignore[no-untyped-def]
    """Speeds at the ends of the profiles that are reached from each other, and on top."""
    v = 0.0
    end = last
    for k in range(last, first - 1, -1):
        if profile[k] == k:
            v = min(limit[end], v)
            profiles[k, V_1] = v
            v = reachable(v, profiles[k, LENGTH], profiles[k, ACCELERATION], profiles[k, JERK])
            end = k - 1
    v = 0.0
    for k in range(first, last + 1):
        if profile[k] == k:
            profiles[k, V_0] = v
            v = reachable(v, profiles[k, LENGTH], profiles[k, ACCELERATION], profiles[k, JERK])
            v = min(v, profiles[k, V_1])
            profiles[k, V_1] = v
            if profiles[k, CHECKED_V_0] != profiles[k, V_0] or profiles[k, CHECKED_V_1] != v:
                profiles[k, CHECKED_V_0] = profiles[k, V_0]
                profiles[k, CHECKED_V_1] = v
                profiles[k, KEEPS_LIMITS] = 0.0
                profiles[k, TOP] = peak_speed(
                    profiles[k, V_0], v, profiles[k, LENGTH], profiles[k, CAP],
                    profiles[k, ACCELERATION], profiles[k, JERK],
                )  # fmt: skip


@compiled
def _split(first, last, length, speed, critical, limit, profile, profiles):  # type: ignore[no-untyped-def]
    """Make the worst violation of each profile critical; whether there was one."""
    violated = False
    k = first
    while k <= last:
        end = k
        while not critical[end]:
            end += 1
        if profiles[k, KEEPS_LIMITS] == 0.0:
            row, at_end = _worst(k, end, length, speed, limit, profiles)
            if row < 0:
                profiles[k, KEEPS_LIMITS] = 1.0
            else:
                violated = True
                critical[row] = 1
                if not at_end and row > first:
                    critical[row - 1] = 1
        k = end + 1
    return violated


@compiled
def _worst(first, last, length, speed, limit, profiles):  # type: ignore[no-untyped-def]
    """Row of a profile that passes its limit by most, or -1; and whether it is at its end."""
    worst, row, at_end = WITHIN, -1, False
    travelled = 0.0
    v_in = profiles[first, V_0]
    for k in range(first, last + 1):
        begin, travelled = travelled, travelled + length[k]
        v = _speed_at(profiles, first, travelled) if k < last else profiles[first, V_1]
        greatest = _greatest(profiles, first, begin, travelled, v_in, v)
        v_in = v
        if greatest > worst * speed[k]:
            worst, row, at_end = greatest / speed[k], k, False
        if k < last and v > worst * limit[k]:
            worst, row, at_end = v / limit[k], k, True
    return row, at_end


@compiled
def _shape(one):  # type: ignore[no-untyped-def]
    """Speeds at both ends and on top, length, acceleration and jerk of a profile."""
    return one[V_0], one[V_1], one[TOP], one[LENGTH], one[ACCELERATION], one[JERK]


@compiled
def _time_at(profiles, p, s):  # type: ignore[no-untyped-def]
    return profile_time(*_shape(profiles[p]), s)


@compiled
def _speed_at(profiles, p, s):  # type: ignore[no-untyped-def]
    return profile_state(*_shape(profiles[p]), _time_at(profiles, p, s))[1]


@compiled
def _greatest(profiles, p, begin, end, v_in, v_out):  # type: ignore[no-untyped-def]
    """Greatest speed of a profile between two path lengths."""
    a, jerk, top = profiles[p, ACCELERATION], profiles[p, JERK], profiles[p, TOP]
    up = ramp_length(profiles[p, V_0], top, a, jerk)
    down = profiles[p, LENGTH] - ramp_length(profiles[p, V_1], top, a, jerk)
    if end >= up and begin <= down:
        return top
    return max(v_in, v_out)


@compiled
def _settle(first, last, length, v_out, v_peak, time, profile, profiles):  # type: ignore[no-untyped-def]
    """Times and speeds of the rows from their profiles."""
    travelled, t_in, v_in = 0.0, 0.0, 0.0
    for k in range(first, last + 1):
        p = profile[k]
        if k == p:
            travelled, t_in, v_in = 0.0, 0.0, profiles[p, V_0]
        begin, travelled = travelled, travelled + length[k]
        if k == last or profile[k + 1] != p:
            v_out[k] = profiles[p, V_1]
            t = profile_duration(*_shape(profiles[p]))
        else:
            t = _time_at(profiles, p, travelled)
            v_out[k] = _speed_at(profiles, p, travelled)
        v_peak[k] = _greatest(profiles, p, begin, travelled, v_in, v_out[k])
        time[k] = t - t_in
        t_in, v_in = t, v_out[k]


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
