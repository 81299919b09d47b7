"""How near the rows of a cut are to each of what limits them, at one F and S."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import cutting_power, no_load_power
from pipeline.optimisation.problem.bounds import HIGH, at_hardest_station
from pipeline.optimisation.problem.constraints import (
    CONSTRAINTS,
    CUTTING_SPEED,
    FEED,
    LEAST_CHIP,
    POWER,
    SPINDLE_SPEED,
    STABILITY,
    TORQUE,
)
from pipeline.optimisation.problem.drive_power import allowed_power
from pipeline.optimisation.problem.ranges import feeds_per_minute

if TYPE_CHECKING:
    from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

AT = 0.98
"""Share of a limit from which a row counts as at it: words of F and S are rounded."""
ORDER = np.array([
    *HIGH, LEAST_CHIP, POWER, STABILITY, FEED, CUTTING_SPEED, SPINDLE_SPEED,
])  # fmt: skip
"""Of several limits that a row is at, the first is told: at the end of F no S makes it faster."""


def shares(problem: "Problem", feeds: Floats, speeds: Floats) -> Floats:
    """Value over limit of each row, limit over value of what has a least one [1].

    Parameters
    ----------
    problem : Problem
        Of M rows.
    feeds, speeds : ndarray, shape (M,)
        F and S in the units of ``Moves``.

    Returns
    -------
    ndarray, shape (12, M)
        In the order of ``CONSTRAINTS``; 0 where nothing limits.  F and S outside of their ranges
        on either side are above 1.
    """
    out = np.zeros((len(CONSTRAINTS), len(problem)))
    cuts, ranges = problem.cuts, problem.ranges
    turns = problem.turns(speeds)
    f_z = np.where(cuts, problem.feed_per_tooth(feeds, speeds), 0.0)
    out[list(HIGH)] = _over(f_z, problem.bounds.most)
    out[LEAST_CHIP] = np.where(cuts, _over(problem.bounds.least, f_z), 0.0)
    _fill_drive(out, problem, f_z, turns)
    if problem.chatter is not None:
        kept = 1.0 + problem.limits.margins.stability
        out[STABILITY] = np.nan_to_num(_over(kept, 1.0 + problem.chatter.margins(turns)), nan=0.0)
    surface = _outside(turns, ranges.surface_low, ranges.surface_high)
    out[CUTTING_SPEED] = np.where(cuts, surface, 0.0)
    machine = _outside(turns, ranges.speed_low, ranges.speed_high)
    out[SPINDLE_SPEED] = np.where(ranges.counted & (machine > surface), machine, 0.0)
    own = feeds_per_minute(problem.cut, feeds, turns)
    judged = np.isfinite(ranges.feed_high)
    out[FEED] = np.where(judged, _outside(own, ranges.feed_low, ranges.feed_high), 0.0)
    return out


def nearest(found: Floats) -> Rows:
    """Which of ``CONSTRAINTS`` each row is at, -1 where none; shape (M,) of (12, M) shares."""
    at = found[ORDER] >= AT
    return np.where(at.any(axis=0), ORDER[at.argmax(axis=0)], -1)


def _fill_drive(out: Floats, problem: "Problem", f_z: Floats, turns: Floats) -> None:
    """Power asked over power allowed, as torque below the base speed."""
    drive = problem.basis.drive
    if drive is None:
        return
    torque = at_hardest_station(problem.cut, problem.bounds.torque, f_z)
    asked = cutting_power(torque, turns / 60) + no_load_power(turns / 60, drive)
    allowed = allowed_power(turns, drive, problem.limits) * drive.efficiency
    used = np.where(problem.cuts & (turns > 0), _over(asked, allowed), 0.0)
    slow = turns / 60 < drive.base_speed
    out[TORQUE] = np.maximum(out[TORQUE], np.where(slow, used, 0.0))
    out[POWER] = np.where(slow, 0.0, used)


def _outside(value: Floats, low: Floats, high: Floats) -> Floats:
    """The greater of low / value and value / high."""
    return np.maximum(_over(low, value), _over(value, high))


def _over(value: Floats | float, limit: Floats) -> Floats:
    shape = np.broadcast_shapes(np.shape(value), limit.shape)
    above = np.where(np.broadcast_to(value, shape) > 0, np.inf, 0.0)
    divided: Floats = np.divide(value, limit, out=above, where=limit > 0)
    return divided
