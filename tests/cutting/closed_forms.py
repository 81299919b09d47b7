"""Closed forms of milling that other results are held against: chip, force, torque, speed.

The zero-helix model is that of Sim2023 (one coefficient K_t and the ratio K_e of radial to
tangential force); frame and angles are those of :mod:`pipeline.cutting.force.waveform`.
"""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.tool_life import Taylor
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.mean_force import cutting_arcs, regressors
from pipeline.cutting.force.waveform import SLICES, _window, basis
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE


def thickness(f_z: ArrayLike, phi: ArrayLike, *, kappa: ArrayLike = np.pi / 2) -> Floats:
    """Thickness h = f_z sin(phi) sin(kappa) [m], 0 where the tooth moves away from the material.

    Parameters
    ----------
    f_z : array_like
        Feed for each tooth [m].
    phi : array_like
        Where the tooth is [rad].
    kappa : array_like
        Lead angle kappa_r of the edge [rad], 90 degrees on the side of an end mill.
    """
    h = np.asarray(f_z, dtype=np.float64) * np.sin(phi) * np.sin(kappa)
    return cast(Floats, np.maximum(h, 0.0))


def width(a_p: ArrayLike, *, kappa: ArrayLike = np.pi / 2) -> Floats:
    """Width b = a_p / sin(kappa): length of the edge in the material [m], without helix."""
    return np.asarray(a_p, dtype=np.float64) / np.sin(kappa)


def swept_angle(a_e: ArrayLike, D: ArrayLike) -> Floats:
    """phi_s = acos(1 - 2 a_e / D), over which a tooth at the side is in the material [rad]."""
    return np.arccos(1 - 2 * np.asarray(a_e, dtype=np.float64) / D)


def immersion(a_e: ArrayLike, D: ArrayLike, side: str) -> tuple[Floats, Floats]:
    """Angles where a tooth enters and leaves [rad], of a cut "up", "down" or in a "slot"."""
    angle = swept_angle(a_e, D)
    return (np.pi - angle, np.full_like(angle, np.pi)) if side == "down" else (angle * 0, angle)


def mean_thickness(
    f_z: ArrayLike, a_e: ArrayLike, D: ArrayLike, *, kappa: ArrayLike = np.pi / 2
) -> Floats:
    """h_m = f_z (2 a_e / D) sin(kappa) / phi_s [m], the mean over the angle in the material.

    Cut at the tool's side (up, down or slot).  Twin2026 prints f_z a_e / D, which is for another
    angle: phi_s / 2 times the true mean, 0.23 of it at a_e = 0.05 D and 1.57 in a slot.  With
    m_c = 0.25 that is 0.33 and 1.40 times the force.
    """
    angle = swept_angle(a_e, D)
    share = 1 - np.cos(angle)
    with np.errstate(invalid="ignore"):
        mean = np.where(angle > 0, share / np.where(angle > 0, angle, 1.0), 0.0)
    return np.asarray(f_z, dtype=np.float64) * np.sin(kappa) * mean


def edge_forces(law: ForceLaw, h: ArrayLike) -> Floats:
    """Tangential, radial, axial force for each width of chip [N/m]; 0 without a chip.

    Parameters
    ----------
    law : ForceLaw
        Of tool and material.
    h : array_like
        Thickness of the chip [m], any shape.

    Returns
    -------
    ndarray, shape (3,) + shape of ``h``
    """
    thickness = np.maximum(np.asarray(h, dtype=np.float64), 0.0)
    there = thickness > 0.0
    power = np.where(there, thickness ** (1.0 - law.m_c), 0.0)
    one = (3,) + (1,) * thickness.ndim
    forces: Floats = law.cutting.reshape(one) * power + law.edge.reshape(one) * there
    return forces


def chip_of_motion(dx: ArrayLike, dy: ArrayLike, phi: ArrayLike) -> Floats:
    """h_j = dx sin(phi_j) + dy cos(phi_j), at least 0 [m].

    Parameters
    ----------
    dx, dy : array_like
        Motion of the axis in one tooth period 60 / (N n) [m]: not in one sample.
    phi : array_like
        Where the tooth is [rad], from the direction of y towards that of x.
    """
    h = np.asarray(dx) * np.sin(phi) + np.asarray(dy) * np.cos(phi)
    return cast(Floats, np.maximum(h, 0.0))


def tooth_forces(K_t: ArrayLike, K_e: ArrayLike, d: ArrayLike, h: ArrayLike) -> Floats:
    """Tangential force K_t d h and radial force K_e F_t [N]; shape (2, ...).

    Parameters
    ----------
    K_t : array_like
        Specific tangential force [N/m^2].
    K_e : array_like
        Ratio of radial to tangential force [1].
    d : array_like
        Axial depth of cut [m].
    h : array_like
        Thickness of the chip [m].
    """
    tangential = np.asarray(K_t) * np.asarray(d) * np.asarray(h)
    return np.stack([tangential, np.asarray(K_e) * tangential])


def in_plane_forces(
    theta: ArrayLike, *, flutes: int, f_z: float, d: float, K_t: float, K_e: float,
    phi_st: float = 0.0, phi_ex: float = np.pi,
) -> Floats:  # fmt: skip
    """F_x and F_y on a tool without helix and runout, fed along x [N].

    Parameters
    ----------
    theta : array_like, shape (...)
        Of the spindle, where tooth 0 is [rad].
    flutes : int
        Number of teeth N.
    f_z, d : float
        Feed for each tooth and axial depth of cut [m].
    K_t, K_e : float
        As :func:`tooth_forces`.
    phi_st, phi_ex : float
        Where teeth enter and leave [rad], at most 2 pi apart, in any turn.

    Returns
    -------
    ndarray, shape (..., 2)
    """
    tip = np.asarray(theta, dtype=np.float64)[..., None]
    phi = (tip - 2 * np.pi / flutes * np.arange(flutes)) % (2 * np.pi)
    within = (phi - phi_st) % (2 * np.pi) < phi_ex - phi_st
    tangential, radial = tooth_forces(K_t, K_e, d, chip_of_motion(f_z, 0.0, phi)) * within
    along = -tangential * np.cos(phi) - radial * np.sin(phi)
    across = tangential * np.sin(phi) - radial * np.cos(phi)
    return np.stack([along.sum(axis=-1), across.sum(axis=-1)], axis=-1)


def slot_peak_load(K_t: ArrayLike, K_e: ArrayLike, d: ArrayLike, f_z: ArrayLike) -> Floats:
    """K_t d f_z sqrt(1 + K_e^2) [N]: the peak in a slot, of one or two teeth without helix."""
    return cast(Floats, np.asarray(K_t) * np.asarray(d) * np.asarray(f_z) * np.hypot(1.0, K_e))


def kienzle_force(k_c11: ArrayLike, m_c: ArrayLike, b: ArrayLike, h: ArrayLike) -> Floats:
    """F = k_c1.1 b h^(1 - m_c), of one tooth [N] (Kienzle 1952).

    Parameters
    ----------
    k_c11 : array_like
        Specific force of a chip of 1 mm by 1 mm [N/mm^2], as tables have it.
    m_c : array_like
        Exponent [1].
    b, h : array_like
        Width and thickness of the chip [m].
    """
    thick = np.maximum(np.asarray(h, dtype=np.float64), 0.0) * 1e3
    return cast(Floats, np.asarray(k_c11) * np.asarray(b) * 1e3 * thick ** (1 - np.asarray(m_c)))


def mean_kienzle_force(
    *, k_c11: ArrayLike, m_c: ArrayLike, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike,
    a_e: ArrayLike, D: ArrayLike,
) -> Floats:  # fmt: skip
    """Mean tangential force of all teeth [N]: N phi_s / (2 pi) teeth with the chip h_m each.

    Taking the mean of the thickness before its power is Kienzle's shortcut; the power is concave,
    so that it never understates the mean of h^(1 - m_c).  For m_c up to 0.35 it overstates it by
    less than 6 % at any immersion, most (a_e = D / 2 and less) where the chip's course is a ramp.

    Parameters
    ----------
    k_c11, m_c : array_like
        As :func:`kienzle_force`.
    flutes : array_like
        Number of teeth N.
    f_z, a_p, a_e, D : array_like
        Feed for each tooth, axial and radial depth of cut, diameter [m].
    """
    teeth = np.asarray(flutes) * swept_angle(a_e, D) / (2 * np.pi)
    return teeth * kienzle_force(k_c11, m_c, a_p, mean_thickness(f_z, a_e, D))


def mean_forces(
    law: ForceLaw, *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike,
    phi_ex: ArrayLike,
) -> Floats:  # fmt: skip
    """Mean F_x, F_y, F_z over a revolution [N]; shape (..., 3).

    F_z is as on the workpiece, the others are on the tool.  Parameters are those of
    :func:`regressors`.
    """
    design = regressors(flutes=flutes, f_z=f_z, a_p=a_p, phi_st=phi_st, phi_ex=phi_ex)
    return cast(Floats, design @ np.concatenate([law.cutting, law.edge]))


def mean_torque(
    law: ForceLaw, *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike,
    phi_ex: ArrayLike, radius: ArrayLike,
) -> Floats:  # fmt: skip
    """Mean torque that the cut takes [N m]; ``radius`` is the tool's [m], else as `regressors`.

    N a_p R / (2 pi) (K_tc f_z (cos phi_st - cos phi_ex) + K_te (phi_ex - phi_st)): times the
    angular speed it is K_tc MRR and the power of the edges' friction.
    """
    teeth, feed, depth, entry, leave = np.broadcast_arrays(flutes, f_z, a_p, phi_st, phi_ex)
    entry, leave = cutting_arcs(entry, leave)
    each = law.K_tc * feed * (np.cos(entry) - np.cos(leave)) + law.K_te * (leave - entry)
    torque = teeth * depth * np.asarray(radius) / (2 * np.pi) * each.sum(axis=0) * (feed > 0)
    return cast(Floats, torque)


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


def waveform(law: ForceLaw, tool: Tool, **cut: Any) -> Floats:
    """F_x, F_y, F_z [N] under constant engagement; shape (T, 3), as `basis`."""
    return basis(tool, m_c=law.m_c, **cut) @ np.concatenate([law.cutting, law.edge])


def torque_basis(
    tool: Tool, *, angles: ArrayLike, m_c: float = 0.0, slope: float = 0.0, slices: int = SLICES,
    **cut: float,
) -> Floats:  # fmt: skip
    """Torque that the cut takes for each coefficient; shape (T, 6), [m] times those of `basis`."""
    return _window(tool, angles, m_c=m_c, slope=slope, slices=slices, **cut)[:, 3]
