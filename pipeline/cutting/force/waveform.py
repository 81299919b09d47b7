"""Milling force waveform over the spindle angle: helix, runout, corner radius.

Frame (Altintas, *Manufacturing Automation*, 2nd ed. 2012, section 2.7): x along the feed, y to the
left of it, z up along the axis; phi as in :mod:`pipeline.cutting.engagement.engagement`.  F_x and
F_y are on the tool, F_z is as on the workpiece.  With M3

    F_x = sum(-F_t cos(phi) - (F_r sin(kappa) + F_a cos(kappa)) sin(phi))
    F_y = sum( F_t sin(phi) - (F_r sin(kappa) + F_a cos(kappa)) cos(phi))
    F_z = sum( F_a sin(kappa) - F_r cos(kappa))

so that F_z = sum F_a on the side of the tool (his eq. 2.40): positive pulls the tool out of its
spindle and lifts the workpiece, as a right-hand helix with K_ac > 0 does; the thrust of a plunge is
negative.  It is minus that of Engin and Altintas 2001 on the tool, whose coefficients hold as they
are.  Spindle angle theta is where tooth 0 has its tip; tooth
j follows j pitches later, and at a height z above the tip

    phi = theta - 2 pi j / N - z tan(helix) / R.

Runout moves the tool's axis parallel to the spindle's: a tooth's edge is r_j = runout
cos(runout_angle + 2 pi j / N + z tan(helix) / R) farther out, and its chip is the material between
it and the surfaces of the last N teeth, min over m of m f_z sin(phi) + r_j - r_(j-m), never below
0 (Kline and DeVor 1983).  Teeth move on circles, not trochoids: an error of order f_z / R.

The side is a cylinder, so that six sums give all forces under constant engagement: of h cos(phi),
h sin(phi), h, cos(phi), sin(phi) and 1 over the edge in the material.  The edge is divided into
equal slices, each integrated at two Gauss points.  Where the chip ends within a slice only the part
with a chip counts, so that the forces change without jumps when runout or helix do.  Faces and
corners are integrated in the same slices, force by force.
"""

from math import ceil, cos, floor, sin

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.engagement.end_rings import whole_ring
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
    bin_middles,
    cut_part,
    edge_elements,
    edge_shape,
    grown,
    motion,
    piece_buffer,
    place_pair,
    radius_differences,
    thickness,
)
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.profile_kernel import TURN, profile_forces
from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats

SLICES = 16
"""Number of slices of the corner and of the side each, with two Gauss points in each."""


def basis(
    tool: Tool, *, f_z: float, a_p: float, phi_st: float, phi_ex: float, angles: ArrayLike,
    m_c: float = 0.0, growth: float = 0.0, slices: int = SLICES,
) -> Floats:  # fmt: skip
    """Forces and torque per coefficient of the law, under constant engagement; shape (T, 4, 6).

    Rows are F_x, F_y, F_z as on the workpiece, and the torque that the cut takes; columns K_tc,
    K_rc, K_ac, K_te, K_re, K_ae: [m^2] or [m] with ``m_c = 0``, [m] times those of the torque.
    Teeth are in the material from ``phi_st`` to ``phi_ex``, 0 to pi [rad], at all heights up to
    ``a_p`` [m]; no forces where the feed per tooth ``f_z`` [m] is 0 or below.  ``angles`` (T,) are
    the spindle's [rad], ``m_c`` the exponent of the chip thickness [1], ``growth`` the thickness
    over which the edge part grows, as 1 - exp(-h / growth) [m]; 0: at once, below 0: along a
    straight line up to -growth.

    Errors are those of slices of length d [rad of lag].  Without runout each has d^4 / 4320 of its
    force: with m_c = 0 and 16 slices below 1e-7 of the greatest force in all where the lag of the
    edge's end is a radian, 6e-6 where it is 4.  With m_c = 0.25 the power of a chip that begins or
    ends with nothing is not smooth: 2.5e-5 at 0.8 rad, 1.6e-4 at 4 rad.  With runout a slice where
    a tooth begins to miss its chip errs by d^2 / 12 or so: 16 slices over 1.7 rad or less leave
    below 0.7 % of the edge part (0.1 % in RMS) and 0.07 % of the cutting part.  Without helix and
    corner there is nothing to divide.

    Examples
    --------
    >>> tool = Tool(kind="flat", diameter_mm=6.0, flutes=2)
    >>> design = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=0.0, phi_ex=np.pi, angles=[np.pi / 2])
    >>> np.round(design[0] * [1e8, 1e8, 1e8, 1e3, 1e3, 1e3], 6)[1].tolist()
    [5.0, -0.0, 0.0, 1.0, -0.0, 0.0]
    """
    theta = np.ascontiguousarray(angles, dtype=np.float64)
    out = np.zeros((len(theta), 4, 6))
    if not (f_z > 0 and a_p > 0 and phi_ex > phi_st):
        return out
    args = (f_z, tool.runout, 1.0 - m_c, growth, radius_differences(tool))
    shape = edge_shape(tool)
    bottom = max(tool.corner_radius, shape[FACE_HEIGHT])
    many, lag = slices if tool.helix else 1, shape[LAG]
    if bottom > 0.0:
        elements, pairs = edge_elements(tool, (0.0, a_p), corner=slices, side=0)
        window_forces(theta, phi_st, phi_ex, shape, elements, pairs, *args, np.empty((2, 5)), out)
    if a_p > bottom:
        side_forces(theta, phi_st, phi_ex, a_p - bottom, tool.radius,
                    lag * (bottom - shape[FACE_HEIGHT]), lag * (a_p - bottom) / many, *args,
                    np.empty((many, 4)), np.empty(6), out)  # fmt: skip
    return out


def profile_basis(
    tool: Tool, *, f_z: float, lower: ArrayLike, upper: ArrayLike, angles: ArrayLike,
    m_c: float = 0.0, slope: float = 0.0, slices: int = 2 * SLICES,
    ring: tuple[Floats, Floats] | None = None,
) -> Floats:  # fmt: skip
    """Forces and torque per coefficient at one station, shape (T, 4, 6); units as :func:`basis`.

    ``lower`` and ``upper`` (F,) are the part in the material, as heights above the tip [m] at the
    angles (k + 1/2) 2 pi / F; a value holds over its whole bin of angle.  ``slope`` is dz / ds of
    the motion, from -1 (plunge) to 1; ``slices`` of the edge's corner and of its side are divided
    by bins as well; ``ring`` are inner and outer radii of the part of a flat end that has material
    below at each angle, (F,) each [m], all of it by default.
    """
    theta = np.ascontiguousarray(angles, dtype=np.float64)
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    out = np.zeros((len(theta), 4, 6))
    there = high > low
    if f_z > 0 and there.any():
        depth = (max(float(low[there].min()), 0.0), float(high[there].max()))
        side = slices if tool.helix else 1
        elements, _ = edge_elements(tool, depth, corner=slices, side=side, slope=slope)
        shape = edge_shape(tool)
        profile_forces(theta, low, high, *(ring or whole_ring(len(low))), shape, elements,
                       motion(f_z, slope), tool.runout, 1.0 - m_c, radius_differences(tool),
                       bin_middles(len(low)),
                       piece_buffer(len(elements), shape, depth[1], len(low)), out)  # fmt: skip
    return out


def profile_waveform(
    law: ForceLaw, tool: Tool, *, f_z: float, lower: ArrayLike, upper: ArrayLike, angles: ArrayLike,
    slope: float = 0.0, slices: int = 2 * SLICES, ring: tuple[Floats, Floats] | None = None,
) -> Floats:  # fmt: skip
    """F_x, F_y, F_z [N] and torque [N m] at one station, (T, 4); as :func:`profile_basis`."""
    each = profile_basis(
        tool, f_z=f_z, lower=lower, upper=upper, angles=angles, m_c=law.m_c, slope=slope,
        slices=slices, ring=ring,
    )  # fmt: skip
    return each @ law.constants


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
    angles, phi_st, phi_ex, shape, elements, pairs, f_z, runout, exponent, growth, differences,
    work, out,
):  # fmt: skip
    """Add forces of face and corner, engaged from ``phi_st`` to ``phi_ex``, to ``out``.

    Rows and columns as :func:`side_forces`.  ``pairs`` of shape (n, 2, 5) are the Gauss points of
    the elements, ``work`` of (2, 5) is to work in.
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
                    _element(low, high, sine, cosine, shape, elements[e], pairs[e], f_z, runout,
                             exponent, growth, differences[j], work, out[t])  # fmt: skip


@compiled
def _element(  # type: ignore[no-untyped-def]
    low, high, sine, cosine, shape, one, pair, f_z, runout, exponent, growth, differences, work,
    out,
):  # fmt: skip
    """Add what one element of one tooth has between two lags, as far as it has a chip."""
    begin, end = min(one[LAG_FROM], one[LAG_TO]), max(one[LAG_FROM], one[LAG_TO])
    if begin == end:
        if not low < begin <= high:
            return
    elif begin >= high or end <= low:
        return
    p, p_end = one[FROM], one[TO]
    if begin < low or end > high:
        z = max(begin, low) / shape[LAG] + shape[FACE_HEIGHT]
        z_end = min(end, high) / shape[LAG] + shape[FACE_HEIGHT]
        p, p_end = along(one[PART], z, shape), along(one[PART], z_end, shape)
        if p > p_end:
            p, p_end = p_end, p
        place_pair(one[PART], p, p_end, shape, work)
        pair = work
    _stretch(sine, cosine, one[PART], p, p_end, shape, pair, f_z, runout, exponent, growth,
             differences, work, out)  # fmt: skip


@compiled
def _stretch(  # type: ignore[no-untyped-def]
    sine, cosine, part, begin, end, shape, pair, f_z, runout, exponent, growth, differences,
    work, out,
):  # fmt: skip
    """Add the force on a stretch of one tooth's edge, as far as it has a chip."""
    h = _chip(sine, cosine, pair[0], f_z, runout, differences)
    after = _chip(sine, cosine, pair[1], f_z, runout, differences)
    start, stop = cut_part(begin, end, h, after)
    if not stop > start:
        return
    if start > begin or stop < end:
        begin, end = start, stop
        place_pair(part, begin, end, shape, work)
        pair = work
        h = max(_chip(sine, cosine, pair[0], f_z, runout, differences), 0.0)
        after = max(_chip(sine, cosine, pair[1], f_z, runout, differences), 0.0)
    for k in range(2):
        point, thick = pair[k], h if k == 0 else after
        s = sine * point[COS_LAG] - cosine * point[SIN_LAG]
        c = cosine * point[COS_LAG] + sine * point[SIN_LAG]
        add_force(s, c, point[SIN_KAPPA], point[COS_KAPPA], point[ARM], thick,
                  0.5 * (end - begin), exponent, growth, out)  # fmt: skip


@compiled
def _chip(sine, cosine, point, f_z, runout, differences):  # type: ignore[no-untyped-def]
    """Thickness of the chip at a point of the edge [m], below 0 where the tooth misses."""
    sk, cl, sl = point[SIN_KAPPA], point[COS_LAG], point[SIN_LAG]
    each = f_z * ((sine * cl - cosine * sl) * sk)
    return thickness(each, sk * cl, sk * sl, sk * runout, differences)
