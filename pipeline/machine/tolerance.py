"""Corners and arcs so slow that the filtered path keeps its tolerance, compiled.

The rules stand in :mod:`pipeline.machine.corners`.  Near a corner the acceleration counts: where
it uses more than half of the corner's tolerance, it is lowered in the blocks that the filters can
see from the corner, those within half of their time.  Where it would have to go below 1 /
:data:`STEEP`, the corner is passed from standstill to standstill.
"""

from math import isfinite

from pipeline.gcode.moves import METRE
from pipeline.kernels import compiled
from pipeline.machine.corners import block_speed
from pipeline.machine.geometry import STRAIGHT
from pipeline.machine.motion import Binding, Motion

STEEP = 8.0
_STILL, _RAPID = int(Motion.STILL), int(Motion.RAPID)
_BY_TOLERANCE, _BY_STOP = int(Binding.TOLERANCE), int(Binding.EXACT_STOP)


@compiled
def keep_tolerance(  # type: ignore[no-untyped-def]
    tolerance, rounding, drain, form, length, turn, bend, next_row, last_row,
    motion, cap, acceleration, corner, pause, reason, end_reason,
):  # fmt: skip
    """Lower what ``limits.limit`` has filled, from ``cap`` on.

    ``rounding`` is of :func:`pipeline.machine.corners.rounding`; ``next_row`` and ``last_row`` name
    the moving row after and before each, -1 for none.
    """
    for k in range(motion.shape[0]):
        if turn[k] > 0.0 and _rounds(k, tolerance, rounding, motion):
            _calm(
                k, tolerance, rounding, drain, form, length, turn, next_row, last_row,
                motion, cap, acceleration, corner, pause, end_reason,
            )  # fmt: skip
    for k in range(motion.shape[0]):
        if motion[k] == _STILL or not _rounds(k, tolerance, rounding, motion):
            continue
        if bend[k] > 0.0:
            _slow_arc(k, tolerance, rounding, motion, bend, cap, reason)
        if turn[k] > 0.0:
            _slow_corner(
                k, tolerance, rounding, drain, form, length, turn, bend, next_row, last_row,
                motion, cap, acceleration, corner, reason, end_reason,
            )  # fmt: skip


@compiled
def _group(motion):  # type: ignore[no-untyped-def]
    return 0 if motion == _RAPID else 1


@compiled
def _rounds(k, tolerance, rounding, motion):  # type: ignore[no-untyped-def]
    """Whether there are filters that round, and a tolerance."""
    return isfinite(tolerance[k]) and isfinite(rounding[0, _group(motion[k])])


@compiled
def _alone(k, window, form, length, cap, next_row):  # type: ignore[no-untyped-def]
    """Whether the corner at the end of row k has the tolerance to itself."""
    return _long(k, window, form, length, cap) and _long(next_row[k], window, form, length, cap)


@compiled
def _long(k, window, form, length, cap):  # type: ignore[no-untyped-def]
    return form[k] == STRAIGHT and cap[k] * 0.5 * window <= length[k]


@compiled
def _seen(k, window, length, next_row, last_row, cap, acceleration, end_reason, lowered):  # type: ignore[no-untyped-def]
    """Greatest acceleration in the blocks within half a window of the corner at the end of row k,
    after it is lowered to ``lowered``.
    """
    greatest = 0.0
    row, time = k, 0.0
    while row >= 0 and time < 0.5 * window:
        acceleration[row] = min(acceleration[row], lowered)
        greatest = max(greatest, acceleration[row])
        time += length[row] / cap[row]
        row = last_row[row]
        if row >= 0 and end_reason[row] == _BY_STOP:
            break
    row, time = next_row[k], 0.0
    while row >= 0 and time < 0.5 * window:
        acceleration[row] = min(acceleration[row], lowered)
        greatest = max(greatest, acceleration[row])
        time += length[row] / cap[row]
        if end_reason[row] == _BY_STOP:
            break
        row = next_row[row]
    return greatest


@compiled
def _calm(  # type: ignore[no-untyped-def]
    k, tolerance, rounding, drain, form, length, turn, next_row, last_row,
    motion, cap, acceleration, corner, pause, end_reason,
):  # fmt: skip
    """Lower the acceleration about a corner, or stand still in it."""
    group = _group(motion[k])
    window, reach = drain[group], rounding[2, group]
    jump = rounding[0, group] * tolerance[k] * METRE
    near = _seen(
        k, window, length, next_row, last_row, cap, acceleration, end_reason, rounding[3, group]
    )  # fmt: skip
    if _alone(k, window, form, length, cap, next_row):
        standing = 2.0 * jump < turn[k] * near * reach
    else:
        calm = 0.5 * jump / (turn[k] * reach)
        standing = STEEP * calm < near
        if calm < near and not standing:
            _seen(k, window, length, next_row, last_row, cap, acceleration, end_reason, calm)
    if standing:
        corner[k], end_reason[k], pause[k] = 0.0, _BY_STOP, window
        turn[k] = 0.0


@compiled
def _slow_arc(k, tolerance, rounding, motion, bend, cap, reason):  # type: ignore[no-untyped-def]
    group = _group(motion[k])
    allowed = rounding[1, group] * tolerance[k] * METRE
    drift = rounding[2, group] * rounding[3, group]
    v = block_speed(bend[k], 0.0, 1.0, allowed, 0.0, drift)
    if v < cap[k]:
        cap[k], reason[k] = v, _BY_TOLERANCE


@compiled
def _slow_corner(  # type: ignore[no-untyped-def]
    k, tolerance, rounding, drain, form, length, turn, bend, next_row, last_row,
    motion, cap, acceleration, corner, reason, end_reason,
):  # fmt: skip
    group = _group(motion[k])
    window, reach = drain[group], rounding[2, group]
    jump = rounding[0, group] * tolerance[k] * METRE
    allowed = rounding[1, group] * tolerance[k] * METRE
    near = _seen(
        k, window, length, next_row, last_row, cap, acceleration, end_reason, rounding[3, group]
    )  # fmt: skip
    alone = _alone(k, window, form, length, cap, next_row)
    v = (2.0 * jump if alone else jump) / turn[k] - near * reach
    if v < corner[k]:
        corner[k], end_reason[k] = max(v, 0.0), _BY_TOLERANCE
    if not alone:
        most = rounding[3, group]
        _slow_block(k, turn[k], allowed, jump, reach, near, most, length, bend, cap, reason)
        after = next_row[k]
        _slow_block(after, turn[k], allowed, jump, reach, near, most, length, bend, cap, reason)


@compiled
def _slow_block(row, turn, allowed, jump, reach, near, most, length, bend, cap, reason):  # type: ignore[no-untyped-def]
    # an arc is judged with the greatest acceleration there is
    drift = reach * (most if bend[row] > 0.0 else near)
    v = block_speed(bend[row], turn, length[row], allowed, jump, drift)
    if v < cap[row]:
        cap[row], reason[row] = v, _BY_TOLERANCE
