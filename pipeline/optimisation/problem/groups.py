"""Groups of blocks that share an F or an S: what a search decides, and what rows make of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class Groups:
    """M rows in G groups of one F and H stretches of one S.

    Parameters
    ----------
    feed : ndarray of intp, shape (M,)
        Group of each row, -1 for rows that keep their F.
    speed : ndarray of intp, shape (M,)
        Stretch of each row, -1 for rows that keep their S.
    own_feed, own_speed : ndarray, shape (M,)
        What the rows have as programmed, in the units of ``Moves``.
    """

    feed: Rows = field(repr=False)
    speed: Rows = field(repr=False)
    own_feed: Floats = field(repr=False)
    own_speed: Floats = field(repr=False)

    @property
    def feeds(self) -> int:
        """G."""
        return int(self.feed.max(initial=-1)) + 1

    @property
    def speeds(self) -> int:
        """H."""
        return int(self.speed.max(initial=-1)) + 1

    def row_feeds(self, feeds: ArrayLike) -> Floats:
        """F of each row, shape (M,) or (P, M), of those of groups, (G,) or (P, G)."""
        return _spread(feeds, self.feed, self.own_feed)

    def row_speeds(self, speeds: ArrayLike) -> Floats:
        """S of each row, shape (M,) or (P, M), of those of stretches, (H,) or (P, H)."""
        return _spread(speeds, self.speed, self.own_speed)


def _spread(values: ArrayLike, group: Rows, own: Floats) -> Floats:
    given = np.asarray(values, dtype=np.float64)
    padded = np.concatenate([given, np.zeros((*given.shape[:-1], 1))], axis=-1)
    return np.where(group >= 0, padded[..., group], own)
