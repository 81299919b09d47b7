"""Spindle growth: two thermal nodes from speed and ambient, or lagged expansion of temperatures.

The nodes are the spindle with its bearings and the structure that carries it, as the network of
:mod:`pipeline.thermal.network`: the bearings' viscous friction n^(5/3), their friction under
preload (its torque does not depend on the speed: power ~ n) and windage n^2 heat the spindle, which
passes heat on to the structure; both lose heat to the ambient.  The growth that a probe at the nose
measures is

    g(t) = a_s (T_s(t) - T_s(0)) + a_b (T_b(t) - T_b(0)) + k (n(t)^2 - n(0)^2),

where t = 0 is the moment at which the probe was set to zero.  The expansions a_s and a_b are
products of coefficient of expansion and length; a structure that moves the nose away from the
probe has a negative one.  k holds what follows the speed at once: centrifugal load on the rings
moves the shaft of angular contact bearings (Abele, Altintas, Brecher: Machine tool spindle units,
CIRP Annals 59/2, 2010).  A spindle that was warm when the probe was set grows other than a cold
one: the nodes' temperatures at the start count, and are estimated from the sensors.  A sensor shows
a mixture of both nodes, T_j = s_j T_s + (1 - s_j) T_b.

From measured temperatures the growth is a lagged expansion of each,

    tau_j y_j' = T_j - y_j,    g(t) = sum_j K_j (y_j(t) - y_j(0)) + k (n(t)^2 - n(0)^2):

a sensor shows heat before the length that it heats is warm.  Given the lags the growth is linear in
K_j and k, so that only the lags are searched for (variable projection: Golub, Pereyra 1973).  A
record starts at rest, y_j(0) = T_j(0).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Finite, NotNegative, Range, Ranged, Share
from pipeline.thermal.network import (
    SOURCES,
    SpindleThermalParameters,
    heat_sources,
    temperatures,
)
from pipeline.thermal.sensors import lag

_Rate = Annotated[float, Range(above=0.0, unit="1/s")]

HEATING = ("bearing_friction", "windage", "load_speed")
"""Sources of the network of heat; under preload the bearings' load is constant."""

START_RIDGE = 0.01
"""Weight of the sensors' mean against a sensor where the start of the nodes is estimated [1].

Nodes that differ by 5 K, seen by sensors good to 0.5 K.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthRecord:
    """Growth record on even times, from the moment at which the probe was set to zero."""

    time_s: Floats
    """Evenly spaced [s]; shape (T,)."""
    speed_rad_s: Floats
    """Spindle speed [rad/s], held over each step; shape (T,)."""
    ambient_C: Floats
    """Ambient temperature [degC]; shape (T,)."""
    temperatures_C: Floats
    """Temperatures of N sensors or groups [degC]; nan where missing, N may be 0; shape (T, N)."""
    growth_m: Floats
    """Growth of the spindle towards the probe [m], nan where missing; shape (T,)."""

    def __post_init__(self) -> None:
        if len(self.time_s) < 2:
            raise ValueError(
                f"a record of growth of {len(self.time_s)} samples must have at least 2"
            )

    @property
    def step(self) -> float:
        """Distance of the samples [s]."""
        return float(self.time_s[-1] - self.time_s[0]) / (len(self.time_s) - 1)


@dataclass(frozen=True, kw_only=True)
class DeformationNetwork(Ranged, section="deformation"):
    """Two nodes of heat and the growth of the spindle."""

    bearing_friction: NotNegative
    """Heating of the spindle by its bearings, k / C [K/s/(rad/s)^(5/3)]."""
    windage: NotNegative
    """Heating of the spindle by windage, k / C [K/s/(rad/s)^2]."""
    preload_friction: NotNegative
    """Heating of the spindle by its bearings under preload, k / C [K/s/(rad/s)]."""
    cooling_rate: _Rate
    """1 / (R C) of the spindle to the ambient [1/s]."""
    coupling_rate: _Rate
    """Heat exchange of the spindle with the structure, over the spindle's C [1/s]."""
    capacity_ratio: Annotated[float, Range(above=0.0)]
    """C of the spindle over C of the structure [1]."""
    structure_cooling_rate: _Rate
    """1 / (R C) of the structure to the ambient [1/s]."""
    spindle_expansion: Finite
    structure_expansion: Finite
    """Growth for a kelvin of a node [m/K]."""
    centrifugal: Finite
    """Growth that follows the speed at once [m/(rad/s)^2]."""
    sensor_shares: tuple[Share, ...] = ()
    """Share of the spindle in each sensor's temperature [1]; empty without sensors."""

    @property
    def thermal(self) -> SpindleThermalParameters:
        """The network of heat alone."""
        return SpindleThermalParameters(
            heating={
                "bearing_friction": self.bearing_friction,
                "windage": self.windage,
                "load_speed": self.preload_friction,
            },
            cooling_rate=self.cooling_rate,
            coupling_rate=self.coupling_rate,
            capacity_ratio=self.capacity_ratio,
            body_cooling_rate=self.structure_cooling_rate,
        )

    def growth(self, nodes_C: Floats, speed_rad_s: ArrayLike) -> Floats:
        """Growth since the first sample [m], shape (..., T), from the nodes, (2, ..., T)."""
        rise = nodes_C - nodes_C[..., :1]
        square = np.asarray(speed_rad_s, float) ** 2
        return (
            self.spindle_expansion * rise[0]
            + self.structure_expansion * rise[1]
            + self.centrifugal * (square - square[..., :1])
        )

    def predict(
        self, speed_rad_s: ArrayLike, ambient_C: ArrayLike, temperatures_C: ArrayLike, step: float
    ) -> Floats:
        """Growth [m], shape (..., T), from speed and ambient, and the sensors at the start alone.

        Spindle speed [rad/s] and ambient [degC], (..., T), are held over each ``step`` [s];
        ``temperatures_C`` (..., N) are the sensors of the fit at the first sample [degC], nan where
        one is missing.
        """
        ambient = np.asarray(ambient_C, float)
        start = start_of_nodes(self.sensor_shares, temperatures_C, ambient[..., 0])
        return self.growth(simulate(speed_rad_s, ambient, step, self, start), speed_rad_s)


def start_of_nodes(
    sensor_shares: ArrayLike, temperatures_C: ArrayLike, ambient_C: ArrayLike
) -> Floats:
    """Node temperatures, shape (..., 2) [degC], from sensors, (..., N), at a start.

    Missing sensors (nan) are left out; without any, the nodes are at the ambient, shape (...). What
    the sensors leave open stays at their mean.

    Parameters
    ----------
    sensor_shares : array_like, shape (..., N)
        Share of the spindle in each sensor's temperature [1].
    temperatures_C, ambient_C : array_like, shapes (..., N) and (...)
        [degC].
    """
    shares, values = np.asarray(sensor_shares, float), np.asarray(temperatures_C, float)
    seen = np.isfinite(values)
    mean = np.where(seen, values, 0.0).sum(axis=-1) / np.maximum(seen.sum(axis=-1), 1)
    mean = np.where(seen.any(axis=-1), mean, ambient_C)
    mixture = np.stack([shares, 1 - shares], axis=-1) * seen[..., None]
    above = np.where(seen, values - mean[..., None], 0.0)
    normal = np.swapaxes(mixture, -1, -2) @ mixture + START_RIDGE * np.eye(2)
    target = (mixture * above[..., None]).sum(axis=-2)
    return mean[..., None] + np.linalg.solve(normal, target[..., None])[..., 0]


def simulate(
    speed_rad_s: ArrayLike,
    ambient_C: ArrayLike,
    step: float,
    parameters: DeformationNetwork,
    start_C: ArrayLike,
) -> Floats:
    """Temperatures of spindle and structure [degC], shape (2, ..., T); exact for inputs held.

    Inputs of shape (..., T) are held over each step [s]; ``start_C`` (..., 2) are spindle and
    structure at the first sample.
    """
    start = np.asarray(start_C, float)
    return temperatures(
        heat_sources(speed_rad_s, 1.0, 0.0), start[..., 0], parameters.thermal, step,
        ambient=ambient_C, body_start=start[..., 1],
    )  # fmt: skip


def unit_heat(record: GrowthRecord, speed: float) -> Floats:
    """Unit heat of each cause, bearing terms 1 at ``speed`` [rad/s]; (6, T, len(SOURCES))."""
    heat = np.zeros((6, len(record.time_s), len(SOURCES)))
    each = heat_sources(record.speed_rad_s / speed, 1.0, 0.0)
    for cause, name in enumerate(HEATING):
        place = list(SOURCES).index(name)
        heat[cause, :, place] = each[:, place]
    return heat


def unit_responses(record: GrowthRecord, heat: Floats, thermal: SpindleThermalParameters) -> Floats:
    """Node temperatures, shape (2, 6, T), that each cause alone would give.

    The causes: bearing friction, windage and preload of :func:`unit_heat`, the ambient of the
    record, and a start of 1 degC of spindle and of structure.  Temperatures are sums of these.
    """
    ambient = np.zeros(heat.shape[:2])
    ambient[3] = record.ambient_C
    return temperatures(
        heat, np.eye(6)[4], thermal, record.step, ambient=ambient, body_start=np.eye(6)[5]
    )


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
        (T, C) [degC].
        """
        columns = _columns(time_s, speed_rad_s, np.asarray(temperatures_C, float), self.lags_s)
        return columns @ np.array([*self.expansions, self.centrifugal])


BOUNDS_S = (1.0, 20000.0)
"""Bounds of the lags [s]."""
STARTS_S = (60.0, 600.0)
"""Lags that the fit is started from, the same for all temperatures [s]."""
EVALUATIONS = 60
"""Most evaluations for each start [1]."""


def fit_expansion(records: Sequence[GrowthRecord]) -> LaggedExpansion:
    """Lags and expansions of the growth of several records by bounded least squares."""
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
        seen = np.concatenate([np.isfinite(record.growth_m) for record in records])
        return cls(
            records=records, count=records[0].temperatures_C.shape[1], seen=seen,
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
