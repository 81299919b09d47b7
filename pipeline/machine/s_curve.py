"""Look-ahead with bounded jerk, compiled.

A stretch between two standstills is one profile (up, cruise, down) where every limit on its way
allows that.  Where a row or a corner does not, the worst of them becomes critical: it is passed
with its own speed and without acceleration, and splits the profile.  This ends at the latest when
every corner is critical, which is always possible; it is not the fastest motion, but no limit can
be passed.
"""

from pipeline.kernels import compiled
from pipeline.machine.jerk_ramp import (
    peak_speed,
    profile_duration,
    profile_state,
    profile_time,
    ramp_length,
    reachable,
)

V_0, V_1, TOP, LENGTH, ACCELERATION, JERK, CAP, CLEAN, SEEN_0, SEEN_1 = range(10)
"""Columns of a profile: speeds at its ends and on top [m/s], length [m], acceleration [m/s^2],
jerk [m/s^3]; and for planning its greatest feed [m/s], whether it was found to keep all limits, and
for which speeds at its ends.
"""
COLUMNS = 10
WITHIN = 1.0 + 1e-9
"""A limit that is met to rounding is met."""


@compiled
def plan_profiles(  # type: ignore[no-untyped-def]
    length, speed, acceleration, jerk, corner, critical, v_out, v_peak, time, profile, profiles
):
    """Plan N rows that all move.

    Parameters
    ----------
    length, speed, acceleration, jerk : (N,) arrays
        ``speed`` is the cap with the feed.
    corner : (N,) array
        Speed not to be passed at the end of the row; 0 at the last.
    critical : (N,) array of uint8
        Room: whether a profile ends with the row.
    v_out, v_peak, time : (N,) arrays
        Filled.
    profile : (N,) array of int32
        Filled: the row that begins the profile that a row belongs to.
    profiles : (N, COLUMNS) array
        Zeros; filled in the rows that begin a profile.
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
    """What lies between two critical corners as one profile."""
    p = first
    for k in range(first, last + 1):
        if k == p:
            known = profiles[p, LENGTH]
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
            if profiles[p, LENGTH] != known:
                profiles[p, CLEAN] = 0.0
                profiles[p, SEEN_0] = -1.0
            p = k + 1


@compiled
def _reach(first, last, limit, profile, profiles):  # type: ignore[no-untyped-def]
    """Speeds at the ends of the profiles that can be had from each other, and on top."""
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
            if profiles[k, SEEN_0] != profiles[k, V_0] or profiles[k, SEEN_1] != v:
                profiles[k, SEEN_0] = profiles[k, V_0]
                profiles[k, SEEN_1] = v
                profiles[k, CLEAN] = 0.0
                profiles[k, TOP] = peak_speed(
                    profiles[k, V_0], v, profiles[k, LENGTH], profiles[k, CAP],
                    profiles[k, ACCELERATION], profiles[k, JERK],
                )  # fmt: skip


@compiled
def _split(first, last, length, speed, critical, limit, profile, profiles):  # type: ignore[no-untyped-def]
    """Make the worst violation of each profile critical; whether there was one."""
    found = False
    k = first
    while k <= last:
        end = k
        while not critical[end]:
            end += 1
        if profiles[k, CLEAN] == 0.0:
            row, at_end = _worst(k, end, length, speed, limit, profiles)
            if row < 0:
                profiles[k, CLEAN] = 1.0
            else:
                found = True
                critical[row] = 1
                if not at_end and row > first:
                    critical[row - 1] = 1
        k = end + 1
    return found


@compiled
def _worst(first, last, length, speed, limit, profiles):  # type: ignore[no-untyped-def]
    """Row of a profile that is passed fastest against its limit, or -1; and whether it is its end
    that is.
    """
    worst, row, at_end = WITHIN, -1, False
    gone = 0.0
    v_in = profiles[first, V_0]
    for k in range(first, last + 1):
        begin, gone = gone, gone + length[k]
        v = _speed_at(profiles, first, gone) if k < last else profiles[first, V_1]
        greatest = _greatest(profiles, first, begin, gone, v_in, v)
        v_in = v
        if greatest > worst * speed[k]:
            worst, row, at_end = greatest / speed[k], k, False
        if k < last and v > worst * limit[k]:
            worst, row, at_end = v / limit[k], k, True
    return row, at_end


@compiled
def _time_at(profiles, p, s):  # type: ignore[no-untyped-def]
    return profile_time(
        profiles[p, V_0], profiles[p, V_1], profiles[p, TOP], profiles[p, LENGTH],
        profiles[p, ACCELERATION], profiles[p, JERK], s,
    )  # fmt: skip


@compiled
def _speed_at(profiles, p, s):  # type: ignore[no-untyped-def]
    return profile_state(
        profiles[p, V_0], profiles[p, V_1], profiles[p, TOP], profiles[p, LENGTH],
        profiles[p, ACCELERATION], profiles[p, JERK], _time_at(profiles, p, s),
    )[1]  # fmt: skip


@compiled
def _greatest(profiles, p, begin, end, v_in, v_out):  # type: ignore[no-untyped-def]
    """Greatest speed of a profile between two places."""
    a, jerk, top = profiles[p, ACCELERATION], profiles[p, JERK], profiles[p, TOP]
    up = ramp_length(profiles[p, V_0], top, a, jerk)
    down = profiles[p, LENGTH] - ramp_length(profiles[p, V_1], top, a, jerk)
    if end >= up and begin <= down:
        return top
    return max(v_in, v_out)


@compiled
def _settle(first, last, length, v_out, v_peak, time, profile, profiles):  # type: ignore[no-untyped-def]
    """Times and speeds of the rows from their profiles."""
    gone, t_in, v_in = 0.0, 0.0, 0.0
    for k in range(first, last + 1):
        p = profile[k]
        if k == p:
            gone, t_in, v_in = 0.0, 0.0, profiles[p, V_0]
        begin, gone = gone, gone + length[k]
        if k == last or profile[k + 1] != p:
            v_out[k] = profiles[p, V_1]
            t = profile_duration(
                profiles[p, V_0], profiles[p, V_1], profiles[p, TOP], profiles[p, LENGTH],
                profiles[p, ACCELERATION], profiles[p, JERK],
            )  # fmt: skip
        else:
            t = _time_at(profiles, p, gone)
            v_out[k] = _speed_at(profiles, p, gone)
        v_peak[k] = _greatest(profiles, p, begin, gone, v_in, v_out[k])
        time[k] = t - t_in
        t_in, v_in = t, v_out[k]
