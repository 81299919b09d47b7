"""Model selection by cross-validation, and uncertainty of the selected fit.

Runout is always part of the model.  Modes of the channels, edge forces of single teeth, an unknown
helix and the waveform residual enter where they predict recordings better that were left out of the
fit; with a single recording, where the Bayesian information criterion favours them, and without the
residual.

The covariance is that of the weighted problem, whose weights hold the scatter of the harmonics, the
zeros and the model error; with four fits or more to a part of the recordings their spread
(jackknife) counts where it is wider.  The differences to fits of other terms that are not much
worse are added: an interval is no narrower than the choice of terms allows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pipeline.cutting.force.force_law import COEFFICIENTS, local_lines
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.cutting import CutConditions, ForceSpread, TermsTried
from pipeline.submodels.cutting.fit import Fit, fit_waveform
from pipeline.submodels.cutting.law_draws import PAIRS, FittedLine, mixed
from pipeline.submodels.cutting.model import CutModel, waveform_residuals
from pipeline.submodels.cutting.waveform import (
    STRAIGHT,
    ChipShape,
    CutHarmonics,
    Terms,
    mean_squares,
    rotated,
)
from pipeline.submodels.statistics import jackknife_half_width, student_quantile

NAMED = ("runout", "helix", "modes", "teeth")
"""Terms that are compared."""
RIVAL = 2.0
"""Error of rival terms over the least error, at most [1]; rivals widen the intervals."""
RIVAL_CRITERION = 10.0
"""Criterion of rival terms above the least, at most (Kass and Raftery 1995: beyond it evidence is
very strong)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold:
    """A fit without some of the recordings."""

    left_out: tuple[int, ...]
    """Positions of the recordings left out."""
    fit: Fit
    """Fit to the other recordings."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Selection:
    """Fit to all recordings with the selected terms, and the comparison behind it."""

    fit: Fit
    """Fit with the selected terms."""
    with_residual: bool
    """Whether the waveform residual is part of the model."""
    folds: Sequence[Fold]
    """Fits of these terms to a part of the recordings."""
    rivals: Sequence[Fit]
    """Fits of other terms that are not much worse."""
    tried: Sequence[TermsTried]
    """Terms, error on recordings left out [1] or criterion, and which were kept."""


def select_model(
    tool: Tool, cuts: Sequence[CutHarmonics], helix: bool, gain: float, folds: int
) -> Selection:
    """The fit with the terms that predict best by cross-validation.

    ``helix`` says whether its angle is unknown, ``gain`` which share of the error a term must save,
    ``folds`` how many the cross-validation has at most.
    """
    whole = fit_waveform(tool, cuts, Terms(modes=True, teeth=tool.flutes > 1, helix=helix))
    fits = {whole.problem.terms: whole}
    for modes, teeth in product((False, True), repeat=2):
        terms = Terms(modes=modes, teeth=teeth and tool.flutes > 1, helix=helix)
        if terms not in fits:
            start = whole if modes or teeth else None
            fits[terms] = fit_waveform(tool, cuts, terms, start=start)
    comparison = _Comparison(cuts=cuts, gain=gain, folds=folds)
    best = comparison.least(list(fits.values()))
    if helix:
        fewer = fit_waveform(tool, cuts, replace(best.problem.terms, helix=False))
        fits[fewer.problem.terms] = fewer
        best = comparison.least([best, fewer])
    left_out = comparison.folds(best)
    with_residual = residual_helps(cuts, left_out, gain)
    kept = best.problem.terms
    tried = [
        TermsTried(terms=tuple(one for one in NAMED if getattr(terms, one)), value=value,
                   kept=terms == kept)
        for terms, value in comparison.errors.items()
    ]  # fmt: skip
    rivals = [fits[terms] for terms in comparison.rivals(kept)]
    return Selection(
        fit=best, with_residual=with_residual, folds=left_out, rivals=rivals, tried=tried
    )


def residual_helps(cuts: Sequence[CutHarmonics], folds: Sequence[Fold], gain: float) -> bool:
    """Whether a waveform residual saves that share of the error on recordings left out."""
    if not folds:
        return False
    with_it, without = (left_out_error(cuts, folds, with_residual=one) for one in (True, False))
    return with_it < (1 - gain) * without


class _Comparison:
    """Compares fits by recordings left out, or by the information criterion."""

    def __init__(self, cuts: Sequence[CutHarmonics], gain: float, folds: int) -> None:
        self.cuts, self.gain, self.most = cuts, gain, folds
        self.errors: dict[Terms, float] = {}
        self._folds: dict[Terms, list[Fold]] = {}

    def least(self, fits: Sequence[Fit]) -> Fit:
        """The fit of the fewest unknowns whose error is within ``gain`` of the least."""
        values = [self._value(one) for one in fits]
        margin = 1 + self.gain if len(self.cuts) > 1 else 1.0
        bound = min(values) * margin if min(values) > 0 else min(values)
        near = [fit for fit, value in zip(fits, values, strict=True) if value <= bound]
        return min(near, key=lambda one: len(one.x) + one.problem.linear)

    def rivals(self, kept: Terms) -> list[Terms]:
        """Terms whose error is not much above that of the selected ones."""
        least = self.errors[kept]
        bound = RIVAL * least if len(self.cuts) > 1 else least + RIVAL_CRITERION
        return [terms for terms, value in self.errors.items() if terms != kept and value <= bound]

    def folds(self, fit: Fit) -> list[Fold]:
        terms = fit.problem.terms
        if terms not in self._folds:
            self._folds[terms] = left_out_fits(fit, self.most)
        return self._folds[terms]

    def _value(self, fit: Fit) -> float:
        if len(self.cuts) > 1:
            value = left_out_error(self.cuts, self.folds(fit))
        else:
            unknowns = len(fit.x) + fit.problem.linear
            value = 2 * fit.unlikely + unknowns * float(np.log(len(fit.solved.residuals)))
        self.errors[fit.problem.terms] = value
        return value


def left_out_fits(fit: Fit, most: int) -> list[Fold]:
    """Fits of the same terms to parts of the recordings, at most so many; none of a single one."""
    problem, count = fit.problem, len(fit.problem.cuts)
    folds, many = [], min(count, most) if count > 1 else 0
    for first in range(many):
        rest = [cut for k, cut in enumerate(problem.cuts) if k % many != first]
        part = fit_waveform(problem.tool, rest, problem.terms, start=fit)
        folds.append(Fold(left_out=tuple(range(first, count, many)), fit=part))
    return folds


def left_out_error(
    cuts: Sequence[CutHarmonics], folds: Sequence[Fold], *, with_residual: bool = False
) -> float:
    """RMS error on the recordings left out, as a share of their RMS force."""
    error = power = 0.0
    for fold in folds:
        model = model_of(fold.fit, with_residual=with_residual)
        for k in fold.left_out:
            missing = mean_squares(cuts[k].lines - model.beside(cuts[k]))
            error += float(missing.sum() / mean_squares(cuts[k].lines).sum())
            power += 1.0
    return float(np.sqrt(error / power))


def own_line(fit: Fit) -> Floats | None:
    """Straight line of a fit's law over its recordings [N/m^2], [N/m]; None where it is one."""
    straight = fit.problem.chip(fit.x) == STRAIGHT
    return None if straight else straight_line(fit, [cut.conditions for cut in fit.problem.cuts])


def straight_line(fit: Fit, each: Sequence[CutConditions]) -> Floats:
    """Straight line of a fit's law over the chips of cuts [N/m^2], [N/m]; shape (6,)."""
    growth, exponent = fit.problem.chip(fit.x)
    values = fit.values[None, : len(COEFFICIENTS)]
    return local_lines(np.full((1, 3), exponent), np.array([growth]), values, each)[0]


def model_of(fit: Fit, *, with_residual: bool, spread: ForceSpread | None = None) -> CutModel:
    """The model of a fit; with ``with_residual`` its waveform residual is part of it."""
    problem, x = fit.problem, fit.x
    modes = problem.modes(x)
    mechanics = CutModel(
        tool=problem.tool, geometry=problem.geometry(x), values=fit.values,
        natural=None if modes is None else modes[0], damping=None if modes is None else modes[1],
        left_out=problem.left_out, spread=spread, chip=problem.chip(x), line=own_line(fit),
    )  # fmt: skip
    if not with_residual:
        return mechanics
    phases = x[: len(problem.cuts)].tolist()
    modelled = [
        rotated(mechanics.mechanics(cut.conditions, cut.harmonics), phase)
        for cut, phase in zip(problem.cuts, phases, strict=True)
    ]
    residuals = waveform_residuals(problem.cuts, modelled, phases, problem.zero)
    return replace(mechanics, residuals=residuals)


FEWEST = 4
"""Fits to a part of the recordings from which a spread is taken, at least."""
LOOSE = 10.0
"""Prior standard deviation of a nonlinear unknown, over its scale [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FitUncertainty:
    """Covariance of a fit's unknowns."""

    names: list[str]
    """Nonlinear unknowns, then the six coefficients, then edge forces of single teeth."""
    covariance: Floats
    """Covariance of the unknowns in SI; shape (P + D, P + D)."""
    quantile: float
    """Half of a 95 % interval over the standard deviation [1]."""
    condition: float
    """Condition number of the Jacobian with columns scaled to length one [1]."""
    factor: Floats
    """Ratio of the coefficients' standard deviations to those of the fit alone [1]; shape (6,)."""

    def half_width(self, by: Mapping[str, float]) -> float:
        """Half of the 95 % interval of a quantity with this gradient by unknowns, 0 by others."""
        slope = np.array([by.get(name, 0.0) for name in self.names])
        return self.quantile * float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))


def fit_uncertainty(
    fit: Fit, folds: Sequence[Fold], rivals: Sequence[Fit], fewest: int = FEWEST
) -> FitUncertainty:
    """Uncertainty of a fit's unknowns.

    ``folds`` are fits of the same terms to a part of the recordings, whose spread counts from
    ``fewest`` on, ``rivals`` those of other terms that are not much worse.
    """
    problem = fit.problem
    slopes, length, loose = _jacobian(fit)
    scaled = slopes / length
    normal = scaled.T @ scaled + np.diag((loose * length) ** -2.0)
    singular = np.linalg.eigvalsh(normal)
    inverse = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
    covariance = np.asarray(inverse / np.outer(length, length), np.float64)
    freedom = max(len(slopes) - slopes.shape[1] - problem.linear, 1)
    single = [f"{name}_tooth{k + 1}" for k in range((problem.linear - 6) // 3)
              for name in COEFFICIENTS[3:]]  # fmt: skip
    names = [*problem.names, *COEFFICIENTS, *single]
    quantile = student_quantile(freedom)
    own = np.sqrt(np.diag(covariance))
    spread, differences = _jackknife(fit, folds, fewest), _rival_differences(fit, rivals)
    wider = np.maximum(own, [spread.get(name, 0.0) for name in names])
    wider = np.hypot(wider, np.array([differences.get(name, 0.0) for name in names]) / quantile)
    factor = wider / np.where(own > 0, own, 1.0)
    covariance = covariance * np.outer(factor, factor)
    return FitUncertainty(
        names=names, covariance=covariance, quantile=quantile,
        condition=float(np.sqrt(singular[-1] / max(float(singular[0]), 1e-300))),
        factor=factor[len(fit.x) : len(fit.x) + len(COEFFICIENTS)],
    )  # fmt: skip


def _jacobian(fit: Fit) -> tuple[Floats, Floats, Floats]:
    """Slopes of the weighted rows, their lengths, and prior deviations of the unknowns."""
    problem = fit.problem
    slopes = np.concatenate([problem.slopes(fit.x, fit.values), fit.solved.table], axis=1)
    loose = LOOSE * np.concatenate([problem.scale, np.full(problem.linear, np.inf)])
    return slopes, np.sqrt((slopes**2).sum(axis=0) + loose**-2.0), loose


def fitted_line(fit: Fit, factor: Floats) -> FittedLine:
    """The six constants of a fit's law by one Gauss-Newton step without the rows of its means.

    The shape of the law is held: laws of other shapes have their own readings.

    ``factor`` is that of the standard deviations over those of the fit alone [1]; shape (6,).
    """
    slopes, length, loose = _jacobian(fit)
    slopes[:, : len(fit.x)] *= [name not in ("growth", "exponent") for name in fit.problem.names]
    rows = np.ones(len(slopes), dtype=bool)
    first = 0
    for cut in fit.problem.cuts:
        rows[first : first + 3] = False
        first += 6 * cut.harmonics + 3
    scaled = (slopes / length)[rows]
    normal = scaled.T @ scaled + np.diag((loose * length) ** -2.0)
    inverse = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
    part = slice(len(fit.x), len(fit.x) + len(COEFFICIENTS))
    wide = factor / length[part]
    step = ((inverse @ scaled.T) / length[:, None])[part]

    def answer(change: Sequence[Complexes]) -> Floats:
        """Change of the six coefficients by one of the harmonics, or by each of several."""
        shown = fit.problem.rows(change, fit.problem.weights())
        return np.asarray(step[:, : len(shown) - 3 * len(change)] @ shown[rows[: len(shown)]])

    def reading(chip: ChipShape) -> Floats:
        """Reading of the fit for each constant of a law of another shape."""
        designs = fit.problem.designs(fit.x, chip)
        return answer([one[..., : len(COEFFICIENTS)] for one in designs])

    def each(parts: Sequence[Complexes]) -> list[Floats]:
        """Answers to the part of each recording alone."""
        alone = [[one if k == other else 0 * one for other, one in enumerate(parts)]
                 for k in range(len(parts))]  # fmt: skip
        return [answer(one) for one in alone]

    shown = [cut.lines for cut in fit.problem.cuts]
    edges = [one[..., 3 : len(COEFFICIENTS)] for one in fit.problem.designs(fit.x)]
    return FittedLine(
        values=fit.values[:6] + step @ fit.solved.residuals[rows], reading=reading,
        covariance=inverse[part, part] * np.outer(wide, wide),
        gain=np.stack(each(shown), axis=1), edges=np.stack(each(edges), axis=1),
        crosstalk=np.stack([answer([mixed(one, *p) for one in shown]) for p in PAIRS], axis=1),
    )  # fmt: skip


def _rival_differences(fit: Fit, rivals: Sequence[Fit]) -> dict[str, float]:
    """Greatest change of each unknown with other terms."""
    here = _values(fit, fit)
    differences: dict[str, float] = {}
    for rival in rivals:
        for name, value in _values(rival, fit).items():
            if name in here and not name.startswith("log_"):
                differences[name] = max(differences.get(name, 0.0), abs(value - here[name]))
    return differences


def _values(part: Fit, whole: Fit) -> dict[str, float]:
    """Coefficients and nonlinear unknowns without phases, teeth numbered as in the whole fit."""
    names = [name for name in part.problem.names if not name.startswith("phase")]
    shape = zip(names, _shape(part, whole).tolist(), strict=True)
    return dict(zip(COEFFICIENTS, part.values[:6].tolist(), strict=True)) | dict(shape)


def _jackknife(fit: Fit, folds: Sequence[Fold], fewest: int) -> dict[str, float]:
    """Jackknife standard deviations from partial fits; empty for too few."""
    if len(folds) < fewest:
        return {}
    values = [_values(one.fit, fit) for one in folds]
    parts = np.array([list(one.values()) for one in values])
    spread = jackknife_half_width(parts) / student_quantile(np.inf)
    return dict(zip(values[0], spread.tolist(), strict=True))


def _shape(part: Fit, whole: Fit) -> Floats:
    """Nonlinear unknowns without phases of a partial fit, teeth numbered as in the whole fit."""
    values = part.x[len(part.problem.cuts) :].copy()
    names = [name for name in part.problem.names if not name.startswith("phase")]
    here, there = whole.problem.geometry(whole.x), part.problem.geometry(part.x)
    flutes = whole.problem.tool.flutes
    rotations = np.exp(2j * np.pi * np.arange(flutes) / flutes)
    offsets = complex(there.along, there.across) * rotations
    best = offsets[int(np.argmin(np.abs(offsets - complex(here.along, here.across))))]
    for name, value in (("along", best.real), ("across", best.imag)):
        if name in names:
            values[names.index(name)] = value
    return values
