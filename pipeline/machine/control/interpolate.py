"""Interpolation: positions at the interpolation period, as the control commands the drives.

Before the filters (``programmed``) the position lies on the programmed path; after them
(``position``) it is what the position loops are given.

A moving average of length T is exact for the straight line between samples, for any T >= 0:
with I the integral of the input since the motion began, (I(t) - I(t - T)) / T, where t - T may lie
between two samples.  A filter begins anew when a motion begins at a standstill.

A bounded command keeps close to a reference, within limits of speed and acceleration.  A command
that is wished for is followed from sample to sample: as fast as the bounds let it where it lies
apart, at once where it does not.  Speed is (x_n - x_(n-1)) / T and acceleration its change over T,
so that the bounds hold for every sample and not on average.  Catching up, the command is never
faster than it can brake again before it is there: with the acceleration a that is left for braking,
a gap d is closed with at most sqrt(2 a d + (a T / 2)^2) - a T / 2 above the speed of what is wished
for.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import cos, sin, sqrt

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import METRE, RADIAN
from pipeline.kernels import compiled
from pipeline.machine.control.geometry import CURVED, arc_length, arc_terms, in_plane, start_of
from pipeline.machine.control.look_ahead import peak_speed, profile_duration, profile_state
from pipeline.machine.control.parameters import Limit
from pipeline.machine.control.path import Binding, Motion
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Floats

_TINY = 1e-12
VALUE, INTEGRAL = 0, 1
"""Quantities that a filter remembers of each sample."""
_STILL, _INDEPENDENT = int(Motion.STILL), int(Motion.INDEPENDENT)
_SPEED, _ACCELERATION = int(Limit.RAPID_SPEED), int(Limit.RAPID_ACCELERATION)
_JERK = int(Limit.JERK)


@dataclass(frozen=True, kw_only=True)
class Trace:
    """T samples of a plan."""

    time: Floats = field(repr=False)
    """Time [s]."""
    programmed: Floats = field(repr=False)
    position: Floats = field(repr=False)
    """X Y Z A B C before and after the filters [m, rad]."""
    row: npt.NDArray[np.int32] = field(repr=False)
    """Row of ``Moves`` that the interpolator is in (the filters lag behind)."""
    distance: Floats = field(repr=False)
    """Path length travelled within the row [m], [rad] where only rotary axes move."""

    def __len__(self) -> int:
        return len(self.time)


def trace(plan: Plan, *, period: float | None = None) -> Trace:
    """All samples of a plan, from 0 to its end or up to a period beyond.

    The ``period`` [s] is the control's ``interpolation_period`` by default. ValueError when it is
    not positive, or the program has no rows.
    """
    step = _period(plan, period)
    return next(traces(plan, period=step, samples=_count(plan, step)))


def traces(plan: Plan, *, period: float | None = None, samples: int = 65536) -> Iterator[Trace]:
    """Trace in chunks of at most ``samples``; ``period`` as in :func:`trace` [s]."""
    step = _period(plan, period)
    lengths = plan.path.control.filters
    history = np.zeros((2, history_length(float(lengths.max()), step), 6, 2))
    base, state = np.zeros((2, 6)), np.array([-1, 0])
    run, group = _runs(plan), _groups(plan)
    arguments = _sampled(plan)
    row = 0
    for first in range(0, _count(plan, step), samples):
        many = min(samples, _count(plan, step) - first)
        programmed, position = np.empty((many, 6)), np.empty((many, 6))
        distance, rows = np.empty(many), np.empty(many, np.int32)
        row = sample(*arguments, step, first, row, programmed, distance, rows)
        filtered(programmed, rows, run, group, lengths, step, history, base, state, position)
        time = step * np.arange(first, first + many, dtype=np.float64)
        yield Trace(
            time=time, programmed=programmed, position=position, row=rows, distance=distance
        )


def _period(plan: Plan, period: float | None) -> float:
    step = plan.path.control.interpolation_period if period is None else period
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"period = {step} s must be finite and positive")
    if len(plan.path) == 0:
        raise ValueError("the program has no rows: there is nothing to interpolate")
    return step


def _count(plan: Plan, period: float) -> int:
    return int(np.ceil(plan.total / period - 1e-9)) + 1


def _runs(plan: Plan) -> npt.NDArray[np.int32]:
    """Number of the motion from standstill to standstill that each row belongs to; shape (M,)."""
    ends = plan.path.end_reason == Binding.EXACT_STOP
    return np.concatenate([[0], np.cumsum(ends)[:-1]]).astype(np.int32)


def _groups(plan: Plan) -> npt.NDArray[np.uint8]:
    """0 in rapids, 1 in cutting, by the last row that moved; shape (M,)."""
    motion = plan.path.motion
    rapid = (motion == Motion.RAPID) | (motion == Motion.INDEPENDENT)
    last = np.maximum.accumulate(np.where(motion != Motion.STILL, np.arange(len(motion)), 0))
    return (~rapid[last]).astype(np.uint8)


def _sampled(plan: Plan) -> tuple[object, ...]:
    path, motion = plan.path, plan.motion
    moves = path.moves
    begin = np.concatenate([[0.0], np.cumsum(plan.time)[:-1]])
    v_out, v_peak, acceleration = _trapezoids(plan)
    return (
        moves.origin, moves.end, moves.centre, moves.angle, moves.plane,
        path.motion, path.form, path.length, acceleration, path.control.limits, plan.feed,
        begin, motion.time, v_out, v_peak,
        motion.profile, motion.profiles, *_profile_places(plan, begin),
    )  # fmt: skip


def _trapezoids(plan: Plan) -> tuple[Floats, Floats, Floats]:
    """Speeds at the end and at the top of each row [m/s], and acceleration [m/s^2].

    A blend takes the time of its own, shorter path: without a steady speed, or at one speed where
    the row's own speeds leave no trapezoid.
    """
    path, v_out, top = plan.path, plan.v_out, plan.v_peak
    if path.segments is None:
        return v_out, top, path.acceleration
    v_in, time = np.append(0.0, v_out[:-1])[: len(path)], np.where(path.moving, plan.motion.time, 1)
    mean = np.where(path.moving, path.length, 1.0) / time
    sharp = mean + np.sqrt(((v_in - mean) ** 2 + (v_out - mean) ** 2) / 2)
    top = np.minimum(top, sharp)
    change = (top - v_in) ** 2 + (top - v_out) ** 2
    ramps = (top > mean) & (top >= np.maximum(v_in, v_out)) & (change > 0)
    top, change = np.where(ramps, top, mean), np.where(ramps, change, np.inf)
    return v_out, top, change / (2 * top * np.maximum(time - path.length / top, _TINY))


def _profile_places(plan: Plan, begin: Floats) -> tuple[Floats, Floats]:
    """Time at which each profile begins [s], path length of each row within its profile [m]."""
    profile = plan.motion.profile
    if len(profile) == 0:
        return np.zeros(0), np.zeros(0)
    rows = np.flatnonzero(profile >= 0)
    of, first = np.unique(profile[rows], return_index=True)
    starts = np.zeros(len(plan.motion.profiles))
    starts[of] = begin[rows[first]]
    travelled = np.concatenate([[0.0], np.cumsum(plan.path.length)])[:-1]
    offset = np.zeros(len(profile))
    offset[rows] = travelled[rows] - travelled[rows[first]][profile[rows]]
    return starts, offset


@compiled
def sample(  # type: ignore[no-untyped-def]
    origin, end, centre, angle, plane, motion, form, length, acceleration, limits, share,
    begin, moving_time, v_out, v_peak, profile, profiles, profile_begin, profile_offset,
    period, first, row, position, distance, rows,
):  # fmt: skip
    """Fill positions [m, rad], distance within the row [m, rad] and row of T samples.

    The first arguments are columns of ``Moves`` and of the path, then the limits of the axes and
    the override of rapids for axes that go independently; ``begin`` and ``moving_time``, the time
    at which a row begins and that for which it moves [s]; of an S-curve the profile of each row
    (empty for trapezoids), the profiles, the time at which each begins [s], and the path length at
    which each row begins within its profile [m].  ``first``
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
                v_in, v_peak[row], v_out[row], acceleration[row], length[row], moving_time[row],
                since,
            )  # fmt: skip
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
    """Share of an arc's angle at the path length ``s`` [m], by Newton's method."""
    total = arc_length(r_0, r_1, c_2, turned)
    part = s / total
    if r_0 == r_1:
        return part
    for _ in range(50):
        r = r_0 + (r_1 - r_0) * part
        travelled = arc_length(r_0, r, c_2, turned * part)
        following = part - (travelled - s) / (turned * sqrt(r * r + c_2))
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
            travelled = _rest_to_rest(
                abs(gap), limits[_SPEED, i] * share, limits[_ACCELERATION, i], limits[_JERK, i],
                jerked, t,
            )  # fmt: skip
            position[n, i] += travelled if gap > 0.0 else -travelled


@compiled
def _rest_to_rest(length, top, a, jerk, jerked, t):  # type: ignore[no-untyped-def]
    """Distance of an axis from standstill to standstill after time t [m]."""
    if jerked:
        top = peak_speed(0.0, 0.0, length, top, a, jerk)
        duration = profile_duration(0.0, 0.0, top, length, a, jerk)
        return length if t >= duration else profile_state(0.0, 0.0, top, length, a, jerk, t)[0]
    top = min(top, sqrt(a * length))
    duration = length / top + top / a
    return length if t >= duration else _trapezoid(0.0, top, 0.0, a, length, duration, t)


def history_length(length: float, period: float) -> int:
    """Number of samples that a filter of a length must remember."""
    return int(length / period) + 3


@compiled
def filtered(raw, rows, run, group, lengths, period, history, base, state, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the samples ``raw`` after two moving averages, (T, 6) each [m, rad].

    ``rows`` (T,) are those of the samples; ``run`` and ``group`` (M,) the motion from standstill to
    standstill that a row belongs to, and its group of filters, whose T1 and T2 are ``lengths``
    (2, 2) [s].  Kept from call to call: ``history`` (2, R, 6, 2), the samples in the filters, R of
    :func:`history_length`; ``base`` (2, 6), the start of the motion and the last sample [m, rad];
    ``state`` (2,), the current motion (-1 before the first sample) and the number of samples.
    """
    for n in range(raw.shape[0]):
        row = rows[n]
        if run[row] != state[0]:
            _begin(raw, n, history, base, state)
            state[0] = run[row]
        state[1] += 1
        for i in range(6):
            base[1, i] = raw[n, i]
            value = raw[n, i] - base[0, i]
            for stage in range(2):
                value = _average(
                    history, stage, i, state[1], value, lengths[group[row], stage], period
                )
            out[n, i] = base[0, i] + value


@compiled
def _begin(raw, n, history, base, state):  # type: ignore[no-untyped-def]
    """Forget what was before: at a standstill the filters have run empty."""
    for i in range(6):
        base[0, i] = raw[n, i] if state[0] < 0 else base[1, i]
        for stage in range(2):
            for m in range(history.shape[1]):
                history[stage, m, i, VALUE] = 0.0
                history[stage, m, i, INTEGRAL] = 0.0


@compiled
def _average(history, stage, i, count, value, length, period):  # type: ignore[no-untyped-def]
    size = history.shape[1]
    here, before = count % size, (count - 1) % size
    integral = history[stage, before, i, INTEGRAL]
    integral += 0.5 * period * (history[stage, before, i, VALUE] + value)
    history[stage, here, i, VALUE] = value
    history[stage, here, i, INTEGRAL] = integral
    if length <= 0.0:
        return value
    whole = int(length / period)
    part = length / period - whole
    late, early = (count - whole) % size, (count - whole - 1) % size
    v_late, v_early = history[stage, late, i, VALUE], history[stage, early, i, VALUE]
    # integral over the rest of the cell in which t - T lies
    rest = period * (v_late * part + 0.5 * (v_early - v_late) * part * part)
    return (integral - history[stage, late, i, INTEGRAL] + rest) / length


LEAST_SHARE = 0.05
"""Share of the bound of acceleration that counts as left for braking where less is [1]."""


@compiled
def follow_within(wished, period, speed, acceleration, command):  # type: ignore[no-untyped-def]
    """Fill a command that keeps its bounds, from rest at the first position that is wished for.

    What is wished for and keeps the bounds itself comes back as it is. ``wished`` and the filled
    ``command`` are positions (T,) [m] at a ``period`` [s]; ``speed`` and ``acceleration`` are
    positive bounds [m/s], [m/s^2].
    """
    last = wished.shape[0] - 1
    x, v = wished[0], 0.0
    command[0] = x
    for n in range(last):
        ahead = (wished[n + 1] - wished[n]) / period
        before = (wished[n] - wished[n - 1]) / period if n > 0 else 0.0
        change = min(max((ahead - before) / period, -acceleration), acceleration)
        gap = wished[n] - x
        left = 0.5 * (acceleration + change if gap > 0.0 else acceleration - change)
        left = max(left, LEAST_SHARE * acceleration)
        half = 0.5 * left * period
        most = sqrt(2.0 * left * abs(gap) + half * half) - half
        closing = min(abs(gap) / period, most)
        asked = ahead + (closing if gap > 0.0 else -closing)
        asked = min(max(asked, v - acceleration * period), v + acceleration * period)
        v = min(max(asked, -speed), speed)
        x = x + period * v
        command[n + 1] = x
