"""90 % intervals of predicted forces: law of the chip, coefficients, waveform, recordings left out.

Forces are predicted by the straight line; peak and mean of the force in the plane are also taken
under every law that the records allow.  Their distance from the line, the covariance of the
coefficients and the model error of the harmonics add up to an expected error.  It grows outside of
the feeds that were learnt, where laws part and the waveform residual is extrapolated, and outside
of the speeds and depths.  The errors on recordings left out, over those expected, scale it: their
mean square is shrunk towards 1 by ``PRIOR`` degrees of freedom, and the quantile is Student's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import ChipLaw, CutConditions, ForceSpread
from pipeline.submodels.cutting.fit import Fit
from pipeline.submodels.cutting.laws import SHARE, chip_laws, feeds, law_scales, mean_edge_force
from pipeline.submodels.cutting.model import CutModel, WaveformResidual
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.selection import FitUncertainty
from pipeline.submodels.cutting.waveform import COEFFICIENTS, CutHarmonics

Complexes = NDArray[np.complex128]
PRIOR = 4
"""Degrees of freedom for which the expected error counts beside recordings left out."""
OTHERWISE = 0.1
"""Standard deviation of a force for each factor e of speed or depth beyond those learnt, as a share
[1]: specific forces fall with the cutting speed to the power of 0.1 (Koenig and Essel 1973)."""
ANGLES = 720
"""Angles of a revolution at which peak and mean are taken."""


@dataclass(frozen=True, kw_only=True)
class ForceLevel:
    """Peak or mean force in the plane [N], and the standard deviation that is expected of it."""

    value: float
    deviation: float


def spread_of(fit: Fit, uncertainty: FitUncertainty) -> ForceSpread:
    """Laws and covariance of a fit, before recordings left out have scaled them."""
    first = len(uncertainty.names) - fit.problem.linear
    part = slice(first, first + COEFFICIENTS)
    covariance = np.asarray(uncertainty.covariance)[part, part]
    cuts = fit.problem.cuts
    laws = chip_laws(cuts)
    each = [one.conditions for one in cuts]
    if feeds(each) < 2:
        laws = _through(fit.values[:COEFFICIENTS], laws, each)
    zero = fit.problem.zero + float(np.mean([cut.variance[0].mean() for cut in cuts]))
    speeds, depths = [one.speed for one in each], [one.a_p for one in each]
    return ForceSpread(
        laws=tuple(laws), covariance=tuple(map(tuple, covariance.tolist())), zero_N2=zero,
        speeds=(min(speeds), max(speeds)), depths_m=(min(depths), max(depths)),
    )  # fmt: skip


def _through(
    values: Floats, laws: Sequence[ChipLaw], each: Sequence[CutConditions]
) -> list[ChipLaw]:
    """The straight line of a fit, and laws that give its mean edge force at the recorded feed."""
    weight = 1 / (len(laws) + 1)
    line = ChipLaw(
        name="linear edge", cutting=tuple(values[:3].tolist()), exponent=(0.0,) * 3,
        edge=tuple(values[3:].tolist()), growth=0.0, weight=weight,
    )  # fmt: skip
    fitted = sum(mean_edge_force(line, one) for one in each)
    through = [line]
    for law in laws:
        there = sum(mean_edge_force(law, one) for one in each)
        factor = np.asarray(fitted) / np.where(np.asarray(there) != 0, there, np.inf)
        through.append(replace(law, cutting=tuple((factor * law.cutting).tolist()), weight=weight))
    return through


def calibrated(spread: ForceSpread, errors: Sequence[tuple[float, float]]) -> ForceSpread:
    """The spread, scaled by errors of peak and mean on recordings left out over those expected."""
    squares = np.array(errors).reshape(-1, 2) ** 2
    scales = np.sqrt((PRIOR + squares.sum(axis=0)) / (PRIOR + len(squares)))
    return replace(
        spread, peak_scale=float(scales[0]), mean_scale=float(scales[1]),
        freedom=PRIOR + len(squares),
    )  # fmt: skip


def left_out_errors(model: CutModel, cut: CutHarmonics) -> tuple[float, float]:
    """Errors of peak and mean of a recording that the model has not seen, over those expected."""
    measured = magnitude(cut.lines)
    levels = force_levels(model, cut.conditions, cut.harmonics)
    real = (float(measured.max()), float(measured.mean()))
    peak, mean = (
        (level.value - true) / max(level.deviation, 1e-9)
        for level, true in zip(levels, real, strict=True)
    )
    return peak, mean


def magnitude(lines: Complexes) -> Floats:
    """Magnitude of the force in the plane over a revolution [N]; shape (ANGLES,)."""
    angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)
    return np.asarray(np.linalg.norm(wave(lines, angles)[:, :2], axis=1))


def half_widths(spread: ForceSpread, levels: Sequence[ForceLevel]) -> tuple[float, float]:
    """Halves of the 90 % intervals of peak and mean [N]."""
    from scipy.stats import t as student

    quantile = float(student.ppf(0.95, spread.freedom))
    peak, mean = levels
    return (
        quantile * spread.peak_scale * peak.deviation,
        quantile * spread.mean_scale * mean.deviation,
    )


def force_levels(
    model: CutModel, conditions: CutConditions, harmonics: int
) -> tuple[ForceLevel, ForceLevel]:
    """Peak and mean force in the plane with the errors that are expected of them.

    Raises
    ------
    ValueError
        When the model has no spread.
    """
    spread = model.spread
    if spread is None:
        raise ValueError("the model holds no spread of its forces: identify it again")
    angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)
    lines = model.predicted(conditions, harmonics)
    force = wave(lines, angles)[:, :2]
    table = model.coefficient_columns(conditions, harmonics)
    shape = wave(table.reshape(len(table), -1), angles).reshape(ANGLES, 3, COEFFICIENTS)[:, :2]
    values, scales = model.values[:COEFFICIENTS], law_scales(spread.laws, conditions)
    weights = np.array([law.weight for law in spread.laws])
    changes = [shape @ (values * np.tile(one - 1, 2)) for one in scales]
    sizes = np.array([np.linalg.norm(force + one, axis=1) for one in changes])
    size = np.linalg.norm(force, axis=1)
    unit = force / np.maximum(size, 1e-9)[:, None]
    slope = np.einsum("tk,tkd->td", unit, shape)
    covariance = np.array(spread.covariance)
    error = model.left_out[:2] * _extrapolated(model.residual(conditions), conditions.f_z)
    top = int(np.argmax(size))
    every = (  # value, by each law, slope by the coefficients, direction squared, harmonics
        (float(size[top]), sizes.max(axis=1), slope[top], unit[top] ** 2, harmonics),
        (float(size.mean()), sizes.mean(axis=1), slope.mean(axis=0), (unit**2).mean(axis=0), 1),
    )
    other = (OTHERWISE * _distance(spread, conditions)) ** 2
    found = []
    for value, by_law, gradient, direction, count in every:
        law = float(weights @ (by_law - value) ** 2)
        known = float(gradient @ covariance @ gradient)
        shaped = float(direction @ (error * count)) + spread.zero_N2
        of_cut = (SHARE**2 + other) * value**2
        total = float(np.sqrt(law + known + shaped + of_cut))
        found.append(ForceLevel(value=value, deviation=total))
    return found[0], found[1]


def _distance(spread: ForceSpread, conditions: CutConditions) -> float:
    """Logarithm of speed and depth over the nearest that were learnt; 0 inside [1]."""
    ranges = ((conditions.speed, spread.speeds), (conditions.a_p, spread.depths_m))
    beyond = [max(np.log(low / value), np.log(value / high), 0.0) for value, (low, high) in ranges]
    return float(np.hypot(*beyond))


def _extrapolated(residual: WaveformResidual | None, f_z: float) -> float:
    """Share of the waveform's model error that is left at a feed [1], at most 1.

    Without a residual all of it; with one the leverage of the feed in the regression over the feeds
    that were learnt, for one feed the square of the relative distance.
    """
    if residual is None:
        return 1.0
    feeds_known = np.array(residual.feeds)
    middle = float(feeds_known.mean())
    around = float(((feeds_known - middle) ** 2).sum())
    far = (f_z - middle) ** 2 / around if around > 0 else (f_z / middle - 1) ** 2
    return min(1 / len(feeds_known) + far, 1.0)
