"""90 % intervals of predicted forces: law, waveform, recording, held-out recordings.

Forces are predicted by a straight law or by one whose edges are not sharp, whichever errs less on
training recordings left out.  The spread of the laws that the records allow
(:mod:`pipeline.submodels.cutting.law_draws`) about it, which grows outside of the feeds that were
learnt, the model error of the harmonics, and what differs from recording to recording (depth and
gain, wear of the edge, zero) add up to an expected error.  It grows outside of the speeds and
depths too.  The errors on recordings left out, over those expected, scale it: their mean square is
shrunk towards 1 by ``PRIOR`` degrees of freedom, and the quantile is Student's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.cutting.force.force_law import laws_lines, outside_share
from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.cutting import CutConditions, ForceSpread
from pipeline.submodels.cutting.fit import Fit
from pipeline.submodels.cutting.law_draws import FRICTION, FittedLine, KnownShape, law_draws
from pipeline.submodels.cutting.model import CutModel, WaveformResidual
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.selection import own_line
from pipeline.submodels.cutting.waveform import COEFFICIENTS, CutHarmonics, phase_shift
from pipeline.submodels.statistics import student_quantile

PRIOR = 4
"""Degrees of freedom for which the expected error counts beside recordings left out."""
ANGLES = 720
"""Angles of a revolution at which peak and mean are taken."""
STORED = 128
"""Draws of the law that are stored."""


@dataclass(frozen=True, kw_only=True)
class ForceLevel:
    """Peak or mean force in the plane [N], and the standard deviation that is expected of it."""

    value: float
    deviation: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceWave:
    """Force on the tool over a revolution, and the error that is expected of it."""

    force: Floats
    """Force along the feed, to its left, along the axis [N]; shape (ANGLES, 3)."""
    draws: Floats
    """Force by each drawn law [N]; shape (D, ANGLES, 3)."""
    shaped: Floats
    """Variance by the model error of all harmonics [N^2]; shape (3,)."""
    recording: Floats
    """Standard deviation by cause that differs between recordings [N]; shape (K, ANGLES, 3)."""

    @property
    def deviation(self) -> Floats:
        """Standard deviation at each angle [N]; shape (ANGLES, 3)."""
        law = ((self.draws - self.force) ** 2).mean(axis=0)
        return np.asarray(np.sqrt(law + self.shaped + (self.recording**2).sum(axis=0)))


def spread_of(fit: Fit, line: FittedLine, shape: KnownShape | None) -> ForceSpread:
    """Laws that a fit's recordings allow, before those left out have scaled their intervals.

    ``line`` and ``shape`` are those of a fit whose edges are not sharp (:mod:`.runout`).
    """
    cuts = fit.problem.cuts
    each = [one.conditions for one in cuts]
    draws = law_draws(cuts, line, shape)
    laws = draws.laws(STORED)
    own = own_line(fit)
    stated = float(np.mean([cut.variance[0].mean() for cut in cuts]))
    ranges = [
        (float(min(values)), float(max(values)))
        for values in zip(*((c.f_z, c.speed, c.a_p) for c in each), strict=True)
    ]
    return ForceSpread(
        laws=laws,
        line=tuple((laws_lines(laws, each).mean(axis=0) if own is None else own).tolist()),
        gain=draws.gain, wear=draws.wear,
        zero_N2=draws.understated**2 * stated, feeds_m=ranges[0], speeds=ranges[1],
        depths_m=ranges[2],
    )  # fmt: skip


def calibrated(spread: ForceSpread, errors: Sequence[tuple[float, ...]]) -> ForceSpread:
    """Spread scaled by the errors over the expected ones on held-out recordings."""
    squares = np.array(errors).reshape(-1, 3) ** 2
    scales = np.sqrt((PRIOR + squares.sum(axis=0)) / (PRIOR + len(squares)))
    peak, mean, shape = scales.tolist()
    return replace(
        spread, peak_scale=peak, mean_scale=mean, shape_scale=shape, freedom=PRIOR + len(squares)
    )


def left_out_errors(model: CutModel, cut: CutHarmonics) -> tuple[float, float, float]:
    """Errors of peak, mean and waveform of a recording that the model has not seen.

    They are over those expected; that of the waveform is a root mean square over angles and
    directions.
    """
    measured = magnitude(cut.lines)
    levels = force_levels(model, cut.conditions, cut.harmonics)
    real = (float(measured.max()), float(measured.mean()))
    peak, mean = (
        (level.value - true) / max(level.deviation, 1e-9)
        for level, true in zip(levels, real, strict=True)
    )
    off = wave(cut.lines - model.beside(cut), _angles())
    deviation = np.maximum(force_wave(model, cut.conditions, cut.harmonics).deviation, 1e-9)
    return peak, mean, float(np.sqrt(((off / deviation) ** 2).mean()))


def magnitude(lines: Complexes) -> Floats:
    """Magnitude of the force in the plane over a revolution [N]; shape (ANGLES,)."""
    return np.asarray(np.linalg.norm(wave(lines, _angles())[:, :2], axis=1))


def _angles() -> Floats:
    return np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)


def quantile(spread: ForceSpread) -> float:
    """Half of a 90 % interval over the standard deviation [1]."""
    return student_quantile(spread.freedom, 0.95)


def half_widths(spread: ForceSpread, levels: Sequence[ForceLevel]) -> tuple[float, float]:
    """Halves of the 90 % intervals of peak and mean [N]."""
    peak, mean = levels
    each = quantile(spread)
    return each * spread.peak_scale * peak.deviation, each * spread.mean_scale * mean.deviation


def wave_half_widths(model: CutModel, cut: CutHarmonics) -> Floats:
    """Half 90 % intervals of the force at each angle [N], (ANGLES, 3); ValueError if no spread."""
    whole = force_wave(model, cut.conditions, cut.harmonics)
    lines = model.predicted(cut.conditions, cut.harmonics)
    shift = phase_shift(lines, cut.lines, model.weight(cut)) / (2 * np.pi)
    turned = np.roll(whole.deviation, -round(shift * ANGLES), axis=0)
    scale = 1.0 if model.spread is None else quantile(model.spread) * model.spread.shape_scale
    return np.asarray(scale * turned)


def force_wave(model: CutModel, conditions: CutConditions, harmonics: int) -> ForceWave:
    """Force over a revolution with its expected error; ValueError when the model has no spread."""
    spread = model.spread
    if spread is None:
        raise ValueError("the model holds no spread of its forces: identify it again")
    angles = _angles()
    force = wave(model.predicted(conditions, harmonics), angles)
    table = model.coefficient_columns(conditions, harmonics)
    shape = wave(table.reshape(len(table), -1), angles).reshape(ANGLES, 3, COEFFICIENTS)
    laws = model.law_departures(conditions, harmonics)
    flat = wave(np.moveaxis(laws, 0, 2).reshape(harmonics + 1, -1), angles)
    parted = np.moveaxis(flat.reshape(ANGLES, 3, -1), 2, 0)
    line = model.values if model.line is None else model.line  # a bend takes a part of the edge's
    land = spread.wear * max(abs(float(line[4])), abs(float(line[3])))
    worn = shape[..., 3:] @ (land * np.array([FRICTION, 1.0, 0.0]))
    beyond = outside_share(spread, conditions.speed, conditions.a_p)
    error = model.left_out * _extrapolated(model.residual(conditions), conditions.f_z)
    zero = np.full_like(force, np.sqrt(spread.zero_N2))
    return ForceWave(
        force=force, draws=force + parted, shaped=error * harmonics,
        recording=np.stack([np.hypot(spread.gain, beyond) * force, worn, zero]),
    )  # fmt: skip


def force_levels(
    model: CutModel, conditions: CutConditions, harmonics: int
) -> tuple[ForceLevel, ForceLevel]:
    """Peak and mean force in the plane with expected errors; ValueError without a spread."""
    whole = force_wave(model, conditions, harmonics)
    plane = whole.force[:, :2]
    size = np.linalg.norm(plane, axis=1)
    unit = plane / np.maximum(size, 1e-9)[:, None]
    drawn = np.linalg.norm(whole.draws[..., :2], axis=2)
    along = (whole.recording[..., :2] * unit).sum(axis=2)
    top = int(np.argmax(size))
    shaped = whole.shaped[:2]
    every = (  # value, by each law, by each cause in the recording, by the harmonics
        (float(size[top]), drawn.max(axis=1), along[:2, top], unit[top] ** 2 @ shaped),
        (float(size.mean()), drawn.mean(axis=1), along[:2].mean(axis=1),
         (unit**2).mean(axis=0) @ shaped / max(harmonics, 1)),
    )  # fmt: skip
    zero = float(whole.recording[2, 0, 0] ** 2)  # along any direction of the plane
    found = []
    for value, by_law, cause, by_shape in every:
        law = float(((by_law - value) ** 2).mean())
        total = law + float((cause**2).sum()) + float(by_shape) + zero
        found.append(ForceLevel(value=value, deviation=float(np.sqrt(total))))
    return found[0], found[1]


def _extrapolated(residual: WaveformResidual | None, f_z: float) -> float:
    """Share of the waveform's model error that remains at a feed [1], at most 1.

    All of it without a residual; with one, the leverage of the feed in the regression over the
    training feeds, for one feed the square of the relative distance.
    """
    if residual is None:
        return 1.0
    feeds_known = np.array(residual.feeds)
    middle = float(feeds_known.mean())
    around = float(((feeds_known - middle) ** 2).sum())
    far = (f_z - middle) ** 2 / around if around > 0 else (f_z / middle - 1) ** 2
    return min(1 / len(feeds_known) + far, 1.0)
