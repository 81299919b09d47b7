"""Chip of milling: the angles between which it is cut.

Angles are those of :mod:`pipeline.cutting.engagement.engagement`.
"""

from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats

Side = Literal["up", "down", "slot", "centred"]


def swept_angle(a_e: ArrayLike, D: ArrayLike) -> Floats:
    """phi_s = acos(1 - 2 a_e / D), over which a tooth at the tool's side is in the material [rad].

    Parameters
    ----------
    a_e : array_like
        Radial depth of cut [m], 0 to D.
    D : array_like
        Diameter [m].

    Raises
    ------
    ValueError
        When a depth does not lie between 0 and the diameter, or that is not positive and finite.

    Examples
    --------
    >>> round(float(swept_angle(3.0, 6.0)) * 2 / np.pi, 6)
    1.0
    """
    diameter = np.asarray(D, dtype=np.float64)
    impossible = ~((diameter > 0) & np.isfinite(diameter))
    if impossible.any():
        raise ValueError(
            f"chip: D = {diameter[impossible].flat[0]:g} m must be positive and finite"
        )
    share = np.asarray(a_e, dtype=np.float64) / diameter
    wrong = ~((share >= 0) & (share <= 1))
    if wrong.any():
        raise ValueError(
            f"chip: a_e = {share[wrong].flat[0]:g} D is not between 0 and the diameter D"
        )
    return cast(Floats, np.arccos(1 - 2 * share))


def immersion(a_e: ArrayLike, D: ArrayLike, side: Side) -> tuple[Floats, Floats]:
    """Angles where a tooth enters and leaves [rad].

    Parameters
    ----------
    a_e, D : array_like
        Radial depth of cut and diameter [m].
    side : {"up", "down", "slot", "centred"}
        Up-milling begins with no chip, down-milling ends with none; a slot is as wide as the tool;
        a face that lies centred under a wider tool is cut around phi = pi / 2.

    Returns
    -------
    phi_st, phi_ex : ndarray

    Raises
    ------
    ValueError
        When a depth does not lie between 0 and the diameter, is below it in a slot, or the side is
        not one of these.
    """
    angle = swept_angle(a_e, D)
    if side == "up":
        return np.zeros_like(angle), angle
    if side == "down":
        return np.pi - angle, np.full_like(angle, np.pi)
    if side == "centred":
        half = np.arcsin(np.asarray(a_e, dtype=np.float64) / np.asarray(D, dtype=np.float64))
        return np.pi / 2 - half, np.pi / 2 + half
    if side != "slot":
        raise ValueError(f"chip: side {side!r} is none of up, down, slot, centred")
    if not np.allclose(angle, np.pi, rtol=0, atol=1e-6):
        narrow = (np.asarray(a_e, dtype=np.float64) / np.asarray(D, dtype=np.float64)).min()
        raise ValueError(
            f"chip: a slot is as wide as the tool, but a_e = {narrow:g} D: choose another side"
        )
    return np.zeros_like(angle), np.full_like(angle, np.pi)


def cutting_arcs(phi_st: ArrayLike, phi_ex: ArrayLike) -> tuple[Floats, Floats]:
    """Parts of an arc in which a tooth cuts a chip: it does from 0 to pi of each turn.

    Parameters
    ----------
    phi_st, phi_ex : array_like
        Where teeth enter and leave [rad], at most 2 pi apart, in any turn.

    Returns
    -------
    begin, end : ndarray, shape (2, ...)
        Of the part in the turn of the entry and of that in the next, from 0 to pi; equal where
        there is none.

    Examples
    --------
    From 20 degrees before phi = 0 to 80 degrees behind it:

    >>> np.degrees(cutting_arcs(np.radians(340.0), np.radians(440.0))).round(6).tolist()
    [[180.0, 0.0], [180.0, 80.0]]
    """
    enter, leave = np.broadcast_arrays(
        np.asarray(phi_st, dtype=np.float64), np.asarray(phi_ex, dtype=np.float64)
    )
    turn = np.floor(enter / (2 * np.pi))
    zero = 2 * np.pi * np.stack([turn, turn + 1])  # phi = 0 in the turn of each part
    return np.clip(enter - zero, 0, np.pi), np.clip(leave - zero, 0, np.pi)
