"""Limits of speed, acceleration and jerk of each row, whatever its feed, and of its corners.

At a corner the speed of axis i jumps by v |du_i|, u the derivative of the axes along the path.

Jump: v |du_i| <= dV_i.  On a curve made of chords jump follows on jump, and a drive cannot tell
them from an acceleration.  So each jump must also be at most a_arc_i times the time of the shorter
of its two blocks.  That does not depend on the feed when the speed of a block of length L is capped
by the greater of the speeds that fulfil

    (kappa_i + |du_i| / L) v^2 <= a_arc_i      (the jump fits because v is small enough)
    kappa_i v^2 + dV_i v / L   <= a_arc_i      (dV_i fits because the block takes long enough)

for both of its corners, kappa_i the curvature of the block itself.  Every jump but one in a window
of length T is then paid for by a block that lies in the window: the speed of axis i changes by at
most (a_cut_i + a_arc_i) T + dV_i.

Tolerance: the filtered position is the mean of the programmed one over the kernel of the filters,
a random time S of zero mean about the delay, variance sigma^2.  From the mean arc length it departs
by the sum over the corners of |du| G, where G <= v g(x) + a q(x) for a corner that is x away in
time, g(x) = E (S - x)+ and q(x) = E ((S - x)+)^2 / 2, and by kappa v^2 sigma^2 / 2 on arcs.  With
r = q(0) / g(0) = sigma^2 / (2 E|S|) >= q / g (the kernel is log-concave) a corner counts as a jump
of |du| (v + a r).  The rules of jumps with dV = tol / E|S| and a_arc = tol / sigma^2 then keep the
path within dV E|S| / 2 + a_arc sigma^2 / 2 = tol.

A corner between two lines that each take half of the filters' time T at least has the tolerance to
itself: dV = 2 tol / E|S|.  For g is convex and vanishes at T / 2, so that two such corners add up
to g(x) + g(T / 2 - x) <= g(0), and what lies densely behind the next one to 3 / 4 of that.

Near a corner the acceleration counts: where it uses more than half of the corner's tolerance, it is
lowered in the blocks that the filters can see from the corner, those within half of their time.
Where it would have to go below 1 / :data:`STEEP`, the corner is passed from standstill to
standstill.
"""

from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import METRE, METRE_PER_SECOND, RADIAN, FeedMode, Kind, PathMode
from pipeline.kernels import compiled
from pipeline.machine.control.geometry import (
    BEGIN,
    CURVATURE,
    FINISH,
    ROTARY,
    STEEPEST,
    STRAIGHT,
    THIRD,
    shape,
)
from pipeline.machine.control.parameters import Limit
from pipeline.machine.control.path import Binding, Codes, Halt, Motion
from pipeline.schema.arrays import Floats

ROUND_OFF = 1e-9
"""Change of direction that counts as none: positions are rounded to about as much [1]."""
FRAMES = (10, 6)
"""Shape of the work array: the frame of the row at hand and of the one before it."""
STOP_ALWAYS, _, STOP_NEVER = range(3)
"""``rapid_stop`` of the control."""

BEFORE = 5
"""First row of ``frames`` that belongs to the row before."""
_RAPID_KIND, _ARC_KIND = int(Kind.RAPID), int(Kind.ARC)
_PROBE, _THREAD = int(Kind.PROBE), int(Kind.THREAD)
_EXACT, _EXACT_PATH = int(PathMode.EXACT_STOP), int(PathMode.EXACT_PATH)
_INVERSE, _PER_REVOLUTION = int(FeedMode.INVERSE_TIME), int(FeedMode.PER_REVOLUTION)
_STILL, _RAPID, _CUTTING = int(Motion.STILL), int(Motion.RAPID), int(Motion.CUTTING)
_PER_TURN, _INDEPENDENT = int(Motion.PER_TURN), int(Motion.INDEPENDENT)
_STOPS = int(Halt.STOPS)
_SPEED, _ACCELERATION = int(Limit.RAPID_SPEED), int(Limit.RAPID_ACCELERATION)
_ARC_ACCELERATION, _JUMP = int(Limit.ARC_ACCELERATION), int(Limit.CORNER_JUMP)
_JERK = int(Limit.JERK)
_BY_AXIS, _BY_ARC, _BY_CURVE = int(Binding.AXIS_SPEED), int(Binding.ARC), int(Binding.CURVE)
_BY_CORNER, _BY_STOP = int(Binding.CORNER), int(Binding.EXACT_STOP)


class Filled(NamedTuple):
    """Arrays of a :class:`pipeline.machine.control.path.Path` of M rows, filled here."""

    motion: Codes
    form: Codes
    length: Floats
    factor: Floats
    cap: Floats
    acceleration: Floats
    jerk: Floats
    corner: Floats
    pause: Floats
    reason: Codes
    end_reason: Codes
    turn: Floats
    bend: Floats
    """Change of direction of X, Y, Z at the end of each row that goes on [1], and the curvature
    [1/m]; empty where no filter rounds a corner within a tolerance."""
    after: npt.NDArray[np.int32]
    before: npt.NDArray[np.int32]
    """The moving rows after and before each moving row, -1 for none, for the rules of tolerance."""


@compiled
def limit(  # type: ignore[no-untyped-def]
    kind, origin, end, centre, angle, plane, feed_mode, path_mode, tolerance, halt,
    limits, most, drain, same_filters, settle, rapid_stop, independent, s_curve, blends,
    frames, rows,
):  # fmt: skip
    """Fill ``rows`` by the limits of each row and by the jumps of its corners.

    The arguments before ``frames`` are columns of ``Moves`` (``tolerance`` with the control's own
    filled in, infinite for none [mm]), ``halt`` of :class:`pipeline.machine.control.path.Halt`,
    ``ControlParameters.limits``, ``most``, the greatest speed and acceleration of X, Y and Z
    together [m/s], [m/s^2], ``drain``, how long the filters take to run empty in rapids and in
    cutting, shape (2,) [s], and the control's settings.  ``frames`` of shape :data:`FRAMES` is a
    work array.
    """
    motion, form, length, corner, pause = (
        rows.motion, rows.form, rows.length, rows.corner, rows.pause
    )  # fmt: skip
    end_reason = rows.end_reason
    last = np.int64(-1)  # a literal would have all that follows compiled a second time
    stopping = False
    for k in range(kind.shape[0]):
        motion[k], length[k], corner[k], pause[k] = _STILL, 0.0, 0.0, 0.0
        rows.reason[k], end_reason[k] = 0, 0
        stopping = stopping or halt[k] == _STOPS
        if _moves(kind[k]):
            form[k], length[k] = shape(kind, origin, end, centre, angle, plane, k, frames)
        if length[k] == 0.0:
            continue
        motion[k] = _motion(kind[k], feed_mode[k], independent)
        group = _group(motion[k])
        _bound_block(k, group, limits, most, s_curve, frames, rows)
        rows.factor[k] = _feed_factor(motion[k], form[k], feed_mode[k], length[k], rows.cap[k])
        if last >= 0:
            checked = (
                stopping
                or path_mode[last] == _EXACT
                or (path_mode[last] == _EXACT_PATH and not blends)
                or _in_position(last, k, kind, motion, rapid_stop)
            )
            standing = checked or _stands(last, k, motion, form, tolerance, same_filters)
            if standing:
                end_reason[last] = _BY_STOP
                pause[last] = drain[_group(motion[last])] + (settle if checked else 0.0)
            else:
                corner[last], end_reason[last] = inf, _BY_CORNER
                if not blends:
                    _join(last, k, limits, frames, rows)
            if rows.turn.shape[0] > 0:
                rows.turn[last] = 0.0 if standing else _turn(frames)
        if rows.bend.shape[0] > 0:
            rows.bend[k] = _bend(frames)
        for row in range(BEFORE):
            for i in range(6):
                frames[BEFORE + row, i] = frames[row, i]
        last, stopping = k, False
    if last >= 0:
        checked = stopping or path_mode[last] == _EXACT or kind[last] == _PROBE
        end_reason[last] = _BY_STOP
        pause[last] = drain[_group(motion[last])] + (settle if checked else 0.0)


@compiled
def _moves(kind):  # type: ignore[no-untyped-def]
    return kind <= _ARC_KIND or kind in (_PROBE, _THREAD)


@compiled
def _motion(kind, feed_mode, independent):  # type: ignore[no-untyped-def]
    if kind == _RAPID_KIND:
        return _INDEPENDENT if independent else _RAPID
    if kind == _THREAD or feed_mode == _PER_REVOLUTION:
        return _PER_TURN
    return _CUTTING


@compiled
def _group(motion):  # type: ignore[no-untyped-def]
    """Group of limits and filters: 0 for rapids, 1 for cutting."""
    return 0 if motion in (_RAPID, _INDEPENDENT) else 1


@compiled
def _feed_factor(motion, form, feed_mode, length, cap):  # type: ignore[no-untyped-def]
    """Speed along the path [m/s, rad/s] for one unit of F; of rapids for an override of 1."""
    if _group(motion) == 0:
        return cap
    if motion == _CUTTING and feed_mode == _INVERSE:
        return length / 60.0
    return RADIAN / 60.0 if form == ROTARY else METRE_PER_SECOND


@compiled
def _bound_block(k, group, limits, most, s_curve, frames, rows):  # type: ignore[no-untyped-def]
    """Limit speed, acceleration and jerk of a block taken alone."""
    speed, a = inf, inf
    if rows.form[k] != ROTARY:
        speed, a = most[0], most[1]
    rows.reason[k] = _BY_AXIS
    for i in range(6):
        if frames[STEEPEST, i] > 0.0:
            speed = min(speed, limits[_SPEED + group, i] / frames[STEEPEST, i])
            a = min(a, limits[_ACCELERATION + group, i] / frames[STEEPEST, i])
    for i in range(6):
        if frames[CURVATURE, i] > 0.0:
            v = sqrt(limits[_ARC_ACCELERATION, i] / frames[CURVATURE, i])
            if v < speed:
                speed, rows.reason[k] = v, _BY_ARC
    rows.cap[k], rows.acceleration[k] = speed, a
    if s_curve:
        rows.cap[k], rows.acceleration[k], rows.jerk[k] = _jerk(frames, limits, speed, a)


@compiled
def _jerk(frames, limits, speed, acceleration):  # type: ignore[no-untyped-def]
    """Speed, acceleration and jerk along the path that keep the jerk of each axis.

    That is at most |dq/ds| j + 3 |d2q/ds2| v a + |d3q/ds3| v^3: at most half of the limit goes to
    the last term, at most half of the rest to the middle one.
    """
    for i in range(6):
        if frames[THIRD, i] > 0.0:
            speed = min(speed, (limits[_JERK, i] / (2.0 * frames[THIRD, i])) ** (1.0 / 3.0))
    for i in range(6):
        if frames[CURVATURE, i] > 0.0:
            rest = limits[_JERK, i] - frames[THIRD, i] * speed**3
            acceleration = min(acceleration, rest / (6.0 * frames[CURVATURE, i] * speed))
    jerk = inf
    for i in range(6):
        if frames[STEEPEST, i] > 0.0:
            rest = limits[_JERK, i] - frames[THIRD, i] * speed**3
            rest -= 3.0 * frames[CURVATURE, i] * speed * acceleration
            jerk = min(jerk, rest / frames[STEEPEST, i])
    return speed, acceleration, jerk


@compiled
def _in_position(last, k, kind, motion, rapid_stop):  # type: ignore[no-untyped-def]
    """Whether the control checks between two rows that the axes are in position."""
    if kind[last] == _PROBE or (kind[k] == _THREAD) != (kind[last] == _THREAD):
        return True
    if motion[k] == _INDEPENDENT or motion[last] == _INDEPENDENT:
        return True
    if _group(motion[k]) != _group(motion[last]):
        return rapid_stop != STOP_NEVER
    return motion[k] == _RAPID and rapid_stop == STOP_ALWAYS


@compiled
def _stands(last, k, motion, form, tolerance, same_filters):  # type: ignore[no-untyped-def]
    """Whether two rows cannot be joined: other filters, tolerance or unit of the path."""
    if (form[k] == ROTARY) != (form[last] == ROTARY) or tolerance[k] != tolerance[last]:
        return True
    return not same_filters and _group(motion[k]) != _group(motion[last])


@compiled
def _join(last, k, limits, frames, rows):  # type: ignore[no-untyped-def]
    """Speed of the corner and caps of the blocks beside it, by the axes' jumps."""
    for i in range(6):
        change = abs(frames[BEGIN, i] - frames[BEFORE + FINISH, i])
        if change > ROUND_OFF:
            jump, a = limits[_JUMP, i], limits[_ARC_ACCELERATION, i]
            rows.corner[last] = min(rows.corner[last], jump / change)
            for row, frame in ((last, BEFORE + CURVATURE), (k, CURVATURE)):
                v = block_speed(frames[frame, i], change, rows.length[row], a, jump, 0.0)
                if v < rows.cap[row]:
                    rows.cap[row], rows.reason[row] = v, _BY_CURVE


@compiled
def _turn(frames):  # type: ignore[no-untyped-def]
    """Change of direction of X, Y, Z [1]."""
    total = 0.0
    for i in range(3):
        total += (frames[BEGIN, i] - frames[BEFORE + FINISH, i]) ** 2
    return sqrt(total) if total > ROUND_OFF * ROUND_OFF else 0.0


@compiled
def _bend(frames):  # type: ignore[no-untyped-def]
    """Curvature of the path of X, Y, Z [1/m]."""
    total = 0.0
    for i in range(3):
        total += frames[CURVATURE, i] ** 2
    return sqrt(total)


STEEP = 8.0
"""Greatest factor by which the acceleration near a corner is lowered [1]."""
_BY_TOLERANCE = int(Binding.TOLERANCE)


def mean_deviation(filters: Floats) -> Floats:
    """E|S| of the sum of two uniform times of lengths T1, T2 (last axis) [s].

    >>> mean_deviation(np.array([[0.012, 0.0], [0.012, 0.012]])).tolist()
    [0.003, 0.004]
    """
    long, short = filters.max(axis=-1) / 2, filters.min(axis=-1) / 2
    with np.errstate(invalid="ignore"):
        more = np.where(long > 0, short**2 / (6 * long), 0.0)
    return long / 2 + more


def variance(filters: Floats) -> Floats:
    """Variance of the sum of two uniform times of lengths T1, T2 (last axis) [s^2]."""
    return (filters**2).sum(axis=-1) / 12


def rounding(filters: Floats, acceleration: Floats) -> Floats:
    """Corner limits for one unit of tolerance, (4, N), by T1, T2 of the filters (N, 2) [s].

    Rows are dV / tol [1/s], a / tol [1/s^2], the time r that an acceleration counts for [s], and
    the greatest ``acceleration`` along the path, (N,) [m/s^2].  Without filters no rule binds.
    """
    deviation, spread = mean_deviation(filters), variance(filters)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(deviation > 0, spread / (2 * deviation), 0.0)
        table: Floats = np.array([1 / deviation, 1 / spread, reach, acceleration])
    return table


@compiled
def block_speed(curvature, change, length, acceleration, jump, drift):  # type: ignore[no-untyped-def]
    """Greatest speed of a block by one of its corners and one axis, see the module [m/s]."""
    dense = curvature + change / length
    small = _root(dense, dense * drift, acceleration)
    long = _root(curvature, curvature * drift + jump / length, acceleration)
    return max(small, long)


@compiled
def _root(a, b, c):  # type: ignore[no-untyped-def]
    """Positive v with a v^2 + b v = c, infinite where both vanish."""
    if a == 0.0 and b == 0.0:
        return inf
    return 2.0 * c / (b + sqrt(b * b + 4.0 * a * c))


@compiled
def keep_tolerance(tolerance, allowance, drain, rows):  # type: ignore[no-untyped-def]
    """Lower what :func:`limit` has filled; ``allowance`` is of :func:`rounding`."""
    for k in range(rows.motion.shape[0]):
        if rows.turn[k] > 0.0 and _rounds(k, tolerance, allowance, rows):
            _limit_acceleration(k, tolerance, allowance, drain, rows)
    for k in range(rows.motion.shape[0]):
        if rows.motion[k] == _STILL or not _rounds(k, tolerance, allowance, rows):
            continue
        if rows.bend[k] > 0.0:
            _limit_arc(k, tolerance, allowance, rows)
        if rows.turn[k] > 0.0:
            _limit_corner(k, tolerance, allowance, drain, rows)


@compiled
def _rounds(k, tolerance, allowance, rows):  # type: ignore[no-untyped-def]
    """Whether the filters round the corner, and a tolerance bounds that."""
    return isfinite(tolerance[k]) and isfinite(allowance[0, _group(rows.motion[k])])


@compiled
def _is_isolated(k, window, rows):  # type: ignore[no-untyped-def]
    """Whether no other corner shares the tolerance of that at the end of row k."""
    return _is_long(k, window, rows) and _is_long(rows.after[k], window, rows)


@compiled
def _is_long(k, window, rows):  # type: ignore[no-untyped-def]
    return rows.form[k] == STRAIGHT and rows.cap[k] * 0.5 * window <= rows.length[k]


@compiled
def _limit_nearby(k, window, rows, lowered):  # type: ignore[no-untyped-def]
    """Greatest acceleration within half a window of row k's end, lowered to ``lowered`` at most."""
    greatest = 0.0
    row, time = k, 0.0
    while row >= 0 and time < 0.5 * window:
        rows.acceleration[row] = min(rows.acceleration[row], lowered)
        greatest = max(greatest, rows.acceleration[row])
        time += rows.length[row] / rows.cap[row]
        row = rows.before[row]
        if row >= 0 and rows.end_reason[row] == _BY_STOP:
            break
    row, time = rows.after[k], 0.0
    while row >= 0 and time < 0.5 * window:
        rows.acceleration[row] = min(rows.acceleration[row], lowered)
        greatest = max(greatest, rows.acceleration[row])
        time += rows.length[row] / rows.cap[row]
        if rows.end_reason[row] == _BY_STOP:
            break
        row = rows.after[row]
    return greatest


@compiled
def _limit_acceleration(k, tolerance, allowance, drain, rows):  # type: ignore[no-untyped-def]
    """Lower the acceleration about a corner, or stop there."""
    group = _group(rows.motion[k])
    window, reach = drain[group], allowance[2, group]
    jump = allowance[0, group] * tolerance[k] * METRE
    nearby = _limit_nearby(k, window, rows, allowance[3, group])
    if _is_isolated(k, window, rows):
        standing = 2.0 * jump < rows.turn[k] * nearby * reach
    else:
        lowered = 0.5 * jump / (rows.turn[k] * reach)
        standing = STEEP * lowered < nearby
        if lowered < nearby and not standing:
            _limit_nearby(k, window, rows, lowered)
    if standing:
        rows.corner[k], rows.end_reason[k], rows.pause[k] = 0.0, _BY_STOP, window
        rows.turn[k] = 0.0


@compiled
def _limit_arc(k, tolerance, allowance, rows):  # type: ignore[no-untyped-def]
    group = _group(rows.motion[k])
    allowed = allowance[1, group] * tolerance[k] * METRE
    drift = allowance[2, group] * allowance[3, group]
    v = block_speed(rows.bend[k], 0.0, 1.0, allowed, 0.0, drift)
    if v < rows.cap[k]:
        rows.cap[k], rows.reason[k] = v, _BY_TOLERANCE


@compiled
def _limit_corner(k, tolerance, allowance, drain, rows):  # type: ignore[no-untyped-def]
    group = _group(rows.motion[k])
    window, reach, most = drain[group], allowance[2, group], allowance[3, group]
    jump = allowance[0, group] * tolerance[k] * METRE
    allowed = allowance[1, group] * tolerance[k] * METRE
    nearby = _limit_nearby(k, window, rows, most)
    alone = _is_isolated(k, window, rows)
    v = (2.0 * jump if alone else jump) / rows.turn[k] - nearby * reach
    if v < rows.corner[k]:
        rows.corner[k], rows.end_reason[k] = max(v, 0.0), _BY_TOLERANCE
    if alone:
        return
    for row in (np.int64(k), np.int64(rows.after[k])):
        # an arc counts with the greatest acceleration there is
        drift = reach * (most if rows.bend[row] > 0.0 else nearby)
        v = block_speed(rows.bend[row], rows.turn[k], rows.length[row], allowed, jump, drift)
        if v < rows.cap[row]:
            rows.cap[row], rows.reason[row] = v, _BY_TOLERANCE
