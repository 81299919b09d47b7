"""Immersion angles of the stations of a program, for chatter."""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, arc_ends
from pipeline.schema.arrays import Bools, Floats

Indices = NDArray[np.int32]
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

    def __post_init__(self) -> None:
        shallow = np.flatnonzero(~((self.depth > 0.0) & np.isfinite(self.depth)))
        if len(shallow):
            raise ValueError(
                f"immersions: depth[{shallow[0]}] = {self.depth[shallow[0]]:g} must be above 0 m "
                "and finite; leave out stations that are not in the material"
            )
        arc = (self.entry >= 0.0) & (self.entry < self.exit) & (self.exit <= pi + 1e-9)
        wrong = np.flatnonzero(~(arc & np.isfinite(self.feed_direction)))
        if len(wrong):
            at = wrong[0]
            raise ValueError(
                f"immersions: station {at} has entry = {self.entry[at]:.6g}, exit = "
                f"{self.exit[at]:.6g}, feed_direction = {self.feed_direction[at]:.6g} rad, which "
                "must be 0 <= entry < exit <= pi and a direction"
            )


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
        block=engagement.block[kept],
        tool=engagement.tool[kept],
        depth=np.where(engaged, height, 0.0).max(axis=1, initial=0.0)[kept],
        entry=np.minimum(entry, pi - LEAST_ARC),
        exit=np.minimum(np.maximum(exit, entry + LEAST_ARC), pi),
        feed_direction=np.arctan2(move[:, 1], move[:, 0])[kept],
        direction=turning[kept],
        blocks=engagement.blocks,
        unjudged=unjudged,
        lowest=np.where(engaged, engagement.lower, np.inf).min(axis=1, initial=np.inf)[kept],
        highest=np.where(engaged, engagement.upper, 0.0).max(axis=1, initial=0.0)[kept],
    )
