"""A change of speed with bounded acceleration and jerk, without acceleration before and after.

Up by d from v0: jerk J for t_j = min(sqrt(d / J), a / J), constant acceleration, jerk -J; the
acceleration is symmetric in time, so that the mean speed is that of both ends.  Compiled.
"""

from math import sqrt

from pipeline.kernels import compiled


@compiled
def ramp_duration(change, a, jerk):  # type: ignore[no-untyped-def]
    """Time to change the speed by ``change`` >= 0 [s]."""
    if change * jerk <= a * a:
        return 2.0 * sqrt(change / jerk)
    return change / a + a / jerk


@compiled
def ramp_length(low, high, a, jerk):  # type: ignore[no-untyped-def]
    """Path that the change between two speeds takes [m]."""
    return 0.5 * (low + high) * ramp_duration(high - low, a, jerk)


@compiled
def ramp_state(low, high, a, jerk, t):  # type: ignore[no-untyped-def]
    """Path and speed at time t of the way up [m], [m/s]."""
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
    """Greatest speed that a path reaches from ``low`` [m/s]."""
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
    """Greatest speed, at most ``top``, from which both ends can be had on the path [m/s]."""
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
        found = ramp_length(v_0, v, a, jerk) + ramp_length(v_1, v, a, jerk) - length
        if found <= 0.0:
            low, lack = v, found
            excess *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            high, excess = v, found
            lack *= 0.5 if side > 0 else 1.0
            side = 1
        if lack == 0.0:
            break
    return low


@compiled
def profile_state(v_0, v_1, top, length, a, jerk, t):  # type: ignore[no-untyped-def]
    """Path and speed at time t of up, cruise, down [m], [m/s]."""
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
    """When the profile has gone ``s`` [s]."""
    low, high = 0.0, profile_duration(v_0, v_1, top, length, a, jerk)
    if s >= length:
        return high
    t = high * s / length
    for _ in range(200):
        gone, v = profile_state(v_0, v_1, top, length, a, jerk, t)
        if gone > s:
            high = t
        else:
            low = t
        step = t - (gone - s) / v if v > 0.0 else -1.0
        following = step if low < step < high else 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * high or not low < following < high:
            break
        t = following
    return t
