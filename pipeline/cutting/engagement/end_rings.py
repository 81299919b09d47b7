"""Rings of a tool's end: on the way into a hole the end cuts only where material is below.

The flat part of an end, of a flat end all of it, is given at each angle by two radii between which
it lies on material.  A ring has the area of the columns that it presses on, so that torque and
removal rate are those of what is removed, and their mean distance from the axis, so that thrust is
that of the edge in the material.

The radii come from the columns that the end presses on, compiled.  A column belongs to the angle
that it lies at, but few lie in the 5 degrees of an angle where the ring is thin.  So angles are
taken together over an arc that is as long all around: the least that holds ``COLUMNS`` columns with
material about one of them, or three quarters of all where there are fewer.  A ring thinner than a
cell is then shared evenly by teeth that follow one another, while a sickle at one side stays there.
The area of the whole ring stays that of its columns, and with it torque and removal rate.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import compiled
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

    @property
    def width(self) -> Floats:
        """Greatest length of the edge that each ring has at an angle [m]; shape (P,)."""
        return (self.outer - self.inner).max(axis=1, initial=0.0).astype(np.float64)

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


COLUMNS = 48.0
"""Columns with material that tell how wide a ring is at an angle."""


@compiled
def write_ring(grid, profiles, tool, station, steps, out, n):  # type: ignore[no-untyped-def]
    """Write the ring of the open station of ``steps``, unless its end is whole.

    A flat end is as thick as the map resolves wherever its ring is.
    """
    flat = profiles.flat[tool]
    out.ring[n] = fill_ring(station.pressed, flat, grid.cell, steps, station.inner, station.outer)
    if not out.ring[n]:
        return
    lowest = 0.0
    for a in range(station.lower.shape[0]):
        lowest = max(lowest, station.lower[a])
    for a in range(station.lower.shape[0]):
        out.inner[n, a], out.outer[n, a] = station.inner[a], station.outer[a]
        there = out.outer[n, a] > out.inner[n, a]
        if profiles.many[tool] > 0:
            # what lies on the flat lies on the tip
            if there and station.lower[a] < profiles.thick[tool, 0]:
                station.depth[a] += station.lower[a]
                station.lower[a] = 0.0
        else:
            station.lower[a] = lowest if there else 0.0
            station.depth[a] = grid.cell if there else 0.0


@compiled
def fill_ring(pressed, flat, cell, steps, inner, outer):  # type: ignore[no-untyped-def]
    """Fill ``inner`` and ``outer`` of shape (F,) [m]; whether the end is not whole.

    ``pressed`` as in :class:`pipeline.cutting.engagement.sweep_workspace.SweepCounts`, added over
    ``steps``; ``flat`` is the radius of the end's flat [m].
    """
    bins, under, met = inner.shape[0], 0.0, 0.0
    for a in range(bins):
        under += pressed[0, a]
        met += pressed[1, a]
    if met == under:
        return False
    half = _half_arc(pressed[1], min(COLUMNS * steps, 0.75 * met))
    # share of the flat's area at each angle, and the middle of it in cells
    total = 0.0
    for a in range(bins):
        below, on, inverse = 0.0, 0.0, 0.0
        for place in range(a - half, a + half + 1):
            below += pressed[0, place % bins]
            on += pressed[1, place % bins]
            inverse += pressed[2, place % bins]
        outer[a] = on / below if below > 0.0 else 0.0
        inner[a] = on / inverse if on > 0.0 else 0.0
        total += outer[a]
    even = met / under * bins / total if total > 0.0 else 0.0
    for a in range(bins):
        inner[a], outer[a] = _radii(even * outer[a], inner[a] * cell, flat)
    return True


@compiled
def _half_arc(met, enough):  # type: ignore[no-untyped-def]
    """Angles to each side of a column within which there are ``enough`` on the average of them."""
    bins, half, columns, together = met.shape[0], 0, 0.0, 0.0
    for a in range(bins):
        columns += met[a]
        together += met[a] * met[a]
    while together < enough * columns and 2 * half + 3 <= bins:
        half += 1
        for a in range(bins):
            together += 2.0 * met[a] * met[(a + half) % bins]
    return half


@compiled
def _radii(share, middle, flat):  # type: ignore[no-untyped-def]
    """Inner and outer radius [m] of a share of the flat's area at an angle.

    A ring's area over its width is its middle radius, the harmonic mean of those of its columns;
    it lies within the flat.
    """
    if share <= 0.0:
        return 0.0, 0.0
    area = 0.5 * min(share, 1.0) * flat * flat
    half = 0.5 * area / middle
    if middle + half > flat:
        return sqrt(max(flat * flat - 2.0 * area, 0.0)), flat
    if middle < half:
        return 0.0, sqrt(2.0 * area)
    return middle - half, middle + half
