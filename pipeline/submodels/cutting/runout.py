"""Runout of the tool, separated from the rounding of its edges.

An edge's force is not there at once: it grows until the chip is about as thick as the edge is round
(Waldorf, DeVor and Kapoor 1998).  The tooth that stands out most enters with the thickest chips, so
that in a straight-edge fit about half of that thickness is taken for runout.  The harmonics of the
revolution tell them apart: runout shifts where a tooth begins to cut, growth bends how its force
begins.  So runout is that of a fit of its own, in which the edge's force grows with the chip, the
cutting force has a size effect and each tooth its own edge.  Its interval holds the spread of fits
without some of the recordings, and the difference to a growth of another form, along a straight
line, since nobody knows the form.  Edges that are worn or ground unlike explain a force once a turn
as unlike radii do: where a fit of edges alike does not predict recordings left out much worse, the
interval holds its runout too.  Two recordings count, with Student's factor, for the harmonics of
one recording err alike.

Where the recordings do not tell, the greatest runout that they allow is said: that of an edge whose
force is there at once, with its interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import DEGREE, UM
from pipeline.submodels.cutting.fit import Fit, fit_waveform
from pipeline.submodels.cutting.law_draws import FittedLine, KnownShape, named_range
from pipeline.submodels.cutting.regression import Estimate
from pipeline.submodels.cutting.selection import (
    RIVAL,
    FitUncertainty,
    Fold,
    fit_uncertainty,
    fitted_line,
    left_out_error,
    left_out_fits,
    straight_line,
)
from pipeline.submodels.statistics import NORMAL_95

RUNOUT = 0.1
"""Least size of a runout in the test of its interval, over the feed per tooth [1]."""
ANGLE_DEG = 45.0
"""Half interval of a determined runout angle, at most [deg]."""
FEWEST = 2
"""Fits without some of the recordings from which their spread counts."""
METHOD = "weighted least squares on the harmonics, with an edge force that grows with the chip"


@dataclass(frozen=True, kw_only=True)
class _Offset:
    """Offset of a fit's tool, the halves of its 95 % interval outward and across it."""

    size: float
    angle: float
    half: float
    half_across: float
    """[m], [rad], [m], [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedFit:
    """Fit in which the edge's force grows with the chip and the cutting force has a size effect."""

    fit: Fit
    """Fit to all recordings."""
    uncertainty: FitUncertainty
    """Uncertainty of the fit."""
    folds: Sequence[Fold]
    """Fits without some of the recordings, in the order of the selection's."""
    factor: Floats
    """Ratio of the constants' standard deviations to those of the fit alone [1]; shape (6,)."""
    alike: Fit | None = None
    """Fit with alike teeth, where held-out recordings do not distinguish it from ``fit``."""

    @property
    def coefficients(self) -> Floats:
        """Straight line of its law over the named range of feeds [N/m^2], [N/m]; shape (6,)."""
        return straight_line(self.fit, named_range([c.conditions for c in self.fit.problem.cuts]))

    @property
    def line(self) -> FittedLine:
        """The constants of its law by the harmonics."""
        return fitted_line(self.fit, self.factor)

    @property
    def line_elsewhere(self) -> FittedLine:
        """The same for other recordings: the spread of two counts, whose harmonics err alike."""
        return fitted_line(self.fit, self.uncertainty.factor)

    @property
    def lines_elsewhere(self) -> list[FittedLine]:
        """Lines of the folds, as uncertain as those of all recordings."""
        return [fitted_line(fold.fit, self.uncertainty.factor) for fold in self.folds]

    @property
    def shape(self) -> KnownShape | None:
        """Shape of the law; None from one recording, whose harmonics err alike."""
        return self._shape_of(self.fit)

    @property
    def shapes(self) -> list[KnownShape | None]:
        """Shapes of the folds, as uncertain as that of all recordings."""
        return [self._shape_of(fold.fit) for fold in self.folds]

    def _shape_of(self, fit: Fit) -> KnownShape | None:
        if len(self.folds) < FEWEST:
            return None
        known = self.uncertainty
        places = [known.names.index(name) for name in ("growth", "exponent")]
        scale = known.quantile / NORMAL_95
        return KnownShape(
            chip=fit.problem.chip(fit.x),
            covariance=scale**2 * known.covariance[np.ix_(places, places)],
        )


def rounded_fit(fit: Fit, most: int) -> RoundedFit:
    """The fit of a fit's terms whose edges are not sharp.

    Of a ``fit`` whose edge force is there at once; ``most`` is the greatest number of fits without
    some recordings.
    """
    problem = fit.problem
    terms = replace(problem.terms, edge="exponential", teeth=problem.tool.flutes > 1)
    whole = fit_waveform(problem.tool, problem.cuts, terms, start=fit)
    other = fit_waveform(problem.tool, problem.cuts, replace(terms, edge="ramp"), start=whole)
    folds = left_out_fits(whole, most)
    found = fit_uncertainty(whole, folds, [other], fewest=FEWEST)
    factor = fit_uncertainty(whole, folds, [other]).factor
    return RoundedFit(
        fit=whole, uncertainty=found, folds=folds, factor=factor,
        alike=_alike(whole, folds, most) if terms.teeth else None,
    )  # fmt: skip


def _alike(fit: Fit, folds: Sequence[Fold], most: int) -> Fit | None:
    """Fit with alike teeth; None where it predicts much worse."""
    problem = fit.problem
    terms = replace(problem.terms, teeth=False)
    found = fit_waveform(problem.tool, problem.cuts, terms, start=fit)
    if not folds:
        return found
    worse = left_out_error(problem.cuts, left_out_fits(found, most))
    return found if worse <= RIVAL * left_out_error(problem.cuts, folds) else None


def runout(
    fit: Fit, uncertainty: FitUncertainty, not_sharp: RoundedFit, widest: float
) -> list[Estimate]:
    """Runout, and its angle from the tooth that protrudes most.

    ``fit`` is the one whose edge force is there at once, ``not_sharp`` that in which it grows.  A
    95 % interval whose half is beyond the share ``widest`` of the value leaves it undetermined.
    """
    flutes = fit.problem.tool.flutes
    if flutes == 1:
        return [_one_tooth("runout", "um"), _one_tooth("runout_angle", "deg")]
    at_once = _offset(fit, uncertainty)
    rounded = _offset(not_sharp.fit, not_sharp.uncertainty, not_sharp.alike)
    growth = not_sharp.fit.problem.chip(not_sharp.fit.x).growth
    f_z = float(np.mean([cut.conditions.f_z for cut in fit.problem.cuts]))
    of_two = "of two teeth: half the difference of their radii, the part along them; "
    remark = (
        f"{of_two if flutes == 2 else ''}edges whose force grows over {growth / UM:.2g} um of chip "
        f"count apart, as runout they would make it {at_once.size / UM:.3g} um"
    )
    most = max(at_once.size + at_once.half, rounded.size) / UM
    reason = (
        f"it is at most {most:.2g} um: rounded edges look like a part of it, and edges of "
        "different teeth do"
    )
    remedy = (
        "measure it with a dial gauge, or record partial immersions and three feeds or more, one "
        f"below {2e-3 * most:.2g} mm a tooth, at which a tooth that stands back does not cut"
    )
    no_angle = "two teeth do not tell it" if flutes == 2 else "the runout is too small to have one"
    pitch = 2 * np.pi / flutes
    return [
        Estimate(
            name="runout", unit="um", value=rounded.size / UM, half_width=rounded.half / UM,
            determined=rounded.half <= widest * max(rounded.size, RUNOUT * f_z), method=METHOD,
            lowest=0.0, remark=remark, reason=reason, remedy=remedy,
        ),
        Estimate(
            name="runout_angle", unit="deg", method=METHOD,
            determined=flutes > 2 and rounded.half_across <= ANGLE_DEG * DEGREE * rounded.size,
            value=(rounded.angle - pitch * round(rounded.angle / pitch)) / DEGREE,
            half_width=rounded.half_across / max(rounded.size, 1e-12) / DEGREE,
            reason=no_angle, remark="from the tooth that stands out most, within half a pitch",
        ),
    ]  # fmt: skip


def _one_tooth(name: str, unit: str) -> Estimate:
    return Estimate(
        name=name, unit=unit, value=0.0, half_width=0.0, determined=False, method=METHOD,
        reason="a single tooth has no other beside which it could stand out",
    )  # fmt: skip


def _offset(fit: Fit, uncertainty: FitUncertainty, alike: Fit | None = None) -> _Offset:
    """Offset of a fit, whose interval also holds that of ``alike``."""
    offset = _complex_offset(fit)
    size = abs(offset)
    outward = offset / size if size > 0 else 1.0 + 0.0j
    half, across = (
        uncertainty.half_width({"along": to.real, "across": to.imag})
        for to in (outward, 1j * outward)
    )
    if alike is not None:
        off = (_complex_offset(alike) - offset) / outward
        half, across = max(half, abs(off.real)), max(across, abs(off.imag))
    return _Offset(size=size, angle=float(np.angle(offset)), half=half, half_across=across)


def _complex_offset(fit: Fit) -> complex:
    geometry = fit.problem.geometry(fit.x)
    return complex(geometry.along, geometry.across)
