"""Look-ahead of many individuals at once, in lanes that the processor works on together, compiled.

The formulas are those of :mod:`pipeline.machine.look_ahead`; only the time of the program is kept.
"""

from math import sqrt

from pipeline.kernels import compiled
from pipeline.machine.look_ahead import asked_speed
from pipeline.machine.motion import Motion

LANES = 16
CARRIED = 5
"""Rows of what is carried from row to row."""
_STILL, _INDEPENDENT = int(Motion.STILL), int(Motion.INDEPENDENT)
_REACH, _V_IN, _TOTAL, _WITHIN, _AFTER = range(CARRIED)


@compiled
def motion_totals(  # type: ignore[no-untyped-def]
    motion, length, factor, cap, acceleration, corner, feed, turns, speed, square, carried, out
):
    """Fill ``out``, how long each individual moves [s]; shape (P,).

    What stands before ``speed`` is as in :func:`pipeline.machine.look_ahead.plan_rows`.  ``speed``
    and ``square`` of shape (M, LANES) and ``carried`` of (CARRIED, LANES) are room to work in.
    """
    many = out.shape[0]
    for first in range(0, many, LANES):
        for lane in range(LANES):
            # what is left of the lanes repeats the last individual
            p = min(first + lane, many - 1)
            for k in range(motion.shape[0]):
                if motion[k] != _STILL and motion[k] != _INDEPENDENT:
                    v = asked_speed(motion, factor, feed, turns, p, k)
                    speed[k, lane] = min(v, cap[k])
        _lanes(motion, length, acceleration, corner, speed, square, carried)
        for lane in range(min(LANES, many - first)):
            out[first + lane] = carried[_TOTAL, lane]


@compiled
def _lanes(motion, length, acceleration, corner, speed, square, carried):  # type: ignore[no-untyped-def]
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
