"""Draws of the law of the chip that the mean forces of recorded cuts allow.

Given the law's exponents and growth the mean forces y are linear in C and E, y = X beta + e, with

    cov e = (s sd)^2 + (g y)^2 by recording + crosstalk + wear of the edge by recording.

The stated deviations sd, zeros above all, may be too small by a factor s; depth and gain differ from
recording to recording by a share g; the dynamometer mixes its channels; and the edge wears, so that
the edge force on the land (radial, tangential by its friction) differs by a share w.  None of the
four is known: each has a grid of values of the same prior weight.  So has the law: a straight line,
size effects, edge forces that grow with the chip, both together.  Every combination is weighted by
its restricted likelihood (Patterson and Thompson 1971), which says nothing where there are no more
means than coefficients: two feeds leave the prior.  Draws with a negative tangential or radial edge
force are left out: an edge that ploughs neither pulls nor drives its tool.

From one feed no line follows: the force then grows as a power of the feed, with the exponents that
tables of Kienzle's constants span, and has no edge part.

The coefficients K_c, K_e are those of the straight line with the least squares to a drawn law over
the chips h = f_z sin(phi), phi evenly over each engagement, of feeds from the least to the greatest
recorded, widened to a ratio of ``SPAN`` (:func:`named_range`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import ChipLaw, CutConditions
from pipeline.submodels.cutting.laws import design, feeds, local_lines
from pipeline.submodels.cutting.waveform import PRIOR, CutHarmonics

EXPONENTS = (0.0, 0.1, 0.2, 0.3)
"""Exponents m of the size effect beside an edge force [1]: those of Kienzle's law alone, which hold
the edge force too, span 0.15 to 0.4 (Koenig and Essel 1973)."""
GROWTHS = (0.0, 3e-6, 6e-6, 12e-6)
"""Thickness h_0 over which the edge force grows [m]: radii of sharp to honed edges."""
BESIDE = (1.0, 1.5)
"""Exponents of radial and axial force over that of the tangential one [1] (Koenig and Essel)."""
POWERS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Exponents m of the tangential force from which one feed cannot choose [1]: 1 - m_c of 0.4 to 1
(Koenig and Essel 1973)."""
STEEPEST = 0.9
"""Greatest exponent of radial and axial force [1]."""
UNDERSTATED = (1.0, 2.0, 4.0, 8.0)
"""Factors s of the stated deviations [1]."""
GAINS = (0.005, 0.01, 0.02)
"""Shares g of depth and gain [1]."""
WEARS = (0.03, 0.1, 0.3)
"""Shares w of the edge force [1]: a land of 10 um at 500 N/mm^2 is a sixth of 30 N/mm."""
FRICTION = 0.4
"""Friction of the land [1] (Smithey, Kapoor and DeVor 2000)."""
CROSSTALK = 0.012
"""Standard deviation of the share of another channel [1]: data sheets allow 2 %, evenly drawn."""
SPAN = 5.0
"""Ratio of the feeds, from finishing to roughing with one tool, over which lines are named [1]."""
TRIED, KEPT = 4096, 1024
"""Draws before and after those with an impossible edge are left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LawDraws:
    """D draws of a law.

    Parameters
    ----------
    exponent : ndarray, shape (D, 3)
        m of each direction [1].
    growth : ndarray, shape (D,)
        h_0 [m].
    values : ndarray, shape (D, 6)
        C [N/m^2], E [N/m].
    understated, gain, wear : float
        Root mean squares of s, g, w over the draws [1].
    """

    exponent: Floats
    growth: Floats
    values: Floats
    understated: float
    gain: float
    wear: float

    def laws(self, count: int) -> tuple[ChipLaw, ...]:
        """So many of them, evenly taken, as they are stored."""
        places = np.linspace(0, len(self.growth) - 1, min(count, len(self.growth))).astype(int)
        return tuple(
            ChipLaw(
                cutting=tuple(self.values[k, :3].tolist()), edge=tuple(self.values[k, 3:].tolist()),
                exponent=tuple(self.exponent[k].tolist()), growth=float(self.growth[k]),
            )
            for k in places.tolist()
        )  # fmt: skip


def named_range(each: Sequence[CutConditions]) -> list[CutConditions]:
    """Conditions at five feeds over which coefficients are named, from the least to the greatest."""
    least, most = min(c.f_z for c in each), max(c.f_z for c in each)
    wider = max(np.sqrt(SPAN * least / most), 1.0)
    named = np.linspace(least / wider, wider * most, 5).tolist()
    arcs = {(c.phi_st, c.phi_ex): c for c in each}
    return [replace(c, f_z=f) for c in arcs.values() for f in named]


def coefficient_draws(draws: LawDraws, each: Sequence[CutConditions]) -> Floats:
    """The six coefficients of each draw over the named range of feeds [N/m^2], [N/m]; (D, 6)."""
    return local_lines(draws.exponent, draws.growth, draws.values, named_range(each))


def _forms(many: bool) -> tuple[Floats, Floats, Floats]:
    """Exponents (L, 3), growths (L,) and prior weights (L,) of the laws, from many feeds or one."""
    if not many:
        exponents = [(m, *(min(BESIDE[1] * m, STEEPEST),) * 2) for m in POWERS]
        return np.array(exponents), np.zeros(len(POWERS)), np.ones(len(POWERS))
    forms = [(m, b, growth) for m, b, growth in product(EXPONENTS, BESIDE, GROWTHS)
             if m > 0 or b == BESIDE[0]]  # fmt: skip
    exponents = [(m, b * m, b * m) for m, b, _ in forms]
    # each exponent and growth counts once, whatever the number of forms that share it
    prior = np.array([1.0 if m == 0.0 else 1.0 / len(BESIDE) for m, *_ in forms])
    return np.array(exponents), np.array([growth for *_, growth in forms]), prior


def law_draws(cuts: Sequence[CutHarmonics], seed: int = 0) -> LawDraws:
    """Draws of the law that the mean forces allow.

    Parameters
    ----------
    cuts : sequence of CutHarmonics
        The recordings.
    seed : int
        Of the draws.
    """
    each = [one.conditions for one in cuts]
    means = np.concatenate([one.lines[0].real for one in cuts])
    many = feeds(each) > 1
    exponents, growths, prior = _forms(many)
    believed = np.array(PRIOR) if many else np.array([*PRIOR[:3], 0.0, 0.0, 0.0])
    tables = np.array([
        np.concatenate([design(one, m, growth) for one in each])
        for m, growth in zip(exponents.tolist(), growths.tolist(), strict=True)
    ])  # fmt: skip
    scales = list(product(UNDERSTATED, GAINS, WEARS))
    parts = _covariances(cuts, tables[0], means)
    solved = [_solutions(tables, means, parts.total(*one), believed) for one in scales]
    likely = np.array([one[0] for one in solved])
    weight = (prior * np.exp(likely - likely.max())).ravel()
    random = np.random.default_rng(seed)
    cell = random.choice(len(weight), TRIED, p=weight / weight.sum())
    of, form = np.divmod(cell, len(growths))
    centres = np.array([one[1] for one in solved])[of, form]
    roots = np.array([one[2] for one in solved])[of, form]
    values = centres + np.einsum("dij,dj->di", roots, random.standard_normal((TRIED, 6)))
    possible = (values[:, [0, 3, 4]] >= 0).all(axis=1)
    kept = np.flatnonzero(possible if possible.sum() >= KEPT // 8 else np.ones(TRIED, bool))[:KEPT]
    s, g, w = np.sqrt((np.array(scales)[of[kept]] ** 2).mean(axis=0)).tolist()
    return LawDraws(
        exponent=exponents[form[kept]], growth=growths[form[kept]], values=values[kept],
        understated=s, gain=g, wear=w,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Covariances:
    """Covariances of the means for s, g and w of one, and that of crosstalk [N^2]."""

    stated: Floats
    gain: Floats
    wear: Floats
    crosstalk: Floats

    def total(self, understated: float, gain: float, wear: float) -> Floats:
        """Of all of them."""
        return (
            understated**2 * self.stated + gain**2 * self.gain + wear**2 * self.wear
            + self.crosstalk
        )  # fmt: skip


def _covariances(cuts: Sequence[CutHarmonics], table: Floats, means: Floats) -> _Covariances:
    """``table`` is that of a straight line, whose radial edge force the wear is a share of."""
    count = len(cuts)
    line = np.linalg.lstsq(table * PRIOR, means, rcond=None)[0] * PRIOR
    land = max(abs(float(line[4])), abs(float(line[3])))
    rows = table[:, 3:] @ (land * np.array([FRICTION, 1.0, 0.0]))
    by = np.kron(np.eye(count), np.ones((3, 3)))
    force = means.reshape(count, 3)
    crosstalk = np.zeros((3 * count, 3 * count))
    for one, other in ((i, j) for i, j in product(range(3), repeat=2) if i != j):
        mixed = np.zeros((count, 3))
        mixed[:, one] = force[:, other]
        crosstalk += np.outer(mixed, mixed)
    return _Covariances(
        stated=np.diag(np.concatenate([one.variance[0] for one in cuts])),
        gain=by * np.outer(means, means), wear=by * np.outer(rows, rows),
        crosstalk=CROSSTALK**2 * crosstalk,
    )  # fmt: skip


def _solutions(
    tables: Floats, means: Floats, covariance: Floats, prior: Floats
) -> tuple[Floats, Floats, Floats]:
    """Logarithm of the restricted likelihood (L,), values (L, 6), roots of covariance (L, 6, 6)."""
    lower = np.linalg.cholesky(covariance)
    white = np.linalg.solve(lower, np.concatenate([means[:, None], *tables], axis=1))
    y, designs = white[:, 0], white[:, 1:].reshape(len(means), -1, 6).swapaxes(0, 1) * prior
    normal = designs.swapaxes(1, 2) @ designs + np.eye(6)
    values = np.linalg.solve(normal, (designs.swapaxes(1, 2) @ y)[..., None])[..., 0]
    misfit = ((y - np.einsum("lij,lj->li", designs, values)) ** 2).sum(axis=1)
    plain = (tables * prior).swapaxes(1, 2) @ (tables * prior) + np.eye(6)
    likely = -0.5 * (
        misfit + (values**2).sum(axis=1) + np.linalg.slogdet(normal)[1]
        - np.linalg.slogdet(plain)[1]
    ) - np.log(np.diag(lower)).sum()  # fmt: skip
    roots = prior[:, None] * np.linalg.inv(np.linalg.cholesky(normal)).swapaxes(1, 2)
    return likely, prior * values, roots
