"""Linear regression on few readings, and estimates of single parameters as they are stored.

Each reading has its own uncertainty.  Noise and rounding of a reading are the least that its
residual can be; where residuals are greater, the model misses something in proportion to the
reading (a cut that took another force).  That share tau is estimated from the residuals (Paule and
Mandel 1982).  Intervals are Student's with the few degrees of freedom there are, and never narrower
than those of the measurement uncertainties.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.model import Parameter
from pipeline.submodels.statistics import student_quantile

COLLINEAR = 1e8
"""Condition number of scaled columns from which the parameters are not separable."""
TINY = 1e-9
"""Least standard deviation of a reading, over the greatest reading [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """D parameters of a linear model."""

    values: Floats
    """Estimates; shape (D,)."""
    covariance: Floats
    """Covariance of the estimates; shape (D, D)."""
    half_width: Floats
    """Half of the 95 % interval; infinite without more readings than parameters; shape (D,)."""
    quantile: float
    """Half widths over standard deviations [1]."""
    freedom: int
    """Readings less parameters."""
    share: float
    """tau, scatter of the readings beyond their uncertainty, as a share of them [1]."""


def regression(design: Floats, readings: Floats, covariance: Floats, size: Floats) -> Regression:
    """Generalised least squares; infinite half widths when the columns are not separable.

    ``design`` (L, D); ``covariance`` (L, L) of the ``readings`` (L,) by their measurement
    uncertainty; ``size`` (L,): magnitudes that the share tau refers to.
    """
    count, parameters = design.shape
    freedom = count - parameters
    scale = np.linalg.norm(design, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    singular = np.linalg.svd(design / scale, compute_uv=False) if count else np.zeros(1)
    apart = freedom >= 0 and singular[0] < COLLINEAR * singular[-1]
    if freedom < 1 or not apart:
        return Regression(
            values=np.full(parameters, np.nan), quantile=np.inf, freedom=freedom, share=np.nan,
            covariance=np.full((parameters, parameters), np.inf),
            half_width=np.full(parameters, np.inf),
        )  # fmt: skip
    least = TINY * np.abs(readings).max(initial=TINY)
    covariance = covariance + least**2 * np.eye(count)  # readings without noise have no inverse
    share = _share(design / scale, readings, covariance, size, freedom)
    values, spread, misfit = _solve(design / scale, readings, covariance, size, share)
    by_scatter = student_quantile(freedom) * np.sqrt(misfit / freedom)
    quantile = max(student_quantile(np.inf), by_scatter)
    spread = spread / np.outer(scale, scale)
    return Regression(
        values=values / scale, covariance=spread, half_width=quantile * np.sqrt(np.diag(spread)),
        quantile=quantile, freedom=freedom, share=share,
    )  # fmt: skip


def _solve(
    design: Floats, readings: Floats, covariance: Floats, size: Floats, share: float
) -> tuple[Floats, Floats, float]:
    """Estimates, their covariance, and the sum of the squared whitened residuals."""
    lower = np.linalg.cholesky(covariance + np.diag((share * size) ** 2))
    whitened = np.linalg.solve(lower, np.column_stack([design, readings]))
    inverse = np.linalg.pinv(whitened[:, :-1])
    values = inverse @ whitened[:, -1]
    residuals = whitened[:, -1] - whitened[:, :-1] @ values
    return values, inverse @ inverse.T, float(residuals @ residuals)


def _share(
    design: Floats, readings: Floats, covariance: Floats, size: Floats, freedom: int
) -> float:
    """Share tau at which the weighted residuals match their degrees of freedom; 0 at least."""
    from scipy.optimize import brentq

    def excess(share: float) -> float:
        return _solve(design, readings, covariance, size, share)[2] - freedom

    if excess(0.0) <= 0.0 or not size.any():
        return 0.0
    high = 0.01
    while excess(high) > 0.0 and high < 1e3:
        high *= 2.0
    return float(brentq(excess, 0.0, high, xtol=1e-6)) if excess(high) <= 0.0 else high


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Estimate of one parameter, determined or not."""

    name: str
    unit: str
    value: float
    """Value in the unit."""
    half_width: float
    """Half of the 95 % interval, in the unit."""
    determined: bool
    """Whether the recordings determine it."""
    method: str
    reason: str = ""
    remedy: str = ""
    """Why they do not if so, and what to record then."""
    remark: str = ""
    """Remark on the meaning of a determined value."""
    lowest: float = -np.inf
    """Physical lower bound of its interval."""

    @property
    def parameter(self) -> Parameter:
        """The estimate as it is stored, to five significant digits."""
        if not (self.determined and np.isfinite(self.value) and np.isfinite(self.half_width)):
            return undetermined(self.unit, self.reason or self.method, self.remedy)
        low = max(self.value - self.half_width, self.lowest)
        return Parameter(
            value=digits(self.value), unit=self.unit, determined=True, method=self.method,
            interval_95=(digits(low), digits(self.value + self.half_width)),
        )  # fmt: skip


def undetermined(unit: str, reason: str, remedy: str = "") -> Parameter:
    """Parameter that the recordings do not determine."""
    return Parameter(
        value=None, unit=unit, interval_95=None, determined=False, method=reason, remedy=remedy
    )


def digits(value: float) -> float:
    """A number to five significant digits."""
    return float(f"{value:.5g}")
