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
