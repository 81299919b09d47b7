"""What a spindle's load is when it turns without cutting, learnt from the machine's own seconds.

At one speed the load of a spindle that cuts nothing is the lowest that it ever shows (friction and
iron losses), so the lower fifth of the loads at a speed is its no-load level, and the scatter
below that level is its noise.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.signals.cleaning.series import Bools, Floats
from pipeline.signals.cleaning.settings import CleanSettings

LEVEL = 0.2
"""Quantile of the load at one speed that stands for no load."""

SPEEDS_PER_OCTAVE = 4
ENOUGH_S = 30
"""Seconds at a speed below which its no-load level is taken from all speeds together."""


@dataclass(frozen=True, kw_only=True)
class NoLoad:
    """No-load level and limit of a spindle.

    ``limit`` [PERCENT] for each class of speed, shape (K,), and for speeds hardly seen.
    """

    limit: Floats
    elsewhere: float

    def cutting(self, speed: Floats, load: Floats) -> Bools:
        """Whether the load [PERCENT] is above no-load at the speed [rev/min], shape (T,)."""
        place = np.clip(_speed_class(speed), 0, len(self.limit) - 1)
        limit = np.where(np.isnan(self.limit[place]), self.elsewhere, self.limit[place])
        return np.asarray(load > limit)


def _speed_class(speed: Floats) -> np.ndarray:
    rounded = np.round(np.log2(np.maximum(np.abs(np.nan_to_num(speed)), 1.0)) * SPEEDS_PER_OCTAVE)
    return np.asarray(rounded.astype(int))


def no_load(speed: Floats, load: Floats, settings: CleanSettings) -> NoLoad:
    """Learn the no-load limit of a spindle.

    Parameters
    ----------
    speed : array of float64, shape (T,)
        Speed [REVOLUTION/MINUTE] in seconds in which it was steady; NaN rows are left out.
    load : array of float64, shape (T,)
        Load [PERCENT].
    settings : CleanSettings
        ``turning_rpm``, ``load_margin``, ``load_spreads``.
    """
    good = (np.abs(speed) > settings.turning_rpm) & ~np.isnan(load)
    classes, loads = _speed_class(speed[good]), np.abs(load[good])
    limit = np.full(int(classes.max(initial=0)) + 1, np.nan)
    for k in np.unique(classes):
        chosen = loads[classes == k]
        if len(chosen) >= ENOUGH_S:
            limit[k] = _limit(chosen, settings)
    return NoLoad(limit=limit, elsewhere=_limit(loads, settings) if len(loads) else np.inf)


def _limit(load: Floats, settings: CleanSettings) -> float:
    level = float(np.quantile(load, LEVEL))
    below = level - load[load <= level]
    spread = 1.4826 * float(np.median(below))  # the normal law's sigma from half its scatter
    return level + max(settings.load_margin, settings.load_spreads * spread)
