"""Mean forces of milling over a revolution, in closed form.

Linear-edge law, constant engagement phi_st to phi_ex over a depth a_p (Altintas, *Manufacturing
Automation*, 2nd ed. 2012, eqs. 2.41 to 2.44; frame of :mod:`pipeline.cutting.waveform`).  Helix
moves force from one angle to another and leaves the mean as it is; so does runout as long as no
tooth misses its chip.  The means are linear in the six coefficients, so that slots or arcs milled
at several feeds give them by linear regression.
"""

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.force_law import ForceLaw

Floats = NDArray[np.float64]

COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
"""Order of the columns of every design matrix of the room."""


def regressors(
    *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike, phi_ex: ArrayLike
) -> Floats:
    """Mean forces on the tool for each coefficient of the linear-edge law.

    Parameters
    ----------
    flutes : array_like
        Number of teeth N.
    f_z : array_like
        Feed for each tooth [m]; without feed there is no chip and no force.
    a_p : array_like
        Axial depth of cut [m].
    phi_st, phi_ex : array_like
        Where teeth enter and leave [rad]; of what lies outside 0 to pi nothing is cut.

    Returns
    -------
    ndarray, shape (..., 3, 6)
        Of F_x, F_y, F_z for each of ``COEFFICIENTS``: [m^2] for cutting, [m] for edge
        coefficients; leading axes are those of the arguments.

    Raises
    ------
    ValueError
        When teeth leave before they enter, or a value is negative or not finite.

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
    return cast(Floats, np.concatenate([share * feed[..., None, None] * chip, share * edge], -1))


def mean_forces(
    law: ForceLaw,
    *,
    flutes: ArrayLike,
    f_z: ArrayLike,
    a_p: ArrayLike,
    phi_st: ArrayLike,
    phi_ex: ArrayLike,
) -> Floats:
    """Mean F_x, F_y, F_z on the tool over a revolution [N]; shape (..., 3).

    Parameters are those of :func:`regressors`.

    Raises
    ------
    ValueError
        When the law is not linear in the thickness of the chip, and as :func:`regressors`.
    """
    _linear(law)
    design = regressors(flutes=flutes, f_z=f_z, a_p=a_p, phi_st=phi_st, phi_ex=phi_ex)
    return cast(Floats, design @ np.concatenate([law.cutting, law.edge]))


def mean_torque(
    law: ForceLaw,
    *,
    flutes: ArrayLike,
    f_z: ArrayLike,
    a_p: ArrayLike,
    phi_st: ArrayLike,
    phi_ex: ArrayLike,
    radius: ArrayLike,
) -> Floats:
    """Mean torque that the cut takes [N m]; ``radius`` is the tool's [m], else as `regressors`.

    N a_p R / (2 pi) (K_tc f_z (cos phi_st - cos phi_ex) + K_te (phi_ex - phi_st)): times the
    angular speed it is K_tc MRR and what the edges rub.
    """
    _linear(law)
    teeth, feed, depth, entry, leave = _arguments(flutes, f_z, a_p, phi_st, phi_ex)
    each = law.K_tc * feed * (np.cos(entry) - np.cos(leave)) + law.K_te * (leave - entry)
    torque = teeth * depth * np.asarray(radius) / (2 * np.pi) * each * (feed > 0)
    return cast(Floats, torque)


def _linear(law: ForceLaw) -> None:
    if law.m_c:
        raise ValueError(
            f"mean forces have a closed form for the linear-edge law only, this law has "
            f"m_c = {law.m_c:g}: average pipeline.cutting.waveform.waveform over a revolution"
        )


def _arguments(*given: ArrayLike) -> list[Floats]:
    arrays = np.broadcast_arrays(*[np.asarray(one, dtype=np.float64) for one in given])
    teeth, feed, depth, entry, leave = arrays
    for name, values in zip(("flutes", "f_z", "a_p"), arrays[:3], strict=True):
        if not (np.isfinite(values).all() and (values >= 0).all()):
            wrong = values[~(np.isfinite(values) & (values >= 0))].flat[0]
            raise ValueError(f"mean forces: {name} = {wrong:g} must be finite and at least 0")
    if not (np.isfinite(entry).all() and np.isfinite(leave).all() and (leave >= entry).all()):
        raise ValueError(
            "mean forces: phi_ex must be finite and not below phi_st in any of the cuts"
        )
    return [teeth, feed, depth, np.clip(entry, 0, np.pi), np.clip(leave, 0, np.pi)]
