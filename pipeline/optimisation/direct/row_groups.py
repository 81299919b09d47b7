"""Sums, greatest and common values of rows by the group that they belong to."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


class RowGroups:
    """Rows of each of U groups.

    Parameters
    ----------
    group : ndarray of intp, shape (M,)
        From 0 without gaps; -1 for rows of none.
    """

    def __init__(self, group: Rows) -> None:
        self.group = group
        order = np.argsort(group, kind="stable")
        self._order = order[np.searchsorted(group[order], 0) :]
        sorted_groups = group[self._order]
        self._first = np.flatnonzero(np.diff(sorted_groups, prepend=-1))
        self._many = np.diff(np.append(self._first, len(self._order)))

    def total(self, values: Floats) -> Floats:
        """Shape (P, U) of (P, M)."""
        return self._reduced(np.add, values)

    def greatest(self, values: Floats) -> Floats:
        """Shape (P, U) of (P, M)."""
        return self._reduced(np.maximum, values)

    def mean(self, values: Floats) -> Floats:
        """Shape (U,) of (M,)."""
        return self.total(values[None])[0] / np.maximum(self._many, 1)

    def first(self, values: Floats) -> Floats:
        """Value of the first row of each group; shape (U,) of (M,)."""
        return values[self._order[self._first]]

    def common(self, values: Floats) -> Floats:
        """Value that all rows of each group have, NaN where they differ; (U,) of (M,)."""
        most, least = self.greatest(values[None])[0], -self.greatest(-values[None])[0]
        return np.where(least == most, least, np.nan)

    def spread(self, values: Floats, other: Floats) -> Floats:
        """Shape (P, M) of (P, U); ``other`` in rows of no group."""
        if not len(self._first):
            return np.repeat(other[None], len(values), axis=0)
        return np.where(self.group >= 0, values[:, self.group], other)

    def _reduced(self, operation: np.ufunc, values: Floats) -> Floats:
        if not len(self._first):
            return np.zeros((len(values), 0))
        reduced: Floats = operation.reduceat(values[:, self._order], self._first, axis=1)
        return reduced
