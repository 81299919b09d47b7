"""Limits of speed, acceleration and jerk of each row, whatever its feed, in one compiled pass.

The rules of corners stand in :mod:`pipeline.machine.control.corners`.
"""

from math import inf, sqrt

import numpy as np

from pipeline.gcode.moves import METRE_PER_SECOND, RADIAN, FeedMode, Kind, PathMode
from pipeline.kernels import compiled
from pipeline.machine.control.corners import block_speed
from pipeline.machine.control.geometry import (
    BEGIN,
    CURVATURE,
    FINISH,
    ROTARY,
    STEEPEST,
    THIRD,
    shape,
)
from pipeline.machine.control.parameters import Limit
from pipeline.machine.control.path import Binding, Halt, Motion

ROUND_OFF = 1e-9
"""Change of direction that counts as none: positions are rounded to about as much [1]."""
FRAMES = (10, 6)
"""Shape of the work array: the frame of the row at hand and of the one before it."""
STOP_ALWAYS, STOP_CHANGE, STOP_NEVER = range(3)
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


@compiled
def limit(  # type: ignore[no-untyped-def]
    kind, origin, end, centre, angle, plane, feed_mode, path_mode, tolerance, halt,
    limits, most, drain, same_filters, settle, rapid_stop, independent, s_curve, blends,
    frames, motion, form, length, factor, cap, acceleration, jerk, corner, pause,
    reason, end_reason, turn, bend,
):  # fmt: skip
    """Fill the arrays of :class:`pipeline.machine.control.path.Path` from ``motion`` on; see there.

    The arguments before ``frames`` are columns of ``Moves`` (``tolerance`` with the control's own
    filled in, infinite for none [mm]), ``halt`` of :class:`pipeline.machine.control.path.Halt`,
    ``ControlParameters.limits``, ``most``, the greatest speed and acceleration of X, Y and Z
    together [m/s], [m/s^2], ``drain``, how long the filters take to run empty in rapids and in
    cutting, shape (2,) [s], and the control's settings.  ``frames`` of shape :data:`FRAMES` is a
    work array.  ``turn`` and ``bend``, where not empty, take the change of direction of X, Y,
    Z at the end of each row that goes on [1], and the curvature [1/m].
    """
    last = np.int64(-1)  # a literal would have all that follows compiled a second time
    stopping = False
    for k in range(kind.shape[0]):
        motion[k], length[k], corner[k], pause[k] = _STILL, 0.0, 0.0, 0.0
        reason[k], end_reason[k] = 0, 0
        stopping = stopping or halt[k] == _STOPS
        if _moves(kind[k]):
            form[k], length[k] = shape(kind, origin, end, centre, angle, plane, k, frames)
        if length[k] == 0.0:
            continue
        motion[k] = _motion(kind[k], feed_mode[k], independent)
        group = _group(motion[k])
        _bound_block(
            k, group, limits, most, form[k], s_curve, frames, cap, acceleration, jerk, reason
        )
        factor[k] = _feed_factor(motion[k], form[k], feed_mode[k], length[k], cap[k])
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
                    _join(last, k, limits, frames, length, cap, corner, reason)
            if turn.shape[0] > 0:
                turn[last] = 0.0 if standing else _turn(frames)
        if bend.shape[0] > 0:
            bend[k] = _bend(frames)
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
def _bound_block(k, group, limits, most, form, s_curve, frames, cap, acceleration, jerk, reason):  # type: ignore[no-untyped-def]
    """Limit speed, acceleration and jerk of a block taken alone."""
    speed, a = inf, inf
    if form != ROTARY:
        speed, a = most[0], most[1]
    reason[k] = _BY_AXIS
    for i in range(6):
        if frames[STEEPEST, i] > 0.0:
            speed = min(speed, limits[_SPEED + group, i] / frames[STEEPEST, i])
            a = min(a, limits[_ACCELERATION + group, i] / frames[STEEPEST, i])
    for i in range(6):
        if frames[CURVATURE, i] > 0.0:
            v = sqrt(limits[_ARC_ACCELERATION, i] / frames[CURVATURE, i])
            if v < speed:
                speed, reason[k] = v, _BY_ARC
    cap[k], acceleration[k] = speed, a
    if s_curve:
        cap[k], acceleration[k], jerk[k] = _jerk(frames, limits, speed, a)


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
def _join(last, k, limits, frames, length, cap, corner, reason):  # type: ignore[no-untyped-def]
    """Speed of the corner and caps of the blocks beside it, by the axes' jumps."""
    for i in range(6):
        change = abs(frames[BEGIN, i] - frames[BEFORE + FINISH, i])
        if change > ROUND_OFF:
            jump, a = limits[_JUMP, i], limits[_ARC_ACCELERATION, i]
            corner[last] = min(corner[last], jump / change)
            bend = frames[BEFORE + CURVATURE, i]
            v = block_speed(bend, change, length[last], a, jump, 0.0)
            if v < cap[last]:
                cap[last], reason[last] = v, _BY_CURVE
            v = block_speed(frames[CURVATURE, i], change, length[k], a, jump, 0.0)
            if v < cap[k]:
                cap[k], reason[k] = v, _BY_CURVE


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
