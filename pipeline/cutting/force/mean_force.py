"""Mean forces of milling over a revolution, in closed form.

Linear-edge law, constant engagement phi_st to phi_ex over a depth a_p (Altintas, *Manufacturing
Automation*, 2nd ed. 2012, eqs. 2.41 to 2.44; frame of :mod:`pipeline.cutting.force.waveform`).
Helix moves force from one angle to another and leaves the mean as it is; so does runout as long as
no tooth misses its chip.  The means are linear in the six coefficients, so that slots or arcs
milled at several feeds give them by linear regression.
"""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats

COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
"""Order of the columns of every design matrix of cutting forces."""


def regressors(
    *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike, phi_ex: ArrayLike
) -> Floats:
    """Mean forces per coefficient of the linear-edge law; F_z as on the workpiece.

    ValueError when teeth leave before they enter or more than a turn later, or a value is negative
    or not finite.

    Parameters
    ----------
    flutes : array_like
        Number of teeth N.
    f_z : array_like
        Feed per tooth [m]; without feed there is no chip and no force.
    a_p : array_like
        Axial depth of cut [m].
    phi_st, phi_ex : array_like
        Entry and exit angle [rad], at most 2 pi apart; nothing is cut from pi to 2 pi.

    Returns
    -------
    ndarray, shape (..., 3, 6)
        F_x, F_y, F_z for each of ``COEFFICIENTS``: [m^2] for cutting, [m] for edge coefficients;
        leading axes are those of the arguments.

    Examples
    --------
    A slot: the mean force along the feed is -N a_p (K_rc f_z / 4 + K_re / pi).

    >>> design = regressors(flutes=2, f_z=1e-4, a_p=1e-3, phi_st=0.0, phi_ex=np.pi)
    >>> np.round(design[0, [1, 4]] / [2 * 1e-3 * 1e-4, 2 * 1e-3], 6).tolist()
    [-0.25, -0.31831]
    """
    teeth, feed, depth, entry, leave = _arguments(flutes, f_z, a_p, phi_st, phi_ex)
    sin1 = np.sin(leave) - np.sin(entry)
    cos1 = np.cos(leave) - np.cos(entry)
    cos2 = (np.cos(2 * leave) - np.cos(2 * entry)) / 4
    arc = leave - entry
    square = (2 * arc - (np.sin(2 * leave) - np.sin(2 * entry))) / 4  # integral of sin^2
    none = np.zeros_like(arc)
    chip = np.stack(
        [
            np.stack([cos2, -square, none], axis=-1),
            np.stack([square, cos2, none], axis=-1),
            np.stack([none, none, -cos1], axis=-1),
        ],
        axis=-2,
    )
    edge = np.stack(
        [
            np.stack([-sin1, cos1, none], axis=-1),
            np.stack([-cos1, -sin1, none], axis=-1),
            np.stack([none, none, arc], axis=-1),
        ],
        axis=-2,
    )
    share = (teeth * depth / (2 * np.pi) * (feed > 0))[..., None, None]
    parts = np.concatenate([share * feed[..., None, None] * chip, share * edge], -1)
    return cast(Floats, parts.sum(axis=0))


def _arguments(*given: ArrayLike) -> list[Floats]:
    arrays = np.broadcast_arrays(*[np.asarray(one, dtype=np.float64) for one in given])
    teeth, feed, depth, entry, leave = arrays
    for name, values in zip(("flutes", "f_z", "a_p"), arrays[:3], strict=True):
        if not (np.isfinite(values).all() and (values >= 0).all()):
            wrong = values[~(np.isfinite(values) & (values >= 0))].flat[0]
            raise ValueError(f"mean forces: {name} = {wrong:g} must be finite and at least 0")
    with np.errstate(invalid="ignore"):
        apart = leave - entry
    wrong_arc = ~((apart >= 0) & (apart <= 2 * np.pi + 1e-12))
    if wrong_arc.any():
        raise ValueError(
            f"mean forces: phi_st = {entry[wrong_arc].flat[0]:g} to phi_ex = "
            f"{leave[wrong_arc].flat[0]:g} must be finite and 0 to 2 pi rad long"
        )
    return [teeth, feed, depth, *cutting_arcs(entry, leave)]


def cutting_arcs(phi_st: ArrayLike, phi_ex: ArrayLike) -> tuple[Floats, Floats]:
    """Begin and end of the two parts of an arc in which a tooth cuts: from 0 to pi of each turn.

    Entry ``phi_st`` and exit ``phi_ex`` [rad] are at most 2 pi apart, in any turn. The results,
    shape (2, ...), are of the part in the turn of the entry and of that in the next; equal where
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
