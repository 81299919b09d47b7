"""Rapids whose axes each go as fast as they can (the dog-leg)."""

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import METRE, RADIAN
from pipeline.machine.control import Floats
from pipeline.machine.corners import Limit
from pipeline.machine.path import Path
from pipeline.machine.profiles import rest_to_rest

UNITS = np.array([METRE] * 3 + [RADIAN] * 3)
"""Factors of the axes to SI."""


def distances(path: Path, rows: npt.NDArray[np.intp]) -> Floats:
    """How far each axis goes in rows [m, rad]; shape (N, 6)."""
    start = np.where((rows > 0)[:, np.newaxis], path.moves.end[rows - 1], path.moves.origin)
    gone: Floats = (path.moves.end[rows] - start) * UNITS
    return gone


def independent_time(path: Path, rows: npt.NDArray[np.intp], share: Floats) -> Floats:
    """Time of the axis that takes longest, from standstill to standstill [s]; shape (P, N).

    Parameters
    ----------
    path : Path
        Its moves and its control's limits.
    rows : (N,) array
        Of the path.
    share : (P, N) array
        Override of the speeds [1].
    """
    here = path.control.has_axis
    size = np.abs(distances(path, rows))[:, here]
    limits = path.control.limits[:, here]
    speed = limits[Limit.RAPID_SPEED] * share[..., np.newaxis]
    jerk = limits[Limit.JERK] if path.control.profile == "s_curve" else np.inf
    time: Floats = rest_to_rest(size, speed, limits[Limit.RAPID_ACCELERATION], jerk).max(axis=-1)
    return time
