"""Closed forms of milling that other results are held against: force, torque, speed.

The zero-helix model is that of Sim2023 (one coefficient K_t and the ratio K_e of radial to
tangential force); frame and angles are those of :mod:`pipeline.cutting.force.waveform`.
"""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.material import Taylor
from pipeline.cutting.force import waveform as product
from pipeline.cutting.force.force_law import ForceLaw, regressors
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE


def immersion(a_e: ArrayLike, D: ArrayLike, side: str) -> tuple[Floats, Floats]:
    """Angles where a tooth enters and leaves [rad], of a cut "up", "down" or in a "slot"."""
    angle = np.arccos(1 - 2 * np.asarray(a_e, dtype=np.float64) / D)
    return (np.pi - angle, np.full_like(angle, np.pi)) if side == "down" else (angle * 0, angle)


def edge_forces(law: ForceLaw, h: ArrayLike) -> Floats:
    """Tangential, radial, axial force for each width of a chip h [m] thick [N/m]; 0 without one.

    Shape (3,) + shape of ``h``.
    """
    thickness = np.maximum(np.asarray(h, dtype=np.float64), 0.0)
    there = thickness > 0.0
    power = np.where(there, thickness ** (1.0 - law.m_c), 0.0)
    one = (3,) + (1,) * thickness.ndim
    forces: Floats = law.cutting.reshape(one) * power + law.edge.reshape(one) * there
    return forces


def in_plane_forces(
    theta: ArrayLike, *, flutes: int, f_z: float, d: float, K_t: float, K_e: float,
    phi_st: float = 0.0, phi_ex: float = np.pi,
) -> Floats:  # fmt: skip
    """F_x and F_y on a tool without helix and runout, fed along x [N]; shape of ``theta`` + (2,).

    F_t = K_t d h and F_r = K_e F_t with h = f_z sin(phi), 0 at least.
    """
    tip = np.asarray(theta, dtype=np.float64)[..., None]
    phi = (tip - 2 * np.pi / flutes * np.arange(flutes)) % (2 * np.pi)
    within = (phi - phi_st) % (2 * np.pi) < phi_ex - phi_st
    tangential = K_t * d * np.maximum(f_z * np.sin(phi), 0.0) * within
    radial = K_e * tangential
    along = -tangential * np.cos(phi) - radial * np.sin(phi)
    across = tangential * np.sin(phi) - radial * np.cos(phi)
    return np.stack([along.sum(axis=-1), across.sum(axis=-1)], axis=-1)


def slot_peak_load(K_t: ArrayLike, K_e: ArrayLike, d: ArrayLike, f_z: ArrayLike) -> Floats:
    """K_t d f_z sqrt(1 + K_e^2) [N]: the peak in a slot, of one or two teeth without helix."""
    return cast(Floats, np.asarray(K_t) * np.asarray(d) * np.asarray(f_z) * np.hypot(1.0, K_e))


def mean_forces(
    law: ForceLaw, *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike,
    phi_ex: ArrayLike,
) -> Floats:  # fmt: skip
    """Mean F_x, F_y, F_z over a revolution [N]; shape (..., 3).

    F_z is as on the workpiece, the others are on the tool.  Parameters are those of
    :func:`regressors`.
    """
    design = regressors(flutes=flutes, f_z=f_z, a_p=a_p, phi_st=phi_st, phi_ex=phi_ex)
    return cast(Floats, design @ law.constants)


def mean_torque(
    law: ForceLaw, *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike,
    phi_ex: ArrayLike, radius: ArrayLike,
) -> Floats:  # fmt: skip
    """Mean torque that the cut takes [N m]; ``radius`` is the tool's [m], else as `regressors`.

    N a_p R / (2 pi) (K_tc f_z (cos phi_st - cos phi_ex) + K_te (phi_ex - phi_st)): times the
    angular speed it is K_tc MRR and the power of the edges' friction.
    """
    teeth, feed, depth, entry, leave = np.broadcast_arrays(flutes, f_z, a_p, phi_st, phi_ex)
    each = law.K_tc * feed * (np.cos(entry) - np.cos(leave)) + law.K_te * (leave - entry)
    return cast(Floats, teeth * depth * np.asarray(radius) / (2 * np.pi) * each * (feed > 0))


def speed_for_life(taylor: Taylor, lasting: ArrayLike) -> Floats:
    """Cutting speed [m/s] at which a tool lasts ``lasting`` [s], at the reference conditions."""
    with np.errstate(divide="ignore"):  # without end for a tool that need not last
        return cast(Floats, taylor.C * (np.asarray(lasting) / MINUTE) ** -taylor.n)


def minimum_cost_speed(taylor: Taylor, change_time: float, life_price: float, rate: float) -> float:
    """Cutting speed that makes the cheapest part [m/s] (Gilbert 1950).

    The tool then lasts (1/n - 1) (T_c + P_t / r): T_c to change a worn tool [s], P_t the cost of
    one life of a tool, r that of machine and operator [1/s].
    """
    return float(speed_for_life(taylor, (1.0 / taylor.n - 1.0) * (change_time + life_price / rate)))


def basis(tool: Tool, **cut: Any) -> Floats:
    """Forces without the torque for each coefficient; shape (T, 3, 6)."""
    return product.basis(tool, **cut)[:, :3]


def torque_basis(tool: Tool, **cut: Any) -> Floats:
    """Torque that the cut takes for each coefficient; shape (T, 6)."""
    return product.basis(tool, **cut)[:, 3]


def waveform(law: ForceLaw, tool: Tool, **cut: Any) -> Floats:
    """F_x, F_y, F_z [N] under constant engagement; shape (T, 3), as `basis`."""
    return basis(tool, m_c=law.m_c, **cut) @ law.constants


def meridian(tool: Tool, low: float, high: float, discs: int):
    """Heights, angle kappa, distances from the axis, lags and widths of the edge of discs."""
    z = np.linspace(low, high, discs + 1)
    corner = tool.corner_radius
    kappa, length = np.full(discs + 1, np.pi / 2), z
    if corner:
        kappa = np.arccos(1 - np.minimum(z, corner) / corner)
        length = corner * kappa + np.maximum(z - corner, 0)
    z, kappa = (z[1:] + z[:-1]) / 2, (kappa[1:] + kappa[:-1]) / 2
    lag = z * np.tan(tool.helix) / tool.radius
    return z, kappa, tool.radius - corner * (1 - np.sin(kappa)), lag, np.diff(length)


def face(tool: Tool, discs: int):
    """The same of an end's face, which has no lag: the lips of a drill, the flat of other tools."""
    half = tool.point_angle / 2 if tool.kind == "drill" else np.pi / 2
    reach = tool.radius - tool.corner_radius
    radius = (np.arange(discs) + 0.5) * (reach / discs)
    each = np.ones(discs)
    height = radius / np.tan(half) if tool.kind == "drill" else 0 * each
    width = reach / discs / np.sin(half)
    return height, (np.pi / 2 - half) * each, radius, 0 * each, width * each


def point_height(tool: Tool) -> float:
    """Height of a drill's point [m]; 0 of other tools."""
    return tool.radius / np.tan(tool.point_angle / 2) if tool.kind == "drill" else 0.0


def plain_forces(
    law: ForceLaw, tool: Tool, f_z: float, low: float, high: float, inside, angles, discs=2000,
    slope: float = 0.0,
):  # fmt: skip
    """F_x, F_y, F_z and torque at angles; ``inside(phi, z)`` says where there is material.

    On a slope the end's face cuts too: a flat one on its way down alone.
    """
    point = point_height(tool)
    z, kappa, radius, lag, b = meridian(tool, max(low, point), max(high, point), discs)
    if slope or point:
        tip = face(tool, discs)
        lag = lag - point * np.tan(tool.helix) / tool.radius
        z, kappa, radius, lag, b = (
            np.append(one, of) for one, of in zip(tip, (z, kappa, radius, lag, b), strict=True)
        )
    ahead, down = f_z * np.sqrt(1 - slope**2) * np.sin(kappa), -f_z * slope * np.cos(kappa)
    teeth = tool.flutes

    def offset(tooth):
        """How far a tooth stands out of the others."""
        pitch = 2 * np.pi / teeth
        return tool.runout * np.cos(tool.runout_angle + pitch * (tooth % teeth) + lag)

    out = np.zeros((len(angles), 4))
    for row, theta in enumerate(angles):
        for j in range(teeth):
            phi = theta - 2 * np.pi * j / teeth - lag
            # along the normal of the envelope, from this tooth to where those before it were
            step = ahead * np.sin(phi) + down
            out_of = np.sin(kappa) * offset(j)
            surfaces = [np.sin(kappa) * offset(j - m) - m * step for m in range(1, teeth + 1)]
            h = out_of - np.max(surfaces, axis=0)
            h[(step <= 1e-9 * f_z) | ~inside(phi % (2 * np.pi), z)] = 0.0
            tangential, radial, axial = edge_forces(law, h) * b
            # from the workpiece into the axis, down the meridian, and against the motion
            outward = radial * np.sin(kappa) + axial * np.cos(kappa)
            out[row, 0] += np.sum(-tangential * np.cos(phi) - outward * np.sin(phi))
            out[row, 1] += np.sum(tangential * np.sin(phi) - outward * np.cos(phi))
            out[row, 2] += np.sum(axial * np.sin(kappa) - radial * np.cos(kappa))
            out[row, 3] += np.sum(tangential * radius)
    return out
