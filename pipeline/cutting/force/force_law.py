"""Force laws of a cutting edge, their mean forces over a revolution, and their linearisation.

Tangential, radial and axial force for each width of chip b are K_c h^(1 - m_c) + K_e, the edge
terms only where there is a chip (h > 0).  With m_c = 0 this is the linear-edge model (Altintas,
*Manufacturing Automation*, 2nd ed. 2012, eq. 2.40); without edge terms it is Kienzle's law
F = k_c1.1 b h^(1 - m_c) (Kienzle 1952).

Chip-force laws are wider.  For each width of chip the edge force along t, r, a is taken as

    F(h) = C h (h / h_ref)^(-m) + E (1 - exp(-h / h_0)).

m = 0 and h_0 = 0 is the linear-edge law, m > 0 the size effect, E = 0 Kienzle's law, h_0 > 0 an
edge force that grows until the chip is about as thick as the edge is round (Waldorf, DeVor and
Kapoor 1998).  Which of them the mean forces of recorded cuts allow stands in the cutting sub-model;
from one feed no law follows.

Helix moves force from one angle to another and leaves the mean as it is; so does runout as long as
no tooth misses its chip.  The means are linear in the coefficients, so that slots or arcs milled at
several feeds give them by linear regression.  Frame and angles are those of
:mod:`pipeline.cutting.force.waveform` [rad]; the rest is SI.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import ChipLaw, CutConditions, ForceSpread
from pipeline.schema.ranges import Finite, NotNegative, Range, Ranged

N_MM2 = 1e6
N_MM = 1e3
THICKNESS = 1e-3  # [m], of which k_c1.1 is the specific force


@dataclass(frozen=True, kw_only=True)
class ForceLaw(Ranged, section="force_law"):
    """Constants of one pair of tool and material, in SI; at least one is tangential."""

    K_tc: NotNegative
    K_rc: Finite
    K_ac: Finite = 0.0
    """Cutting coefficients, tangential, radial, axial [N/m^2 m^m_c]."""
    K_te: NotNegative = 0.0
    K_re: Finite = 0.0
    K_ae: Finite = 0.0
    """Edge coefficients [N/m]."""
    m_c: Annotated[float, Range(least=0.0, below=1.0)] = 0.0
    """Exponent of the chip thickness [1]; 0 for the linear-edge model."""

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
        >>> chip = 1e-3 ** (1.0 - law.m_c)  # 1 mm thick; force [N/mm] of its width
        >>> round(law.K_tc * chip / 1e3, 6), round(law.K_rc * chip / 1e3, 6)
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

    @property
    def constants(self) -> Floats:
        """Cutting, then edge coefficients; shape (6,)."""
        return np.concatenate([self.cutting, self.edge])


REFERENCE = 5e-5
"""Thickness h_ref, at which C is the specific force [m]."""
APART = 1.1
"""Ratio from which two feeds count as different [1]."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)
"""Gauss nodes over an arc from -1 to 1, and their weights."""
OTHERWISE = 0.1
"""Standard deviation of a force for each factor e of speed or depth beyond those learnt, as a share
[1]: specific forces fall with the cutting speed to the power of 0.1 (Koenig and Essel 1973)."""


def _parts(h: Floats, exponent: Sequence[float], growth: float) -> Floats:
    """Factors of C and E [m], [1]; shape (6,) + shape of ``h``."""
    thick = np.maximum(h, 1e-12)
    chip = [thick * (thick / REFERENCE) ** -m for m in exponent]
    edge = 1 - np.exp(-thick / growth) if growth > 0 else np.ones_like(thick)
    return np.stack([*chip, edge, edge, edge])


def _arc(conditions: CutConditions) -> tuple[Floats, Floats]:
    """Angles of an arc [rad] and their Gauss weights [rad]; shape (N,) each."""
    half = (conditions.phi_ex - conditions.phi_st) / 2
    return conditions.phi_st + half * (NODES + 1), half * WEIGHTS


def design(conditions: CutConditions, exponent: Sequence[float], growth: float) -> Floats:
    """Mean F_x, F_y, F_z over a revolution for each of C_t, C_r, C_a, E_t, E_r, E_a; (3, 6)."""
    phi, weight = _arc(conditions)
    parts = _parts(conditions.f_z * np.sin(phi), exponent, growth)
    sine, cosine = parts @ (weight * np.sin(phi)), parts @ (weight * np.cos(phi))
    table = np.zeros((3, 6))
    for k in (0, 3):
        table[0, k], table[0, k + 1] = -cosine[k], -sine[k + 1]
        table[1, k], table[1, k + 1] = sine[k], -cosine[k + 1]
        table[2, k + 2] = parts[k + 2] @ weight
    return conditions.flutes * conditions.a_p / (2 * np.pi) * table


def feeds(cuts: Sequence[CutConditions]) -> int:
    """Number of feeds per tooth that differ."""
    found: list[float] = []
    for f_z in sorted(cut.f_z for cut in cuts):
        if not found or f_z >= APART * found[-1]:
            found.append(f_z)
    return len(found)


def local_lines(
    exponent: Floats, growth: Floats, values: Floats, each: Sequence[CutConditions]
) -> Floats:
    """Straight lines K_c h + K_e with the least squares to D laws over the chips of cuts.

    Angles have equal weights over each engagement, so that a line has the mean forces of its law in
    a slot of one feed.  ``exponent`` (D, 3) is m [1], ``growth`` (D,) h_0 [m], ``values`` (D, 6)
    C [N/m^2] and E [N/m], as the result K_c and K_e.
    """
    h, slope, weight, middle = _regression(each)
    chip = h * (h / REFERENCE) ** -exponent[..., None]
    edge = np.where(growth[:, None] > 0, -np.expm1(-h / np.maximum(growth, 1e-12)[:, None]), 1.0)
    force = values[:, :3, None] * chip + values[:, 3:, None] * edge[:, None]
    k_c = force @ slope
    return np.concatenate([k_c, force @ weight - k_c * middle], axis=1)


def _regression(each: Sequence[CutConditions]) -> tuple[Floats, Floats, Floats, float]:
    """Chips h of cuts [m], weights of a force at each in K_c and in its mean, mean of h."""
    arcs = [_arc(one) for one in each]
    h = np.concatenate(
        [np.maximum(one.f_z * np.sin(phi), 1e-12) for one, (phi, _) in zip(each, arcs, strict=True)]
    )
    weight = np.concatenate([w / w.sum() for _, w in arcs]) / len(arcs)
    middle = float(weight @ h)
    return h, weight * (h - middle) / float(weight @ (h - middle) ** 2), weight, middle


def laws_lines(laws: Sequence[ChipLaw], each: Sequence[CutConditions]) -> Floats:
    """:func:`local_lines` of stored laws; shape (D, 6)."""
    exponent = np.array([law.exponent for law in laws])
    growth = np.array([law.growth for law in laws])
    values = np.array([(*law.cutting, *law.edge) for law in laws])
    return local_lines(exponent, growth, values, each)


def outside_share(spread: ForceSpread, speed: float, a_p: float) -> float:
    """Standard deviation of a force by speed [rev/s] and depth [m] beyond those learnt [1]."""
    ranges = ((speed, spread.speeds), (a_p, spread.depths_m))
    beyond = [max(np.log(low / value), np.log(value / high), 0.0) for value, (low, high) in ranges]
    return OTHERWISE * float(np.hypot(*beyond))


COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
"""Order of the columns of every design matrix of cutting forces."""


def regressors(
    *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike, phi_ex: ArrayLike
) -> Floats:
    """Mean F_x, F_y, F_z over a revolution for each of ``COEFFICIENTS``, in closed form.

    Linear-edge law, teeth in cut from ``phi_st`` to ``phi_ex``, within 0 to pi (Altintas 2012,
    eqs. 2.41 to 2.44).

    Returns
    -------
    ndarray, shape (..., 3, 6)
        [m^2] for cutting, [m] for edge coefficients; F_z as on the workpiece.

    Examples
    --------
    A slot: the mean force along the feed is -N a_p (K_rc f_z / 4 + K_re / pi).

    >>> design = regressors(flutes=2, f_z=1e-4, a_p=1e-3, phi_st=0.0, phi_ex=np.pi)
    >>> np.round(design[0, [1, 4]] / [2 * 1e-3 * 1e-4, 2 * 1e-3], 6).tolist()
    [-0.25, -0.31831]
    """
    teeth, feed, depth, entry, leave = np.broadcast_arrays(
        *(np.asarray(one, dtype=np.float64) for one in (flutes, f_z, a_p, phi_st, phi_ex))
    )
    sin1, cos1 = np.sin(leave) - np.sin(entry), np.cos(leave) - np.cos(entry)
    cos2 = feed * (np.cos(2 * leave) - np.cos(2 * entry)) / 4
    arc = leave - entry
    square = feed * (2 * arc - (np.sin(2 * leave) - np.sin(2 * entry))) / 4  # integral of sin^2
    none = np.zeros_like(arc)
    table = np.array([
        [cos2, -square, none, -sin1, cos1, none],
        [square, cos2, none, -cos1, -sin1, none],
        [none, none, -feed * cos1, none, none, arc],
    ])  # fmt: skip
    share = teeth * depth / (2 * np.pi) * (feed > 0)
    return share[..., None, None] * np.moveaxis(table, (0, 1), (-2, -1))
