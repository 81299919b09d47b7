"""Calibrated 90 % prediction intervals: split conformal by regime, and its tracking over time.

The half width of an interval is a quantile of the absolute residuals of groups (days, recordings)
that the predicting model was not fitted on.  Cross-conformal: each training group is predicted by a
model of the others, so that no group is spent on calibration alone (Vovk 2015).

Samples of a group hang together, and a new group is what the interval has to hold for, so groups
count as whole: the half width of a regime is the 90 % quantile of its absolute residuals, where
each group weighs the same, and the worst stands for the group to come and for those that
:data:`TELLING` ones would have as well.  Conformal prediction of groups (Lee, Barber and Willett
2023) puts the group to come at infinity, and holds more than 90 % by that.  So the interval holds
90 % of a new group's samples in the mean over groups, of few of them a little more; what they did
not show it cannot hold.

Adaptive over time: a factor on the half width rises when a measured value that has become known lay
outside and falls when it lay inside (quantile tracking, Angelopoulos, Candes and Tibshirani 2023;
Gibbs and Candes 2021), so that the share inside comes back to 90 % when conditions drift.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.model import AdaptiveSettings as AdaptiveSettings
from pipeline.schema.model import Band as Band
from pipeline.schema.model import Bands as Bands

LEVEL = 0.9
"""Share of samples that an interval shall hold [1]."""
TELLING = 9
"""Least number of groups of one value each [1] whose greatest is exceeded by one new one in ten."""
ALL_REGIMES = ""
"""Name of the band over all regimes, for samples of a regime that was not seen in training."""

Labels = np.ndarray[Any, np.dtype[np.str_]]
"""A word for each sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """Errors of predictions of groups that the predicting model did not see."""

    error: Floats
    """Measured minus predicted, in the quantity's unit; not finite ones are skipped; (N,)."""
    regime: Labels
    group: Labels
    """Regime and group of each sample; shape (N,)."""
    t: Floats
    """Time of the sample within its group, not falling [s]; shape (N,)."""

    def __post_init__(self) -> None:
        lengths = [len(values) for values in (self.error, self.regime, self.group, self.t)]
        if len(set(lengths)) > 1:
            raise ValueError(
                f"residuals have {lengths} errors, regimes, groups and times: give as many of each"
            )

    def where(self, chosen: Bools) -> "Residuals":
        """The residuals of some samples."""
        return Residuals(
            error=self.error[chosen], regime=self.regime[chosen], group=self.group[chosen],
            t=self.t[chosen],
        )  # fmt: skip

    @staticmethod
    def joined(parts: Iterable["Residuals"]) -> "Residuals":
        """The residuals of several parts, one after the other."""
        found = list(parts)
        if not found:
            none, words = np.empty(0), np.empty(0, dtype=str)
            return Residuals(error=none, regime=words, group=words, t=none)
        return Residuals(
            error=np.concatenate([p.error for p in found]),
            regime=np.concatenate([p.regime for p in found]),
            group=np.concatenate([p.group for p in found]),
            t=np.concatenate([p.t for p in found]),
        )


def splits(groups: Sequence[str], folds: int) -> Iterator[tuple[list[str], list[str]]]:
    """Pairs of groups to fit on and groups left out; each group is left out once.

    Neighbours in the order of ``groups`` are left out together; there are ``folds`` pairs, at most
    one a group.

    Examples
    --------
    >>> list(splits(["a", "b", "c"], 2))
    [(['c'], ['a', 'b']), (['a', 'b'], ['c'])]
    """
    if len(groups) < 2:
        return
    for part in np.array_split(np.arange(len(groups)), min(folds, len(groups))):
        left = {int(i) for i in part}
        yield (
            [name for i, name in enumerate(groups) if i not in left],
            [name for i, name in enumerate(groups) if i in left],
        )


def bands(residuals: Residuals) -> dict[str, Band]:
    """Calibrated half widths by regime, and over all regimes under :data:`ALL_REGIMES`.

    A regime that has residuals of fewer groups than half of all, or of one, has no band of its own
    unless it is the only one: the band over all regimes serves it.

    ValueError without residuals.
    """
    known = residuals.where(np.isfinite(residuals.error))
    if not len(known.error):
        raise ValueError(
            "no residual of a group left out is known: an interval needs two training groups at "
            "least, record another"
        )
    everywhere = _band(known)
    found = {ALL_REGIMES: everywhere}
    for name in np.unique(known.regime).tolist():
        own = _band(known.where(known.regime == name))
        if name != ALL_REGIMES and own.groups >= max(2, everywhere.groups / 2):
            found[name] = own
    return found


def _band(residuals: Residuals) -> Band:
    """90 % quantile of sizes, each group of the same weight, the worst also for those to come."""
    size = np.abs(residuals.error)
    _, group, count = np.unique(residuals.group, return_inverse=True, return_counts=True)
    order = np.argsort(size, kind="stable")
    size, group = size[order], group[order]
    counted = max(len(count), TELLING) + 1
    weight = 1.0 / (counted * count[group])
    worst = counted - len(count) + 1
    half = max(
        _quantile(size, np.where(group == one, worst * weight, weight)) for one in range(len(count))
    )
    return Band(lower=half, upper=half, n=len(size), groups=len(count))


def _quantile(size: Floats, weight: Floats) -> float:
    """90 % quantile of sizes in order with weights that add up to 1, as Hazen's (1914)."""
    return float(np.interp(LEVEL, np.cumsum(weight) - weight / 2, size))


def half_widths(regime: Labels, bands: Bands) -> tuple[Floats, Floats]:
    """Lower and upper half width of each sample, each (N,), by its regime."""
    names, place = np.unique(regime, return_inverse=True)
    chosen = [bands.get(name, bands[ALL_REGIMES]) for name in names.tolist()]
    lower = np.array([band.lower for band in chosen], dtype=float)
    upper = np.array([band.upper for band in chosen], dtype=float)
    return lower[place], upper[place]


def interval(predicted: Floats, regime: Labels, bands: Bands) -> tuple[Floats, Floats]:
    """Low and high of the 90 % interval around predictions, each (N,).

    ``predicted`` in the unit of the bands; what the regime of each sample depends on has to be
    available at the time of the prediction.
    """
    lower, upper = half_widths(regime, bands)
    return predicted - lower, predicted + upper


def adaptive(
    t: Floats,
    measured: Floats,
    predicted: Floats,
    regime: Labels,
    bands: Bands,
    settings: AdaptiveSettings,
) -> tuple[Floats, Floats]:
    """Low and high of a 90 % interval that follows the errors of one group, each (N,).

    The half width at t is that of :func:`interval` times a factor of its regime.  The factor starts
    at 1; each measured value available by t, that is of an earlier sample at least ``delay_s``
    old, has raised it by 0.9 ``step`` when it lay outside the interval of its own time and lowered
    it by 0.1 ``step`` when it lay inside.  Nothing of t itself or later is looked at.

    Times t (N,) do not fall [s]; ``measured`` and ``predicted`` (N,) are in the unit of the bands,
    NaN where nothing was measured, which changes no factor. ValueError when the times fall.
    """
    if (np.diff(t) < 0).any():
        at = int(np.argmax(np.diff(t) < 0)) + 1
        raise ValueError(f"time falls to {t[at]:g} s at sample {at}: put the samples in order")
    lower, upper = half_widths(regime, bands)
    factor = _factors(
        t.tolist(), _size(measured - predicted, lower, upper).tolist(),
        np.unique(regime, return_inverse=True)[1].tolist(), settings,
    )  # fmt: skip
    return predicted - factor * lower, predicted + factor * upper


def _size(error: Floats, lower: Floats, upper: Floats) -> Floats:
    """Residual over the half width on its side [1]; infinite outside a width of 0."""
    width = np.where(error < 0, lower, upper)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error == 0, 0.0, np.abs(error) / width)


def _factors(
    t: list[float], size: list[float], regime: list[int], settings: AdaptiveSettings
) -> Floats:
    """Factor on the half width at each sample, from values measured before, shape (N,)."""
    by_regime = [1.0] * (max(regime, default=0) + 1)
    up, down = LEVEL * settings.step, (1 - LEVEL) * settings.step
    found = [1.0] * len(t)
    known = 0
    for now, time in enumerate(t):
        while known < now and t[known] + settings.delay_s <= time:
            own, one = regime[known], size[known]
            if one > found[known]:
                by_regime[own] += up
            elif one <= found[known]:  # neither holds for NaN
                by_regime[own] = max(by_regime[own] - down, 0.0)
            known += 1
        found[now] = by_regime[regime[now]]
    return np.array(found)


def chosen_step(
    residuals: Residuals, bands: Bands, steps: Sequence[float], delay_s: float
) -> float:
    """The step with the least mean interval score over training groups left out.

    The interval score is the width, and 2 / 0.1 times the distance of what lies outside (Gneiting
    and Raftery 2007): it is least, in the mean, for the interval that holds 90 %.  Each group
    weighs the same.

    ``residuals`` are of training groups only; a step of 0 is an interval that does not adapt; a
    measured value is available ``delay_s`` after its time [s]. ValueError when there is no step to
    choose from.
    """
    if not steps:
        raise ValueError("there is no step to choose from: name one at least, 0 for none")
    scores = [
        float(np.mean([
            _interval_score(residuals.where(residuals.group == name), bands, step, delay_s)
            for name in np.unique(residuals.group)
        ]))
        for step in steps
    ]  # fmt: skip
    return float(steps[int(np.argmin(scores))])


def _interval_score(own: Residuals, bands: Bands, step: float, delay_s: float) -> float:
    low, high = adaptive(
        own.t, own.error, np.zeros(len(own.error)), own.regime, bands,
        AdaptiveSettings(step=step, delay_s=delay_s),
    )  # fmt: skip
    missed = np.maximum(low - own.error, 0.0) + np.maximum(own.error - high, 0.0)
    return float(np.nanmean(high - low + 2 / (1 - LEVEL) * missed))
