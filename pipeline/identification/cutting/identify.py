"""Identification of a cut from recordings of its forces: from recordings to what is stored."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.certainty import Certain, certain
from pipeline.identification.cutting.choice import Chosen, chosen
from pipeline.identification.cutting.fit import Fit
from pipeline.identification.cutting.mean_regression import mean_regression
from pipeline.identification.cutting.model import CutModel, model_of
from pipeline.identification.cutting.parameters import Parameter
from pipeline.identification.cutting.problem import Cut
from pipeline.identification.cutting.records import CuttingRecording
from pipeline.identification.cutting.settings import CuttingFitSettings

__all__ = ["CutFound", "cut_beside", "identify_cut"]

from pipeline.identification.cutting.known import CuttingKnown

Floats = NDArray[np.float64]

FLOOR = 2e-3
"""Of the RMS force, below which no harmonic is known: slices and angles err as much."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CutFound:
    """What recordings say of a cut.

    Parameters
    ----------
    recordings : sequence of CuttingRecording
        All of the machine.
    cuts : sequence of Cut
        Those that were learnt from, in their order.
    chosen : Chosen, optional
        The fit; None without a recording to learn from.
    fit : Fit, optional
        The optimum that is taken.
    certain : Certain, optional
        How well it determines its unknowns.
    mean_force : sequence of Parameter
        What the regression of the mean forces says.
    mean_values : ndarray, shape (6,), optional
        The same, SI.
    methods : sequence of mapping
        Error and evaluations of each method tried.
    reason : str
        Why there is no fit.
    """

    recordings: Sequence[CuttingRecording]
    cuts: Sequence[Cut] = ()
    chosen: Chosen | None = None
    fit: Fit | None = None
    certain: Certain | None = None
    mean_force: Sequence[Parameter] = ()
    mean_values: Floats | None = None
    methods: Sequence[dict[str, object]] = ()
    reason: str = ""

    @property
    def model(self) -> CutModel | None:
        """The model that predicts."""
        if self.fit is None or self.chosen is None:
            return None
        return model_of(self.fit, over=self.chosen.over)

    @property
    def learnt(self) -> list[CuttingRecording]:
        """Recordings that were learnt from, in the order of ``cuts``."""
        return [one for one in self.recordings if one.role == "training"]


def cut_beside(recording: CuttingRecording, settings: CuttingFitSettings) -> Cut:
    """A recording as the fit takes it, with the speed that was found and the zero's variance.

    Raises
    ------
    ValueError
        When the recording is left out.
    """
    conditions, revolution = recording.cut
    variance = revolution.scatter.copy()
    if not recording.zero_known:
        variance[0] += settings.zero_N**2
    floor = FLOOR**2 * (np.abs(revolution.lines) ** 2).sum(axis=0)
    return Cut(
        conditions=replace(conditions, speed=revolution.speed), lines=revolution.lines,
        variance=np.maximum(variance, np.maximum(floor, 1e-12)),
    )  # fmt: skip


def identify_cut(
    recordings: Sequence[CuttingRecording], known: CuttingKnown, settings: CuttingFitSettings
) -> CutFound:
    """Coefficients, runout and modes from the training recordings.

    Parameters
    ----------
    recordings : sequence of CuttingRecording
        All of the machine; those that may be learnt from are.
    known : CuttingKnown
        The tool, and how the dynamometer stands.
    settings : CuttingFitSettings
        How they are identified.
    """
    cuts = [cut_beside(one, settings) for one in recordings if one.role == "training"]
    if not cuts:
        return CutFound(recordings=recordings, reason=_why_none(recordings))
    best = chosen(known.tool, cuts, "helix" in known.sought, settings.gain)
    fit, methods = best.fit, [_method("least_squares", best.fit)]
    if settings.compare or settings.method == "genetic":
        from pipeline.identification.cutting.genetic_fit import genetic_fit

        other = genetic_fit(best.fit, settings.genetic)
        methods.append(_method("genetic", other))
        fit = other if settings.method == "genetic" else fit
    mean_values, means = mean_regression(cuts, settings.widest, fit)
    return CutFound(
        recordings=recordings, cuts=cuts, chosen=best, fit=fit,
        certain=certain(fit, best.folds, best.rivals), mean_force=means, mean_values=mean_values,
        methods=methods, reason=_upside_down(fit),
    )  # fmt: skip


def _why_none(recordings: Sequence[CuttingRecording]) -> str:
    if not recordings:
        return "no dynamometer: coefficients of the cut are found from its forces, record them"
    left = [one for one in recordings if one.trained]
    if not left:
        return "no recording is named in cutting_records.training: name those to learn from"
    said = "; ".join(f"{one.name}: {one.reason}" for one in left)
    return f"none of the training recordings can be used ({said})"


def _upside_down(fit: Fit) -> str:
    if fit.values[0] > 0:
        return ""
    return (
        f"K_tc is {fit.values[0] / 1e6:.4g} N/mm^2, and no tool cuts with that: correct the "
        "directions and signs in cutting.dynamometer, or the immersion"
    )


def _method(name: str, fit: Fit) -> dict[str, object]:
    return {
        "method": name, "rms_error_percent": rms_error_percent(fit),
        "evaluations": fit.evaluations,
    }  # fmt: skip


def rms_error_percent(fit: Fit) -> float:
    """RMS of what a fit leaves over, of all recordings and directions, over that of the force."""
    error = power = 0.0
    for cut, model in zip(fit.problem.cuts, fit.modelled, strict=True):
        for lines, sign in ((cut.lines - model, 0), (cut.lines, 1)):
            square = np.abs(lines) ** 2
            square[1:] /= 2
            error, power = (error, power + square.sum()) if sign else (error + square.sum(), power)
    return 100 * float(np.sqrt(error / power))
