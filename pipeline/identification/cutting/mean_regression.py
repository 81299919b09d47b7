"""Coefficients from mean forces alone, as Altintas has them.

Means over a revolution are linear in the six coefficients (*Manufacturing Automation*, 2nd ed.
2012, section 2.8.1), and neither helix nor modes touch them; runout does not as long as no tooth
misses its chip.  Each mean is worth its scatter over the revolutions and the zero of its recording.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.mean_force import regressors
from pipeline.identification.cutting.fit import Fit
from pipeline.identification.cutting.parameters import Parameter, coefficients
from pipeline.identification.cutting.problem import PRIOR, Cut

Floats = NDArray[np.float64]

HOW = "linear regression of the mean forces"


def mean_regression(
    cuts: Sequence[Cut], widest: float, fit: Fit | None = None
) -> tuple[Floats, list[Parameter]]:
    """Coefficients from the mean forces of recordings [N/m^2], [N/m], and what is said of each.

    Parameters
    ----------
    cuts : sequence of Cut
        The recordings.
    widest : float
        Half an interval that is wider, as a share, is no determination [1].
    fit : Fit, optional
        Of the waveforms of ``cuts``; what teeth that miss their chips do to means, as it has them,
        widens the intervals.
    """
    from scipy.stats import t as student

    table, measured, deviation = _means(cuts)
    values, covariance = _solved(table, measured, deviation)
    freedom = len(measured) - 6
    quantile, spread = 1.96, 1.0
    if freedom > 0:  # zeros may scatter more than was said of them
        square = float((((measured - table @ values) / deviation) ** 2).sum()) / freedom
        if square > 1:
            quantile, spread = float(student.ppf(0.975, freedom)), square
    half = quantile * np.sqrt(spread * np.diag(covariance))
    if fit is not None:
        modelled = np.concatenate([one[0].real for one in fit.modelled])
        half = np.hypot(half, _solved(table, modelled, deviation)[0] - fit.values[:6])
    f_z = float(np.mean([one.conditions.f_z for one in cuts]))
    return values, coefficients(values, half, f_z, widest, HOW)


def linear_means(cuts: Sequence[Cut]) -> Floats:
    """The six coefficients that the mean forces give [N/m^2], [N/m]."""
    return _solved(*_means(cuts))[0]


def _means(cuts: Sequence[Cut]) -> tuple[Floats, Floats, Floats]:
    """Design matrix, means of the forces [N] and their standard deviations; 3 R rows."""
    each = [one.conditions for one in cuts]
    table = regressors(
        flutes=[c.flutes for c in each], f_z=[c.f_z for c in each], a_p=[c.a_p for c in each],
        phi_st=[c.phi_st for c in each], phi_ex=[c.phi_ex for c in each],
    ).reshape(-1, 6)  # fmt: skip
    measured = np.concatenate([one.lines[0].real for one in cuts])
    return table, measured, np.sqrt(np.concatenate([one.variance[0] for one in cuts]))


def _solved(table: Floats, measured: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Weighted least squares with the prior, and its covariance."""
    scaled = np.concatenate([table / deviation[:, None], np.diag(1 / np.array(PRIOR))])
    length = np.linalg.norm(scaled, axis=0)
    right = np.concatenate([measured / deviation, np.zeros(6)])
    values = np.linalg.lstsq(scaled / length, right, rcond=1e-14)[0] / length
    inverse = np.linalg.inv((scaled / length).T @ (scaled / length))
    return values, inverse / np.outer(length, length)
