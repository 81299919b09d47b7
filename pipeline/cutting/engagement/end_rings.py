"""Rings of a tool's end: on the way into a hole the end cuts only where material is below.

The flat part of an end, of a flat end all of it, is given at each angle by two radii between which
it lies on material.  A ring has the area of the columns that it presses on, so that torque and
removal rate are those of what is removed, and their mean distance from the axis, so that thrust is
that of the edge in the material.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.schema.arrays import Floats, Ints, Singles


@dataclass(frozen=True, kw_only=True, eq=False)
class EndRings:
    """Rings of P stations on the way down over less than the whole flat end, rising."""

    station: Ints
    """Rising indices of the stations; at all others the whole end counts; shape (P,)."""
    inner: Singles
    outer: Singles
    """Inner and outer radius of the part of the flat on material, at each of F angles [m]; none
    where ``outer <= inner``; shape (P, F)."""

    def __post_init__(self) -> None:
        if self.inner.shape != self.outer.shape or len(self.inner) != len(self.station):
            raise ValueError(
                f"end rings: {len(self.station)} stations have inner radii of shape "
                f"{self.inner.shape}, outer ones of {self.outer.shape}: give each one row of both"
            )
        if (np.diff(self.station) <= 0).any():
            raise ValueError("end rings: the stations must rise")

    @property
    def width(self) -> Floats:
        """Greatest length of the edge that each ring has at an angle [m]; shape (P,)."""
        width: Floats = (self.outer - self.inner).max(axis=1, initial=0.0).astype(np.float64)
        return width

    @property
    def around_the_axis(self) -> NDArray[np.bool_]:
        """Whether nothing is below the axis, as in a hole that is bored or reamed; shape (P,)."""
        there = self.outer > self.inner
        return np.asarray((~there | (self.inner > 0)).all(axis=1) & there.any(axis=1))

    def of(self, station: int) -> tuple[Floats, Floats] | None:
        """Inner and outer radii of a station [m], each of shape (F,); None where it is whole."""
        row = int(np.searchsorted(self.station, station))
        if row == len(self.station) or self.station[row] != station:
            return None
        return self.inner[row].astype(np.float64), self.outer[row].astype(np.float64)

    def rows(self, stations: int) -> Ints:
        """Ring of each of N stations, counted from 1; 0 where it is whole.  Shape (N,)."""
        rows = np.zeros(stations, dtype=np.int64)
        rows[self.station] = 1 + np.arange(len(self.station))
        return rows


def whole_ends(bins: int = 0) -> EndRings:
    """No rings at ``bins`` angles: every end counts as a whole."""
    none = np.zeros((0, bins), np.float32)
    return EndRings(station=np.zeros(0, np.int64), inner=none, outer=none)


def whole_ring(bins: int) -> tuple[Floats, Floats]:
    """Radii of an end that lies on material everywhere [m]; each of shape (F,)."""
    return np.zeros(bins), np.full(bins, np.inf)
