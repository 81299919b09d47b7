"""Peak loads of one engagement under uncertain coefficients and runout.

The forces are those of :mod:`pipeline.cutting.force.waveform`, computed at angles that are coarser:
teeth stand 7.5 degrees apart, closer in arcs below 60 degrees, so that a peak is missed by up to a
few percent where a straight edge enters or leaves the material with its greatest chip.  Changes
of such peaks from draw to draw err by less: both miss the same.
"""

from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.engagement.end_rings import whole_ring
from pipeline.cutting.force.edge import (
    bin_middles,
    edge_elements,
    edge_shape,
    motion,
    piece_buffer,
    thickness,
)
from pipeline.cutting.force.profile_kernel import (
    CHIP,
    COS_KAPPA,
    COS_LAG,
    COSINE,
    SIN_KAPPA,
    SIN_LAG,
    SINE,
    WIDTH,
    edge_pieces,
)
from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
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
    """Pieces of an engagement.

    ``lower``, ``upper`` [m], ``slope`` and ``ring`` as
    :func:`pipeline.cutting.force.waveform.profile_basis` takes them.
    """
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    there = high > low
    angles = _angles(tool, there)
    first = np.zeros(angles + 1, dtype=np.intp)
    if not there.any():
        return EdgeTurn(tool=tool, pieces=np.empty((0, 9)), first=first)
    shape, bins = edge_shape(tool), len(low)
    depth = max(float(low[there].min()), 0.0), float(high[there].max())
    elements, _ = edge_elements(tool, depth, corner=CORNER, side=1, slope=slope)
    size = len(piece_buffer(len(elements), shape, depth[1], bins))
    pieces = np.empty((angles * size, 9))
    pieces_of_turn(low, high, *(ring or whole_ring(bins)), shape, elements, motion(1.0, slope),
                   bin_middles(bins), angles, pieces, first)  # fmt: skip
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

    Parameters
    ----------
    turn : EdgeTurn
        Edges of the tool in its cut.
    coefficients : array_like, shape (D, 6)
        K_tc, K_rc, K_ac [N/m^2], with ``m_c`` [N/m^(2 - m_c)], K_te, K_re, K_ae [N/m].
    offsets : array_like, shape (D, 2)
        The tool's axis from the spindle's, along the first tooth and 90 deg after it in the sense
        of ``Tool.runout_deg`` [m].
    f_z : array_like, shape (K,)
        Rising feeds per tooth, above 0 [m].
    m_c : float
        Exponent of the chip thickness [1].
    mean : bool
        Means instead of peaks.
    """
    law = np.ascontiguousarray(coefficients, dtype=np.float64)
    throw = np.ascontiguousarray(offsets, dtype=np.float64)
    feeds = np.ascontiguousarray(f_z, dtype=np.float64)
    teeth, angles = turn.tool.flutes, len(turn.first) - 1
    place = np.exp(2j * np.pi * np.arange(teeth) / teeth)
    out = np.zeros((len(feeds), len(law)))
    fill_loads(turn.pieces, turn.first, teeth, law, throw, feeds, _powers(feeds, teeth, m_c),
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
    return (share * teeth * feeds[-1]) ** (1.0 - m_c)


@compiled
def pieces_of_turn(  # type: ignore[no-untyped-def]
    lower, upper, inner, outer, shape, elements, motion, middles, angles, pieces, first
):
    """Fill ``pieces`` with those at each of A angles of a tip, ``first`` of shape (A + 1,).

    ``pieces`` is large enough for A times the pieces of :func:`edge_pieces`; else as there.
    """
    size = pieces.shape[0] // angles
    n = 0
    for a in range(angles):
        first[a] = n
        n += edge_pieces(2 * pi * (a + 0.5) / angles, lower, upper, inner, outer, shape, elements,
                         motion, middles, pieces[n : n + size])  # fmt: skip
    first[angles] = n


@compiled
def fill_loads(  # type: ignore[no-untyped-def]
    pieces, first, teeth, coefficients, offsets, feeds, powers, turned, mean, stand, forces, out
):
    """Fill ``out`` of shape (K, D), loads across the axis at K feeds in D draws [N].

    They are peaks over a turn, or with ``mean`` means.  ``coefficients`` has shape (D, 6) and
    ``offsets`` (D, 2): where the tool's axis stands, along the first tooth and a quarter turn after
    it [m].  ``powers`` are those of chips between none and the thickest, N times the last feed, at
    squares; without any force is linear.  ``turned`` of shape (N, 2) holds cosine and sine of each
    tooth's place; ``stand`` of (N, N, 2) and ``forces`` of (K, A, 2) are to work in.
    """
    angles = first.shape[0] - 1
    pitch = angles // teeth
    for d in range(coefficients.shape[0]):
        along, across = offsets[d, 0], offsets[d, 1]
        throw = sqrt(along * along + across * across) if teeth > 1 else 0.0
        _stand_out(along, across, turned, stand)
        several = teeth if throw > 0.0 else 1
        turn = angles if throw > 0.0 else pitch
        forces[:, :turn] = 0.0
        for a in range(angles):
            for i in range(first[a], first[a + 1]):
                _add_piece(pieces[i], a, several, pitch, turn, throw, coefficients[d], feeds,
                           powers, stand, forces)  # fmt: skip
        for k in range(feeds.shape[0]):
            peak, total = 0.0, 0.0
            for a in range(turn):
                square = forces[k, a, 0] ** 2 + forces[k, a, 1] ** 2
                peak = max(peak, square)
                if mean:
                    total += sqrt(square)
            out[k, d] = total / turn if mean else sqrt(peak)


@compiled
def _stand_out(along, across, turned, stand):  # type: ignore[no-untyped-def]
    """Fill by how much tooth j stands out over the m-th before it, cosine and sine parts."""
    teeth = turned.shape[0]
    for j in range(teeth):
        for m in range(teeth):
            cosine = turned[j, 0] - turned[j - m, 0]
            sine = turned[j, 1] - turned[j - m, 1]
            stand[j, m, 0] = along * cosine - across * sine
            stand[j, m, 1] = along * sine + across * cosine


@compiled
def _add_piece(  # type: ignore[no-untyped-def]
    one, a, several, pitch, turn, throw, law, feeds, powers, stand, forces
):
    """Add the force of a piece, on each tooth when its tip is there, at each feed."""
    s, c, sk, ck, width = one[SINE], one[COSINE], one[SIN_KAPPA], one[COS_KAPPA], one[WIDTH]
    across, edge = law[1] * sk + law[2] * ck, law[4] * sk + law[5] * ck
    x, y = -width * (law[0] * c + across * s), width * (law[0] * s - across * c)
    x_edge, y_edge = -width * (law[3] * c + edge * s), width * (law[3] * s - edge * c)
    cosine, sine = sk * one[COS_LAG], sk * one[SIN_LAG]
    teeth = stand.shape[0]
    thickest = teeth * feeds[feeds.shape[0] - 1]
    for j in range(several):
        at = (a + j * pitch) % turn
        for k in range(feeds.shape[0]):
            h = thickness(feeds[k] * one[CHIP], cosine, sine, sk * throw, stand[j])
            if h > 0.0:
                area = h if powers.shape[0] == 0 else _power(h / thickest, powers)
                forces[k, at, 0] += area * x + x_edge
                forces[k, at, 1] += area * y + y_edge


@compiled
def _power(share, powers):  # type: ignore[no-untyped-def]
    """Power of a chip that is ``share`` of the thickest, from the table."""
    last = powers.shape[0] - 1
    place = last * sqrt(share)
    k = min(int(place), last - 1)
    return powers[k] + (place - k) * (powers[k + 1] - powers[k])
