"""Chip-force laws: edge forces over the chip thickness, and their linearisation.

For each width of chip the edge force along t, r, a is taken as

    F(h) = C h (h / h_ref)^(-m) + E (1 - exp(-h / h_0)).

m = 0 and h_0 = 0 is the linear-edge law (Altintas 2012, eq. 2.40), m > 0 the size effect, E = 0
Kienzle's law (1952), h_0 > 0 an edge force that grows until the chip is about as thick as the edge
is round (Waldorf, DeVor and Kapoor 1998).  Which of them the mean forces of recorded cuts allow
stands in the cutting sub-model; from one feed no law follows.
Angles are those of :mod:`pipeline.cutting.engagement.engagement` [rad]; the rest is SI.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import ChipLaw, CutConditions, ForceSpread

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
    a slot of one feed.

    Parameters
    ----------
    exponent, growth, values : ndarray, shapes (D, 3), (D,), (D, 6)
        m [1], h_0 [m], C [N/m^2] and E [N/m] of each law.
    each : sequence of CutConditions
        Cuts in which the chips arise.

    Returns
    -------
    ndarray, shape (D, 6)
        K_tc, K_rc, K_ac [N/m^2], K_te, K_re, K_ae [N/m].
    """
    h, slope, weight, middle = _regression(each)
    chip = h * (h / REFERENCE) ** -exponent[..., None]
    edge = np.where(
        growth[:, None] > 0, -np.expm1(-h / np.maximum(growth, 1e-12)[:, None]), 1.0
    )  # fmt: skip
    force = values[:, :3, None] * chip + values[:, 3:, None] * edge[:, None]
    k_c = force @ slope
    return np.concatenate([k_c, force @ weight - k_c * middle], axis=1)


def _regression(each: Sequence[CutConditions]) -> tuple[Floats, Floats, Floats, float]:
    """Chips h of cuts [m], weights of a force at each in K_c and in its mean, mean of h."""
    arcs = [_arc(one) for one in each]
    h = np.concatenate([
        np.maximum(one.f_z * np.sin(phi), 1e-12)
        for one, (phi, _) in zip(each, arcs, strict=True)
    ])  # fmt: skip
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
