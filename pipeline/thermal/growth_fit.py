"""Parameters of spindle growth from several records, by bounded least squares.

Residuals are the growth of each record and, where there are sensors, their temperatures.  The
temperatures of the nodes at the start of a record are free about what the sensors show; they enter
linearly, so that they are eliminated (variable projection: Golub, Pereyra 1973, in the form of
Kaufman 1975), and what the Jacobian says of the other parameters holds for starts that are known to
``START_ERROR_K``.  Rates are fitted as logarithms.

Bounds keep the fit from two great expansions that cancel: they are of the order of steel or cast
iron of at most a metre, 1e-5 m/K, and the structure is the heavier node.  The spindle's temperature
is by definition that of one sensor; with no sensors heat and expansion are known as a product.
"""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
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
"""Error of growth [m] that counts as much as one kelvin, root mean square over the sensors."""
START_ERROR_K = 0.1
"""Error of a node at the start of a record, about what :func:`.start_of_nodes` has from the sensors
(without any, from the ambient), that counts as much as an error of one throughout the record [K].
A great one fits the start freely: right for records that the network can explain, else starts make
up for what it lacks."""
FAST_S, SLOW_S = (600.0, 2400.0), (5400.0, 18000.0)
"""Time constants of spindle and structure that the fit is started from, each with each [s]."""
TRIALS, EVALUATIONS = 5, 100
"""Evaluations for each start, and most evaluations of the best one, which goes on [1]."""


def fit_network(
    records: Sequence[GrowthRecord], start_error_K: float = START_ERROR_K
) -> DeformationNetwork:
    """The network of records of growth; ValueError when the spindle never turns."""
    from scipy.optimize import OptimizeResult, least_squares

    task = _Task(records, start_error_K)
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

    trials = [solve(task.first(fast, slow), TRIALS) for fast in FAST_S for slow in SLOW_S]
    best = solve(whole(min(trials, key=lambda one: one.cost).x), EVALUATIONS)
    return task.network(whole(best.x))


class _Task:
    """Residuals and Jacobian of records in scaled parameters: micrometres, K/s at the top speed."""

    def __init__(self, records: Sequence[GrowthRecord], start_error_K: float) -> None:
        self.records, self.start_error_K = records, start_error_K
        self.sensors = records[0].temperatures_C.shape[1]
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
        """The sensor that rises most within the records; its temperature is the spindle's."""
        rises = np.zeros(self.sensors)
        for record in self.records:
            seen = np.isfinite(record.temperatures_C)
            top = np.where(seen, record.temperatures_C, -np.inf).max(axis=0)
            low = np.where(seen, record.temperatures_C, np.inf).min(axis=0)
            rises = np.maximum(rises, np.where(seen.any(axis=0), top - low, 0.0))
        self.rise = float(rises.max(initial=0.0))
        return int(np.argmax(rises)) if self.rise > 0 else None

    def _free(self) -> Ints:
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
        """Start values: half of the spindle's heat goes to the ambient, half to the structure."""
        heat = max(self.rise, 1.0) / fast / 2
        rates = np.log([0.5 / fast, 0.5 / fast, 0.5 * fast / slow, 0.5 / slow])
        x = np.array(
            [heat, 0.1 * heat, 0.1 * heat, *rates, 1.0, 1.0, 0.0, *np.full(self.sensors, 0.5)]
        )
        if self.spindle_sensor is not None:
            x[_SHARED + self.spindle_sensor] = 1.0
        return x

    def network(self, x: Floats) -> DeformationNetwork:
        values = x * self.scale
        values[_LOGARITHMIC] = np.exp(x[_LOGARITHMIC])
        return DeformationNetwork(
            **{name: float(v) for name, v in zip(_NAMES, values[:_SHARED], strict=True)},
            sensor_shares=tuple(float(v) for v in values[_SHARED:]),
        )

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
        shares = x[_SHARED:, None]
        rise = nodes - nodes[..., :1]
        rows = np.empty((*nodes.shape[1:-1], 1 + self.sensors, nodes.shape[-1]))
        rows[..., 0, :] = x[7] * rise[0] + x[8] * rise[1]
        rows[..., 1:, :] = shares * nodes[0][..., None, :] + (1 - shares) * nodes[1][..., None, :]
        rows += offset
        rows[..., 1:, :] /= np.sqrt(max(self.sensors, 1))
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
        shown = start_of_nodes(x[_SHARED:], record.temperatures_C[0], record.ambient_C[0])
        rest = np.concatenate([rest, -shown / error])
        start: Floats = -np.linalg.solve(by_start @ by_start.T, by_start @ rest).astype(float)
        return rest + start @ by_start, by_start, start

    def _start_error(self, record: GrowthRecord) -> float:
        """Start deviation over sqrt(T) [K], as model errors are correlated over a record."""
        return self.start_error_K / float(np.sqrt(len(record.time_s)))

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
        return slopes.T - by_start.T @ inner
