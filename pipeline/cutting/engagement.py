"""Engagement: where along its path the tool is in the material, and with which part of it.

Angles are those of milling (Altintas 2012, fig. 2.20): phi = 0 where a tooth stands a quarter
turn before the direction of feed and moves into it, so that the chip of a tooth is f_z sin(phi)
thick, phi = 0 is where up-milling begins and phi = pi where down-milling ends.  Seen along the
direction of feed with a spindle that turns clockwise (M3), phi = 0 is to the left and phi grows
clockwise; for M4 left and right change places.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Engagement:
    """N stations along a tool path, each with the part of the tool that is in the material there.

    A station stands for a stretch of a piece over which the engagement is the same within the
    resolution.  Pieces without material have no station.

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
