"""Forces where engagement is given as heights for bins of angle, compiled.

Each tooth's edge is cut where it goes from one bin to the next and where it enters and leaves the
material, exactly; each piece between is integrated at its middle, so that it errs by the square of
a bin over 24, 0.03 % of its own force for 72 bins.  With runout a piece where a tooth begins to
miss its chip counts or does not: up to 3 % of the greatest edge force (0.5 % in RMS), and up to
0.4 % of the cutting part.
"""

from math import ceil, cos, floor, pi, sin

from pipeline.cutting.edge_kernel import (
    CONE_COS,
    CORNER,
    FACE,
    FACE_HEIGHT,
    FROM,
    LAG,
    LAG_FROM,
    LAG_TO,
    PART,
    SIDE,
    TO,
    Z_FROM,
    Z_TO,
    add_force,
    along,
    thickness,
    where,
)
from pipeline.kernels import compiled

TURN = 2 * pi
FLOOR = 1e-4
"""Height above the tip up to which material counts as lying under a flat end [m]: profiles carry
the rounding of the map that they come from."""
WIDTH, CHIP, SINE, COSINE, SIN_KAPPA, COS_KAPPA, ARM, COS_LAG, SIN_LAG = range(9)
"""What is known of a piece; CHIP is its thickness without runout over the feed for each tooth."""


@compiled
def profile_forces(  # type: ignore[no-untyped-def]
    angles, lower, upper, shape, elements, motion, runout, exponent, differences, middles, pieces,
    out,
):  # fmt: skip
    """Fill ``out`` of shape (T, 4, 6); ``lower`` and ``upper`` have shape (F,).

    Else as :func:`edge_pieces` and :func:`pipeline.cutting.waveform_kernel.window_forces`.
    """
    teeth = differences.shape[0]
    for t in range(angles.shape[0]):
        for j in range(teeth):
            tip = angles[t] - TURN * j / teeth
            n = edge_pieces(tip, lower, upper, shape, elements, motion, middles, pieces)
            for i in range(n):
                one = pieces[i]
                h = piece_chip(one, motion[0], runout, differences[j])
                if h > 0.0:
                    add_force(one[SINE], one[COSINE], one[SIN_KAPPA], one[COS_KAPPA], one[ARM], h,
                              one[WIDTH], exponent, out[t])  # fmt: skip


@compiled
def piece_chip(one, f_z, runout, differences):  # type: ignore[no-untyped-def]
    """Thickness of a piece's chip [m], below 0 where the tooth misses."""
    sk = one[SIN_KAPPA]
    return thickness(
        f_z * one[CHIP], sk * one[COS_LAG], sk * one[SIN_LAG], sk * runout, differences
    )


@compiled
def edge_pieces(tip, lower, upper, shape, elements, motion, middles, pieces):  # type: ignore[no-untyped-def]
    """Fill ``pieces`` of shape (n, 9) with what cuts of an edge whose tip is at an angle; how many.

    ``middles`` of shape (F, 2) holds sine and cosine of the middles of the bins; else as
    :func:`pipeline.cutting.waveform_kernel.window_forces`.
    """
    n, bins = 0, lower.shape[0]
    per_bin = bins / TURN
    for e in range(elements.shape[0]):
        one = elements[e]
        if one[LAG_FROM] == one[LAG_TO]:
            k = floor((tip - one[LAG_FROM]) * per_bin) % bins
            if upper[k] > lower[k]:
                n += _piece(tip, one, one[Z_FROM], one[Z_TO], lower[k], upper[k], shape, motion,
                            middles[k], False, pieces[n])  # fmt: skip
            continue
        begin = tip - max(one[LAG_FROM], one[LAG_TO])
        end = tip - min(one[LAG_FROM], one[LAG_TO])
        for place in range(floor(begin * per_bin), ceil(end * per_bin)):
            k = place % bins
            if not upper[k] > lower[k]:
                continue
            low, high = place / per_bin, (place + 1) / per_bin
            whole = one[PART] == SIDE and low >= begin and high <= end
            z = (tip - max(low, begin)) / shape[LAG] + shape[FACE_HEIGHT]
            z_end = (tip - min(high, end)) / shape[LAG] + shape[FACE_HEIGHT]
            n += _piece(tip, one, min(z, z_end), max(z, z_end), lower[k], upper[k], shape, motion,
                        middles[k], whole, pieces[n])  # fmt: skip
    return n


@compiled
def _piece(tip, one, begin, end, low, high, shape, motion, middle, whole, out):  # type: ignore[no-untyped-def]
    """Fill what lies between two heights of an element and in the material; 1 if that cuts, or 0.

    ``whole`` says that the heights fill a bin, whose ``middle`` is then their own.
    """
    if one[PART] == FACE and begin == end:
        if low > begin + FLOOR or high <= begin:
            return 0
        p, out[WIDTH] = 0.5 * (one[FROM] + one[TO]), one[TO] - one[FROM]
    else:
        whole &= begin >= low and end <= high
        begin, end = max(begin, low), min(end, high)
        if not end > begin:
            return 0
        if one[PART] == FACE:
            begin, end = begin / shape[CONE_COS], end / shape[CONE_COS]
        elif one[PART] == CORNER:
            begin, end = along(CORNER, begin, shape), along(CORNER, end, shape)
        p, out[WIDTH] = 0.5 * (begin + end), end - begin
    out[SIN_KAPPA], out[COS_KAPPA], out[ARM], _, lag = where(one[PART], p, shape)
    out[SINE], out[COSINE] = (middle[0], middle[1]) if whole else (sin(tip - lag), cos(tip - lag))
    out[COS_LAG], out[SIN_LAG] = cos(lag), sin(lag)
    out[CHIP] = motion[1] * out[SINE] * out[SIN_KAPPA] - motion[2] * out[COS_KAPPA]
    return 1 if out[CHIP] > 0.0 else 0
