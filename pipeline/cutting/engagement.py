"""Engagement: where along its path the tool is in the material, and with which part of it.

Angles are those of milling (Altintas 2012, fig. 2.20): phi = 0 where a tooth stands a quarter
turn before the direction of feed and moves into it, so that the chip of a tooth is f_z sin(phi)
thick, phi = 0 is where up-milling begins and phi = pi where down-milling ends.  Seen along the
direction of feed with a spindle that turns clockwise (M3), phi = 0 is to the left and phi grows
clockwise; for M4 left and right change places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement_arc import engaged_arc
from pipeline.cutting.height_map import HeightMap
from pipeline.cutting.tool import Tool
from pipeline.cutting.tool_path import ToolPath

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]


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
    thick as the map resolves.  What a flat end presses down in a ramp is in ``volume`` alone.

    What is engaged over less than a cell across the feed is right on the average of a stretch of
    several cells; a block shorter than that may by chance have no station.

    Parameters
    ----------
    piece, block, tool : ndarray of int32, shape (N,)
        Piece of the path, block of the program, index of the tool.
    along : ndarray, shape (N,)
        Where on its piece the station begins [m].
    length : ndarray, shape (N,)
        Of the stretch that it stands for [m].
    lower, upper : ndarray of float32, shape (N, F)
        Part of the tool's envelope in the material at each of F angles, as heights above the tip
        [m]; nothing where ``upper <= lower``.  Angle k is (k + 1/2) 2 pi / F.
    volume : ndarray, shape (N,)
        Material removed [m^3].
    slope : ndarray, shape (N,)
        dz / ds of the motion: -1 straight down (a plunge), 0 in the plane.
    feed : ndarray of bool, shape (N,)
        False where a rapid went through material.
    blocks : int
        Blocks of the program, B; those without a station cut air.
    resolution : float
        Of the height map [m].
    """

    piece: Indices
    block: Indices
    tool: Indices
    along: Floats
    length: Floats
    lower: Singles
    upper: Singles
    volume: Floats
    slope: Floats
    feed: Flags
    blocks: int
    resolution: float

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def angles(self) -> Floats:
        """Where ``lower`` and ``upper`` are given [rad]; shape (F,)."""
        many = self.upper.shape[1]
        return (np.arange(many) + 0.5) * (2 * np.pi / many)

    @property
    def axial_depth(self) -> Floats:
        """a_p: greatest height in the material above the tip [m]; shape (N,)."""
        depth: Floats = np.where(self.upper > self.lower, self.upper, 0.0).max(axis=1, initial=0.0)
        return depth.astype(np.float64)

    @property
    def plunge(self) -> Flags:
        """Whether the tool goes straight down or up; shape (N,)."""
        plunge: Flags = np.abs(self.slope) > 1 - 1e-9
        return plunge

    @property
    def entry(self) -> Floats:
        """phi_st: where the longest engaged arc begins [rad], NaN without one; shape (N,)."""
        return engaged_arc(self.upper - self.lower)[0]

    @property
    def exit(self) -> Floats:
        """phi_ex: where the longest engaged arc ends [rad], above ``entry``; shape (N,)."""
        return engaged_arc(self.upper - self.lower)[1]

    def radial_depth(self, tools: Sequence[Tool]) -> Floats:
        """a_e: width across the feed of the longest engaged arc, at full diameter [m]; shape (N,).

        D (cos phi_st - cos phi_ex) / 2; 0 without an arc.
        """
        radius = np.array([tool.radius for tool in tools])[self.tool]
        begin, end = engaged_arc(self.upper - self.lower)
        # what is engaged behind the tool is as wide as the tool
        width = np.cos(begin) - np.cos(np.minimum(end, np.pi))
        return np.nan_to_num(radius * width)

    @property
    def block_volume(self) -> Floats:
        """Material that each block removes [m^3]; shape (B,)."""
        volume: Floats = np.bincount(self.block, self.volume, self.blocks).astype(float)
        return volume

    def block_air(self, path: ToolPath) -> Floats:
        """Way that each block goes at feed without material [m]; shape (B,)."""
        way = np.bincount(path.block, path.length * path.feed, self.blocks)
        cut = np.bincount(self.block, self.length * self.feed, self.blocks)
        # lengths are added in another order
        return np.maximum(way - cut, 0.0)


def engage(
    path: ToolPath, tools: Sequence[Tool], stock: HeightMap, *, bins: int = 72
) -> tuple[Engagement, HeightMap]:
    """Engagement along a path, and the stock that it leaves.

    Parameters
    ----------
    path : ToolPath
        In the stock's frame.
    tools : sequence of Tool
        Those that ``path.tool`` counts.
    stock : HeightMap
        What the path starts from; it is not changed.
    bins : int
        Angles F at which the engagement is given: even, 8 to 720.

    Returns
    -------
    Engagement
    HeightMap
        The stock that is left.

    Raises
    ------
    ValueError
        When ``bins`` is out of its range or the path names a tool that is not there.
    """
    from pipeline.cutting.sweep import swept

    if bins % 2 or not 8 <= bins <= 720:
        raise ValueError(f"engagement: bins = {bins} must be even and from 8 to 720")
    if len(path) and not (path.tool.min() >= 0 and path.tool.max() < len(tools)):
        wrong = path.tool[(path.tool < 0) | (path.tool >= len(tools))][0]
        raise ValueError(f"engagement: the path names tool {wrong} of {len(tools)} that there are")
    columns, left = swept(path, tools, stock, bins)
    piece, rise = columns.piece, path.end[:, 2] - path.start[:, 2]
    engagement = Engagement(
        piece=piece,
        block=path.block[piece],
        tool=path.tool[piece],
        along=columns.along,
        length=columns.length,
        lower=columns.lower,
        upper=columns.upper,
        volume=columns.volume,
        slope=rise[piece] / path.length[piece],
        feed=path.feed[piece],
        blocks=int(path.block[-1]) + 1 if len(path) else 0,
        resolution=stock.cell,
    )
    return engagement, left
