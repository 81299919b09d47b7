"""Force waveform under constant engagement for each coefficient, compiled.

The side is a cylinder, so that six sums give all forces: of h cos(phi), h sin(phi), h, cos(phi),
sin(phi) and 1 over the edge in the material.  The edge is divided into equal slices, each
integrated at two Gauss points.  Where the chip ends within a slice only the part with a chip
counts, so that the forces change without jumps when runout or helix do.  Faces and corners are
integrated in the same slices, force by force.
"""

from math import ceil, cos, floor, pi, sin

from pipeline.cutting.force.edge import (
    ARM,
    COS_KAPPA,
    COS_LAG,
    FACE_HEIGHT,
    FROM,
    GAUSS,
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
    grown,
    place_pair,
    thickness,
)
from pipeline.kernels import compiled

TURN = 2 * pi


@compiled
def side_forces(  # type: ignore[no-untyped-def]
    angles, phi_st, phi_ex, depth, radius, lag, step, f_z, runout, exponent, growth, differences,
    points, sums, out,
):  # fmt: skip
    """Add forces and torque of the side under constant engagement to ``out``; shape (T, 4, 6).

    Rows are F_x, F_y, F_z and the torque, columns the coefficients.  ``depth`` [m] is the side's,
    ``lag`` [rad] that of its lower end, ``step`` [rad] of a slice; ``differences`` for each tooth
    as :func:`pipeline.cutting.force.edge.thickness`.  ``points`` of shape (n, 4) has a row
    for each slice, ``sums`` of (6,) is to work in.
    """
    many, slices = differences.shape[0], points.shape[0]
    for e in range(slices):
        points[e, 0], points[e, 1], points[e, 2], points[e, 3] = _lags(e, e + 1.0, lag, step)
    least, most = min(lag, lag + step * slices), max(lag, lag + step * slices)
    for t in range(angles.shape[0]):
        sums[:] = 0.0
        for j in range(many):
            tip = angles[t] - TURN * j / many
            tip -= TURN * floor(tip / TURN)
            sine, cosine = sin(tip), cos(tip)
            # the lag of what is in the window lies between these, for each turn of the edge
            first = ceil((least - tip + phi_st) / TURN)
            last = floor((most - tip + phi_ex) / TURN)
            for turns in range(first, last + 1):
                low, high = tip - phi_ex + TURN * turns, tip - phi_st + TURN * turns
                if step == 0.0:
                    begin, end = 0.0, (float(slices) if low < lag <= high else 0.0)
                else:
                    begin, end = (low - lag) / step, (high - lag) / step
                    if step < 0.0:
                        begin, end = end, begin
                    begin, end = max(begin, 0.0), min(end, float(slices))
                if begin < end:
                    _slices(begin, end, sine, cosine, lag, step, depth / slices, f_z, runout,
                            exponent, growth, differences[j], points, sums)  # fmt: skip
        _spread(sums, radius, out[t])


@compiled
def _spread(sums, radius, out):  # type: ignore[no-untyped-def]
    """Add the six sums where they belong among forces and coefficients."""
    for k in range(2):
        column, c, s, plain = 3 * k, sums[3 * k], sums[3 * k + 1], sums[3 * k + 2]
        out[0, column] -= c
        out[0, column + 1] -= s
        out[1, column] += s
        out[1, column + 1] -= c
        out[2, column + 2] += plain
        out[3, column] += radius * plain


@compiled
def _slices(  # type: ignore[no-untyped-def]
    begin, end, sine, cosine, lag, step, width, f_z, runout, exponent, growth, differences,
    points, out,
):  # fmt: skip
    """Add what one tooth has between two places on the edge, counted in slices."""
    hc, hs, h0, ec, es, e0 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(int(begin), ceil(end)):
        low, high = max(begin, float(e)), min(end, e + 1.0)
        if high - low == 1.0:
            cl, sl, cl2, sl2 = points[e, 0], points[e, 1], points[e, 2], points[e, 3]
        else:
            cl, sl, cl2, sl2 = _lags(low, high, lag, step)
        s, s2 = sine * cl - cosine * sl, sine * cl2 - cosine * sl2
        h = thickness(f_z * s, cl, sl, runout, differences)
        h2 = thickness(f_z * s2, cl2, sl2, runout, differences)
        start, stop = cut_part(low, high, h, h2)
        if not stop > start:
            continue
        if start > low or stop < high:
            low, high = start, stop
            cl, sl, cl2, sl2 = _lags(low, high, lag, step)
            s, s2 = sine * cl - cosine * sl, sine * cl2 - cosine * sl2
            h = max(thickness(f_z * s, cl, sl, runout, differences), 0.0)
            h2 = max(thickness(f_z * s2, cl2, sl2, runout, differences), 0.0)
        c, c2 = cosine * cl + sine * sl, cosine * cl2 + sine * sl2
        b = 0.5 * width * (high - low)
        if growth != 0.0:
            edge, edge2 = b * grown(h, growth), b * grown(h2, growth)
            ec += edge * c + edge2 * c2
            es += edge * s + edge2 * s2
            e0 += edge + edge2
        else:
            ec += b * (c + c2)
            es += b * (s + s2)
            e0 += 2.0 * b
        if exponent != 1.0:
            h, h2 = h**exponent, h2**exponent
        hc += b * (h * c + h2 * c2)
        hs += b * (h * s + h2 * s2)
        h0 += b * (h + h2)
    out[0] += hc
    out[1] += hs
    out[2] += h0
    out[3] += ec
    out[4] += es
    out[5] += e0


@compiled
def _lags(low, high, lag, step):  # type: ignore[no-untyped-def]
    """Cosine and sine of the lags at both Gauss points between two places."""
    middle, half = lag + 0.5 * step * (low + high), 0.5 * step * GAUSS * (high - low)
    a, b = middle - half, middle + half
    return cos(a), sin(a), cos(b), sin(b)


@compiled
def window_forces(  # type: ignore[no-untyped-def]
    angles, phi_st, phi_ex, shape, elements, pairs, motion, runout, exponent, growth,
    differences, work, out,
):  # fmt: skip
    """Fill ``out`` of shape (T, 4, 6): constant engagement from ``phi_st`` to ``phi_ex``.

    Rows are F_x, F_y, F_z and the torque.  ``motion`` holds f_z, cosine and sine of its slope;
    ``pairs`` of shape (n, 2, 5) the Gauss points of the elements, ``work`` of (2, 5) is to
    work in; else as :func:`pipeline.cutting.force.edge.chip`.
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
                        exponent, growth, differences, work, out[t],
                    )  # fmt: skip


@compiled
def _element(  # type: ignore[no-untyped-def]
    low, high, sine, cosine, j, shape, one, pair, motion, runout, exponent, growth, differences,
    work, out,
):  # fmt: skip
    """Add what one element has between two lags."""
    begin, end = min(one[LAG_FROM], one[LAG_TO]), max(one[LAG_FROM], one[LAG_TO])
    if begin == end:
        if low < begin <= high:
            _stretch(sine, cosine, j, one[PART], one[FROM], one[TO], shape, pair, motion, runout,
                     exponent, growth, differences, work, out)  # fmt: skip
        return
    if begin >= high or end <= low:
        return
    if begin >= low and end <= high:
        _stretch(sine, cosine, j, one[PART], one[FROM], one[TO], shape, pair, motion, runout,
                 exponent, growth, differences, work, out)  # fmt: skip
        return
    z = max(begin, low) / shape[LAG] + shape[FACE_HEIGHT]
    z_end = min(end, high) / shape[LAG] + shape[FACE_HEIGHT]
    p, p_end = along(one[PART], z, shape), along(one[PART], z_end, shape)
    if p > p_end:
        p, p_end = p_end, p
    place_pair(one[PART], p, p_end, shape, work)
    _stretch(sine, cosine, j, one[PART], p, p_end, shape, work, motion, runout, exponent, growth,
             differences, work, out)  # fmt: skip


@compiled
def _stretch(  # type: ignore[no-untyped-def]
    sine, cosine, j, part, begin, end, shape, pair, motion, runout, exponent, growth,
    differences, work, out,
):  # fmt: skip
    """Add the force on a stretch of one tooth's edge, as far as it has a chip."""
    h = _chip(sine, cosine, pair[0], motion, runout, differences[j])
    after = _chip(sine, cosine, pair[1], motion, runout, differences[j])
    start, stop = cut_part(begin, end, h, after)
    if not stop > start:
        return
    if start > begin or stop < end:
        begin, end = start, stop
        place_pair(part, begin, end, shape, work)
        pair = work
        h = max(_chip(sine, cosine, pair[0], motion, runout, differences[j]), 0.0)
        after = max(_chip(sine, cosine, pair[1], motion, runout, differences[j]), 0.0)
    for k in range(2):
        point, thick = pair[k], h if k == 0 else after
        s = sine * point[COS_LAG] - cosine * point[SIN_LAG]
        c = cosine * point[COS_LAG] + sine * point[SIN_LAG]
        add_force(s, c, point[SIN_KAPPA], point[COS_KAPPA], point[ARM], thick,
                  0.5 * (end - begin), exponent, growth, out)  # fmt: skip


@compiled
def _chip(sine, cosine, point, motion, runout, differences):  # type: ignore[no-untyped-def]
    s = sine * point[COS_LAG] - cosine * point[SIN_LAG]
    return chip(s, point[SIN_KAPPA], point[COS_KAPPA], point[COS_LAG], point[SIN_LAG], motion,
                runout, differences)  # fmt: skip
