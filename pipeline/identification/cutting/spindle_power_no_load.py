"""No-load power of a spindle: what it takes turning free, P_0(n) = p0 + p1 n + p2 n^2.

It is the efficiency times the motor's power without a cut, as
:class:`pipeline.cutting.economics.spindle_power.SpindleDrive` has it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.identification.cutting.spindle_power_levels import Levels
from pipeline.identification.cutting.spindle_power_regression import Regression, regression

Floats = NDArray[np.float64]

TERMS = 3
"""When there are speeds enough."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NoLoad:
    """Power that the spindle takes turning free.

    Parameters
    ----------
    fit : Regression
        Of p0, p1, p2 in [W], [W s], [W s^2] with n in rev/s: as many as the speeds determine.
    lowest, highest : float
        Speeds between which it holds [rev/s].
    levels : Levels
        That it was found from.
    """

    fit: Regression
    lowest: float
    highest: float
    levels: Levels

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients p0, p1, p2 of n [rev/s]; those not there are 0."""
        found = self.fit.values.tolist()
        return tuple(found + [0.0] * (TERMS - len(found)))

    def power(self, n: ArrayLike) -> Floats:
        """P_0 at the speed n [rev/s], in W."""
        power: Floats = powers(n, len(self.fit.values)) @ self.fit.values
        return power

    def half_width(self, n: ArrayLike) -> Floats:
        """Half of the 95 % interval of P_0 at the speed n [rev/s], in W."""
        rows = powers(n, len(self.fit.values))
        variance = np.einsum("...i,ij,...j->...", rows, self.fit.covariance, rows)
        half: Floats = self.fit.quantile * np.sqrt(np.maximum(variance, 0.0))
        return half


def no_load(levels: Levels) -> NoLoad:
    """No-load power from levels without a cut; one term less than there are speeds.

    Raises
    ------
    ValueError
        When there are fewer than two speeds.
    """
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
    return NoLoad(
        fit=fit,
        lowest=float(idle.speed.min()),
        highest=float(idle.speed.max()),
        levels=idle,
    )


def powers(n: ArrayLike, terms: int) -> Floats:
    """1, n, n^2, … up to as many terms; shape of ``n`` + (terms,)."""
    rows: Floats = np.asarray(n, dtype=np.float64)[..., None] ** np.arange(terms)
    return rows
