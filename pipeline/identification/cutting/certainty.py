"""How certain a fit of a waveform is: the covariance of all its unknowns.

It is that of the weighted problem, whose weights hold the scatter of the harmonics, the zeros and
what the model leaves out; with four fits to a part of the recordings or more, their spread
(jackknife) counts where it is wider.  What fits of other terms say that are not much worse is
added: a model that leaves something out has no better interval than the choice of its terms.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.mean_force import COEFFICIENTS
from pipeline.identification.cutting.choice import Fold
from pipeline.identification.cutting.fit import Fit

Floats = NDArray[np.float64]

FEWEST = 4
"""Fits to a part of the recordings that tell a spread."""
LOOSE = 10.0
"""Standard deviation of a nonlinear unknown beforehand, in its scales."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Certain:
    """Covariance of a fit.

    Parameters
    ----------
    names : list of str
        Nonlinear unknowns, then the six coefficients, then edges of single teeth.
    covariance : ndarray, shape (P + D, P + D)
        SI.
    quantile : float
        Standard deviations of half a 95 % interval.
    condition : float
        Of the slopes with columns scaled to length one.
    """

    names: list[str]
    covariance: Floats
    quantile: float
    condition: float

    def half_width(self, slope: Floats) -> float:
        """Half of the 95 % interval of what has these slopes over the unknowns."""
        return self.quantile * float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))


def certain(fit: Fit, folds: Sequence[Fold], rivals: Sequence[Fit]) -> Certain:
    """How well a fit determines its unknowns.

    Parameters
    ----------
    fit : Fit
        To all recordings.
    folds : sequence of Fold
        Fits of the same terms to a part of them.
    rivals : sequence of Fit
        Fits of other terms that are not much worse.
    """
    from scipy.stats import t as student

    problem = fit.problem
    slopes = np.concatenate([problem.slopes(fit.x, fit.values), fit.solved.table], axis=1)
    loose = LOOSE * np.concatenate([problem.scale, np.full(problem.linear, np.inf)])
    length = np.sqrt((slopes**2).sum(axis=0) + loose**-2.0)
    scaled = slopes / length
    normal = scaled.T @ scaled + np.diag((loose * length) ** -2.0)
    singular: Floats = np.linalg.eigvalsh(normal)
    covariance = np.linalg.pinv(normal, rcond=1e-14, hermitian=True) / np.outer(length, length)
    freedom = max(len(slopes) - slopes.shape[1] - problem.linear, 1)
    names = [*problem.names, *COEFFICIENTS, *_edges(fit)]
    quantile = float(student.ppf(0.975, freedom))
    own = np.sqrt(np.diag(covariance))
    spread, apart = _jackknife(fit, folds), _apart(fit, rivals)
    told = np.maximum(own, [spread.get(name, 0.0) for name in names])
    told = np.hypot(told, np.array([apart.get(name, 0.0) for name in names]) / quantile)
    wider = told / np.where(own > 0, own, 1.0)
    covariance = covariance * np.outer(wider, wider)
    return Certain(
        names=names, covariance=covariance, quantile=quantile,
        condition=float(np.sqrt(singular[-1] / max(float(singular[0]), 1e-300))),
    )  # fmt: skip


def _edges(fit: Fit) -> list[str]:
    many = (fit.problem.linear - 6) // 3
    return [f"{name}_tooth{k + 1}" for k in range(many) for name in COEFFICIENTS[3:]]


def _apart(fit: Fit, rivals: Sequence[Fit]) -> dict[str, float]:
    """By how much other terms change an unknown, at most."""
    here = _values(fit, fit)
    found: dict[str, float] = {}
    for rival in rivals:
        for name, value in _values(rival, fit).items():
            if name in here and not name.startswith("log_"):
                found[name] = max(found.get(name, 0.0), abs(value - here[name]))
    return found


def _values(part: Fit, whole: Fit) -> dict[str, float]:
    """Coefficients and nonlinear unknowns but phases, teeth counted as in the whole."""
    names = [name for name in part.problem.names if not name.startswith("phase")]
    shape = zip(names, _shape(part, whole).tolist(), strict=True)
    return dict(zip(COEFFICIENTS, part.values[:6].tolist(), strict=True)) | dict(shape)


def _jackknife(fit: Fit, folds: Sequence[Fold]) -> dict[str, float]:
    """Standard deviations from fits to a part of the recordings; nothing from too few."""
    from scipy.stats import norm
    from scipy.stats import t as student

    many = len(folds)
    if many < FEWEST:
        return {}
    each = [_values(one.fit, fit) for one in folds]
    parts = np.array([list(one.values()) for one in each])
    spread = np.sqrt((many - 1) / many * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))
    spread *= student.ppf(0.975, many - 1) / norm.ppf(0.975)
    return dict(zip(each[0], spread.tolist(), strict=True))


def _shape(part: Fit, whole: Fit) -> Floats:
    """Nonlinear unknowns but phases of a fit to a part, its teeth counted as in the whole."""
    values = part.x[len(part.problem.cuts) :].copy()
    names = [name for name in part.problem.names if not name.startswith("phase")]
    here, there = whole.problem.geometry(whole.x), part.problem.geometry(part.x)
    flutes = whole.problem.tool.flutes
    turns = np.exp(2j * np.pi * np.arange(flutes) / flutes)
    each = complex(there.along, there.across) * turns
    best = each[int(np.argmin(np.abs(each - complex(here.along, here.across))))]
    for name, value in (("along", best.real), ("across", best.imag)):
        if name in names:
            values[names.index(name)] = value
    return values
