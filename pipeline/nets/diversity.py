"""Features of windows, and collapse of a generator: samples that differ too little.

Features are level, spread and shape of a channel, and the shares of its spectrum in bands;
distances are those between windows of neighbouring conditions.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats

BANDS = 8
"""Bands of a spectrum, evenly spaced on a logarithmic scale."""
COLLAPSED = 0.3
"""Spread of samples below this share of the spread of recorded windows is a collapse [1]."""
SATURATED = 0.02
"""Hinge loss or cross entropy of the discriminator below which the generator learns nothing [1]."""
TINY = 1e-12


def features(windows: ArrayLike) -> Floats:
    """Features of windows (N, C, L), shape (N, C (4 + bands)).

    Mean, logarithms of standard deviation and of the largest distance from the mean, skewness, and
    logarithm of the power in bands of each channel.
    """
    x = np.asarray(windows, dtype=np.float64)
    mean = x.mean(axis=2, keepdims=True)
    around = x - mean
    spread = np.sqrt((around**2).mean(axis=2))
    floor = TINY + 1e-9 * np.abs(x).max() if x.size else TINY
    skew = (around**3).mean(axis=2) / np.maximum(spread, floor) ** 3
    peak = np.abs(around).max(axis=2)
    power = band_power(around)
    parts = [
        mean, np.log(np.maximum(spread, floor))[:, :, None],
        np.log(np.maximum(peak, floor))[:, :, None], skew[:, :, None],
        np.log(np.maximum(power, floor**2)),
    ]  # fmt: skip
    return np.concatenate(parts, axis=2).reshape(len(x), -1)


def band_power(windows: Floats) -> Floats:
    """Mean squares of windows (N, C, L) in bands, shape (N, C, B); they add up to the whole."""
    length = windows.shape[2]
    lines = np.abs(np.fft.rfft(windows, axis=2)) ** 2
    weight = np.full(lines.shape[2], 2.0)
    weight[0] = 1.0
    if length % 2 == 0:
        weight[-1] = 1.0
    lines = lines * weight / length**2
    edges = band_edges(length)
    return np.stack([lines[:, :, a:b].sum(axis=2) for a, b in pairwise(edges)], axis=2)


def band_edges(length: int, bands: int = BANDS) -> "np.ndarray[Any, Any]":
    """Lines of the spectrum of so many samples at which bands begin, and the end of the last."""
    many = length // 2
    return np.unique(np.round(np.geomspace(1, many + 1, bands + 1)).astype(int))


@dataclass(frozen=True, kw_only=True, eq=False)
class FeatureScaling:
    """Features brought to a common scale by the median and the quartiles of recorded windows."""

    shift: Floats
    scale: Floats

    @staticmethod
    def of(values: Floats) -> "FeatureScaling":
        """Scaling by features, shape (N, K)."""
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75], axis=0)
        wide = np.maximum(high - low, 0.1 * values.std(axis=0))
        return FeatureScaling(shift=middle, scale=np.where(wide > TINY, wide, 1.0))

    def __call__(self, values: Floats) -> Floats:
        """Scaled features; those far out are brought to 10, so that none decides alone."""
        return np.clip((values - self.shift) / self.scale, -10.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class Collapse:
    """Whether samples differ as recorded windows do."""

    within: float
    """Median distance of samples at neighbouring conditions, over that of recorded windows [1]."""
    between: float
    """Spread over all conditions [1]."""
    saturated: bool
    """Whether the discriminator's loss has vanished at the end of the training."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Signs of a collapse, a sentence each; empty for a sound generator."""
        found = []
        if self.within < COLLAPSED:
            found.append(
                f"samples at the same conditions differ by {self.within:.2g} of what recorded "
                f"windows do, limit {COLLAPSED:g}: the generator has collapsed"
            )
        if self.between < COLLAPSED:
            found.append(
                f"samples over all conditions differ by {self.between:.2g} of what recorded "
                f"windows do, limit {COLLAPSED:g}: the generator has collapsed"
            )
        if self.saturated:
            found.append(
                f"the loss of the discriminator is below {SATURATED:g}: the generator learns "
                "nothing more from it"
            )
        return tuple(found)


def collapse(
    recorded: ArrayLike, sampled: ArrayLike, conditions: ArrayLike,
    losses: ArrayLike = (), *, most: int = 400, seed: int = 0,
) -> Collapse:  # fmt: skip
    """Spread of samples against that of recorded windows, pair by pair.

    ``sampled`` and ``recorded`` (N, C, L) at ``conditions`` (N, K) of one scale; ``losses`` (H,) of
    the discriminator [1]; ``most`` windows count, at random by ``seed``.
    """
    rng = np.random.default_rng(seed)
    many = len(np.asarray(recorded))
    if many < 3:
        raise ValueError(f"{many} windows show no spread: give three or more")
    rows = rng.permutation(many)[:most]
    theirs = features(np.asarray(recorded)[rows])
    scaling = FeatureScaling.of(theirs)
    real, made = scaling(theirs), scaling(features(np.asarray(sampled)[rows]))
    place = np.asarray(conditions, dtype=np.float64)[rows].reshape(len(rows), -1)
    near = _nearest(place)
    far = rng.permutation(len(rows))
    ratios = []
    for other in (near, far):
        apart = [np.sqrt(((some - some[other]) ** 2).mean(axis=1)) for some in (real, made)]
        apart = [one[other != np.arange(len(other))] for one in apart]
        ratios.append(float(np.median(apart[1]) / max(np.median(apart[0]), TINY)))
    late = np.asarray(losses, dtype=np.float64)
    late = late[-max(len(late) // 10, 1) :]
    saturated = bool(len(late) and late.mean() < SATURATED)
    return Collapse(within=ratios[0], between=ratios[1], saturated=saturated)


def _nearest(place: Floats) -> Any:
    """For each row another one whose conditions are next to it."""
    apart = ((place[:, None] - place[None]) ** 2).sum(axis=2)
    np.fill_diagonal(apart, np.inf)
    return apart.argmin(axis=1)
