"""Laws of the chip that the mean forces of recorded cuts cannot tell apart.

For each width of chip the edge force along t, r, a is taken as

    F(h) = C h (h / h_ref)^(-m) + E (1 - exp(-h / h_0)).

m = 0 and h_0 = 0 is the linear-edge law (Altintas 2012, eq. 2.40), m > 0 the size effect, E = 0
Kienzle's law (1952), h_0 > 0 an edge force that grows until the chip is about as thick as the edge
is round (Waldorf, DeVor and Kapoor 1998).  Every law is fitted to the same mean forces and weighted
by its likelihood; where two feeds or fewer leave no misfit, all count alike.  From one feed no law
follows: the force then grows as a power of the feed, with the exponents that tables of Kienzle's
constants span (Koenig and Essel 1973: 1 - m_c of 0.4 to 1; the radial and axial ones are less).
Angles are those of :mod:`pipeline.cutting.engagement.engagement` [rad]; the rest is SI.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import ChipLaw, CutConditions
from pipeline.submodels.cutting.waveform import PRIOR, CutHarmonics

REFERENCE = 5e-5
"""Thickness h_ref, at which C is the specific force [m]."""
EXPONENTS = (0.1, 0.2, 0.3)
"""Exponents m of the size effect beside an edge force [1]."""
GROWTHS = (3e-6, 6e-6, 12e-6)
"""Thickness h_0 over which the edge force grows [m]: radii of sharp to honed edges."""
POWERS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Exponents m of the tangential force from which one feed cannot choose [1]."""
BESIDE = 1.5
"""Exponent of radial and axial force over that of the tangential one [1] (Koenig and Essel)."""
STEEPEST = 0.9
"""Greatest exponent [1]."""
SHARE = 0.02
"""Standard deviation of a mean force by depth, crosstalk and gain, as a share [1]: data sheets of
dynamometers allow 2 % of crosstalk."""
APART = 1.1
"""Ratio from which two feeds count as different [1]."""
SPAN = 5.0
"""Ratio of the feeds, from finishing to roughing with one tool, for which the interval of a
straight line holds at least [1]."""
NODES = 48
"""Gauss nodes over an arc."""
LIMIT = 4.0
"""Greatest change of a force by the choice of the law, up and down [1]."""


def edge_force(law: ChipLaw, h: Floats) -> Floats:
    """Tangential, radial, axial force for each width of chip [N/m]; shape (3,) + shape of ``h``."""
    parts = _parts(h, law.exponent, law.growth)
    one = (3,) + (1,) * h.ndim
    cutting, edge = np.reshape(law.cutting, one), np.reshape(law.edge, one)
    return np.asarray(cutting * parts[:3] + edge * parts[3:])


def _parts(h: Floats, exponent: Sequence[float], growth: float) -> Floats:
    """What C and E are multiplied by [m], [1]; shape (6,) + shape of ``h``."""
    thick = np.maximum(h, 1e-12)
    chip = [thick * (thick / REFERENCE) ** -m for m in exponent]
    edge = 1 - np.exp(-thick / growth) if growth > 0 else np.ones_like(thick)
    return np.stack([*chip, edge, edge, edge])


def _arc(conditions: CutConditions) -> tuple[Floats, Floats]:
    """Angles of an arc [rad] and their Gauss weights [rad]; shape (NODES,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    half = (conditions.phi_ex - conditions.phi_st) / 2
    return conditions.phi_st + half * (nodes + 1), half * weights


def mean_edge_force(law: ChipLaw, conditions: CutConditions) -> Floats:
    """Mean of :func:`edge_force` over the engagement [N/m]; shape (3,).

    Tangential and radial force count with sin(phi), as the mean forces of a slot hold them, so that
    laws that give the same means of slots give the same here.
    """
    phi, weight = _arc(conditions)
    share = weight * np.stack([np.sin(phi), np.sin(phi), np.ones_like(phi)])
    force = edge_force(law, conditions.f_z * np.sin(phi))
    return np.asarray((force * share).sum(axis=1) / share.sum(axis=1))


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


def chip_laws(cuts: Sequence[CutHarmonics]) -> list[ChipLaw]:
    """Laws that the mean forces allow, with weights that add up to 1.

    Parameters
    ----------
    cuts : sequence of CutHarmonics
        The recordings.  From two feeds on the linear-edge law is the first.
    """
    each = [one.conditions for one in cuts]
    means = np.concatenate([one.lines[0].real for one in cuts])
    size = np.repeat([np.linalg.norm(one.lines[0].real) for one in cuts], 3)
    scatter = np.concatenate([one.variance[0] for one in cuts])
    deviation = np.sqrt(scatter + (SHARE * size) ** 2)
    if feeds(each) < 2:
        return _powers(each, means, deviation)
    forms = [("linear edge", (0.0,) * 3, 0.0), *(("size effect", (m,) * 3, 0.0) for m in EXPONENTS)]
    forms += [("growing edge", (0.0,) * 3, growth) for growth in GROWTHS]
    fits = [_fitted(name, m, growth, each, means, deviation) for name, m, growth in forms]
    fits.append(_kienzle(each, means, deviation))
    misfit = np.array([fit for _, fit in fits])
    scale = max(1.0, float(misfit.min()) / max(len(means) - 6, 1))
    families = [law.name for law, _ in fits]
    prior = np.array([1 / families.count(name) for name in families])
    weight = prior * np.exp(-(misfit - misfit.min()) / (2 * scale))
    weight /= weight.sum()
    return [replace(law, weight=float(w)) for (law, _), w in zip(fits, weight, strict=True)]


def _fitted(
    name: str, exponent: tuple[float, ...], growth: float, each: Sequence[CutConditions],
    means: Floats, deviation: Floats,
) -> tuple[ChipLaw, float]:  # fmt: skip
    """The law of this form that is nearest to the means, and its sum of squares."""
    table = np.concatenate([design(one, exponent, growth) for one in each])
    values = _weighted(table, means, deviation)
    square = float((((means - table @ values) / deviation) ** 2).sum())
    law = ChipLaw(
        name=name, cutting=tuple(values[:3].tolist()), exponent=exponent,
        edge=tuple(values[3:].tolist()), growth=growth, weight=1.0,
    )  # fmt: skip
    return law, square


def _weighted(table: Floats, means: Floats, deviation: Floats) -> Floats:
    """Weighted least squares, with a prior that matters only where the means are silent."""
    prior = np.array(PRIOR)
    rows = np.concatenate([table / deviation[:, None] * prior, np.eye(6)])
    right = np.concatenate([means / deviation, np.zeros(6)])
    return np.asarray(prior * np.linalg.lstsq(rows, right, rcond=None)[0])


def _kienzle(
    each: Sequence[CutConditions], means: Floats, deviation: Floats
) -> tuple[ChipLaw, float]:
    """Kienzle's law with an exponent for each direction, and its sum of squares."""
    from scipy.optimize import least_squares

    start = _fitted("Kienzle", (0.3,) * 3, 0.0, each, means, deviation)[0]
    table = np.concatenate([design(one, (0.3,) * 3, 0.0) for one in each])[:, :3]
    first = np.linalg.lstsq(table / deviation[:, None], means / deviation, rcond=None)[0]
    unit = max(float(np.abs(first).max()), 1.0)

    def residuals(x: Floats) -> Floats:
        made = [design(one, x[3:].tolist(), 0.0)[:, :3] @ (unit * x[:3]) for one in each]
        return np.asarray((means - np.concatenate(made)) / deviation)

    low, high = [-np.inf] * 3 + [0.0] * 3, [np.inf] * 3 + [STEEPEST] * 3
    found = least_squares(residuals, [*(first / unit), 0.3, 0.3, 0.3], bounds=(low, high))
    law = replace(
        start, cutting=tuple((unit * found.x[:3]).tolist()), exponent=tuple(found.x[3:].tolist()),
        edge=(0.0, 0.0, 0.0),
    )  # fmt: skip
    return law, float(2 * found.cost)


def _powers(each: Sequence[CutConditions], means: Floats, deviation: Floats) -> list[ChipLaw]:
    """Power laws through the means of one feed, all with the same weight."""
    laws = []
    for m in POWERS:
        beside = min(BESIDE * m, STEEPEST)
        exponent = (m, beside, beside)
        table = np.concatenate([design(one, exponent, 0.0) for one in each])[:, :3]
        values = np.linalg.lstsq(table / deviation[:, None], means / deviation, rcond=None)[0]
        laws.append(
            ChipLaw(
                name="power of the feed", cutting=tuple(values.tolist()), exponent=exponent,
                edge=(0.0, 0.0, 0.0), growth=0.0, weight=1 / len(POWERS),
            )
        )  # fmt: skip
    return laws


def straight_line_spread(cuts: Sequence[CutHarmonics]) -> Floats:
    """Standard deviation of the six coefficients by the law and the feeds [N/m^2], [N/m]; (6,).

    A straight line through a law that is none depends on the feeds of its cuts.  Those of lines
    over the recorded feeds, widened to both sides to a ratio of ``SPAN``, or to one side alone, are
    compared with that of the recorded feeds, law by law.  It is infinite for one feed.
    """
    each = [one.conditions for one in cuts]
    if feeds(each) < 2:
        return np.full(6, np.inf)
    least, most = min(c.f_z for c in each), max(c.f_z for c in each)
    wider = max(np.sqrt(SPAN * least / most), 1.0)
    ranges = ((least / wider, most), (least, wider * most), (least / wider, wider * most),
              (least, most))  # fmt: skip
    square = np.zeros(6)
    for law in chip_laws(cuts):
        here = _line(law, each)
        for low, high in ranges:
            there = [replace(c, f_z=f) for c in each for f in np.linspace(low, high, 5).tolist()]
            square += law.weight / len(ranges) * (_line(law, there) - here) ** 2
    return np.sqrt(square)


def _line(law: ChipLaw, each: Sequence[CutConditions]) -> Floats:
    """The six coefficients that a regression of a law's mean forces gives."""
    values = np.array([*law.cutting, *law.edge])
    means = np.concatenate([design(one, law.exponent, law.growth) @ values for one in each])
    table = np.concatenate([design(one, (0.0,) * 3, 0.0) for one in each])
    return _weighted(table, means, np.full(len(means), max(1e-3 * np.abs(means).max(), 1e-9)))


def law_scales(laws: Sequence[ChipLaw], conditions: CutConditions) -> Floats:
    """Mean edge force by each law over that of the first; shape (L, 3) [1].

    1 where the first one has next to no force in a direction.
    """
    each = np.array([mean_edge_force(law, conditions) for law in laws])
    base = each[0]
    there = np.abs(base) > SHARE * np.abs(base).max()
    scales = np.where(there, each / np.where(there, base, 1.0), 1.0)
    return np.asarray(np.clip(scales, 1 / LIMIT, LIMIT))
