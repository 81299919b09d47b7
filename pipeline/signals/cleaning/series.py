"""One data item's values in the order of time, as plain arrays."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Values = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class Series:
    """What one data item said.

    Parameters
    ----------
    time : array of int64, shape (T,)
        When [ns since 1970, UTC], ascending.
    value : array of float64 or object, shape (T,)
        NaN, or None for words: not known from here on.
    fresh : array of bool, shape (T,)
        Whether the value was said at that time; False for what was brought over from before.
    """

    time: Ints
    value: Values
    fresh: Bools

    @property
    def text(self) -> bool:
        """Whether the values are words."""
        return self.value.dtype == object

    @property
    def known(self) -> Bools:
        """Where there is a value, shape (T,)."""
        if self.text:
            return np.array([v is not None for v in self.value], dtype=bool)
        return np.asarray(~np.isnan(self.value.astype(float)))

    def keep(self, mask: Bools) -> "Series":
        """The rows where ``mask`` holds."""
        return Series(time=self.time[mask], value=self.value[mask], fresh=self.fresh[mask])

    def unknown_at(self, times: Ints) -> "Series":
        """The same with "not known from here on" put in at ``times`` [ns], after equal times."""
        at = np.searchsorted(self.time, times, side="right")
        hole: Any = None if self.text else np.nan
        return Series(
            time=np.insert(self.time, at, times),
            value=np.insert(self.value, at, hole),
            fresh=np.insert(self.fresh, at, False),
        )

    def before(self, end: int) -> "Series":
        """The rows before ``end`` [ns]."""
        return self.keep(self.time < end)


def empty(*, text: bool) -> Series:
    """A series without rows."""
    value = np.array([], dtype=object if text else float)
    return Series(time=np.array([], dtype=np.int64), value=value, fresh=np.array([], dtype=bool))


def joined(first: Series, second: Series) -> Series:
    """Two series in the order of time; of equal times the first comes first."""
    time = np.concatenate([first.time, second.time])
    order = np.argsort(time, kind="stable")
    value = np.concatenate([first.value, second.value])
    fresh = np.concatenate([first.fresh, second.fresh])
    return replace(first, time=time[order], value=value[order], fresh=fresh[order])
