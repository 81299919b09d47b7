"""Speed limits of corners and of the blocks beside them, by jumps and by tolerance.

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

import numpy as np

from pipeline.gcode.moves import METRE
from pipeline.kernels import compiled
from pipeline.machine.control.geometry import STRAIGHT
from pipeline.machine.control.path import Binding, Motion
from pipeline.schema.arrays import Floats

STEEP = 8.0
"""Greatest factor by which the acceleration near a corner is lowered [1]."""
_STILL, _RAPID = int(Motion.STILL), int(Motion.RAPID)
_BY_TOLERANCE, _BY_STOP = int(Binding.TOLERANCE), int(Binding.EXACT_STOP)


def mean_deviation(filters: Floats) -> Floats:
    """E|S| of the sum of two uniform times of lengths T1, T2 (last axis) [s].

    Examples
    --------
    >>> mean_deviation(np.array([[0.012, 0.0], [0.012, 0.012]])).tolist()
    [0.003, 0.004]
    """
    long, short = filters.max(axis=-1) / 2, filters.min(axis=-1) / 2
    with np.errstate(invalid="ignore"):
        more = np.where(long > 0, short**2 / (6 * long), 0.0)
    deviation: Floats = long / 2 + more
    return deviation


def variance(filters: Floats) -> Floats:
    """Variance of the sum of two uniform times of lengths T1, T2 (last axis) [s^2]."""
    spread: Floats = (filters**2).sum(axis=-1) / 12
    return spread


def rounding(filters: Floats, acceleration: Floats) -> Floats:
    """Corner limits for one unit of tolerance, shape (4, N).

    Rows are dV / tol [1/s], a / tol [1/s^2], the time r that an acceleration counts for [s], and
    the acceleration [m/s^2].

    Parameters
    ----------
    filters : (N, 2) array
        T1, T2 [s]; without filters the rules do not bind.
    acceleration : (N,) array
        Greatest acceleration along the path [m/s^2].
    """
    deviation, spread = mean_deviation(filters), variance(filters)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(deviation > 0, spread / (2 * deviation), 0.0)
        table: Floats = np.array([1 / deviation, 1 / spread, reach, acceleration])
    return table


@compiled
def block_speed(
    curvature: float,
    change: float,
    length: float,
    acceleration: float,
    jump: float,
    drift: float,
) -> float:
    """Greatest speed of a block by one of its corners and one axis, see the module [m/s]."""
    dense = curvature + change / length
    small = _root(dense, dense * drift, acceleration)
    long = _root(curvature, curvature * drift + jump / length, acceleration)
    return max(small, long)


@compiled
def _root(a: float, b: float, c: float) -> float:
    """Positive v with a v^2 + b v = c, infinite where both vanish."""
    if a == 0.0 and b == 0.0:
        return inf
    return 2.0 * c / (b + sqrt(b * b + 4.0 * a * c))


@compiled
def keep_tolerance(  # type: ignore[no-untyped-def]
    tolerance, allowance, drain, form, length, turn, bend, next_row, last_row,
    motion, cap, acceleration, corner, pause, reason, end_reason,
):  # fmt: skip
    """Lower what ``limits.limit`` has filled, from ``cap`` on.

    ``allowance`` is of :func:`rounding`; ``next_row`` and ``last_row`` name the moving row after
    and before each, -1 for none.
    """
    for k in range(motion.shape[0]):
        if turn[k] > 0.0 and _rounds(k, tolerance, allowance, motion):
            _limit_acceleration(
                k, tolerance, allowance, drain, form, length, turn, next_row, last_row,
                motion, cap, acceleration, corner, pause, end_reason,
            )  # fmt: skip
    for k in range(motion.shape[0]):
        if motion[k] == _STILL or not _rounds(k, tolerance, allowance, motion):
            continue
        if bend[k] > 0.0:
            _limit_arc(k, tolerance, allowance, motion, bend, cap, reason)
        if turn[k] > 0.0:
            _limit_corner(
                k, tolerance, allowance, drain, form, length, turn, bend, next_row, last_row,
                motion, cap, acceleration, corner, reason, end_reason,
            )  # fmt: skip


@compiled
def _group(motion):  # type: ignore[no-untyped-def]
    return 0 if motion == _RAPID else 1


@compiled
def _rounds(k, tolerance, allowance, motion):  # type: ignore[no-untyped-def]
    """Whether the filters round the corner, and a tolerance bounds that."""
    return isfinite(tolerance[k]) and isfinite(allowance[0, _group(motion[k])])


@compiled
def _is_isolated(k, window, form, length, cap, next_row):  # type: ignore[no-untyped-def]
    """Whether no other corner shares the tolerance of that at the end of row k."""
    return _is_long(k, window, form, length, cap) and _is_long(
        next_row[k], window, form, length, cap
    )


@compiled
def _is_long(k, window, form, length, cap):  # type: ignore[no-untyped-def]
    return form[k] == STRAIGHT and cap[k] * 0.5 * window <= length[k]


@compiled
def _limit_nearby(k, window, length, next_row, last_row, cap, acceleration, end_reason, lowered):  # type: ignore[no-untyped-def]
    """Greatest acceleration within half a window of row k's end, lowered to ``lowered`` at most."""
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
def _limit_acceleration(  # type: ignore[no-untyped-def]
    k, tolerance, allowance, drain, form, length, turn, next_row, last_row,
    motion, cap, acceleration, corner, pause, end_reason,
):  # fmt: skip
    """Lower the acceleration about a corner, or stop there."""
    group = _group(motion[k])
    window, reach = drain[group], allowance[2, group]
    jump = allowance[0, group] * tolerance[k] * METRE
    nearby = _limit_nearby(
        k, window, length, next_row, last_row, cap, acceleration, end_reason, allowance[3, group]
    )  # fmt: skip
    if _is_isolated(k, window, form, length, cap, next_row):
        standing = 2.0 * jump < turn[k] * nearby * reach
    else:
        lowered = 0.5 * jump / (turn[k] * reach)
        standing = STEEP * lowered < nearby
        if lowered < nearby and not standing:
            _limit_nearby(
                k, window, length, next_row, last_row, cap, acceleration, end_reason, lowered
            )
    if standing:
        corner[k], end_reason[k], pause[k] = 0.0, _BY_STOP, window
        turn[k] = 0.0


@compiled
def _limit_arc(k, tolerance, allowance, motion, bend, cap, reason):  # type: ignore[no-untyped-def]
    group = _group(motion[k])
    allowed = allowance[1, group] * tolerance[k] * METRE
    drift = allowance[2, group] * allowance[3, group]
    v = block_speed(bend[k], 0.0, 1.0, allowed, 0.0, drift)
    if v < cap[k]:
        cap[k], reason[k] = v, _BY_TOLERANCE


@compiled
def _limit_corner(  # type: ignore[no-untyped-def]
    k, tolerance, allowance, drain, form, length, turn, bend, next_row, last_row,
    motion, cap, acceleration, corner, reason, end_reason,
):  # fmt: skip
    group = _group(motion[k])
    window, reach = drain[group], allowance[2, group]
    jump = allowance[0, group] * tolerance[k] * METRE
    allowed = allowance[1, group] * tolerance[k] * METRE
    nearby = _limit_nearby(
        k, window, length, next_row, last_row, cap, acceleration, end_reason, allowance[3, group]
    )  # fmt: skip
    alone = _is_isolated(k, window, form, length, cap, next_row)
    v = (2.0 * jump if alone else jump) / turn[k] - nearby * reach
    if v < corner[k]:
        corner[k], end_reason[k] = max(v, 0.0), _BY_TOLERANCE
    if not alone:
        most = allowance[3, group]
        _limit_block(k, turn[k], allowed, jump, reach, nearby, most, length, bend, cap, reason)
        after = next_row[k]
        _limit_block(after, turn[k], allowed, jump, reach, nearby, most, length, bend, cap, reason)


@compiled
def _limit_block(row, turn, allowed, jump, reach, nearby, most, length, bend, cap, reason):  # type: ignore[no-untyped-def]
    # an arc counts with the greatest acceleration there is
    drift = reach * (most if bend[row] > 0.0 else nearby)
    v = block_speed(bend[row], turn, length[row], allowed, jump, drift)
    if v < cap[row]:
        cap[row], reason[row] = v, _BY_TOLERANCE
