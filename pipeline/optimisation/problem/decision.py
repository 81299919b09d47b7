"""A decision: F of each group and S of each stretch; what it makes of a part."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.problem.groups import Groups

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """One answer.

    Parameters
    ----------
    groups : Groups
        What shares an F, what an S.
    feeds : ndarray, shape (G,)
        In the units of ``Moves`` ([mm/min] or [mm/rev]).
    speeds : ndarray, shape (H,)
        [rev/min].
    """

    groups: Groups
    feeds: Floats = field(repr=False)
    speeds: Floats = field(repr=False)

    @property
    def row_feeds(self) -> Floats:
        """Shape (M,)."""
        return self.groups.row_feeds(self.feeds)

    @property
    def row_speeds(self) -> Floats:
        """Shape (M,)."""
        return self.groups.row_speeds(self.speeds)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What P decisions make of a part.

    Parameters
    ----------
    objectives : ndarray, shape (P, 4)
        Time [s], cost [currency], energy [kWh], share of tool life [1]; NaN where not known.
    violation : ndarray, shape (P,)
        Sum over rows of what passes each limit, as a share of it [1]; 0 inside all limits.
    """

    objectives: Floats
    violation: Floats
