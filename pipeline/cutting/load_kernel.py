"""Loads of many stations over the feed for each tooth, and their look-up, compiled.

Forces of one tooth are added for all teeth by shifting them by pitches, so that the tip's angles
are a multiple of the number of teeth.  Without runout they are affine in u = f_z^(1 - m_c), a
cutting part times u and an edge part, and are computed once for all feeds.
"""

from math import pi, sqrt

from pipeline.cutting.edge_kernel import FACE_HEIGHT, divide
from pipeline.cutting.profile_kernel import (
    ARM,
    CHIP,
    COS_KAPPA,
    COSINE,
    SIN_KAPPA,
    SINE,
    WIDTH,
    edge_pieces,
    piece_chip,
)
from pipeline.kernels import compiled

FINEST = 4
"""How many times more angles of the tip arcs below 30 degrees have than those above 60."""
PEAK, MEAN, RMS, AXIAL, TORQUE, PEAK_TORQUE = range(6)


@compiled
def station_loads(  # type: ignore[no-untyped-def]
    lower, upper, slope, shape, law, exponent, feeds, runout, differences, many, elements, pairs,
    motion, middles, pieces, forces, out,
):  # fmt: skip
    """Fill ``out`` of shape (S, K + 1, 6), the loads of S stations at K feeds and beyond.

    Feeds are those where u is 0, 1, 4, 9, ... of its unit; 0 stands for a feed just above it.  The
    last row goes on from the one before as fast as loads can rise with u.  ``lower`` and ``upper``
    have shape (S, F), ``slope`` (S,), ``law`` (6,), ``feeds`` (K,) [m]; ``forces`` of shape
    (K + 2, A, 4) is for the angles of the tip, A a multiple of FINEST times the teeth; ``many``,
    ``elements`` and ``pairs`` as :func:`pipeline.cutting.edge_kernel.divide`, ``motion`` of (3,),
    ``middles`` and ``pieces`` as :func:`pipeline.cutting.profile_kernel.edge_pieces`.
    """
    last = feeds.shape[0] - 1
    unit = feeds[last] ** exponent / last**2
    cut, edge = forces[last + 1], forces[last + 2]
    for station in range(lower.shape[0]):
        low, high, row = lower[station], upper[station], out[station]
        n = _divided(low, high, slope[station], shape, many, elements, pairs)
        row[:] = 0.0
        if n == 0:
            continue
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
            m = edge_pieces(tip, low, high, shape, elements[:n], motion, middles, pieces)
            _without_runout(pieces[:m], law, exponent, cut[a % pitch], edge[a % pitch])
            if runout > 0.0:
                _with_runout(pieces[:m], law, exponent, feeds, runout, differences, a,
                             forces[:, :angles])  # fmt: skip
        _reduce(cut, edge, 1.0, 0.0, pitch, row[last + 1])
        for k in range(last + 1):
            if runout > 0.0:
                _reduce(forces[k], edge, 1.0, 0.0, angles, row[k])
            else:
                _reduce(cut, edge, k * k * unit, 1.0, pitch, row[k])
        for q in range(6):
            rise = max(row[last + 1, q] * unit, (row[last, q] - row[last - 1, q]) / (2 * last - 1))
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
        many[0] = 1 if slope < 0.0 else 0  # a flat end cuts on its way down only
    return divide(shape, max(bottom, 0.0), top, many, elements, pairs)


@compiled
def _coarseness(low, high):  # type: ignore[no-untyped-def]
    """By how much the tip's angles may be coarser than the finest: short arcs pass quickly."""
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
    """Fill the six loads of ``u`` times the cutting part and ``share`` times the edge part."""
    peak, mean, total, axial, torque, peak_torque = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
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
    out[PEAK], out[MEAN], out[RMS] = sqrt(peak), mean / rows, sqrt(total / rows)
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
