"""Stability margins of a cut's rows at any speed of its range."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.stability.margins import StabilityTable
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.optimisation.problem.ranges import Ranges
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks
from pipeline.twin.cut_stability import stability

Floats = NDArray[np.float64]

LEAST = 0.1
"""Slowest speed whose lobes are looked at, over the fastest: below it lobes stand close together,
and the least limit of all speeds counts.
"""


ALIKE = 0.999
"""What the slowest is at most of the fastest, so that there are two."""
NEAR = 1e-9
"""Share that a margin may be passed by and count as kept: rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chatter:
    """Lobes of a cut between two speeds [rev/min]."""

    table: StabilityTable
    low: float
    high: float

    def margins(self, turns: Floats) -> Floats:
        """Least margin of each row [1]; inf in air, NaN where it is not judged.

        Parameters
        ----------
        turns : ndarray, shape (M,) or (P, M)
            [rev/min]; those outside of the lobes count as their ends.
        """
        return self.table.margins(np.clip(turns, self.low, self.high))

    def violation(self, turns: Floats, least: float) -> Floats:
        """Sum over rows of (1 + least) / (1 + margin) - 1 where above 0; (P,) of (P, M) speeds."""
        over = (1.0 + least) / np.maximum(1.0 + self.margins(turns), NEAR) - 1.0
        total: Floats = np.where(over > NEAR, over, 0.0).sum(axis=1)  # NaN is not judged
        return total


class Lobes:
    """Lobes that are computed when they are first asked for, and kept: they take time.

    Parameters
    ----------
    cut, blocks, dynamics, ranges, free
        As :func:`chatter_of` takes them; without dynamics there are none.
    """

    def __init__(
        self, cut: Cut, blocks: CutBlocks, dynamics: TipDynamics | None, ranges: Ranges,
        free: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self._of = cut, blocks, dynamics, ranges, free

    @cached_property
    def chatter(self) -> Chatter | None:
        """None where nothing that is milled has known dynamics."""
        cut, blocks, dynamics, ranges, free = self._of
        return None if dynamics is None else chatter_of(cut, blocks, dynamics, ranges, free)


def chatter_of(
    cut: Cut, blocks: CutBlocks, dynamics: TipDynamics, ranges: Ranges, free: NDArray[np.bool_]
) -> Chatter | None:
    """Lobes over the range of speeds of rows whose S is free, and what the others turn.

    None where nothing that is milled has known dynamics.
    """
    row = blocks.row
    own, mine = cut.plan.spindle_speed[row], free[row]
    low = float(np.where(mine, ranges.speed_low[row], own).min(initial=np.inf))
    high = float(np.where(mine, ranges.speed_high[row], own).max(initial=0.0))
    if not high > 0.0:
        return None
    span = max(min(low, ALIKE * high), LEAST * high), high
    found = stability(cut, blocks, dynamics, span)
    if found is None:
        return None
    table = _deepest(found.table)
    if low < span[0]:
        table.limit[:, 0] = table.limit.min(axis=1)
    return Chatter(table=table, low=span[0], high=span[1])


def _deepest(table: StabilityTable) -> StabilityTable:
    """The same margins from the deepest station of each class in each block."""
    order = np.lexsort((-table.depth, table.kind, table.block))
    block, kind = table.block[order], table.kind[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(block) != 0) | (np.diff(kind) != 0)
    kept = order[first]
    return replace(
        table, kind=table.kind[kept], block=table.block[kept], depth=table.depth[kept]
    )  # fmt: skip
