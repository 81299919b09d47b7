"""Levels of a spindle's power, and the no-load power and specific cutting force that they give.

Levels are stretches of constant speed and cut.  A control shows its spindle's load in whole
percents, a few times a second.  A thousand samples of one level are then no thousand readings:
while the load lies between two whole numbers, all of them are off by the same part of a percent.
The uncertainty of a level's mean follows from how far noise carries the load over the steps of the
display, and from how long the noise is correlated.

P eta = P_0(n) + K_tc Q + K_te w, with the no-load power P_0(n) = p0 + p1 n + p2 n^2: the motor's
power P times the efficiency eta covers the spindle running without load, the volume Q removed per
second, and the width of chip times cutting speed w of the edges.  K_tc and K_te are those of the
linear-edge model; P_0 is that of :class:`pipeline.cutting.economics.spindle_power.SpindleDrive`.
All of it scales with rated power, efficiency and meaning of the load, which are premises.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.spindle_power import SpindleDrive, power_curve
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import MINUTE
from pipeline.submodels.cutting.regression import Regression, regression

ALIKE = 0.02
"""Share by which speed, removal and edge rate of equal levels differ at most [1]; equal levels have
the same rounding error."""
MANY = 8
"""Different readings from which the step of a display follows by their differences."""
REACH = 4.0
"""Standard deviations that noise reaches in a level, at most [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Levels:
    """L levels of constant speed and cut."""

    speed: Floats
    """n [rev/s]; shape (L,)."""
    power: Floats
    """Mean at the spindle's nose, no-load losses included [W]; shape (L,)."""
    deviation: Floats
    """Standard deviation of ``power`` from noise and rounding [W]; shape (L,)."""
    removal: Floats
    """Material removed [m^3/s]; 0 where the spindle turns free; shape (L,)."""
    edge: Floats
    """Width of chip times cutting speed, over all teeth in cut [m^2/s]; an edge force K_te takes
    the power K_te times this; shape (L,)."""
    samples: Ints
    """Number of readings of each; shape (L,)."""

    def __len__(self) -> int:
        return len(self.speed)

    def where(self, mask: Bools) -> "Levels":
        """The levels that a mask selects."""
        return Levels(**{name: column[mask] for name, column in vars(self).items()})


def settled(
    times: ArrayLike, speed: ArrayLike, *, settle_s: float = 1.0, tolerance: float = 0.01
) -> Bools:
    """Samples at which the spindle has held its speed, and holds it for half as long after.

    A change of speed takes power before it shows in a speed in whole rev/min.

    ``settle_s`` [s] is how long the speed n [rev/s], in any sense, must have been held before a
    sample counts; half of it after, and until the next sample at least.  A change up to the share
    ``tolerance`` of the speed is none.  False where the spindle stands still, or where its speed is
    missing.
    """
    t, n = np.asarray(times, dtype=np.float64), np.abs(np.asarray(speed, dtype=np.float64))
    if not len(t):
        return np.zeros(0, dtype=np.bool_)
    finite = np.isfinite(n)
    n = np.where(finite, n, 0.0)
    first = np.searchsorted(t, t - settle_s)
    after = np.searchsorted(t, t + settle_s / 2, "right")
    last = np.minimum(np.maximum(np.arange(len(t)) + 2, after), len(t))
    bounds = np.stack([first, last], axis=1).ravel()
    padded = np.append(n, n[-1])
    highest = np.maximum.reduceat(padded, bounds)[::2]
    lowest = np.minimum.reduceat(padded, bounds)[::2]
    kept: Bools = finite & (lowest > 0.0) & (highest - lowest <= tolerance * highest)
    return kept & (t - settle_s >= t[0])


def runs(chosen: ArrayLike) -> Ints:
    """Number of the run of chosen samples that each is in, -1 for the others; shape (T,)."""
    flags = np.asarray(chosen, dtype=np.bool_)
    begins = flags & ~np.concatenate([[False], flags[:-1]])
    return np.where(flags, np.cumsum(begins) - 1, -1)


def resolution(load: ArrayLike) -> float:
    """Step of a display in percent, from what it showed.

    The coarsest of 1, 0.1, 0.01 and 0.001 that all readings are multiples of; where it showed many
    different ones, all of them further apart than that, their smallest difference.  Readings that
    are no decimals: their smallest difference, at most 1.

    Examples
    --------
    >>> resolution([12.0, 30.0]), resolution([12.0, 30.5]), resolution([0.390625, 0.78125])
    (1.0, 0.1, 0.390625)
    """
    shown = np.unique(np.asarray(load, dtype=np.float64))
    gap = float(np.diff(shown).min()) if len(shown) > 1 else 1.0
    for step in (1.0, 0.1, 0.01, 0.001):
        if np.allclose(shown, np.round(shown / step) * step, rtol=0.0, atol=1e-6 * step):
            return max(step, gap) if len(shown) >= MANY else step
    return min(gap, 1.0)


def levels(
    label: ArrayLike, speed: ArrayLike, power: ArrayLike, step: ArrayLike,
    removal: ArrayLike = 0.0, edge: ArrayLike = 0.0,
) -> Levels:  # fmt: skip
    """Levels of labelled samples; equal ones are merged.

    ``label`` (T,) is the cut or line of the program, or the run of constant speed, and negative for
    what does not count; speed, power, removal and edge are as of :class:`Levels`, of each sample;
    ``step`` is what one step of the display is there [W].  Ordered by speed, then by removal rate.
    """
    labels = np.asarray(label, dtype=np.int64)
    columns = [np.broadcast_to(np.asarray(c, dtype=np.float64), labels.shape)
               for c in (speed, power, step, removal, edge)]  # fmt: skip
    n, P, q, Q, b = columns
    valid = (labels >= 0) & np.all(np.isfinite(columns), axis=0)
    _, member = np.unique(labels[valid], return_inverse=True)
    count = np.bincount(member)
    means = [np.bincount(member, c[valid]) / count for c in (np.abs(n), Q, b)]
    kind = _alike(means)
    rows = [
        _level(P[valid], q[valid], member, kind[member] == k)
        for k in range(kind.max(initial=-1) + 1)
    ]
    power_, deviation, samples = (np.array([r[i] for r in rows]) for i in range(3))
    each = [np.bincount(kind, m * count) / np.bincount(kind, count) for m in means]
    result = Levels(
        speed=each[0], power=power_, deviation=deviation, removal=each[1], edge=each[2],
        samples=samples.astype(np.int64),
    )  # fmt: skip
    return result.where(np.lexsort((result.removal, result.speed)))  # type: ignore[arg-type]


def _alike(means: list[Floats]) -> Ints:
    """Group of equal levels that each label is in, by speed, removal and edge rate."""
    rows = np.stack(means, axis=1)
    kinds: list[Floats] = []
    kind = np.zeros(len(rows), dtype=np.int64)
    for i, row in enumerate(rows):
        same = (k for k, other in enumerate(kinds)
                if (np.abs(row - other) <= ALIKE * np.maximum(row, other)).all())  # fmt: skip
        kind[i] = next(same, len(kinds))
        kinds += [row] if kind[i] == len(kinds) else []
    return kind


def _level(power: Floats, step: Floats, member: Ints, chosen: Bools) -> tuple[float, float, int]:
    """Mean, its standard deviation, and the samples of one level."""
    values, labels, q = power[chosen], member[chosen], float(step[chosen].mean())
    mean = float(values.mean())
    spread = values - mean
    variance = float(spread @ spread) / max(len(values) - 1, 1)
    rounding = q / np.sqrt(12) * _carried(values, variance, q)
    neighbours = labels[1:] == labels[:-1]
    total = float(spread @ spread)
    lag = float(spread[1:][neighbours] @ spread[:-1][neighbours]) / total if total > 0.0 else 0.0
    lag = float(np.clip(lag, 0.0, 0.999))
    effective = max(len(values) * (1 - lag) / (1 + lag), 1.0)
    averages = np.array([values[labels == w].mean() for w in np.unique(labels)])
    between = float(averages.var(ddof=1)) / len(averages) if len(averages) > 1 else 0.0
    return mean, float(np.sqrt(max(variance / effective, between) + rounding**2)), len(values)


def _carried(values: Floats, variance: float, step: float) -> float:
    """Share of the rounding error that remains when noise carries readings over the steps [1].

    exp(-2 pi^2 sigma^2 / q^2) (Widrow, Kollar and Liu 1996).  Of readings on two neighbouring steps
    noise cannot be separated from a load that lies between them, so that sigma is taken no greater
    than their range requires.
    """
    if step <= 0.0:
        return 0.0
    reach = max(float(np.ptp(values)) - step, 0.0) / (2 * REACH)
    sigma = min(reach, float(np.sqrt(max(variance - step**2 / 12, 0.0))))
    return float(np.exp(-2 * (np.pi * sigma / step) ** 2))


@dataclass(frozen=True, kw_only=True)
class LoadScale:
    """Power at the tool from the load that a control shows; a premise that all results scale with.

    ``available``: percent of what the motor can give at that speed, P_rated min(1, n / n_base);
    percent of the torque available there is the same number.  ``rated``: percent of the rated power
    at any speed.  Which one a control shows, and whether it is power or current, its manual says; a
    current that magnetises without load makes the no-load power look greater.

    Examples
    --------
    >>> drive = SpindleDrive(rated_power_kW=15.0, base_speed_rpm=3000.0, top_speed_rpm=8000.0)
    >>> float(LoadScale(drive=drive).power(10.0, 25.0))
    750.0
    """

    drive: SpindleDrive
    """Rated power, base speed and mechanical efficiency."""
    of: Literal["available", "rated"] = "available"
    """Meaning of 100 % load."""

    def power(self, load_percent: ArrayLike, speed: ArrayLike) -> Floats:
        """Power at the tool [W], of loads [%] at speeds [rev/s]."""
        drive = self.drive
        full: float | Floats = drive.rated_power
        if self.of == "available":
            full = power_curve(speed, rated=drive.rated_power, base_speed=drive.base_speed)
        return drive.efficiency * (np.asarray(load_percent) / 100 * full)

    @property
    def words(self) -> str:
        """The premise in words, for documents."""
        of = "the power available at its speed" if self.of == "available" else "the rated power"
        drive = self.drive
        return (
            f"load is a percentage of {of}; {drive.rated_power_kW:g} kW from "
            f"{drive.base_speed_rpm:g} rev/min, efficiency {drive.efficiency:g}"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadLog:
    """Log of a spindle's speed and load, with the cut of each of its T rows."""

    times: Floats
    """Rising [s]; shape (T,)."""
    speed: Floats
    """Speed of the spindle [rev/s]; shape (T,)."""
    load: Floats
    """Load [%]; NaN where it is missing; shape (T,)."""
    cut: Ints
    """Cut, or run of a spindle without load, of each row; negative for none; shape (T,)."""
    removal: Floats
    edge: Floats
    """Rates of the cut [m^3/s], [m^2/s]; 0 for a line in air; shape (T,)."""


def load_levels(log: LoadLog, scale: LoadScale, *, settle_s: float = 1.0) -> Levels:
    """Levels of a log: constant speed and cut for ``settle_s`` [s], the load's averaging time."""
    steady = settled(log.times, log.speed, settle_s=settle_s)
    begins = np.flatnonzero(np.diff(log.cut, prepend=log.cut[:1] - 1) != 0)
    begun = begins[np.searchsorted(begins, np.arange(len(log.cut)), "right") - 1]
    label = np.where(steady & (log.times - log.times[begun] >= settle_s), log.cut, -1)
    shown = log.load[np.isfinite(log.load)]
    step = scale.power(resolution(shown), log.speed)
    power = scale.power(log.load, log.speed)
    return levels(label, log.speed, power, step, log.removal, log.edge)


TERMS = 3
"""Terms of the no-load power where there are enough speeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NoLoad:
    """No-load power of a spindle."""

    fit: Regression
    """Regression for p0, p1, p2 [W], [W s], [W s^2], n in rev/s, as far as determined."""
    lowest: float
    highest: float
    """Speeds between which it holds [rev/s]."""
    levels: Levels
    """Levels that it was identified from."""

    def power(self, n: ArrayLike) -> Floats:
        """P_0 at the speed n [rev/s], in W."""
        return powers(n, len(self.fit.values)) @ self.fit.values

    def half_width(self, n: ArrayLike) -> Floats:
        """Half of the 95 % interval of P_0 at the speed n [rev/s], in W."""
        rows = powers(n, len(self.fit.values))
        variance = np.einsum("...i,ij,...j->...", rows, self.fit.covariance, rows)
        return self.fit.quantile * np.sqrt(np.maximum(variance, 0.0))


def no_load(levels: Levels) -> NoLoad:
    """No-load power by levels without a cut; ValueError when there are fewer than two speeds."""
    idle = levels.where((levels.removal == 0.0) & (levels.edge == 0.0))
    if len(idle) < 2:
        raise ValueError(
            f"the spindle turns free at {len(idle)} settled speed(s): record it at 4 or more, 20 s "
            "each"
        )
    terms = min(TERMS, len(idle) - 1)
    fit = regression(
        powers(idle.speed, terms), idle.power, np.diag(idle.deviation**2), np.abs(idle.power)
    )
    lowest, highest = float(idle.speed.min()), float(idle.speed.max())
    return NoLoad(fit=fit, lowest=lowest, highest=highest, levels=idle)


def powers(n: ArrayLike, terms: int) -> Floats:
    """1, n, n^2, … up to as many terms; shape of ``n`` + (terms,)."""
    return np.asarray(n, dtype=np.float64)[..., None] ** np.arange(terms)


BEYOND = 0.02
"""Share by which a cut's speed may lie outside the no-load record [1]."""
NORMAL = 1.959963984540054
"""Half width of the 95 % interval over the standard deviation, with many degrees of freedom."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecificForce:
    """Cutting energy per volume removed."""

    value: float
    half_width: float
    """Power of these cuts over the rates at which they remove material, edges and all
    [N/m^2 = J/m^3], summed over levels, each for the same time; and half of its 95 % interval: by
    how much cuts of the same kind differ is counted where there is more than one level."""
    fit: Regression
    """Regression for K_tc [N/m^2], then K_te [N/m] where the cuts were to determine it."""
    cuts: int
    """Number of levels."""


def specific_force(levels: Levels, idle: NoLoad) -> SpecificForce:
    """Specific cutting force from levels with a cut at speeds of the no-load record.

    The no-load power's own uncertainty is counted, common to cuts at the same speed. ValueError
    when no cut is at a speed of the no-load record.
    """
    cuts = _cuts(levels, idle)
    power, covariance = _above_no_load(cuts, idle)
    alone = regression(cuts.removal[:, None], power, covariance, np.abs(power))
    terms = 2 if cuts.edge.any() else 1
    design = np.stack([cuts.removal, cuts.edge], axis=1)[:, :terms]
    fit = regression(design, power, covariance, np.abs(power))
    weight = np.full(len(cuts), 1.0 / cuts.removal.sum())
    half = _together(weight, covariance, power, (fit, alone))
    return SpecificForce(value=float(weight @ power), half_width=half, fit=fit, cuts=len(cuts))


def _cuts(levels: Levels, idle: NoLoad) -> Levels:
    if not np.isfinite(idle.fit.half_width).all():
        raise ValueError(
            "the no-load power is not determined, nothing can be taken off the cuts: record the "
            "spindle turning free at 4 speeds or more"
        )
    low, high = idle.lowest * (1 - BEYOND), idle.highest * (1 + BEYOND)
    cuts = levels.where((levels.speed >= low) & (levels.speed <= high) & (levels.removal > 0.0))
    if not len(cuts):
        raise ValueError(
            "no settled cut is at a speed that the spindle also turned free at: record cuts "
            f"between {idle.lowest * MINUTE:.0f} and {idle.highest * MINUTE:.0f} rev/min"
        )
    return cuts


def _above_no_load(cuts: Levels, idle: NoLoad) -> tuple[Floats, Floats]:
    """Cutting powers [W] and their covariance, that of the no-load power in common."""
    rows = powers(cuts.speed, len(idle.fit.values))
    wider = (idle.fit.quantile / NORMAL) ** 2  # its few degrees of freedom
    free = rows @ idle.fit.covariance @ rows.T * wider
    return cuts.power - idle.power(cuts.speed), np.diag(cuts.deviation**2) + free


def _together(
    weight: Floats, covariance: Floats, power: Floats, fits: tuple[Regression, ...]
) -> float:
    """Half of the 95 % interval of the weighted sum of powers.

    The scatter of cuts is that of the first fit that the levels determine; a single level has only
    its measurement uncertainty.
    """
    determined = next((fit for fit in fits if np.isfinite(fit.half_width).all()), None)
    share = 0.0 if determined is None else determined.share
    quantile = NORMAL if determined is None else determined.quantile
    variance = weight @ (covariance + np.diag((share * power) ** 2)) @ weight
    return quantile * float(np.sqrt(variance))
