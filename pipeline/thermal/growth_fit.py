"""Parameters of spindle growth from several records, by bounded least squares.

Residuals are the growth of each record and, where there are sensors, their temperatures.  The
temperatures of the nodes at the start of a record are free about what the sensors show; they enter
linearly, so that they are eliminated (variable projection: Golub, Pereyra 1973, in the form of
Kaufman 1975), and what the Jacobian says of the other parameters holds for starts that are known to
``start_error_K``.  Rates are fitted as logarithms.

Bounds keep the fit from two great expansions that cancel: they are of the order of steel or cast
iron of at most a metre, 1e-5 m/K, and the structure is the heavier node.  The spindle's temperature
is by definition that of one sensor; with no sensors heat and expansion are known as a product.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.thermal.deformation import (
    HEATING,
    DeformationNetwork,
    GrowthRecord,
    start_of_nodes,
    unit_heat,
    unit_responses,
)

_LOGARITHMIC = slice(3, 7)
"""Places of the rates and of the ratio of capacities, as in :class:`DeformationNetwork`."""
_SHARED = 10
"""Parameters before the shares of the sensors."""
_NAMES = tuple(f.name for f in fields(DeformationNetwork))[:_SHARED]
_SLOPE = 1e-6
"""Step of a logarithm or a share for differences [1]."""
_MICROMETRE = 1e-6


@dataclass(frozen=True, kw_only=True)
class GrowthFitSettings(Ranged, section="growth_fit"):
    """Settings of the fit.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    growth_error_m: Positive = 1e-6
    """Error of growth that counts as much as ``temperature_error_K`` [m]."""
    temperature_error_K: Positive = 1.0
    """Error of the temperatures, root mean square over the sensors [K]."""
    start_error_K: Positive = 0.1
    """Error of a node at the start of a record, as :meth:`DeformationNetwork.start` has it from the
    sensors (without any, from the ambient), that counts as much as an error of one throughout the
    record [K].  A great one fits the start freely: right for records that the network can explain,
    else starts make up for what it lacks."""
    spindle_sensor: Annotated[int, Range(least=0)] | None = None
    """Column of the sensor whose temperature is by definition that of the spindle, share 1; the one
    that rises most within the records unless given."""
    fast_s: tuple[Positive, ...] = (600.0, 2400.0)
    slow_s: tuple[Positive, ...] = (5400.0, 18000.0)
    """Time constants of spindle and structure that the fit is started from, each with each [s]."""
    trials: Count = 5
    """Evaluations for each start [1]; the best one goes on."""
    evaluations: Count = 100
    """Most evaluations of the best one [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthFit:
    """A network and how well its records determine it."""

    network: DeformationNetwork
    """The fitted one."""
    names: tuple[str, ...]
    """Names of the D parameters: the fields of the network, then ``sensor_shares[j]``."""
    values: Floats
    """In the units of the network; shape (D,)."""
    half_width_95: Floats
    """Half of the 95 % interval; infinite where the records say nothing.  Textbook covariance, with
    as many independent residuals as their correlation from sample to sample leaves; shape (D,)."""
    determined: Bools
    """Whether the interval leaves out zero and no bound of the fit is reached; for a share, whether
    it is narrower than half of its range; shape (D,)."""
    jacobian: Floats
    """Jacobian of the residuals by the parameters in their units, starts eliminated;
    shape (R, D)."""
    residuals: Floats
    """In errors of the settings, modelled less measured; shape (R,)."""
    blocks: Ints
    """Record of each residual; shape (R,)."""
    starts_C: Floats
    """Spindle and structure at the start of each record [degC]; shape (records, 2)."""
    growth_rms_m: float
    """Root mean square of the residuals of growth [m]."""
    converged: bool
    """Whether the optimum was reached."""


def fit(records: Sequence[GrowthRecord], settings: GrowthFitSettings | None = None) -> GrowthFit:
    """Fit a network to records of growth.

    Raises
    ------
    ValueError
        When there is no record, records differ in their sensors, none has a finite growth, or the
        spindle never turns.
    """
    from scipy.optimize import OptimizeResult, least_squares

    settings = settings or GrowthFitSettings()
    task = _Task(records, settings)
    start, low, high = task.first(1.0, 1.0), *task.bounds()
    free = task.free

    def whole(y: Floats) -> Floats:
        x = start.copy()
        x[free] = y
        return x

    def residuals(y: Floats) -> Floats:
        return task.residuals(whole(y))

    def jacobian(y: Floats) -> Floats:
        return task.jacobian(whole(y))[:, free]

    def solve(x: Floats, evaluations: int) -> OptimizeResult:
        return least_squares(
            residuals, x[free], jacobian,
            (low[free], high[free]), x_scale="jac", max_nfev=evaluations,
        )  # fmt: skip

    trials = [
        solve(task.first(fast, slow), settings.trials)
        for fast in settings.fast_s
        for slow in settings.slow_s
    ]
    best = solve(whole(min(trials, key=lambda one: one.cost).x), settings.evaluations)
    at_bound = np.zeros(len(start), bool)
    at_bound[free] = best.active_mask != 0
    return task.answer(whole(best.x), at_bound, bool(best.success))


class _Task:
    """Residuals and Jacobian of records in scaled parameters: micrometres, K/s at the top speed."""

    def __init__(self, records: Sequence[GrowthRecord], settings: GrowthFitSettings) -> None:
        if not records:
            raise ValueError("records of growth: 0, at least one is needed")
        sensors = {record.temperatures_C.shape[1] for record in records}
        if len(sensors) > 1:
            raise ValueError(
                f"records with {sorted(sensors)} temperatures must all have the same sensors: put "
                "nan where one is missing"
            )
        if not any(np.isfinite(record.growth_m[1:]).any() for record in records):
            raise ValueError(f"growth_m of {len(records)} records holds no value: there is none")
        self.records, self.settings, self.sensors = records, settings, sensors.pop()
        self.speed = max(float(np.abs(record.speed_rad_s).max()) for record in records)
        if self.speed == 0:
            raise ValueError(
                f"speed_rad_s of {len(records)} records is 0 throughout: record a spindle "
                "that turns"
            )
        self.heat = [unit_heat(record, self.speed) for record in records]
        self.scale = np.ones(_SHARED + self.sensors)
        self.scale[:3] = self.speed ** np.array([-5 / 3, -2.0, -1.0])
        self.scale[7:9] = _MICROMETRE
        self.scale[9] = _MICROMETRE / self.speed**2
        self.spindle_sensor = self._spindle_sensor()
        self.free = self._free()

    def _spindle_sensor(self) -> int | None:
        rises = np.zeros(self.sensors)
        for record in self.records:
            seen = np.isfinite(record.temperatures_C)
            top = np.where(seen, record.temperatures_C, -np.inf).max(axis=0)
            low = np.where(seen, record.temperatures_C, np.inf).min(axis=0)
            rises = np.maximum(rises, np.where(seen.any(axis=0), top - low, 0.0))
        self.rise = float(rises.max(initial=0.0))
        if self.rise == 0:
            return None
        given = self.settings.spindle_sensor
        if given is not None and not (given < self.sensors and rises[given] > 0):
            raise ValueError(
                f"growth_fit.spindle_sensor = {given} must be one of {self.sensors} sensors whose "
                "temperature changes within the records"
            )
        return int(np.argmax(rises)) if given is None else given

    def _free(self) -> Ints:
        """Places of the parameters that the records can tell."""
        seen = np.zeros(self.sensors, bool)
        for record in self.records:
            seen |= np.isfinite(record.temperatures_C).any(axis=0)
        if self.spindle_sensor is not None:
            seen[self.spindle_sensor] = False  # its share is one
        return np.concatenate([np.arange(_SHARED), _SHARED + np.flatnonzero(seen)])

    def bounds(self) -> tuple[Floats, Floats]:
        low = np.full(_SHARED + self.sensors, -np.inf)
        high = -low
        low[:3] = 0.0
        low[_LOGARITHMIC], high[_LOGARITHMIC] = np.log(1e-6), np.log(0.1)
        low[5], high[5] = np.log(0.01), 0.0
        low[7:9], high[7:9] = (0.0, -10.0), 10.0
        low[_SHARED:], high[_SHARED:] = 0.0, 1.0
        return low, high

    def first(self, fast: float, slow: float) -> Floats:
        """Where to start: half of the spindle's heat goes to the ambient, half to the structure."""
        heat = max(self.rise, 1.0) / fast / 2
        rates = np.log([0.5 / fast, 0.5 / fast, 0.5 * fast / slow, 0.5 / slow])
        x = np.array(
            [heat, 0.1 * heat, 0.1 * heat, *rates, 1.0, 1.0, 0.0, *np.full(self.sensors, 0.5)]
        )
        if self.spindle_sensor is not None:
            x[_SHARED + self.spindle_sensor] = 1.0
        return x

    def network(self, x: Floats) -> DeformationNetwork:
        values = self.values(x)
        return DeformationNetwork(
            **{name: float(v) for name, v in zip(_NAMES, values[:_SHARED], strict=True)},
            sensor_shares=tuple(float(v) for v in values[_SHARED:]),
        )

    def values(self, x: Floats) -> Floats:
        values = x * self.scale
        values[_LOGARITHMIC] = np.exp(x[_LOGARITHMIC])
        return values

    def residuals(self, x: Floats) -> Floats:
        responses = self._responses(x)
        return np.concatenate(
            [self._record(r, x, u)[0] for r, u in zip(self.records, responses, strict=True)]
        )

    def jacobian(self, x: Floats) -> Floats:
        responses, slopes = self._responses(x), []
        for place in range(*_LOGARITHMIC.indices(len(x))):
            ahead = x.copy()
            ahead[place] += _SLOPE
            pairs = zip(self._responses(ahead), responses, strict=True)
            slopes.append([(a - b) / _SLOPE for a, b in pairs])
        return np.concatenate([
            self._slopes(record, x, responses[k], [one[k] for one in slopes])
            for k, record in enumerate(self.records)
        ])  # fmt: skip

    def _responses(self, x: Floats) -> list[Floats]:
        thermal = replace(self.network(x).thermal, heating=dict.fromkeys(HEATING, 1.0))
        return [
            unit_responses(record, heat, thermal)
            for record, heat in zip(self.records, self.heat, strict=True)
        ]

    def _observed(self, record: GrowthRecord, x: Floats, nodes: Floats, offset: Floats) -> Floats:
        """Weighted growth and temperatures of nodes of shape (2, ..., T), one after the other.

        ``offset`` (N + 1, T) is what does not come from the nodes; it is added, in the units of x.
        """
        s, shares = self.settings, x[_SHARED:, None]
        rise = nodes - nodes[..., :1]
        rows = np.empty((*nodes.shape[1:-1], 1 + self.sensors, nodes.shape[-1]))
        rows[..., 0, :] = x[7] * rise[0] + x[8] * rise[1]
        rows[..., 1:, :] = shares * nodes[0][..., None, :] + (1 - shares) * nodes[1][..., None, :]
        rows += offset
        rows[..., 0, :] *= _MICROMETRE / s.growth_error_m
        rows[..., 1:, :] /= s.temperature_error_K * np.sqrt(max(self.sensors, 1))
        return np.where(self._seen(record), rows, 0.0).reshape(*nodes.shape[1:-1], -1)

    def _seen(self, record: GrowthRecord) -> Bools:
        seen: Bools = np.isfinite(np.vstack([record.growth_m, record.temperatures_C.T]))
        seen[0, 0] = False  # growth is zero there by definition
        return seen

    def _record(
        self, record: GrowthRecord, x: Floats, responses: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Residuals with the best start, what a start adds to them (2, R), and the start (2,)."""
        zero = np.zeros((1 + self.sensors, 1))
        square = (record.speed_rad_s / self.speed) ** 2
        fixed = -np.vstack([record.growth_m / _MICROMETRE, record.temperatures_C.T])
        fixed[0] += x[9] * (square - square[0])
        causes = np.array([*x[:3], 1.0])
        rest = self._observed(record, x, np.tensordot(responses[:, :4], causes, (1, 0)), fixed)
        by_start = self._observed(record, x, responses[:, 4:], zero)
        error = self._start_error(record)
        by_start = np.hstack([by_start, np.eye(2) / error])
        rest = np.concatenate([rest, -self._shown(record, x) / error])
        start: Floats = -np.linalg.solve(by_start @ by_start.T, by_start @ rest).astype(float)
        return rest + start @ by_start, by_start, start

    def _start_error(self, record: GrowthRecord) -> float:
        """Errors of a model hang together over a record: its start counts as its samples do."""
        return self.settings.start_error_K / float(np.sqrt(len(record.time_s)))

    def _shown(self, record: GrowthRecord, x: Floats) -> Floats:
        """Nodes at the start, as the sensors of the first sample show them, (2,)."""
        return start_of_nodes(x[_SHARED:], record.temperatures_C[0], record.ambient_C[0])

    def _slopes(
        self, record: GrowthRecord, x: Floats, responses: Floats, by_rate: list[Floats]
    ) -> Floats:
        _, by_start, start = self._record(record, x, responses)
        causes = np.array([*x[:3], 1.0, *start])
        zero = np.zeros((1 + self.sensors, 1))
        moved = np.stack([*np.moveaxis(responses[:, :3], 1, 0), *(
            np.tensordot(one, causes, (1, 0)) for one in by_rate
        )], axis=1)  # fmt: skip
        nodes = np.tensordot(responses, causes, (1, 0))
        rise = nodes - nodes[:, :1]
        square = (record.speed_rad_s / self.speed) ** 2
        direct = np.zeros((3 + self.sensors, 1 + self.sensors, nodes.shape[1]))
        direct[:2, 0], direct[2, 0] = rise, square - square[0]
        for j in range(self.sensors):
            direct[3 + j, 1 + j] = nodes[0] - nodes[1]
        still = np.zeros((2, len(direct), nodes.shape[1]))
        slopes = np.vstack(
            [self._observed(record, x, moved, zero), self._observed(record, x, still, direct)]
        )
        shown = np.zeros((len(slopes), 2))
        places = self.free[self.free >= _SHARED]
        step = _SLOPE * np.eye(self.sensors)[places - _SHARED]
        ends = [np.clip(x[_SHARED:] + one, 0.0, 1.0) for one in (step, -step)]
        ahead, behind = (
            start_of_nodes(one, record.temperatures_C[0], record.ambient_C[0]) for one in ends
        )
        width = (ends[0] - ends[1]).sum(axis=1, keepdims=True)
        shown[places] = (behind - ahead) / self._start_error(record) / width
        slopes = np.hstack([slopes, shown])
        inner = np.linalg.solve(by_start @ by_start.T, by_start @ slopes.T)
        projected: Floats = slopes.T - by_start.T @ inner
        return projected

    def answer(self, x: Floats, at_bound: Bools, converged: bool) -> GrowthFit:
        network, values = self.network(x), self.values(x)
        parts = [
            self._record(r, x, u) for r, u in zip(self.records, self._responses(x), strict=True)
        ]
        residuals = np.concatenate([part[0] for part in parts])
        blocks = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        by_unit = self.scale.copy()
        by_unit[_LOGARITHMIC] = values[_LOGARITHMIC]
        jacobian = self.jacobian(x) / by_unit
        half_width = np.full(len(x), np.inf)
        half_width[self.free] = _half_width(jacobian[:, self.free], residuals, self._count(parts))
        if self.spindle_sensor is not None:
            half_width[_SHARED + self.spindle_sensor] = 0.0  # by definition
        limit = np.abs(values)
        limit[_SHARED:] = 0.25
        growth = np.concatenate([
            part[0][: len(r.time_s)][np.isfinite(r.growth_m)]
            for part, r in zip(parts, self.records, strict=True)
        ])  # fmt: skip
        return GrowthFit(
            network=network,
            names=_NAMES + tuple(f"sensor_shares[{j}]" for j in range(self.sensors)),
            values=values,
            half_width_95=half_width,
            determined=(half_width < limit) & ~at_bound,
            jacobian=jacobian,
            residuals=residuals,
            blocks=blocks,
            starts_C=np.array([part[2] for part in parts]),
            growth_rms_m=float(np.sqrt(np.mean(growth**2))) * self.settings.growth_error_m,
            converged=converged,
        )

    def _count(self, parts: list[tuple[Floats, Floats, Floats]]) -> int:
        seen = sum(int(self._seen(record).sum()) for record in self.records)
        return max(seen - 2 * len(parts), 1)


def _half_width(jacobian: Floats, residuals: Floats, count: int) -> Floats:
    """Half of the 95 % intervals; ``count`` residuals are those that were seen, less the starts."""
    from scipy.special import stdtrit

    square = float(residuals @ residuals)
    together = float(residuals[1:] @ residuals[:-1]) / square if square > 0 else 0.0
    together = min(max(together, 0.0), 0.999)
    free = max(count * (1 - together) / (1 + together) - jacobian.shape[1], 1.0)
    length = np.linalg.norm(jacobian, axis=0)
    known = length > 0
    half_width = np.full(len(length), np.inf)
    scaled = jacobian[:, known] / length[known]
    _, singular, right = np.linalg.svd(scaled, full_matrices=False)
    singular = np.maximum(singular, 1e-12 * singular[0])
    spread = np.sqrt(((right / singular[:, None]) ** 2).sum(axis=0))
    # the mean square of as many residuals as are independent
    noise = np.sqrt(square / count * (1 + together) / (1 - together))
    half_width[known] = stdtrit(free, 0.975) * noise * spread / length[known]
    return half_width
