"""Box of the parameters, seen as the unit cube, and the first population of a search.

A logarithmic parameter is spread evenly over its logarithm; whole numbers have equal shares of
their axis, the two bounds among them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.schema.arrays import Bools, Floats

Sides = NDArray[np.int8]
"""Bound that each parameter is at: -1 the lower, 1 the upper, 0 none."""

NEAR = 1e-3
"""Share of the axis from a bound within which a parameter counts as at the bound [1]."""


@dataclass(frozen=True)
class Box:
    """Bounds of D parameters."""

    low: Floats
    high: Floats
    """Least and greatest values, in the parameters' units; the same where one is held;
    shape (D,)."""
    log: Bools
    """Whether each parameter is searched on a logarithmic scale; shape (D,)."""
    integer: Bools
    """Whether each is a whole number, with the same share of its axis, 1 / (high - low + 1); on a
    logarithmic scale the number k has the share of k - 1/2 to k + 1/2; shape (D,)."""

    @staticmethod
    def of(
        low: ArrayLike,
        high: ArrayLike,
        log: ArrayLike | None = None,
        integer: ArrayLike | None = None,
    ) -> "Box":
        """Bounds from anything like an array.

        ``log`` and ``integer`` are one answer for all parameters, or one for each.  Raises
        ValueError when the bounds are no box, a logarithmic one holds zero, or one of whole numbers
        is none.
        """
        low, high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
        if low.ndim != 1 or low.shape != high.shape or len(low) == 0:
            raise ValueError(
                f"search bounds of shapes {low.shape} and {high.shape} are no box: "
                "give low and high as two lists of the same length, one entry a parameter"
            )
        logs = _each(log, low.shape, "log", "scale")
        whole = _each(integer, low.shape, "integer", "kind of number")
        for k, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
            if not (np.isfinite(a) and np.isfinite(b) and a <= b):
                raise ValueError(
                    f"search bounds of parameter {k} are {a} to {b}: give finite ones, "
                    "the lower first"
                )
        if (logs & (low <= 0)).any():
            k = int(np.argmax(logs & (low <= 0)))
            raise ValueError(
                f"search bounds of parameter {k} begin at {low[k]}: a logarithmic scale needs a "
                "positive lower bound"
            )
        broken = whole & ((low != np.floor(low)) | (high != np.floor(high)))
        if broken.any():
            k = int(np.argmax(broken))
            raise ValueError(
                f"search bounds of parameter {k} are {low[k]} to {high[k]}: "
                "give whole numbers as bounds of an integer"
            )
        return Box(low, high, logs, whole)

    def __len__(self) -> int:
        """Number of parameters D."""
        return len(self.low)

    @cached_property
    def _axes(self) -> tuple[Floats, Floats]:
        """Values at 0 of each axis, and the width; whole numbers reach half a step further."""
        half = np.where(self.integer, 0.5, 0.0)
        return self.low - half, (self.high + half) - (self.low - half)

    @cached_property
    def _decades(self) -> tuple[Floats, Floats] | None:
        """Values at 0 of the logarithmic axes and the logarithm of the ratio that they span."""
        if not self.log.any():
            return None
        first, width = (axis[self.log] for axis in self._axes)
        high = np.where(self.integer[self.log], first + width, self.high[self.log])
        return first, np.log(high / first)

    @cached_property
    def _some_whole(self) -> bool:
        return bool(self.integer.any())

    def place(self, unit: Floats) -> Floats:
        """Values at points of the unit cube, shape (P, D); never outside the bounds."""
        first, width = self._axes
        x = first + unit * width
        if self._decades is not None:
            low, ratio = self._decades
            x[:, self.log] = low * np.exp(unit[:, self.log] * ratio)
        if self._some_whole:
            x[:, self.integer] = np.floor(x[:, self.integer] + 0.5)
        return np.minimum(np.maximum(x, self.low, out=x), self.high, out=x)

    def unit(self, x: ArrayLike) -> Floats:
        """Points of the unit cube at values of shape (K, D); 0.5 for a parameter that is held.

        A whole number lies in the middle of its share.  Raises ValueError when a value lies outside
        the bounds, or is none of its whole numbers.
        """
        values = np.atleast_2d(np.array(x, dtype=np.float64))
        if values.ndim != 2 or values.shape[1] != len(self):
            raise ValueError(
                f"start has shape {values.shape}: give one row for each individual, "
                f"{len(self)} parameters wide"
            )
        outside = ~((values >= self.low) & (values <= self.high))
        if outside.any():
            row, k = np.argwhere(outside)[0]
            raise ValueError(
                f"start individual {row} has parameter {k} = {values[row, k]} outside "
                f"{self.low[k]} to {self.high[k]}: start inside the bounds"
            )
        broken = self.integer & (values != np.floor(values))
        if broken.any():
            row, k = np.argwhere(broken)[0]
            raise ValueError(
                f"start individual {row} has parameter {k} = {values[row, k]}: "
                "start an integer at a whole number"
            )
        first, width = self._axes
        unit = (values - first) / np.where(width > 0, width, 1.0)
        if self._decades is not None:
            low, ratio = self._decades
            unit[:, self.log] = np.log(values[:, self.log] / low) / np.where(ratio > 0, ratio, 1.0)
        unit[:, self.low == self.high] = 0.5
        return np.clip(unit, 0.0, 1.0)

    def at_bounds(self, x: Floats) -> Sides:
        """Sides (D,): -1 where ``x`` is at a lower bound (within :data:`NEAR`), 1 upper, else 0."""
        unit = self.unit(x)[0]
        near = np.where(self.integer, 0.0, NEAR)
        low = np.where(self.integer, x == self.low, unit <= near)
        high = np.where(self.integer, x == self.high, unit >= 1.0 - near)
        return high.astype(np.int8) - low.astype(np.int8)


def _each(answer: ArrayLike | None, shape: tuple[int, ...], name: str, what: str) -> Bools:
    """One answer for each parameter, from one for all or one for each."""
    given = np.array(False if answer is None else answer, dtype=bool)
    if given.shape not in ((), shape):
        raise ValueError(
            f"search {what} has shape {given.shape}: give {name} once, or for each of the "
            f"{shape[0]} parameters"
        )
    return np.broadcast_to(given, shape).copy()


def first_population(
    box: Box, many: int, start: ArrayLike | None, rng: np.random.Generator, *, setting: str
) -> Floats:
    """``start``, then a Latin hypercube, in the unit cube; shape (many, D).

    ``start`` (K, D) are given individuals, in the parameters' units; ``setting`` is the name under
    which the user set ``many``, for the message.  Raises ValueError when there are more of
    ``start`` than places, or one lies outside the box.
    """
    given = np.empty((0, len(box))) if start is None else box.unit(start)
    if len(given) > many:
        raise ValueError(
            f"start has {len(given)} individuals, more than the population of {many}: "
            f"give fewer, or raise {setting}"
        )
    free = many - len(given)
    strata = rng.permuted(np.tile(np.arange(free), (len(box), 1)), axis=1).T
    return np.concatenate([given, (strata + rng.random((free, len(box)))) / max(free, 1)])
