"""Forces of any part of the edge over the angle of the spindle, for each coefficient, compiled.

As :mod:`pipeline.cutting.side_kernel`, for faces and corners too.
"""

from math import ceil, cos, floor, pi, sin

from pipeline.cutting.edge_kernel import (
    ARM,
    COS_KAPPA,
    COS_LAG,
    FACE_HEIGHT,
    FROM,
    LAG,
    LAG_FROM,
    LAG_TO,
    PART,
    SIN_KAPPA,
    SIN_LAG,
    TO,
    add_force,
    along,
    chip,
    cut_part,
    place_pair,
)
from pipeline.kernels import compiled

TURN = 2 * pi


@compiled
def window_forces(  # type: ignore[no-untyped-def]
    angles, phi_st, phi_ex, shape, elements, pairs, motion, runout, exponent, differences, room, out
):
    """Fill ``out`` of shape (T, 4, 6): constant engagement from ``phi_st`` to ``phi_ex``.

    Rows are F_x, F_y, F_z and the torque.  ``motion`` holds f_z, cosine and sine of its slope;
    ``pairs`` of shape (n, 2, 5) the Gauss points of the elements, ``room`` of (2, 5) is to work
    in; else as :func:`pipeline.cutting.edge_kernel.chip`.
    """
    many = differences.shape[0]
    least, most = 0.0, 0.0
    for e in range(elements.shape[0]):
        least = min(least, min(elements[e, LAG_FROM], elements[e, LAG_TO]))
        most = max(most, max(elements[e, LAG_FROM], elements[e, LAG_TO]))
    for t in range(angles.shape[0]):
        for j in range(many):
            tip = angles[t] - TURN * j / many
            tip -= TURN * floor(tip / TURN)
            sine, cosine = sin(tip), cos(tip)
            # the lag of what is in the window lies between these, for each turn of the edge
            first = ceil((least - tip + phi_st) / TURN)
            last = floor((most - tip + phi_ex) / TURN)
            for turns in range(int(first), int(last) + 1):
                low, high = tip - phi_ex + TURN * turns, tip - phi_st + TURN * turns
                for e in range(elements.shape[0]):
                    _element(
                        low, high, sine, cosine, j, shape, elements[e], pairs[e], motion, runout,
                        exponent, differences, room, out[t],
                    )  # fmt: skip


@compiled
def _element(  # type: ignore[no-untyped-def]
    low, high, sine, cosine, j, shape, one, pair, motion, runout, exponent, differences, room, out
):
    """Add what one element has between two lags."""
    begin, end = min(one[LAG_FROM], one[LAG_TO]), max(one[LAG_FROM], one[LAG_TO])
    if begin == end:
        if low < begin <= high:
            _stretch(sine, cosine, j, one[PART], one[FROM], one[TO], shape, pair, motion, runout,
                     exponent, differences, room, out)  # fmt: skip
        return
    if begin >= high or end <= low:
        return
    if begin >= low and end <= high:
        _stretch(sine, cosine, j, one[PART], one[FROM], one[TO], shape, pair, motion, runout,
                 exponent, differences, room, out)  # fmt: skip
        return
    z = max(begin, low) / shape[LAG] + shape[FACE_HEIGHT]
    z_end = min(end, high) / shape[LAG] + shape[FACE_HEIGHT]
    p, p_end = along(one[PART], z, shape), along(one[PART], z_end, shape)
    if p > p_end:
        p, p_end = p_end, p
    place_pair(one[PART], p, p_end, shape, room)
    _stretch(sine, cosine, j, one[PART], p, p_end, shape, room, motion, runout, exponent,
             differences, room, out)  # fmt: skip


@compiled
def _stretch(  # type: ignore[no-untyped-def]
    sine, cosine, j, part, begin, end, shape, pair, motion, runout, exponent, differences, room, out
):
    """Add the force on a stretch of one tooth's edge, as far as it has a chip."""
    h = _chip(sine, cosine, pair[0], motion, runout, differences[j])
    after = _chip(sine, cosine, pair[1], motion, runout, differences[j])
    start, stop = cut_part(begin, end, h, after)
    if not stop > start:
        return
    if start > begin or stop < end:
        begin, end = start, stop
        place_pair(part, begin, end, shape, room)
        pair = room
        h = max(_chip(sine, cosine, pair[0], motion, runout, differences[j]), 0.0)
        after = max(_chip(sine, cosine, pair[1], motion, runout, differences[j]), 0.0)
    for k in range(2):
        point, thick = pair[k], h if k == 0 else after
        s = sine * point[COS_LAG] - cosine * point[SIN_LAG]
        c = cosine * point[COS_LAG] + sine * point[SIN_LAG]
        add_force(s, c, point[SIN_KAPPA], point[COS_KAPPA], point[ARM], thick,
                  0.5 * (end - begin), exponent, out)  # fmt: skip


@compiled
def _chip(sine, cosine, point, motion, runout, differences):  # type: ignore[no-untyped-def]
    s = sine * point[COS_LAG] - cosine * point[SIN_LAG]
    return chip(s, point[SIN_KAPPA], point[COS_KAPPA], point[COS_LAG], point[SIN_LAG], motion,
                runout, differences)  # fmt: skip
