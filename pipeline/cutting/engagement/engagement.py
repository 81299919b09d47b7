"""Tool engagement along a path: stations in the material, with the engaged part of the tool.

Angles are those of milling (Altintas 2012, fig. 2.20): phi = 0 where a tooth stands a quarter
turn before the direction of feed and moves into it, so that the chip of a tooth is f_z sin(phi)
thick, phi = 0 is where up-milling begins and phi = pi where down-milling ends.  Seen along the
direction of feed with a spindle that turns clockwise (M3), phi = 0 is to the left and phi grows
clockwise; for M4 left and right change places.  Immersions are the part of an engagement that
decides on chatter: one arc and one height for each station that mills.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.end_rings import EndRings, whole_ends
from pipeline.cutting.engagement.stock import HeightMap
from pipeline.cutting.engagement.sweep_stations import PIECE, SCALARS, STATE, sweep_path
from pipeline.cutting.engagement.sweep_workspace import (
    STEPS,
    Grid,
    StationColumns,
    station_accumulator,
    station_buffer,
    sweep_counts,
    tool_profiles,
)
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Bools, Floats, Ints, Singles

Indices = NDArray[np.int32]

_ROWS = 64 * STEPS
"""Stations that the buffer of the compiled sweep holds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolPath:
    """Q straight pieces (chords of arcs) in the order of cutting, tool axis z; for any F and S."""

    start: Floats
    end: Floats
    """End position of the tool tip [m]; shape (Q, 3)."""
    block: Indices
    """Block of the program that each belongs to, never falling; shape (Q,)."""
    tool: Indices
    """Index into the tools that go with the path; shape (Q,)."""
    feed: Bools
    """Whether it moves at feed; False for rapids; shape (Q,)."""
    direction: NDArray[np.int8]
    """Spindle direction: 1 clockwise from above (M3), -1 anticlockwise (M4), 0 at rest; (Q,)."""

    def __post_init__(self) -> None:
        for item in fields(self):
            if len(getattr(self, item.name)) != len(self.start):
                raise ValueError(
                    f"tool path: {item.name} has {len(getattr(self, item.name))} rows, start has "
                    f"{len(self.start)}: each piece has one"
                )
        if not (np.isfinite(self.start).all() and np.isfinite(self.end).all()):
            raise ValueError("tool path: a position is not finite")

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> Floats:
        """Length of each piece [m]; shape (Q,)."""
        return np.linalg.norm(self.end - self.start, axis=1)


def engaged_arc(depth: NDArray[np.floating]) -> tuple[Floats, Floats]:
    """Entry phi_st, 0 to 2 pi, and exit phi_ex of the longest engaged arc [rad]; (N,) each.

    ``depth`` (N, F) is the height engaged at angles (k + 1/2) 2 pi / F, mean over the angle's width
    [m]; the entry is NaN where nothing is engaged. The first and the last angle of an arc are
    engaged in part: by as much of their width, seen along the feed, as their depth is of their
    neighbour's.

    Examples
    --------
    >>> begin, end = engaged_arc(np.array([[2.0, 2.0, 1.0, 0, 0, 0, 0, 0]]))
    >>> np.degrees(end - begin).round(2)
    array([110.7])
    """
    many, bins = depth.shape
    on = depth > 0
    # longest run of engaged angles, over two turns so that it may pass phi = 0
    run, longest, last = (np.zeros(many, np.int64) for _ in range(3))
    for k in range(2 * bins):
        run = np.where(on[:, k % bins], run + 1, 0)
        better = np.minimum(run, bins) > longest
        longest[better], last[better] = run[better], k
    begin, end = arc_ends(depth, last - longest + 1, last)
    end += np.where(end < begin, 2 * np.pi, 0.0)
    none, full = longest == 0, longest == bins
    entry = np.where(none, np.nan, np.where(full, 0.0, begin))
    return entry, np.where(none, np.nan, np.where(full, 2 * np.pi, end))


def arc_ends(depth: NDArray[np.floating], first: Ints, last: Ints) -> tuple[Floats, Floats]:
    """Begin and end of arcs from angle ``first`` to ``last``, 0 to 2 pi [rad].

    Parameters as in :func:`engaged_arc`, which says how; ``first`` and ``last`` have shape (N,).
    """
    bins, row = depth.shape[1], np.arange(len(depth))
    inner = (last > first).astype(np.int64)
    begin = _within(first % bins, _missing(depth, row, first, first + inner), bins)
    end = _within(last % bins, 1 - _missing(depth, row, last, last - inner), bins)
    return begin, end


def _within(at: Ints, share: Floats, bins: int) -> Floats:
    """Angle within the width of angle ``at`` with a share of it, seen along the feed, before it."""
    width = 2 * np.pi / bins
    begin, end = np.cos(at * width), np.cos((at + 1) * width)
    front = np.arccos(np.clip(begin + share * (end - begin), -1, 1))
    return np.where(at * width < np.pi, front, 2 * np.pi - front)


def _missing(depth: NDArray[np.floating], row: Ints, at: Ints, beside: Ints) -> Floats:
    """Part of an angle's width that is not engaged [1]."""
    bins = depth.shape[1]
    here, there = depth[row, at % bins], depth[row, beside % bins]
    share = np.divide(here, there, out=np.ones(len(row)), where=there > 0)
    return 1 - np.minimum(share, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Engagement:
    """N stations along a tool path, each with the part of the tool that is in the material there.

    A station stands for a stretch of a piece over which the engagement is the same within the
    resolution: its limits move by less than a cell, its depth by less than 5 %.  Pieces without
    material have no station.  At an angle that is engaged only in part, or over part of the
    stretch, ``upper - lower`` is the mean; it is the height engaged altogether where material lies
    in several layers.

    The angles are counted from the direction of feed; a plunge has none and takes +x.  In a plunge
    the sides of a tool cut nothing, only its end is given: a flat end, which has no height, as
    thick as the map resolves, and where it goes down over a hole the ring of it that cuts.
    Material that a flat end presses down in a ramp is in ``volume`` alone.

    Engagement over less than a cell across the feed is right on the average of a stretch of several
    cells; a block shorter than that may by chance have no station.
    """

    piece: Indices
    block: Indices
    tool: Indices
    """Piece of the path, block of the program, index of the tool; shape (N,)."""
    along: Floats
    """Begin of the station on its piece [m]; shape (N,)."""
    length: Floats
    """Length of the stretch that it stands for [m]; shape (N,)."""
    lower: Singles
    upper: Singles
    """Part of the tool's envelope in the material at each of F angles, as heights above the tip
    [m]; nothing where ``upper <= lower``.  Angle k is (k + 1/2) 2 pi / F; shape (N, F)."""
    volume: Floats
    """Material removed [m^3]; shape (N,)."""
    slope: Floats
    """dz / ds of the motion: -1 straight down (a plunge), 0 in the plane; shape (N,)."""
    feed: Bools
    """False where a rapid went through material; shape (N,)."""
    blocks: int
    """Blocks of the program, B; those without a station cut air."""
    resolution: float
    """Resolution of the height map [m]."""
    rings: EndRings = field(default_factory=whole_ends)
    """Rings of the stations whose end goes down over less than its whole flat."""

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def angles(self) -> Floats:
        """Angles at which ``lower`` and ``upper`` are given [rad]; shape (F,)."""
        many = self.upper.shape[1]
        return (np.arange(many) + 0.5) * (2 * np.pi / many)

    @property
    def axial_depth(self) -> Floats:
        """a_p: greatest height in the material above the tip [m]; shape (N,)."""
        depth: Floats = np.where(self.upper > self.lower, self.upper, 0.0).max(axis=1, initial=0.0)
        return depth.astype(np.float64)

    @property
    def plunge(self) -> Bools:
        """Whether the tool goes straight down or up; shape (N,)."""
        return np.asarray(np.abs(self.slope) > 1 - 1e-9)

    @property
    def rapid_depth(self) -> Floats:
        """Depth of the material that rapids go through in each block [m]; shape (B,).

        Straight down it is the path length in the material, since the end of a tool has no height;
        contact with less than two columns, or less deep than the map resolves, is none.
        """
        depth, down = np.zeros(self.blocks), self.plunge
        wide = self.volume > 2 * self.resolution**2 * self.length
        across, into = ~self.feed & ~down, ~self.feed & down & wide
        np.maximum.at(depth, self.block[across], self.axial_depth[across])
        np.add.at(depth, self.block[into], self.length[into])
        return np.where(depth > self.resolution * (1 + 1e-6), depth, 0.0)


def engage(
    path: ToolPath, tools: Sequence[Tool], stock: HeightMap, *, bins: int = 72
) -> tuple[Engagement, HeightMap]:
    """Engagement along a path, and the stock that it leaves.

    The path is in the stock's frame, ``tools`` are those that ``path.tool`` counts; the stock is
    not changed. ``bins`` is the even number of angles F at which the engagement is given.
    ValueError when the path names a tool that is not there.
    """
    if len(path) and not (path.tool.min() >= 0 and path.tool.max() < len(tools)):
        wrong = path.tool[(path.tool < 0) | (path.tool >= len(tools))][0]
        raise ValueError(f"engagement: the path names tool {wrong} of {len(tools)} that there are")
    columns, left = _sweep(path, tools, stock, bins)
    piece, rise = columns.piece, path.end[:, 2] - path.start[:, 2]
    engagement = Engagement(
        piece=piece, block=path.block[piece], tool=path.tool[piece], along=columns.along,
        length=columns.length, lower=columns.lower, upper=columns.upper, volume=columns.volume,
        slope=rise[piece] / path.length[piece], feed=path.feed[piece],
        blocks=int(path.block[-1]) + 1 if len(path) else 0, resolution=stock.cell,
        rings=EndRings(
            station=np.flatnonzero(columns.ring), inner=columns.inner, outer=columns.outer
        ),
    )  # fmt: skip
    return engagement, left


def _sweep(
    path: ToolPath, tools: Sequence[Tool], stock: HeightMap, bins: int
) -> tuple[StationColumns, HeightMap]:
    """Stations of a path at ``bins`` angles, and the stock that it leaves."""
    grid, profiles, counts = grid_of(stock, tools), tool_profiles(tools), sweep_counts(bins)
    station, out = station_accumulator(bins, SCALARS), station_buffer(_ROWS, bins)
    state = np.zeros(STATE, np.int64)
    # one layout, one compiled kernel
    start, end = (np.ascontiguousarray(ends, np.float64) for ends in (path.start, path.end))
    tool = np.ascontiguousarray(path.tool, np.int32)
    direction = np.ascontiguousarray(path.direction, np.int8)
    parts = []
    while True:
        many = sweep_path(
            start, end, tool, direction, profiles, grid, counts, station, out, state, bins,
        )  # fmt: skip
        ringed = out.ring[:many]
        rings = [radii[:many][ringed] for radii in (out.inner, out.outer)]
        parts.append([*(column[:many].copy() for column in out[:-2]), *rings])
        if state[PIECE] == len(path):
            break
    whole = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    return StationColumns(*whole), replace(stock, heights=grid.heights)


def grid_of(stock: HeightMap, tools: Sequence[Tool]) -> Grid:
    """Copy of the map, to be cut by the tools."""
    heights = stock.heights.copy()
    floor = float(np.float32(stock.floor))
    widest = max((tool.diameter for tool in tools), default=0.0)
    margin = int(2 * widest / stock.cell) + 4
    x_shifts, y_shifts = stock.shifts(margin)
    top = float(heights.max(initial=floor))
    return Grid(heights, x_shifts, y_shifts, stock.x0, stock.y0, stock.cell, floor, top, margin)


STEEPEST = 0.7
"""|dz / ds| up to which a cut is milling; steeper ones drill, and vibrate along the axis."""


LEAST_ARC = 1e-4
"""Least arc of a station that cuts at all [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Immersions:
    """Immersions of N stations of a program: depth, and arc of a tooth in the material."""

    block: Indices
    tool: Indices
    """Block of the program, index of the tool; shape (N,)."""
    depth: Floats
    """Axial length of the edge in the material [m], above 0; shape (N,)."""
    entry: Floats
    exit: Floats
    """[rad], as in :mod:`pipeline.cutting.engagement.engagement`, 0 <= entry < exit <= pi;
    shape (N,)."""
    feed_direction: Floats
    """Angle from the machine's x [rad]; shape (N,)."""
    direction: NDArray[np.int8]
    """Direction of the spindle, 1 or -1; shape (N,)."""
    blocks: int
    """Blocks of the program, B."""
    unjudged: Bools
    """Blocks with a cut that is no milling, under a turning spindle: plunges, rapids; (B,)."""
    lowest: Floats | None = None
    highest: Floats | None = None
    """Least and greatest height above the tip of the edge in the material [m]; from the tip to
    ``depth`` where they are not given; shape (N,)."""


def immersions(path: ToolPath, engagement: Engagement) -> Immersions:
    """Immersions of a program's engagement: its part that decides on chatter.

    Where teeth are in the material at several arcs or heights the least arc and height that hold
    all of them count, as far as the chip has a thickness (0 to pi).  An arc ends within a bin of
    the engagement's angles as in :func:`pipeline.cutting.engagement.engagement.engaged_arc`.
    """
    # angles at which a chip is cut
    angles = engagement.angles
    height = (engagement.upper - engagement.lower).astype(np.float64)
    engaged = (height > 0.0) & (np.sin(angles) > 0.0)
    cuts = engaged.any(axis=1)
    # stations that mill with a spindle that turns
    move = (path.end - path.start)[engagement.piece]
    turning = path.direction[engagement.piece]
    level = (np.abs(engagement.slope) <= STEEPEST) & (np.hypot(move[:, 0], move[:, 1]) > 0.0)
    kept = cuts & level & engagement.feed & (turning != 0)
    # arc of each, and blocks with stations that do not mill
    first, last = engaged.argmax(axis=1), len(angles) - 1 - engaged[:, ::-1].argmax(axis=1)
    entry, exit = arc_ends(np.where(engaged, height, 0.0)[kept], first[kept], last[kept])
    unjudged = np.zeros(engagement.blocks, dtype=np.bool_)
    unjudged[engagement.block[~kept & (height > 0.0).any(axis=1)]] = True
    return Immersions(
        block=engagement.block[kept], tool=engagement.tool[kept],
        depth=np.where(engaged, height, 0.0).max(axis=1, initial=0.0)[kept],
        entry=np.minimum(entry, pi - LEAST_ARC),
        exit=np.minimum(np.maximum(exit, entry + LEAST_ARC), pi),
        feed_direction=np.arctan2(move[:, 1], move[:, 0])[kept], direction=turning[kept],
        blocks=engagement.blocks, unjudged=unjudged,
        lowest=np.where(engaged, engagement.lower, np.inf).min(axis=1, initial=np.inf)[kept],
        highest=np.where(engaged, engagement.upper, 0.0).max(axis=1, initial=0.0)[kept],
    )  # fmt: skip
