"""Cutting forces under engagement given as heights by angle bin, compiled.

Each tooth's edge is cut where it goes from one bin to the next and where it enters and leaves the
material, exactly; each piece between is integrated at its middle, so that it errs by the square of
a bin over 24, 0.03 % of its own force for 72 bins.  On slopes pieces of a corner end where its
chip does.  With runout a piece where a tooth begins to miss its chip counts or does not: up to 3 %
of the greatest edge force (0.5 % in RMS), and up to 0.4 % of the cutting part.

Three uses share these pieces: the waveform of one station, the loads of many stations over the
feed per tooth, and the peaks of one station for many draws of coefficients and runout.
"""

from math import ceil, cos, floor, pi, sin, sqrt

from pipeline.cutting.force.edge import (
    CONE_COS,
    CORNER,
    CORNER_RADIUS,
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
    divide,
    thickness,
    where,
)
from pipeline.kernels import compiled

TURN = 2 * pi
FLOOR = 1e-4
"""Height above the tip up to which material counts as lying under a flat end [m]: profiles carry
the rounding of the map that they come from."""
WIDTH, CHIP, SINE, COSINE, SIN_KAPPA, COS_KAPPA, ARM, COS_LAG, SIN_LAG = range(9)
"""Columns of a piece; CHIP is its thickness without runout over the feed for each tooth."""


@compiled
def profile_forces(  # type: ignore[no-untyped-def]
    angles, lower, upper, inner, outer, shape, elements, motion, runout, exponent, differences,
    middles, pieces, out,
):  # fmt: skip
    """Fill ``out`` of shape (T, 4, 6); ``lower``, ``upper``, ``inner``, ``outer`` have shape (F,).

    Else as :func:`edge_pieces` and :func:`pipeline.cutting.force.waveform.window_forces`.
    """
    teeth = differences.shape[0]
    for t in range(angles.shape[0]):
        for j in range(teeth):
            tip = angles[t] - TURN * j / teeth
            n = edge_pieces(tip, lower, upper, inner, outer, shape, elements, motion, middles,
                            pieces)  # fmt: skip
            for i in range(n):
                one = pieces[i]
                h = piece_chip(one, motion[0], runout, differences[j])
                if h > 0.0:
                    add_force(one[SINE], one[COSINE], one[SIN_KAPPA], one[COS_KAPPA], one[ARM], h,
                              one[WIDTH], exponent, 0.0, out[t])  # fmt: skip


@compiled
def piece_chip(one, f_z, runout, differences):  # type: ignore[no-untyped-def]
    """Thickness of a piece's chip [m], below 0 where the tooth misses."""
    sk = one[SIN_KAPPA]
    return thickness(
        f_z * one[CHIP], sk * one[COS_LAG], sk * one[SIN_LAG], sk * runout, differences
    )


@compiled
def edge_pieces(  # type: ignore[no-untyped-def]
    tip, lower, upper, inner, outer, shape, elements, motion, middles, pieces
):
    """Fill ``pieces`` of shape (n, 9) with those of an edge at an angle that cut; their number.

    ``inner`` and ``outer`` (F,) are radii of the part of a flat that has material below;
    ``middles`` of shape (F, 2) holds sine and cosine of the middles of the bins; else as
    :func:`pipeline.cutting.force.waveform.window_forces`.
    """
    n, bins = 0, lower.shape[0]
    per_bin = bins / TURN
    for e in range(elements.shape[0]):
        one = elements[e]
        if one[LAG_FROM] == one[LAG_TO]:
            k = floor((tip - one[LAG_FROM]) * per_bin) % bins
            if upper[k] > lower[k]:
                n += _piece(tip, one, one[Z_FROM], one[Z_TO], lower[k], upper[k], inner[k],
                            outer[k], shape, motion, middles[k], False, pieces[n])  # fmt: skip
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
            n += _piece(tip, one, min(z, z_end), max(z, z_end), lower[k], upper[k], inner[k],
                        outer[k], shape, motion, middles[k], whole, pieces[n])  # fmt: skip
    return n


@compiled
def _piece(  # type: ignore[no-untyped-def]
    tip, one, begin, end, low, high, inner, outer, shape, motion, middle, whole, out
):
    """Fill the piece of an element between two heights in the material; 1 if it cuts, or 0.

    Of a flat it is what lies between the radii ``inner`` and ``outer``.  ``whole`` says that the
    heights fill a bin, whose ``middle`` is then their own.
    """
    if one[PART] == FACE and begin == end:
        if low > begin + FLOOR or high <= begin:
            return 0
        begin, end = max(one[FROM], inner), min(one[TO], outer)
        if not end > begin:
            return 0
        p, out[WIDTH] = 0.5 * (begin + end), end - begin
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
    _point(tip, one[PART], p, shape, motion, middle, whole, out)
    if one[PART] == CORNER and motion[2] != 0.0:
        _cut_corner(tip, p, shape, motion, middle, out)
    return 1 if out[CHIP] > 0.0 else 0


@compiled
def _point(tip, part, p, shape, motion, middle, whole, out):  # type: ignore[no-untyped-def]
    """Fill the columns of a piece at length ``p`` of a part, all but its width."""
    out[SIN_KAPPA], out[COS_KAPPA], out[ARM], _, lag = where(part, p, shape)
    out[SINE], out[COSINE] = (middle[0], middle[1]) if whole else (sin(tip - lag), cos(tip - lag))
    out[COS_LAG], out[SIN_LAG] = cos(lag), sin(lag)
    out[CHIP] = motion[1] * out[SINE] * out[SIN_KAPPA] - motion[2] * out[COS_KAPPA]


@compiled
def _cut_corner(tip, p, shape, motion, middle, out):  # type: ignore[no-untyped-def]
    """Shorten the piece of a corner about ``p`` to where it has a chip: on slopes not everywhere.

    The chip's course along the corner is taken as straight within the piece.
    """
    corner, sk = shape[CORNER_RADIUS], out[SIN_KAPPA]
    turned = out[SINE] * out[COS_KAPPA] - out[COSINE] * shape[LAG] * corner * sk * sk
    rise = (motion[1] * turned + motion[2] * sk) * 0.5 * out[WIDTH] / corner
    if abs(out[CHIP]) < abs(rise):
        size = 0.5 * (1.0 + out[CHIP] / abs(rise)) * out[WIDTH]
        p += 0.5 * (out[WIDTH] - size) * (1.0 if rise > 0.0 else -1.0)
        out[WIDTH] = size
        _point(tip, CORNER, p, shape, motion, middle, False, out)


STEEP = 0.5
"""Slope |dz / ds| from which on a corner with runout has twice the elements [1]: near its tip teeth
miss their chips along part of it, and their forces across the axis balance but for that."""
BALANCED = 1e-9
"""Load across the axis over the torque below which it is rounding of teeth that balance [1/m]."""
FINEST = 4
"""Ratio of the tip angles of arcs below 30 degrees to those above 60."""
PEAK, MEAN, RMS, AXIAL, TORQUE, PEAK_TORQUE, FORCE = range(7)
"""Columns of a station's loads; from FORCE on the three components of its mean force, then their
standard deviations over a turn."""
COLUMNS = FORCE + 6


@compiled
def station_loads(  # type: ignore[no-untyped-def]
    lower, upper, ring, inner, outer, slope, shape, law, exponent, feeds, runout, differences, many,
    elements, pairs, motion, middles, pieces, forces, out,
):  # fmt: skip
    """Fill ``out`` of shape (S, K + 1, COLUMNS), the loads of S stations at K feeds and beyond.

    Feeds are those where u is 0, 1, 4, 9, ... of its unit; 0 stands for a feed just above it.  The
    last row goes on from the one before as fast as loads can rise with u.  ``lower`` and ``upper``
    have shape (S, F), ``ring`` (S,) is the row of each in ``inner`` and ``outer`` (E, F), ``slope``
    has (S,), ``law`` (6,), ``feeds`` (K,) [m]; ``forces`` of shape
    (K + 2, A, 4) is for the angles of the tip, A a multiple of FINEST times the teeth; ``many``,
    ``elements`` and ``pairs`` as :func:`pipeline.cutting.force.edge.divide`, ``motion`` of
    (3,), ``middles`` and ``pieces`` as :func:`edge_pieces`.

    Forces of one tooth are added for all teeth by shifting them by pitches, so that the tip's
    angles are a multiple of the number of teeth.  Without runout they are affine in
    u = f_z^(1 - m_c), a cutting part times u and an edge part, computed once for all feeds.
    """
    last = feeds.shape[0] - 1
    unit = feeds[last] ** exponent / last**2
    cut, edge = forces[last + 1], forces[last + 2]
    corner = many[CORNER]
    for station in range(lower.shape[0]):
        low, high, row = lower[station], upper[station], out[station]
        many[CORNER] = corner * (2 if runout > 0.0 and abs(slope[station]) > STEEP else 1)
        n = _divided(low, high, slope[station], shape, many, elements, pairs)
        row[:] = 0.0
        if n == 0:
            continue
        # forces of one tooth over the angle of its tip
        motion[0], motion[2] = 1.0, slope[station]
        motion[1] = sqrt(max(1.0 - slope[station] ** 2, 0.0))
        angles = forces.shape[1] // _coarseness(low, high)
        pitch = angles // differences.shape[0]
        if runout > 0.0:
            forces[:, :angles] = 0.0
        else:
            forces[last + 1 :, :pitch] = 0.0
        for a in range(angles):
            tip = 2 * pi * (a + 0.5) / angles
            m = edge_pieces(tip, low, high, inner[ring[station]], outer[ring[station]], shape,
                            elements[:n], motion, middles, pieces)  # fmt: skip
            _without_runout(pieces[:m], law, exponent, cut[a % pitch], edge[a % pitch])
            if runout > 0.0:
                _with_runout(pieces[:m], law, exponent, feeds, runout, differences, a,
                             forces[:, :angles])  # fmt: skip
        # loads and mean force at each feed, then their slope beyond the last
        _reduce(cut, edge, 1.0, 0.0, pitch, row[last + 1])
        for k in range(last + 1):
            if runout > 0.0:
                _reduce(forces[k], edge, 1.0, 0.0, angles, row[k])
            else:
                _reduce(cut, edge, k * k * unit, 1.0, pitch, row[k])
        for q in range(6):
            rise = max(row[last + 1, q] * unit, (row[last, q] - row[last - 1, q]) / (2 * last - 1))
            row[last + 1, q] = row[last, q] + rise * (2 * last + 1)
        for q in range(FORCE, COLUMNS):
            rise = (row[last, q] - row[last - 1, q]) / (2 * last - 1)
            row[last + 1, q] = row[last, q] + rise * (2 * last + 1)


@compiled
def _divided(low, high, slope, shape, many, elements, pairs):  # type: ignore[no-untyped-def]
    """Divide the edge between the station's heights; how many elements there are."""
    bottom, top = 1e9, 0.0
    for k in range(low.shape[0]):
        if high[k] > low[k]:
            bottom, top = min(bottom, low[k]), max(top, high[k])
    if not top > bottom:
        return 0
    if shape[FACE_HEIGHT] == 0.0:
        many[0] = 1 if slope < 0.0 else 0  # a flat end cuts going down only
    return divide(shape, max(bottom, 0.0), top, many, elements, pairs)


@compiled
def _coarseness(low, high):  # type: ignore[no-untyped-def]
    """Factor on the spacing of the tip angles over the finest: short arcs pass quickly."""
    arc = 0
    for k in range(low.shape[0]):
        arc += high[k] > low[k]
    if 12 * arc <= low.shape[0]:
        return 1
    return 2 if 6 * arc <= low.shape[0] else FINEST


@compiled
def _without_runout(pieces, law, exponent, cut, edge):  # type: ignore[no-untyped-def]
    """Add the cutting part for a feed of 1 and the edge part of one tooth's forces."""
    for i in range(pieces.shape[0]):
        one = pieces[i]
        h = one[CHIP] if exponent == 1.0 else one[CHIP] ** exponent
        area, width = h * one[WIDTH], one[WIDTH]
        _add(one, area * law[0], area * law[1], area * law[2], cut)
        _add(one, width * law[3], width * law[4], width * law[5], edge)


@compiled
def _with_runout(pieces, law, exponent, feeds, runout, differences, a, forces):  # type: ignore[no-untyped-def]
    """Add the forces of each tooth at each feed, where the spindle is when its tip is there."""
    teeth, angles, last = differences.shape[0], forces.shape[1], feeds.shape[0] - 1
    for k in range(last + 1):
        f_z = max(feeds[k], 1e-6 * feeds[last])
        for j in range(teeth):
            out = forces[k, (a + j * (angles // teeth)) % angles]
            for i in range(pieces.shape[0]):
                one = pieces[i]
                h = piece_chip(one, f_z, runout, differences[j])
                if h > 0.0:
                    width = one[WIDTH]
                    area = width * (h if exponent == 1.0 else h**exponent)
                    _add(one, area * law[0] + width * law[3], area * law[1] + width * law[4],
                         area * law[2] + width * law[5], out)  # fmt: skip


@compiled
def _add(one, tangential, radial, axial, out):  # type: ignore[no-untyped-def]
    s, c, sk, ck = one[SINE], one[COSINE], one[SIN_KAPPA], one[COS_KAPPA]
    across = radial * sk + axial * ck
    out[0] -= tangential * c + across * s
    out[1] += tangential * s - across * c
    out[2] += axial * sk - radial * ck
    out[3] += tangential * one[ARM]


@compiled
def _reduce(cut, edge, u, share, rows, out):  # type: ignore[no-untyped-def]
    """Fill loads and mean force of ``u`` times the cutting and ``share`` times the edge part."""
    peak, mean, total, axial, torque, peak_torque = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    out[FORCE:] = 0.0
    for a in range(rows):
        x = u * cut[a, 0] + share * edge[a, 0]
        y = u * cut[a, 1] + share * edge[a, 1]
        square = x * x + y * y
        moment = u * cut[a, 3] + share * edge[a, 3]
        peak = max(peak, square)
        mean += sqrt(square)
        total += square
        torque += moment
        axial = max(axial, abs(u * cut[a, 2] + share * edge[a, 2]))
        peak_torque = max(peak_torque, moment)
        for axis in range(3):
            component = u * cut[a, axis] + share * edge[a, axis]
            out[FORCE + axis] += component / rows
            out[FORCE + 3 + axis] += component * component / rows
    for q in range(FORCE, FORCE + 3):
        out[q + 3] = sqrt(max(out[q + 3] - out[q] * out[q], 0.0))
    out[PEAK], out[MEAN], out[RMS] = sqrt(peak), mean / rows, sqrt(total / rows)
    if out[PEAK] < BALANCED * peak_torque:
        out[PEAK], out[MEAN], out[RMS] = 0.0, 0.0, 0.0
    out[AXIAL], out[TORQUE], out[PEAK_TORQUE] = axial, torque / rows, peak_torque


@compiled
def look_up(f_z, values, scale, exponent, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P, M) from ``values`` of (M, K + 1) at feeds of (P, M).

    ``scale`` and ``exponent`` of shape (M,) give u = scale f_z^exponent, in its unit.
    """
    last = values.shape[1] - 2.0
    for p in range(f_z.shape[0]):
        for m in range(f_z.shape[1]):
            feed = f_z[p, m]
            if feed <= 0.0:
                out[p, m] = 0.0
                continue
            u = scale[m] * (feed if exponent[m] == 1.0 else feed ** exponent[m])
            k = int(min(sqrt(u), last)) if u >= 0.0 else 0
            share = (u - k * k) / (2 * k + 1)
            out[p, m] = values[m, k] + share * (values[m, k + 1] - values[m, k])
