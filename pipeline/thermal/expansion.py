"""Spindle growth from measured temperatures: lagged expansion of each.

    tau_j y_j' = T_j - y_j,    g(t) = sum_j K_j (y_j(t) - y_j(0)) + k (n(t)^2 - n(0)^2)

A sensor shows heat before the length that it heats is warm.  Given the lags the growth is linear in
K_j and k, so that only the lags are searched for (variable projection: Golub, Pereyra 1973).  A
record starts at rest, y_j(0) = T_j(0).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Finite, Range, Ranged
from pipeline.thermal.deformation import GrowthRecord
from pipeline.thermal.lagged import lag

_Lag = Annotated[float, Range(above=0.0, unit="s")]


@dataclass(frozen=True, kw_only=True)
class LaggedExpansion(Ranged, section="expansion"):
    """Growth from C temperatures, a lag and an expansion of each, and the speed."""

    expansions: tuple[Finite, ...]
    """K of each temperature [m/K]."""
    lags_s: tuple[_Lag, ...]
    """Time constant tau of each [s]."""
    centrifugal: Finite
    """k, growth that follows the speed at once [m/(rad/s)^2]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.expansions) != len(self.lags_s):
            raise ValueError(
                f"expansion.lags_s of {len(self.lags_s)} must be as many as the "
                f"{len(self.expansions)} expansions"
            )

    def predict(
        self, time_s: ArrayLike, speed_rad_s: ArrayLike, temperatures_C: ArrayLike
    ) -> Floats:
        """Growth since the first sample [m], shape (T,); a sample uses no later one.

        Times (T,) ascend at any distances [s], with spindle speed [rad/s] and finite temperatures
        (T, C) [degC]. ValueError when there are not as many temperatures as expansions, or one is
        missing.
        """
        values = np.asarray(temperatures_C, float)
        if values.ndim != 2 or values.shape[1] != len(self.expansions):
            raise ValueError(
                f"temperatures of shape {values.shape} must have a column for each of "
                f"{len(self.expansions)} expansions"
            )
        columns = _columns(time_s, speed_rad_s, values, self.lags_s)
        grown: Floats = columns @ np.array([*self.expansions, self.centrifugal])
        return grown


BOUNDS_S = (1.0, 20000.0)
"""Bounds of the lags [s]."""
STARTS_S = (60.0, 600.0)
"""Lags that the fit is started from, the same for all temperatures [s]."""
EVALUATIONS = 60
"""Most evaluations for each start [1]."""


def fit_expansion(records: Sequence[GrowthRecord]) -> LaggedExpansion:
    """Lags and expansions of the growth of several records by bounded least squares.

    ValueError when there is no record, or one has other temperatures or misses one.
    """
    from scipy.optimize import least_squares

    growth = _Growth.of(records)
    low, high = np.log(BOUNDS_S)
    trials = [
        least_squares(
            growth.left, np.full(growth.count, np.log(start)), bounds=(low, high),
            diff_step=[1e-4] * growth.count, max_nfev=EVALUATIONS,
        )
        for start in STARTS_S
    ]  # fmt: skip
    lags = np.exp(min(trials, key=lambda one: one.cost).x)
    factors, _ = growth.linear(lags)
    return LaggedExpansion(
        expansions=tuple(factors[:-1].tolist()), lags_s=tuple(lags.tolist()),
        centrifugal=float(factors[-1]),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Growth:
    """Measured growth [m] of several records, and which samples have one."""

    records: Sequence[GrowthRecord]
    count: int  # of temperatures
    seen: Bools
    measured: Floats

    @classmethod
    def of(cls, records: Sequence[GrowthRecord]) -> Self:
        if not records:
            raise ValueError("records of growth: 0, at least one is needed")
        many = {record.temperatures_C.shape[1] for record in records}
        if len(many) > 1 or 0 in many:
            raise ValueError(
                f"records with {sorted(many)} temperatures must all have the same ones, at least "
                "one"
            )
        seen = np.concatenate([np.isfinite(record.growth_m) for record in records])
        return cls(
            records=records, count=many.pop(), seen=seen,
            measured=np.concatenate([record.growth_m for record in records])[seen],
        )  # fmt: skip

    def linear(self, lags: Floats) -> tuple[Floats, Floats]:
        """Best factors of the columns of lags, and what they leave."""
        table = np.concatenate(
            [_columns(r.time_s, r.speed_rad_s, r.temperatures_C, lags) for r in self.records]
        )[self.seen]
        length = np.linalg.norm(table, axis=0)
        length[length == 0] = 1.0
        factors = np.linalg.lstsq(table / length, self.measured, rcond=None)[0] / length
        return factors, table @ factors - self.measured

    def left(self, logarithms: Floats) -> Floats:
        """Residual of the best factors of lags, over the greatest growth."""
        scale = max(float(np.abs(self.measured).max(initial=0.0)), 1e-9)
        return self.linear(np.exp(logarithms))[1] / scale


def _columns(
    time_s: ArrayLike, speed_rad_s: ArrayLike, temperatures_C: Floats, lags_s: ArrayLike
) -> Floats:
    """Regressors of K_j and k, shape (T, C + 1): lagged rises and the square of the speed."""
    square = np.asarray(speed_rad_s, float) ** 2
    slow = [
        lag(time_s, column, float(constant)) - column[0]
        for column, constant in zip(temperatures_C.T, np.asarray(lags_s, float), strict=True)
    ]
    return np.column_stack([*slow, square - square[0]])
