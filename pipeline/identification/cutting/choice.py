"""Which terms the model has: those that predict recordings better that were not fitted.

Runout is always there.  Modes of the channels, edges of single teeth, a helix that is sought and
what is left over come in where the recordings left out ask for them; with one recording, where the
Bayesian information criterion does, and nothing is left over then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.fit import Fit, fitted
from pipeline.identification.cutting.model import CutModel, model_of
from pipeline.identification.cutting.problem import Cut, Terms

Floats = NDArray[np.float64]

FOLDS = 6
"""At most; recordings are left out in turn, one or more at a time."""


RIVAL = 2.0
"""Times the least error that other terms may have and still say something of the parameters..."""
RIVAL_CRITERION = 10.0
"""...or above the least criterion (Kass and Raftery 1995: beyond it evidence is very strong)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold:
    """A fit without some of the recordings.

    Parameters
    ----------
    left_out : tuple of int
        Which ones.
    fit : Fit
        To the others.
    """

    left_out: tuple[int, ...]
    fit: Fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Chosen:
    """The fit to all recordings, and how it was chosen.

    Parameters
    ----------
    fit : Fit
        With the terms that were kept.
    over : bool
        Whether what is left over is part of the model.
    folds : sequence of Fold
        Fits of these terms to a part of the recordings.
    rivals : sequence of Fit
        Fits of other terms that are not much worse.
    tried : sequence of mapping
        Terms, error on recordings left out [1] or criterion, and which were kept.
    """

    fit: Fit
    over: bool
    folds: Sequence[Fold]
    rivals: Sequence[Fit]
    tried: Sequence[dict[str, object]]


def chosen(tool: Tool, cuts: Sequence[Cut], helix: bool, gain: float) -> Chosen:
    """The fit with the terms that the recordings ask for.

    Parameters
    ----------
    tool : Tool
        That cut.
    cuts : sequence of Cut
        The recordings.
    helix : bool
        Whether the helix angle is sought.
    gain : float
        Share of the error that a term must save.
    """
    whole = fitted(tool, cuts, Terms(modes=True, teeth=tool.flutes > 1, helix=helix))
    fits = {whole.problem.terms: whole}
    for modes, teeth in product((False, True), repeat=2):
        terms = Terms(modes=modes, teeth=teeth and tool.flutes > 1, helix=helix)
        if terms not in fits:
            begin = whole if modes or teeth else None
            fits[terms] = fitted(tool, cuts, terms, begin=begin)
    judge = _Judge(tool=tool, cuts=cuts, gain=gain)
    best = judge.least(list(fits.values()))
    if helix:
        fewer = fitted(tool, cuts, replace(best.problem.terms, helix=False))
        fits[fewer.problem.terms] = fewer
        best = judge.least([best, fewer])
    folds = judge.folds(best)
    over = bool(folds) and _error(cuts, folds, True) < (1 - gain) * _error(cuts, folds, False)
    kept = best.problem.terms
    tried = [
        {**_words(terms), "value": value, "kept": terms == kept}
        for terms, value in judge.seen.items()
    ]
    rivals = [fits[terms] for terms in judge.rivals(kept)]
    return Chosen(fit=best, over=over, folds=folds, rivals=rivals, tried=tried)


def _words(terms: Terms) -> dict[str, object]:
    names = [name for name in ("runout", "helix", "modes", "teeth") if getattr(terms, name)]
    return {"terms": names}


class _Judge:
    """Compares fits by recordings left out, or by the information criterion."""

    def __init__(self, tool: Tool, cuts: Sequence[Cut], gain: float) -> None:
        self.tool, self.cuts, self.gain = tool, cuts, gain
        self.seen: dict[Terms, float] = {}
        self._folds: dict[Terms, list[Fold]] = {}

    def least(self, fits: Sequence[Fit]) -> Fit:
        """The fit of the fewest unknowns whose error is within ``gain`` of the least."""
        values = [self._value(one) for one in fits]
        margin = 1 + self.gain if len(self.cuts) > 1 else 1.0
        bound = min(values) * margin if min(values) > 0 else min(values)
        near = [fit for fit, value in zip(fits, values, strict=True) if value <= bound]
        return min(near, key=lambda one: len(one.x) + one.problem.linear)

    def rivals(self, kept: Terms) -> list[Terms]:
        """Terms whose error is not much more than that of those that were kept."""
        least = self.seen[kept]
        bound = RIVAL * least if len(self.cuts) > 1 else least + RIVAL_CRITERION
        return [terms for terms, value in self.seen.items() if terms != kept and value <= bound]

    def folds(self, fit: Fit) -> list[Fold]:
        """Fits of the same terms to a part of the recordings."""
        terms = fit.problem.terms
        if terms not in self._folds:
            self._folds[terms] = [
                Fold(left_out=tuple(out), fit=self._without(out, fit))
                for out in _turns(len(self.cuts))
            ]
        return self._folds[terms]

    def _without(self, out: Sequence[int], fit: Fit) -> Fit:
        rest = [cut for k, cut in enumerate(self.cuts) if k not in out]
        return fitted(self.tool, rest, fit.problem.terms, begin=fit)

    def _value(self, fit: Fit) -> float:
        if len(self.cuts) > 1:
            value = _error(self.cuts, self.folds(fit), False)
        else:
            unknowns = len(fit.x) + fit.problem.linear
            value = 2 * fit.unlikely + unknowns * float(np.log(len(fit.solved.residuals)))
        self.seen[fit.problem.terms] = value
        return value


def _turns(many: int) -> list[list[int]]:
    """Recordings that are left out in turn."""
    if many < 2:
        return []
    turns = min(many, FOLDS)
    return [list(range(k, many, turns)) for k in range(turns)]


def _error(cuts: Sequence[Cut], folds: Sequence[Fold], over: bool) -> float:
    """RMS error on the recordings left out, as a share of their RMS force."""
    error = power = 0.0
    for fold in folds:
        model = model_of(fold.fit, over=over)
        for k in fold.left_out:
            missing, whole = squares(model, cuts[k])
            error += float(missing.sum() / whole.sum())
            power += 1.0
    return float(np.sqrt(error / power))


def squares(model: CutModel, cut: Cut) -> tuple[Floats, Floats]:
    """Mean squares of a model's error and of the force, by direction [N^2]; shape (3,) each."""
    found = []
    for lines in (cut.lines - model.beside(cut), cut.lines):
        power = np.abs(lines) ** 2
        power[1:] /= 2
        found.append(power.sum(axis=0))
    return found[0], found[1]
