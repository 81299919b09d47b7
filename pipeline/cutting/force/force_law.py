"""Force law of a cutting edge, and the forces that it gives in closed form.

Tangential, radial and axial force for each width of chip b are K_c h^(1 - m_c) + K_e, the edge
terms only where there is a chip (h > 0).  With m_c = 0 this is the linear-edge model (Altintas,
*Manufacturing Automation*, 2nd ed. 2012, eq. 2.40); without edge terms it is Kienzle's law
F = k_c1.1 b h^(1 - m_c) (Kienzle 1952).

The zero-helix model is that of Sim2023 (one coefficient K_t and the ratio K_e of radial to
tangential force); frame and angles are those of :mod:`pipeline.cutting.force.waveform`.
"""

from dataclasses import dataclass
from typing import Annotated, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.force.chip import mean_thickness, swept_angle
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Finite, NotNegative, Range, Ranged

N_MM2 = 1e6
N_MM = 1e3
THICKNESS = 1e-3  # [m], of which k_c1.1 is the specific force


@dataclass(frozen=True, kw_only=True)
class ForceLaw(Ranged, section="force_law"):
    """Constants of one pair of tool and material, in SI.

    Parameters
    ----------
    K_tc, K_rc, K_ac : float
        Cutting coefficients, tangential, radial, axial [N/m^2 m^m_c].
    K_te, K_re, K_ae : float
        Edge coefficients [N/m].
    m_c : float
        Exponent of the chip thickness [1]; 0 for the linear-edge model.

    Raises
    ------
    ValueError
        When a value is not finite or out of its range, or no coefficient is tangential.
    """

    K_tc: NotNegative
    K_rc: Finite
    K_ac: Finite = 0.0
    K_te: NotNegative = 0.0
    K_re: Finite = 0.0
    K_ae: Finite = 0.0
    m_c: Annotated[float, Range(least=0.0, below=1.0)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.K_tc == self.K_te == 0.0:
            raise ValueError(
                "force_law.K_tc and force_law.K_te are both 0: a tool that cuts takes force"
            )

    @classmethod
    def linear(
        cls, *, K_tc: float, K_rc: float, K_ac: float = 0.0,
        K_te: float = 0.0, K_re: float = 0.0, K_ae: float = 0.0,
    ) -> "ForceLaw":  # fmt: skip
        """Linear-edge law from tables: cutting [N/mm^2], edge [N/mm]."""
        return cls(
            K_tc=K_tc * N_MM2, K_rc=K_rc * N_MM2, K_ac=K_ac * N_MM2,
            K_te=K_te * N_MM, K_re=K_re * N_MM, K_ae=K_ae * N_MM,
        )  # fmt: skip

    @classmethod
    def kienzle(cls, *, k_c11: float, m_c: float, radial: float, axial: float = 0.0) -> "ForceLaw":
        """Kienzle's law from tables: k_c1.1 [N/mm^2], radial and axial force over tangential [1].

        Examples
        --------
        >>> law = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.5)
        >>> force = edge_forces(law, 1e-3)  # of a chip 1 mm thick, for each metre of its width
        >>> round(float(force[0]) / 1e3, 6), round(float(force[1]) / 1e3, 6)
        (1500.0, 750.0)
        """
        tangential = k_c11 * N_MM2 * THICKNESS**m_c
        return cls(K_tc=tangential, K_rc=radial * tangential, K_ac=axial * tangential, m_c=m_c)

    @property
    def cutting(self) -> Floats:
        """K_tc, K_rc, K_ac; shape (3,)."""
        return np.array([self.K_tc, self.K_rc, self.K_ac])

    @property
    def edge(self) -> Floats:
        """K_te, K_re, K_ae; shape (3,)."""
        return np.array([self.K_te, self.K_re, self.K_ae])


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

    Raises
    ------
    ValueError
        When there is no whole number of teeth.
    """
    if not (flutes >= 1 and flutes % 1 == 0):
        raise ValueError(f"force: flutes = {flutes} must be a whole number of at least 1")
    tip = np.asarray(theta, dtype=np.float64)[..., None]
    phi = (tip - 2 * np.pi / flutes * np.arange(flutes)) % (2 * np.pi)
    within = (phi - phi_st) % (2 * np.pi) < phi_ex - phi_st
    tangential, radial = tooth_forces(K_t, K_e, d, chip_of_motion(f_z, 0.0, phi)) * within
    along = -tangential * np.cos(phi) - radial * np.sin(phi)
    across = tangential * np.sin(phi) - radial * np.cos(phi)
    return np.stack([along.sum(axis=-1), across.sum(axis=-1)], axis=-1)


def slot_peak_load(K_t: ArrayLike, K_e: ArrayLike, d: ArrayLike, f_z: ArrayLike) -> Floats:
    """K_t d f_z sqrt(1 + K_e^2) [N]: the peak in a slot, of one or two teeth without helix.

    Examples
    --------
    Sim2023: A6061, 0.5 mm deep, 0.05 mm/tooth.

    >>> round(float(slot_peak_load(1.23e9, 0.5, 0.5e-3, 0.05e-3)), 3)
    34.38
    """
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
