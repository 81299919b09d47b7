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
"""

from math import floor, pi
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.engagement.end_rings import whole_ring
from pipeline.cutting.force.edge import (
    bin_middles,
    edge_elements,
    edge_shape,
    motion,
    piece_buffer,
    radius_differences,
)
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats

SLICES = 16
"""Number of slices of the corner and of the side each, with two Gauss points in each."""


def basis(
    tool: Tool, *, f_z: float, a_p: float, phi_st: float, phi_ex: float, angles: ArrayLike,
    m_c: float = 0.0, growth: float = 0.0, slope: float = 0.0, slices: int = SLICES,
) -> Floats:  # fmt: skip
    """Forces per coefficient of the law, under constant engagement; F_z as on the workpiece.

    Errors are those of slices of length d [rad of lag].  Without runout each has d^4 / 4320 of its
    force: with m_c = 0 and 16 slices below 1e-7 of the greatest force in all where the lag of the
    edge's end is a radian, 6e-6 where it is 4.  With m_c = 0.25 the power of a chip that begins or
    ends with nothing is not smooth: 2.5e-5 at 0.8 rad, 1.6e-4 at 4 rad.  With runout a slice where
    a tooth begins to miss its chip errs by d^2 / 12 or so: 16 slices over 1.7 rad or less leave
    below 0.7 % of the edge part (0.1 % in RMS) and 0.07 % of the cutting part.  Without helix and
    corner there is nothing to divide.  ValueError when a value is not finite or out of its range.

    Parameters
    ----------
    tool : Tool
        Tool with helix, runout and form.
    f_z : float
        Feed per tooth [m]; no forces where it is 0 or below.
    a_p : float
        Axial depth of cut [m].
    phi_st, phi_ex : float
        Entry and exit angle [rad], at most 2 pi apart, the same at all heights.
    angles : array_like, shape (T,)
        Spindle angles [rad].
    m_c : float
        Exponent of the chip thickness [1].
    growth : float
        Thickness over which the edge part grows, as 1 - exp(-h / growth) [m]; 0: at once, below 0:
        along a straight line up to -growth.
    slope : float
        dz / ds of the motion, from -1 (plunge) to 1.
    slices : int
        Slices of the edge's corner and of its side.

    Returns
    -------
    ndarray, shape (T, 3, 6)
        F_x, F_y, F_z for K_tc, K_rc, K_ac, K_te, K_re, K_ae: [m^2] or [m] with ``m_c = 0``.

    Examples
    --------
    >>> tool = Tool(kind="flat", diameter_mm=6.0, flutes=2)
    >>> design = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=0.0, phi_ex=np.pi, angles=[np.pi / 2])
    >>> np.round(design[0] * [1e8, 1e8, 1e8, 1e3, 1e3, 1e3], 6)[1].tolist()
    [5.0, -0.0, 0.0, 1.0, -0.0, 0.0]
    """
    each = _window(
        tool, angles, f_z=f_z, a_p=a_p, phi_st=phi_st, phi_ex=phi_ex, m_c=m_c, slope=slope,
        slices=slices, growth=growth,
    )  # fmt: skip
    return each[:, :3]


def profile_basis(
    tool: Tool, *, f_z: float, lower: ArrayLike, upper: ArrayLike, angles: ArrayLike,
    m_c: float = 0.0, slope: float = 0.0, slices: int = 2 * SLICES,
    ring: tuple[Floats, Floats] | None = None,
) -> Floats:  # fmt: skip
    """Forces and torque per coefficient at one station, shape (T, 4, 6); units as :func:`basis`.

    ValueError when a value is not finite or out of its range.

    Parameters
    ----------
    tool, f_z, angles, m_c, slope
        Parameters of :func:`basis`.
    lower, upper : array_like, shape (F,)
        Part in the material, as heights above the tip [m] at the angles (k + 1/2) 2 pi / F; a
        value holds over its whole bin of angle.
    slices : int
        Slices of the edge's corner and of its side, divided by bins as well.
    ring : tuple of ndarray, optional
        Inner and outer radii of the part of a flat end that has material below at each angle, two
        of shape (F,) [m]; all of it by default.
    """
    from pipeline.cutting.force.profile_kernel import profile_forces

    _check(f_z, m_c, slope, slices)
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if low.shape != high.shape or low.ndim != 1 or not len(low):
        raise ValueError(
            f"waveform: lower has shape {low.shape}, upper {high.shape}: give both one height for "
            "each bin of angle"
        )
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError("waveform: a height of the profile is not finite")
    theta = _angles(angles)
    out = np.zeros((len(theta), 4, 6))
    there = high > low
    if f_z > 0 and there.any():
        depth = (max(float(low[there].min()), 0.0), float(high[there].max()))
        elements, _ = edge_elements(tool, depth, slope=slope, slices=slices)
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
    return cast(Floats, each @ np.concatenate([law.cutting, law.edge]))


def _window(
    tool: Tool, angles: ArrayLike, *, f_z: float, a_p: float, phi_st: float, phi_ex: float,
    m_c: float, slope: float, slices: int, growth: float = 0.0,
) -> Floats:  # fmt: skip
    """Forces and torque for each coefficient under constant engagement; shape (T, 4, 6)."""
    from pipeline.cutting.force.edge import FACE_HEIGHT, LAG
    from pipeline.cutting.force.waveform_kernel import side_forces, window_forces

    _check(f_z, m_c, slope, slices)
    if not (np.isfinite(a_p) and a_p >= 0):
        raise ValueError(f"waveform: a_p = {a_p} must be finite and at least 0")
    if not 0.0 <= phi_ex - phi_st <= 2 * np.pi + 1e-12:
        raise ValueError(
            f"waveform: phi_st = {phi_st} to phi_ex = {phi_ex} must be 0 to 2 pi rad long"
        )
    theta = _angles(angles)
    out = np.zeros((len(theta), 4, 6))
    if not (f_z > 0 and a_p > 0):
        return out
    args = (motion(f_z, slope), tool.runout, 1.0 - m_c, growth, radius_differences(tool))
    shape = edge_shape(tool)
    bottom = max(tool.corner_radius, shape[FACE_HEIGHT])
    many, lag = slices if tool.helix else 1, shape[LAG]
    for enter, leave in _windows(phi_st, phi_ex, slope):
        if bottom > 0.0 or slope < 0.0:
            elements, pairs = edge_elements(
                tool, (0.0, a_p), slope=slope, slices=slices, side=False
            )
            window_forces(theta, enter, leave, shape, elements, pairs, *args, np.empty((2, 5)),
                          out)  # fmt: skip
        if a_p > bottom and slope > -1.0:
            side_forces(theta, enter, leave, a_p - bottom, tool.radius,
                        lag * (bottom - shape[FACE_HEIGHT]), lag * (a_p - bottom) / many,
                        f_z * np.sqrt(1.0 - slope**2), *args[1:], np.empty((many, 4)), np.empty(6),
                        out)  # fmt: skip
    return out


def _windows(phi_st: float, phi_ex: float, slope: float) -> list[tuple[float, float]]:
    """Arcs where teeth may have a chip: from 0 to pi of each turn, on a slope anywhere."""
    arcs = [(phi_st, phi_ex)]
    if slope == 0.0:  # as mean_force.cutting_arcs, which is for many at once
        zero = 2 * pi * floor(phi_st / (2 * pi))
        arcs = [(max(phi_st - z, 0.0), min(phi_ex - z, pi)) for z in (zero, zero + 2 * pi)]
    return [(begin, end) for begin, end in arcs if end > begin]


def _check(f_z: float, m_c: float, slope: float, slices: int) -> None:
    if not np.isfinite(f_z):
        raise ValueError(f"waveform: f_z = {f_z} must be finite")
    if not 0.0 <= m_c < 1.0:
        raise ValueError(f"waveform: m_c = {m_c} is out of its range, 0 to below 1")
    if not -1.0 <= slope <= 1.0:
        raise ValueError(f"waveform: slope = {slope} must be from -1 to 1: it is dz / ds")
    if not (slices >= 1 and slices % 1 == 0):
        raise ValueError(f"waveform: slices = {slices} must be a whole number of at least 1")


def _angles(angles: ArrayLike) -> Floats:
    theta = np.ascontiguousarray(angles, dtype=np.float64)
    if theta.ndim != 1 or not np.isfinite(theta).all():
        raise ValueError("waveform: angles must be a row of finite values [rad]")
    return theta
