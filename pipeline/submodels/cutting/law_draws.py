"""Draws of the chip-force law from the mean forces of recorded cuts.

Given the law's exponents and growth the mean forces y are linear in C and E, y = X beta + e, with

    cov e = (s sd)^2 + (g y)^2 by recording + crosstalk + wear of the edge by recording.

The constants that the harmonics of the waveform give count as six means more: of each law what
the fit whose edges are not sharp reads of its waveform, runout left free.  Gain and crosstalk move
them as far as the fit passes them on.

The stated deviations sd, zeros above all, may be too small by a factor s; depth and gain differ
from recording to recording by a share g; the dynamometer mixes its channels; and the edge wears, so
that the force on its land (radial, tangential by its friction) differs by a share w, one half of
the variance at random, the other with the logarithm of the feed: series are often cut in the order
of their feeds, and wear then looks like cutting force.  None of these is known: each has a grid of
values of the same prior weight.  So has the law: a straight line, size effects, edge forces that
grow with the chip, both together; where the waveforms show its shape (:class:`KnownShape`) it
weighs the laws.  Every combination is weighted by its restricted likelihood (Patterson and Thompson
1971), which says nothing where there are no more means than coefficients.  Draws with a negative
tangential or radial edge force are left out: an edge that ploughs neither pulls nor drives its
tool.

From one feed no line follows: the force then grows as a power of the feed, with the exponents that
tables of Kienzle's constants span, and has no edge part.

The coefficients K_c, K_e are those of the straight line with the least squares to a drawn law over
the chips h = f_z sin(phi), phi evenly over each engagement, of feeds from the least to the greatest
recorded, widened to a ratio of ``SPAN`` (:func:`named_range`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
from scipy.linalg import block_diag

from pipeline.cutting.force.force_law import design, feeds, local_lines
from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.cutting import ChipLaw, CutConditions
from pipeline.submodels.cutting.waveform import PRIOR, ChipShape, CutHarmonics

EXPONENTS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
"""Exponents m of the size effect beside an edge force [1]: those of Kienzle's law alone, which hold
the edge force too, span 0.15 to 0.4 (Koenig and Essel 1973)."""
GROWTHS = (0.0, *np.geomspace(1e-6, 12e-6, 6).tolist())
"""Thickness h_0 over which the edge force grows [m]: radii of sharp to honed edges, evenly in their
logarithm as befits a scale (Jeffreys)."""
BESIDE = (1.0, 1.5)
"""Exponents of radial and axial force over that of the tangential one [1] (Koenig and Essel)."""
POWERS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Exponents m of the tangential force from which one feed cannot choose [1]: 1 - m_c of 0.4 to 1
(Koenig and Essel 1973)."""
STEEPEST = 0.9
"""Greatest exponent of radial and axial force [1]."""
UNDERSTATED = (1.0, 2.0, 4.0)
"""Factors s of the stated deviations [1]."""
SHAPES = (1.0, 2.0, 4.0)
"""Factors of the stated deviations of a line by the waveforms [1]."""
GAINS = (0.005, 0.01, 0.02)
"""Shares g of depth and gain [1]."""
WEARS = (0.05, 0.15, 0.3)
"""Shares w of the edge force [1]: a land of 3 to 20 um at 500 N/mm^2 is 0.05 to 0.3 of 30 N/mm."""
FRICTION = 0.4
"""Friction of the land [1] (Smithey, Kapoor and DeVor 2000)."""
CROSSTALK = 0.012
"""Standard deviation of the share of another channel [1]: data sheets allow 2 %, evenly drawn."""
SPAN = 5.0
"""Ratio of the feeds, from finishing to roughing with one tool, over which lines are named [1]."""
UNLIKELY = 1e-4
"""Weight of a law over that of the likeliest below which it is left out [1]."""
TRIED, KEPT = 4096, 1024
"""Draws before and after those with an impossible edge are left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LawDraws:
    """D draws of a law."""

    exponent: Floats
    """m of each direction [1]; shape (D, 3)."""
    growth: Floats
    """h_0 [m]; shape (D,)."""
    values: Floats
    """C [N/m^2], E [N/m]; shape (D, 6)."""
    understated: float
    gain: float
    wear: float
    """Root mean squares of s, g, w over the draws [1]."""

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
    """Conditions at the five feeds over which coefficients are named, least to greatest."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedLine:
    """Constants of a fit's law that the harmonics of the waveforms give without the mean forces."""

    values: Floats
    """Values [N/m^2], [N/m]; shape (6,)."""
    covariance: Floats
    """Covariance of the values; shape (6, 6)."""
    gain: Floats
    """Their change by the gain of each recording; shape (6, R)."""
    edges: Floats
    """Their change by the edge force of each recording, tangential, radial, axial; (6, R, 3)."""
    crosstalk: Floats
    """Their change by the share of each of ``PAIRS``; shape (6, 6)."""
    reading: Callable[[ChipShape], Floats]
    """Constants of the fit for each constant of a law of that shape, (6, 6): a part of another bend
    is taken for runout."""

    def tables(self, exponents: Floats, growths: Floats) -> Floats:
        """Readings of L laws of exponents (L, 3) and growths (L,); shape (L, 6, 6)."""
        cutting = {m: self.reading(ChipShape(0.0, m)) for m in np.unique(exponents).tolist()}
        edge = {h_0: self.reading(ChipShape(h_0, 0.0)) for h_0 in np.unique(growths).tolist()}
        return np.array([
            np.column_stack([*(cutting[one][:, k] for k, one in enumerate(m)), edge[h_0][:, 3:]])
            for m, h_0 in zip(exponents.tolist(), growths.tolist(), strict=True)
        ])  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownShape:
    """Shape of the law that the waveforms show (:mod:`.runout`)."""

    chip: ChipShape
    """h_0 [m] and m [1], the same m for all directions."""
    covariance: Floats
    """Covariance of h_0 and m; shape (2, 2)."""

    def likely(self, exponents: Floats, growths: Floats) -> Floats:
        """Logarithm of the likelihood of laws of exponents (L, 3) and growths (L,); shape (L,).

        The exponent of a law is the mean of its directions.  A law stands for its whole step of the
        grid, whose variance adds to the covariance.
        """
        off = np.stack([growths, exponents.mean(axis=1)], axis=1) - np.array(self.chip)
        step = np.interp(growths, GROWTHS, np.gradient(GROWTHS))
        covariance = np.tile(self.covariance, (len(off), 1, 1))
        covariance[:, 0, 0] += step**2 / 12
        covariance[:, 1, 1] += (EXPONENTS[1] - EXPONENTS[0]) ** 2 / 12
        size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        share = covariance / (size[:, :, None] * size[:, None, :])
        square = np.einsum("li,lij,lj->l", off / size, np.linalg.inv(share), off / size)
        return np.asarray(-0.5 * (square + np.linalg.slogdet(share)[1]) - np.log(size).sum(axis=1))


PAIRS = tuple((to, of) for to, of in product(range(3), repeat=2) if to != of)
"""A channel, and another one that it shows a share of."""
Forces = TypeVar("Forces", Floats, Complexes)


def mixed(forces: Forces, to: int, of: int) -> Forces:
    """Response of channel ``to`` to ``of``, for forces of shape (..., 3)."""
    shown = np.zeros_like(forces)
    shown[..., to] = forces[..., of]
    return shown


def law_draws(
    cuts: Sequence[CutHarmonics], line: FittedLine | None = None, shape: KnownShape | None = None,
    seed: int = 0,
) -> LawDraws:  # fmt: skip
    """Draws of the law that the mean forces and the waveforms allow.

    ``line`` is what the waveforms say, which zeros do not move: a reading of each law; its stated
    deviations may be too small by a factor, too.  ``shape`` is that of the law by the waveforms;
    without it every shape has its prior weight.
    """
    each = [one.conditions for one in cuts]
    means = np.concatenate([one.lines[0].real for one in cuts])
    many = feeds(each) > 1
    exponents, growths, prior = _forms(many)
    if many and shape is not None:
        likely = shape.likely(exponents, growths)
        prior = prior * np.exp(likely - likely.max())
        seen = prior > UNLIKELY * prior.max()
        exponents, growths, prior = exponents[seen], growths[seen], prior[seen]
    believed = np.array(PRIOR) if many else np.array([*PRIOR[:3], 0.0, 0.0, 0.0])
    tables = np.array([
        np.concatenate([design(one, m, growth) for one in each])
        for m, growth in zip(exponents.tolist(), growths.tolist(), strict=True)
    ])  # fmt: skip
    line = line if many else None
    scales = list(product(UNDERSTATED, GAINS, WEARS, (0.0,) if line is None else SHAPES))
    straight = np.concatenate([design(one, (0.0, 0.0, 0.0), 0.0) for one in each])
    parts = _covariances(cuts, straight, means, line)
    if line is not None:
        tables = np.concatenate([tables, line.tables(exponents, growths)], axis=1)
        means = np.concatenate([means, line.values])
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
    s, g, w, _ = np.sqrt((np.array(scales)[of[kept]] ** 2).mean(axis=0)).tolist()
    return LawDraws(
        exponent=exponents[form[kept]], growth=growths[form[kept]], values=values[kept],
        understated=s, gain=g, wear=w,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Covariances:
    """Covariances for s, g, w and the factor of a fitted line of one, and that of crosstalk."""

    stated: Floats
    gain: Floats
    wear: Floats
    shape: Floats
    crosstalk: Floats

    def total(self, understated: float, gain: float, wear: float, shape: float) -> Floats:
        return (
            understated**2 * self.stated + gain**2 * self.gain + wear**2 * self.wear
            + shape**2 * self.shape + self.crosstalk
        )  # fmt: skip


def _covariances(
    cuts: Sequence[CutHarmonics], table: Floats, means: Floats, line: FittedLine | None
) -> _Covariances:
    """Covariance of the means, and of the six rows of a fitted line after them.

    ``table`` is that of a straight line, to whose radial edge force the wear refers.
    """
    count, more = len(cuts), 0 if line is None else 6
    fitted = np.linalg.lstsq(table * PRIOR, means, rcond=None)[0] * PRIOR
    land = max(abs(float(fitted[4])), abs(float(fitted[3]))) * np.array([FRICTION, 1.0, 0.0])
    each = [one.conditions for one in cuts]
    forces, worn = np.zeros((3 * count + more, count)), np.zeros((3 * count + more, count))
    rows = table[:, 3:] @ land
    for k in range(count):
        part = slice(3 * k, 3 * k + 3)
        forces[part, k], worn[part, k] = means[part], rows[part]
    force = means.reshape(count, 3)
    crosstalk = np.stack([mixed(force, *pair).ravel() for pair in PAIRS], axis=1)
    shape = none = np.zeros((more, more))
    if line is not None:
        forces[3 * count :], worn[3 * count :] = line.gain, line.edges @ land
        crosstalk = np.concatenate([crosstalk, line.crosstalk])
        shape = line.covariance
    stated = np.concatenate([one.variance[0] for one in cuts])
    return _Covariances(
        stated=block_diag(np.diag(stated), none), gain=forces @ forces.T,
        wear=worn @ _alike(each) @ worn.T,
        shape=block_diag(np.zeros((3 * count, 3 * count)), shape),
        crosstalk=CROSSTALK**2 * crosstalk @ crosstalk.T,
    )  # fmt: skip


def _alike(each: Sequence[CutConditions]) -> Floats:
    """Covariance of the wear of recordings, of variance 1 on the average; shape (R, R)."""
    logarithm = np.log([one.f_z for one in each])
    order = logarithm - logarithm.mean()
    size = float(np.sqrt((order**2).mean()))
    drift = order / size if size > 1e-6 else np.zeros(len(order))
    return np.asarray(0.5 * np.eye(len(order)) + 0.5 * np.outer(drift, drift))


def _solutions(
    tables: Floats, means: Floats, covariance: Floats, prior: Floats
) -> tuple[Floats, Floats, Floats]:
    """Logarithm of the restricted likelihood (L,), values (L, 6), roots of covariance (L, 6, 6)."""
    size = np.sqrt(np.diag(covariance))
    lower = size[:, None] * np.linalg.cholesky(covariance / np.outer(size, size))
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
