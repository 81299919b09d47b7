"""Peak loads of one engagement under uncertain coefficients and runout.

The forces are those of :mod:`pipeline.cutting.force.waveform`, computed at angles that are coarser:
teeth stand 7.5 degrees apart, closer in arcs below 60 degrees, so that a peak is missed by up to a
few percent where a straight edge enters or leaves the material with its greatest chip.  Changes
of such peaks from draw to draw err by less: both miss the same.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.engagement.end_rings import whole_ring
from pipeline.cutting.force.edge import LIP, bin_middles, edge_shape, motion, piece_buffer
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Bools, Floats

ANGLES = 48
"""Least number of angles in a turn of the spindle."""
POWERS = 129
"""Number of chip thicknesses whose power is tabulated."""
CORNER = 4
"""Number of elements of a corner."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgeTurn:
    """Pieces of a tool's edge that are in the material over a turn of the spindle."""

    tool: Tool
    """Whose edge it is; its runout is not used."""
    pieces: Floats
    """Pieces of the edge as in :mod:`pipeline.cutting.force.profile_kernel`; shape (n, 9)."""
    first: NDArray[np.intp]
    """First piece of each tip angle; shape (A + 1,)."""


def edge_turn(
    tool: Tool, lower: ArrayLike, upper: ArrayLike, *, slope: float = 0.0,
    ring: tuple[Floats, Floats] | None = None,
) -> EdgeTurn:  # fmt: skip
    """The pieces of an engagement.

    ``lower``, ``upper`` [m], ``slope`` and ``ring`` as
    :func:`pipeline.cutting.force.waveform.profile_basis` takes them.
    """
    from pipeline.cutting.force.edge import divide
    from pipeline.cutting.force.profile_kernel import pieces_of_turn

    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    there = high > low
    angles = _angles(tool, there)
    first = np.zeros(angles + 1, dtype=np.intp)
    if not there.any():
        return EdgeTurn(tool=tool, pieces=np.empty((0, 9)), first=first)
    many = np.array([LIP if tool.kind == "drill" else int(slope < 0), CORNER, 1])
    elements, pairs = np.empty((many.sum(), 7)), np.empty((many.sum(), 2, 5))
    shape, bins = edge_shape(tool), len(low)
    depth = max(float(low[there].min()), 0.0), float(high[there].max())
    n = divide(shape, *depth, many, elements, pairs)
    size = len(piece_buffer(many.sum(), shape, depth[1], bins))
    pieces = np.empty((angles * size, 9))
    pieces_of_turn(low, high, *(ring or whole_ring(bins)), shape, elements[:n],
                   motion(1.0, slope), bin_middles(bins), angles, pieces, first)  # fmt: skip
    return EdgeTurn(tool=tool, pieces=pieces[: first[-1]].copy(), first=first)


def _angles(tool: Tool, there: Bools) -> int:
    """Angles of the tip over a turn: short arcs pass quickly."""
    share = there.mean()
    finer = 4 if share <= 1 / 12 else 2 if share <= 1 / 6 else 1
    return tool.flutes * ceil(finer * ANGLES / tool.flutes)


def drawn_loads(
    turn: EdgeTurn, coefficients: ArrayLike, offsets: ArrayLike, f_z: ArrayLike, *,
    m_c: float = 0.0, mean: bool = False,
) -> Floats:  # fmt: skip
    """Peak across the axis over a spindle revolution [N] in D draws, at K feeds; shape (K, D).

    ValueError when the shapes do not go together.

    Parameters
    ----------
    turn : EdgeTurn
        Edge over one revolution at the engagement.
    coefficients : array_like, shape (D, 6)
        K_tc, K_rc, K_ac, K_te, K_re, K_ae [N/m^2] or with ``m_c``, [N/m].
    offsets : array_like, shape (D, 2)
        Tool axis from the spindle axis, along the first tooth and 90 deg after it in the sense of
        ``Tool.runout_deg`` [m].
    f_z : array_like, shape (K,)
        Feeds per tooth, above 0 and rising [m].
    m_c : float
        Exponent of the chip thickness [1].
    mean : bool
        Means over the revolution instead of peaks.
    """
    from pipeline.cutting.force.profile_kernel import drawn_loads as fill

    law = np.ascontiguousarray(coefficients, dtype=np.float64)
    throw = np.ascontiguousarray(offsets, dtype=np.float64)
    feeds = np.ascontiguousarray(f_z, dtype=np.float64)
    if law.shape != (len(throw), 6) or throw.shape != (len(law), 2) or feeds.ndim != 1:
        raise ValueError(
            f"drawn loads: coefficients have shape {law.shape}, offsets {throw.shape}, f_z "
            f"{feeds.shape}: give (D, 6), (D, 2) and (K,)"
        )
    teeth, angles = turn.tool.flutes, len(turn.first) - 1
    place = np.exp(2j * np.pi * np.arange(teeth) / teeth)
    out = np.zeros((len(feeds), len(law)))
    fill(turn.pieces, turn.first, teeth, law, throw, feeds, _powers(feeds, teeth, m_c),
         place.view(np.float64).reshape(teeth, 2), mean, np.empty((teeth, teeth, 2)),
         np.empty((len(feeds), angles, 2)), out)  # fmt: skip
    return out


def _powers(feeds: Floats, teeth: int, m_c: float) -> Floats:
    """h^(1 - m_c) from none to the thickest chip, at squares; nothing where force is linear.

    Between them it is straight: below by 0.1 % where the chip is a hundredth of the thickest.
    """
    if m_c == 0.0 or not len(feeds):
        return np.empty(0)
    share = np.linspace(0.0, 1.0, POWERS) ** 2
    powers: Floats = (share * teeth * feeds[-1]) ** (1.0 - m_c)
    return powers
