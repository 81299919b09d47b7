"""How fast a corner may be passed, and how fast the blocks beside it.

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
"""

from enum import IntEnum
from math import inf, sqrt

import numpy as np
import numpy.typing as npt

from pipeline.kernels import compiled

Floats = npt.NDArray[np.float64]


class Limit(IntEnum):
    """Rows of ``ControlParameters.limits``."""

    RAPID_SPEED = 0
    CUTTING_SPEED = 1
    RAPID_ACCELERATION = 2
    CUTTING_ACCELERATION = 3
    ARC_ACCELERATION = 4
    CORNER_JUMP = 5
    JERK = 6


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
    """What tolerances come to, shape (4, N): rows dV / tol [1/s], a / tol [1/s^2], the time r that
    an acceleration counts for [s], and the acceleration [m/s^2].

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
    """Cap of a block's speed by one of its corners and one axis, as the module says [m/s]."""
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
