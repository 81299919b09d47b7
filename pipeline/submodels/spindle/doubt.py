"""Doubts of a spindle's fit: equally good networks, and residuals correlated with a source.

An interval is conditional on the network that was chosen.  Where others are as good on hours left
out, it is widened to hold theirs.  And where what the fit leaves over still answers to a source, it
is widened to what the residuals say of it: no source is 0 to within little while they rise with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.signals.windows import StateSegment
from pipeline.submodels.spindle.fit import (
    Problem,
    SpindleFit,
    SpindleFitSettings,
    sensor_step,
    structure_of,
)
from pipeline.submodels.statistics import LEVEL
from pipeline.thermal.network import SOURCES, first_order
from pipeline.twin import spindle

FEWEST = 3
"""Hours that excite a source below which its residuals say nothing."""


def with_doubt(
    fit: SpindleFit,
    others: Mapping[str, SpindleFit],
    pieces: Sequence[StateSegment],
    records: spindle.SpindleRecords,
    settings: SpindleFitSettings,
) -> SpindleFit:
    """Fit with the intervals of its sources widened by the residuals and by ``others``."""
    said = residuals_say(fit, pieces, records, settings)
    intervals, left_out = dict(fit.intervals), dict(fit.left_out)
    for name, own in fit.intervals.items():
        value = fit.parameters.heating.get(name, 0.0)
        ends = [own, *(one.intervals[name] for one in others.values() if name in one.intervals)]
        if name in said:
            ends.append((value + said[name][0], value + said[name][1]))
        intervals[name] = min(low for low, _ in ends), max(high for _, high in ends)
        if name in left_out and intervals[name] != own:
            left_out[name] = _words(name, intervals[name], said.get(name), list(others))
    return replace(
        fit, intervals=intervals, left_out=left_out, in_doubt=tuple(others),
        unfollowed=tuple(said),
    )  # fmt: skip


def _words(
    name: str, whole: tuple[float, float], said: tuple[float, float] | None, others: list[str]
) -> str:
    """Why a source that was left out is not 0 to within little."""
    low, high = whole
    text = f"its 95 % interval is {low:.2g} to {high:.2g} {SOURCES[name]}"
    if said is not None:
        way = "rises" if said[0] > 0 else "falls"
        return (
            f"{text}: what the network leaves over {way} while it is on, by {said[0]:.2g} to "
            f"{said[1]:.2g} {SOURCES[name]}, which no network tried here follows"
        )
    return f"{text} over the networks that the records bear as well ({', '.join(others)})"


def residuals_say(
    fit: SpindleFit,
    pieces: Sequence[StateSegment],
    records: spindle.SpindleRecords,
    settings: SpindleFitSettings,
) -> dict[str, tuple[float, float]]:
    """Sources that the residuals still answer to, with the 95 % interval of the further heating.

    The residual of each hour, less its mean, is regressed on the response of a first-order lag to
    the source, for each time constant from which the fit starts; hours are the clusters.  The
    level is shared out among sources and time constants (Bonferroni); and what they say has to come
    to half a step of the sensor.  In the coefficient's unit.
    """
    problem = Problem(
        pieces, records, settings, list(fit.parameters.heating), structure_of(fit.parameters)
    )
    left = [-r for r in problem.by_stretch(problem.position(fit.parameters))]
    error = np.concatenate([r[m] for r, m in zip(left, problem.masks, strict=True)])
    found: dict[str, tuple[float, float]] = {}
    least = sensor_step(np.concatenate(problem.measured)) / 2
    level = LEVEL / max(len(fit.intervals) * len(settings.time_constants_s), 1)
    for name in fit.intervals:
        best = 0.0
        for constant in settings.time_constants_s:
            response = np.concatenate([
                first_order(-1 / constant, p.frame[name].to_numpy(float), 0.0, p.step)[m]
                for p, m in zip(pieces, problem.masks, strict=True)
            ])  # fmt: skip
            slope, deviation, freedom = _slope(response, error, problem.blocks)
            significance, width = _student(slope, deviation, freedom, level)
            felt = abs(slope) * float(np.ptp(response)) >= least
            if felt and significance > max(best, 1.0):
                best, found[name] = significance, (slope - width, slope + width)
    return found


def _slope(x: Floats, y: Floats, blocks: Ints) -> tuple[float, float, int]:
    """Slope within blocks with its deviation clustered over them, and the degrees of freedom."""
    _, block = np.unique(blocks, return_inverse=True)
    count = np.bincount(block)
    x, y = (v - (np.bincount(block, weights=v) / count)[block] for v in (x, y))
    weight = np.bincount(block, weights=x * x)
    excited = int((weight > 1e-6 * weight.max(initial=0.0)).sum()) if weight.any() else 0
    if excited < FEWEST:
        return 0.0, np.inf, 1
    slope = float(x @ y / weight.sum())
    scores = np.bincount(block, weights=x * (y - slope * x))
    deviation = np.sqrt((scores**2).sum() * excited / (excited - 1)) / weight.sum()
    return slope, float(deviation), excited - 1


def _student(slope: float, deviation: float, freedom: int, level: float) -> tuple[float, float]:
    """Slope over what is significant at ``level``, and half of its 95 % interval."""
    from scipy.special import stdtrit

    if not np.isfinite(deviation) or deviation == 0:
        return 0.0, np.inf
    bound = float(stdtrit(freedom, 1 - level / 2)) * deviation
    return abs(slope) / bound, float(stdtrit(freedom, 0.975)) * deviation
