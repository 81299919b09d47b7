"""Peak loads of one engagement for many draws of coefficients and runout, compiled.

What does not depend on a draw, the pieces of the edge in the material at each angle of a tooth's
tip, is found once; the forces of a draw are then a few products for each piece, tooth and feed.
"""

from math import pi, sqrt

from pipeline.cutting.profile_kernel import (
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
from pipeline.kernels import compiled


@compiled
def pieces_of_turn(lower, upper, shape, elements, motion, middles, angles, pieces, first):  # type: ignore[no-untyped-def]
    """Fill ``pieces`` with those at each of A angles of a tip, ``first`` of shape (A + 1,).

    ``pieces`` has room for A times what :func:`edge_pieces` may fill; else as that.
    """
    room = pieces.shape[0] // angles
    n = 0
    for a in range(angles):
        first[a] = n
        n += edge_pieces(2 * pi * (a + 0.5) / angles, lower, upper, shape, elements, motion,
                         middles, pieces[n : n + room])  # fmt: skip
    first[angles] = n


@compiled
def drawn_peaks(  # type: ignore[no-untyped-def]
    pieces, first, teeth, coefficients, offsets, feeds, powers, turned, stand, forces, out
):
    """Fill ``out`` of shape (K, D), the peaks across the axis at K feeds in D draws [N].

    ``coefficients`` has shape (D, 6) and ``offsets`` (D, 2): where the tool's axis stands, along
    the first tooth and a quarter turn after it [m].  ``powers`` are those of chips between none and
    the thickest, N times the last feed, at squares; without any force is linear.  ``turned`` of
    shape (N, 2) holds cosine and sine of each tooth's place; ``stand`` of (N, N, 2) and ``forces``
    of (K, A, 2) are to work in.
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
            peak = 0.0
            for a in range(turn):
                peak = max(peak, forces[k, a, 0] ** 2 + forces[k, a, 1] ** 2)
            out[k, d] = sqrt(peak)


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
            each = feeds[k] * one[CHIP]
            h = each
            if throw > 0.0:
                h = teeth * each
                for m in range(1, teeth):
                    if (m - 1) * each >= 2.0 * sk * throw:  # what stands out most is passed
                        break
                    h = min(h, m * each + stand[j, m, 0] * cosine - stand[j, m, 1] * sine)
            if h > 0.0:
                area = h if powers.shape[0] == 0 else _power(h / thickest, powers)
                forces[k, at, 0] += area * x + x_edge
                forces[k, at, 1] += area * y + y_edge


@compiled
def _power(share, powers):  # type: ignore[no-untyped-def]
    """Power of a chip that is a share of the thickest, of its table."""
    last = powers.shape[0] - 1
    place = last * sqrt(share)
    k = min(int(place), last - 1)
    return powers[k] + (place - k) * (powers[k + 1] - powers[k])
