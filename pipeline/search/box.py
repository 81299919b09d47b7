"""Box that is searched, seen as the unit cube, and the population that a search begins with.

In the cube every parameter spans 0 to 1, so that one width of step suits parameters of any unit.  A
parameter that spans orders of magnitude is spread evenly over its logarithm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Bools, Floats


@dataclass(frozen=True)
class Box:
    """Bounds of D parameters.

    Parameters
    ----------
    low, high : ndarray, shape (D,)
        Least and greatest values, in the parameters' units; the same where one is held.
    log : ndarray of bool, shape (D,)
        Which are searched on a logarithmic scale.
    """

    low: Floats
    high: Floats
    log: Bools

    @staticmethod
    def of(low: ArrayLike, high: ArrayLike, log: ArrayLike | None = None) -> "Box":
        """Bounds from anything like an array; ``log`` as one answer for all, or one for each.

        Raises
        ------
        ValueError
            When the bounds are no box, or a logarithmic one holds zero.
        """
        low, high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
        if low.ndim != 1 or low.shape != high.shape or len(low) == 0:
            raise ValueError(
                f"search bounds of shapes {low.shape} and {high.shape} are no box: "
                "give low and high as two lists of the same length, one entry a parameter"
            )
        scale = np.array(False if log is None else log, dtype=bool)
        if scale.shape not in ((), low.shape):
            raise ValueError(
                f"search scale has shape {scale.shape}: give log once, or for each of the "
                f"{len(low)} parameters"
            )
        for k, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
            if not (np.isfinite(a) and np.isfinite(b) and a <= b):
                raise ValueError(
                    f"search bounds of parameter {k} are {a} to {b}: give finite ones, "
                    "the lower first"
                )
        logs = np.broadcast_to(scale, low.shape).copy()
        if (logs & (low <= 0)).any():
            k = int(np.argmax(logs & (low <= 0)))
            raise ValueError(
                f"search bounds of parameter {k} begin at {low[k]}: a logarithmic scale needs a "
                "positive lower bound"
            )
        return Box(low, high, logs)

    def __len__(self) -> int:
        """Number of parameters D."""
        return len(self.low)

    def place(self, unit: Floats) -> Floats:
        """Values at points of the unit cube, shape (P, D); never outside the bounds."""
        x = self.low + unit * (self.high - self.low)
        if self.log.any():
            ratio = np.log(self.high[self.log] / self.low[self.log])
            x[:, self.log] = self.low[self.log] * np.exp(unit[:, self.log] * ratio)
        inside: Floats = np.minimum(np.maximum(x, self.low, out=x), self.high, out=x)
        return inside

    def unit(self, x: ArrayLike) -> Floats:
        """Points of the unit cube at values of shape (K, D); 0.5 for a parameter that is held.

        Raises
        ------
        ValueError
            When a value lies outside the bounds.
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
        width = self.high - self.low
        unit = (values - self.low) / np.where(width > 0, width, 1.0)
        if self.log.any():
            low = self.low[self.log]
            ratio = np.log(self.high[self.log] / low)
            unit[:, self.log] = np.log(values[:, self.log] / low) / np.where(ratio > 0, ratio, 1.0)
        unit[:, width == 0] = 0.5
        return np.clip(unit, 0.0, 1.0)


def first_population(
    box: Box, many: int, start: ArrayLike | None, rng: np.random.Generator, *, setting: str
) -> Floats:
    """``start``, then a Latin hypercube, in the unit cube; shape (many, D).

    Parameters
    ----------
    box : Box
        Bounds.
    many : int
        Individuals.
    start : array_like, shape (K, D), optional
        Those that are given, in the parameters' units.
    rng : numpy.random.Generator
        Random numbers.
    setting : str
        Name under which the user set ``many``, for the message.

    Raises
    ------
    ValueError
        When there are more of ``start`` than places, or one lies outside the box.
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
