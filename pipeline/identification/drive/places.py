"""What the place on the screw does to a friction curve.

Cogs, pitch errors and the guideway push by the place, not by the time.  A slow stroke stays at one
place: all of its samples share one push, and so does every repetition of it, so that scatter in
time knows nothing of it.  How strong and how long such pushes are is seen in the strokes that
travel past several of them; from there the covariance of all rows at all places follows.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.regressors import Regressors

Floats = NDArray[np.float64]

TRAVEL = 3.0
"""Lengths that a stroke must travel to show how the pushes change."""
ROWS = 8
"""Of a stroke at least."""
STROKES = 2
"""Of nearly one speed at least."""
CELLS = 3000
"""Places at most."""
STEADY = 0.1
"""Share of friction that inertia may add in rows that count."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """Pushes by the place.

    Parameters
    ----------
    variance : float
        [N^2].
    length : float
        Way over which they hang together [m].
    strokes : int
        How many showed nearly as much.
    """

    variance: float
    length: float
    strokes: int

    @property
    def quantile(self) -> float:
        """Of Student's t for a 95 % interval: a variance from few strokes is uncertain itself."""
        from scipy.stats import t as student

        return float(student.ppf(0.975, self.strokes))


def pushes(rows: Regressors, residuals: Floats, mass: float) -> Pushes | None:
    """What the strokes show of pushes by the place; None when no stroke shows any.

    Of the strokes at constant speed, grouped by octaves of speed, each group gives the variance
    within its strokes and the way over which it hangs together.  The group of the greatest variance
    counts: slower ones did not travel far enough to see all, from faster ones the filter took it.
    """
    friction = float(np.median(np.abs(rows.force)))
    inertia = np.abs(mass * rows.linear[:, rows.names.index("mass")])
    steady = inertia < STEADY * friction
    groups: dict[int, list[tuple[float, float]]] = {}
    for stroke in np.unique(rows.stroke[steady]).tolist():
        chosen = np.flatnonzero(steady & (rows.stroke == stroke))
        if len(chosen) < ROWS:
            continue
        speed = float(np.median(np.abs(rows.velocity[chosen])))
        centred = residuals[chosen] - residuals[chosen].mean()
        variance = float(centred @ centred) / (len(chosen) - 1)
        length = speed * rows.period * (_persistence(centred) - 1)  # less what the filter joins
        if float(np.ptp(rows.position[chosen])) > TRAVEL * length:
            groups.setdefault(int(np.floor(np.log2(speed))), []).append((variance, length))
    enough = {octave: found for octave, found in groups.items() if len(found) >= STROKES}
    groups = {o: found for o, found in enough.items() if np.median(found, axis=0)[1] > 0}
    if not groups:
        return None
    medians = {octave: np.median(np.array(found), axis=0) for octave, found in groups.items()}
    loudest = max(medians, key=lambda octave: float(medians[octave][0]))
    variance, length = medians[loudest].tolist()
    strokes = sum(len(groups[o]) for o, one in medians.items() if one[0] >= 0.5 * variance)
    return Pushes(variance=variance, length=length, strokes=strokes)


def _persistence(centred: Floats) -> float:
    """Rows over which a series hangs together: until its autocorrelation has fallen to 1/e."""
    power = float(centred @ centred)
    for lag in range(1, len(centred) // 2):
        if float(centred[lag:] @ centred[:-lag]) < power / np.e:
            return float(lag)
    return len(centred) / 2


def scores_covariance(rows: Regressors, slopes: Floats, found: Pushes) -> Floats:
    """Covariance of the sums of ``slopes`` times pushes; shape (D, D).

    Pushes of two places hang together by exp(-way / length); a row that the filter averages over
    many lengths feels little of them; both directions are taken as strangers to each other.

    Parameters
    ----------
    rows : Regressors
        N rows.
    slopes : ndarray, shape (N, D)
        Weighted derivatives of the modelled force.
    found : Pushes
        As :func:`pushes` found them.
    """
    averaged = np.abs(rows.velocity) * rows.period / found.length
    felt = slopes / np.sqrt(1 + averaged**2)[:, None]
    total = np.zeros((slopes.shape[1], slopes.shape[1]))
    for way in (rows.velocity > 0, rows.velocity < 0):
        if not way.any():
            continue
        place = rows.position[way]
        width = max(found.length / 2, float(np.ptp(place)) / CELLS, 1e-9)
        cells, member = np.unique(np.floor(place / width), return_inverse=True)
        sums = np.zeros((len(cells), slopes.shape[1]))
        np.add.at(sums, member, felt[way])
        away = np.abs(cells[:, None] - cells) * width
        total += sums.T @ np.exp(-away / found.length) @ sums
    covariance: Floats = found.variance * total
    return covariance


def shared_weights(rows: Regressors, residuals: Floats, found: Pushes) -> Floats:
    """Weights that let rows of one stroke at one place count as the one push they share; (N,).

    n rows with a push of variance P in common and noise of variance R of their own are worth
    n / (1 + n P / R) rows; weights are 1 for rows that share nothing.
    """
    own = max(float(np.median(residuals**2)) / 0.455, 1e-3 * found.variance)
    cell = np.stack([rows.stroke, np.floor(rows.position / found.length).astype(np.int64)])
    averaged = np.abs(rows.velocity) * rows.period / found.length
    _, member, count = np.unique(cell, axis=1, return_inverse=True, return_counts=True)
    weights: Floats = 1 / (1 + count[member.ravel()] * found.variance / own / (1 + averaged**2))
    return weights / weights.max()
