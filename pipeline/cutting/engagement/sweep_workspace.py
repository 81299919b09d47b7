"""Workspace of the compiled sweep: grid, tool profiles, sweep counts, station accumulator."""

from collections.abc import Sequence
from math import inf, pi, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats, Ints

SLICES = 12
"""Slices into which the rounded or pointed end of a tool is divided, from the tip up."""
STEPS = 64
"""Greatest number of steps of a piece that are counted at once."""
_PARTS = 2048
FLAT, ROUND, CONE = 0, 1, 2


class Grid(NamedTuple):
    """A height map as the kernels take it; ``heights`` is what they cut.

    The shifts of :class:`pipeline.cutting.engagement.stock.HeightMap` go on for ``margin``
    cells around it: a tool at the edge meets air there, which counts as much as material.
    """

    heights: NDArray[np.float32]
    x_shifts: Floats
    y_shifts: Floats
    x0: float
    y0: float
    cell: float
    floor: float
    top: float
    margin: int


class ToolProfiles(NamedTuple):
    """Profiles of T tools, each in slices: ``many`` of the end, and one more of the cylinder above.

    ``kind`` (T,); ``radius``, ``flat``: radius of the flat part of the end; ``corner``: radius of
    the rounded part; ``cone``: height over radius of a point (T,) [m].  Of each slice ``bottom``
    (T, SLICES + 2): height above the tip at which it begins; ``thick``,
    ``across``, ``inverse`` and ``rise`` (T, SLICES + 1): its height, radius in its middle, 1 over
    that, and height over radius of the surface there.
    """

    kind: Ints
    many: Ints
    radius: Floats
    flat: Floats
    corner: Floats
    cone: Floats
    bottom: Floats
    thick: Floats
    across: Floats
    inverse: Floats
    rise: Floats


class LinearSegment(NamedTuple):
    """A straight motion in ``steps`` equal steps: all or part of a piece of the path.

    From (x, y, z) of the tip, ``length`` along (fx, fy) in the plane, rising by ``slope`` for each
    of it; ``height`` is how much it rises.  ``window``: length over which columns are counted; a
    steep motion looks beyond its end, where else there would be none.  ``mirror``: 1 for a spindle
    that turns clockwise, -1 else.  ``joined``: the same tool stood at its beginning before.
    """

    x: float
    y: float
    z: float
    fx: float
    fy: float
    length: float
    slope: float
    height: float
    window: float
    steps: int
    mirror: float
    joined: bool


class SweepCounts(NamedTuple):
    """Counts of the columns that the steps of a piece swept: by step, slice and angle.

    ``swept`` and ``met`` (STEPS, SLICES + 1, F): columns swept, and material in them within the
    slice [m]; ``volume`` (STEPS,) [m^3]; ``deepest`` (STEPS,): greatest depth of a column [m].
    ``cosines`` (F / 2 + 1,): of the limits of the angles, from 1 to below -1; ``starts``: the first
    angle in each of equal parts of them.  ``pressed`` (3, F): columns under the flat of an
    end that goes straight down, those of them with material, and of these the sum of a cell over
    the distance from the axis.
    """

    swept: Floats
    met: Floats
    volume: Floats
    deepest: Floats
    cosines: Floats
    starts: Ints
    pressed: Floats


class StationAccumulator(NamedTuple):
    """The station that steps are joined to, the counts of earlier pieces, and arrays to work in.

    ``swept`` and ``met`` (SLICES + 1, F) as in :class:`SweepCounts`, ``air`` the columns swept
    since the station last met material; ``recent_swept``, ``recent_met``: of the pieces before.
    ``depth`` and ``lower`` (F,): height engaged at each angle so far, and where it begins [m];
    ``step_depth`` and ``step_lower``: the same of one step; ``mean`` (SLICES + 1, F): to work in;
    ``cosines`` (F / 2 + 1,): of the limits of the front angles; ``scalars``: see ``SCALARS`` in
    :mod:`pipeline.cutting.engagement.sweep_stations`.  ``pressed`` (3, F) as in
    :class:`SweepCounts`; ``inner`` and ``outer`` (F,): ring of the end [m].
    """

    swept: Floats
    met: Floats
    air: Floats
    recent_swept: Floats
    recent_met: Floats
    depth: Floats
    lower: Floats
    step_depth: Floats
    step_lower: Floats
    mean: Floats
    cosines: Floats
    scalars: Floats
    pressed: Floats
    inner: Floats
    outer: Floats


class StationColumns(NamedTuple):
    """Columns of :class:`pipeline.cutting.engagement.engagement.Engagement`, to be filled.

    ``inner`` and ``outer`` hold where ``ring`` does.
    """

    piece: NDArray[np.int32]
    along: Floats
    length: Floats
    volume: Floats
    lower: NDArray[np.float32]
    upper: NDArray[np.float32]
    ring: NDArray[np.bool_]
    inner: NDArray[np.float32]
    outer: NDArray[np.float32]


def tool_profiles(tools: Sequence[Tool]) -> ToolProfiles:
    """Profiles of the tools, slice by slice."""
    rows = [_tool_profile(tool) for tool in tools]
    columns = [np.array([row[name] for row in rows]) for name in ToolProfiles._fields]
    return ToolProfiles(*columns)


def sweep_counts(bins: int) -> SweepCounts:
    """Counts at ``bins`` angles, with the tables of the angles."""
    shape = STEPS, SLICES + 1, bins
    cosines = np.cos(np.arange(bins // 2 + 1) * (2 * pi / bins))
    parts = 1 - np.arange(_PARTS) * (2 / _PARTS)
    # the last has no end: rounding may not lead beyond it
    cosines[-1] = -2.0
    starts = np.searchsorted(-cosines[1:-1], -parts, side="left")
    return SweepCounts(
        np.zeros(shape), np.zeros(shape), np.zeros(STEPS), np.zeros(STEPS), cosines, starts,
        np.zeros((3, bins)),
    )  # fmt: skip


def station_accumulator(bins: int, scalars: int) -> StationAccumulator:
    """Accumulator of one station, empty."""
    counts = [np.zeros((SLICES + 1, bins)) for _ in range(5)]
    angles = [np.zeros(bins) for _ in range(4)]
    mean, cosines = np.zeros((SLICES + 1, bins)), np.cos(np.arange(bins // 2 + 1) * (2 * pi / bins))
    ring = np.zeros((3, bins)), np.zeros(bins), np.zeros(bins)
    return StationAccumulator._make([*counts, *angles, mean, cosines, np.zeros(scalars), *ring])


def station_buffer(many: int, bins: int) -> StationColumns:
    """Columns for ``many`` stations, to be filled."""
    return StationColumns(
        np.empty(many, np.int32), np.empty(many), np.empty(many), np.empty(many),
        np.empty((many, bins), np.float32), np.empty((many, bins), np.float32),
        np.empty(many, np.bool_), np.empty((many, bins), np.float32),
        np.empty((many, bins), np.float32),
    )  # fmt: skip


def _tool_profile(tool: Tool) -> dict[str, object]:
    radius, corner = tool.radius, tool.corner_radius
    flat = radius - corner
    cone = 1 / tan(tool.point_angle / 2) if tool.kind == "drill" else 0.0
    # a drill of 180 degrees is flat
    kind = CONE if cone > 1e-9 else ROUND if corner else FLAT
    many = 0 if kind == FLAT else SLICES
    edges = np.arange(many + 1) / max(many, 1)
    middles = (edges[:-1] + edges[1:]) / 2
    bottom, across, rise = (np.full(SLICES + size, inf) for size in (2, 1, 1))
    bottom[0], across[many], thick = 0.0, radius, np.full(SLICES + 1, inf)
    if kind == ROUND:
        bottom[: many + 1] = corner * (1 - np.cos(edges * pi / 2))
        across[:many] = flat + corner * np.sin(middles * pi / 2)
        rise[:many] = np.tan(middles * pi / 2)
    elif kind == CONE:
        bottom[: many + 1] = radius * cone * edges
        across[:many] = radius * middles
        rise[:many] = cone
    thick[:many] = np.diff(bottom[: many + 1])
    return {
        "kind": kind, "many": many, "radius": radius, "flat": flat if kind != CONE else 0.0,
        "corner": corner, "cone": cone, "bottom": bottom, "thick": thick,
        "across": across, "inverse": 1 / across, "rise": rise,
    }  # fmt: skip
