"""Inputs of the methods: rises since the start, groups of sensors, lags, speed and ambient.

Growth is zero at the start of a recording, and so is every input: rises of temperature since the
start, their answers through first-order lags, the rise of the squared speed.  A machine that starts
warm relaxes by itself; what the start knows of it are the groups' temperatures above the air, and
each enters as a relaxation (1 - exp(-t / lag)) of every lag.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.submodels.deformation.records import State
from pipeline.thermal.sensors import lag, sensor_groups

GROUPS = 3
"""Groups of sensors [1]: front, middle and rear of the spindle."""
AT_TOP_SPEED = 10.0
"""Input of the squared speed at the highest speed learnt [1], about as large as the rises in K."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """Inputs of the methods: T samples of S sensors in C groups."""

    state: State
    """Complete."""
    rises: Floats
    """Temperature of each sensor above its first [K]; shape (T, S)."""
    groups: Floats
    """Temperature of each group above its first [K]; shape (T, C)."""
    group_temperatures: Floats
    """Group temperatures [degC]; shape (T, C)."""
    linear: Floats
    """Groups, their lags, speed, ambient and relaxation from the start; shape (T, K)."""
    each_sensor: Floats
    """The same with every sensor in the place of the groups; shape (T, M)."""

    def __len__(self) -> int:
        return len(self.state)

    @property
    def time(self) -> Floats:
        """Time since the start [s]; shape (T,)."""
        return self.state.time


@dataclass(frozen=True, kw_only=True)
class InputMaker:
    """Makes the inputs of every recording alike; stored with the model."""

    weights: tuple[tuple[float, ...], ...]
    """Weights of each sensor in the temperature of a group [1]."""
    lags_s: tuple[float, ...]
    """Time constants [s]."""
    top_speed: float
    """Highest speed learnt [rev/min]; 0 where none is recorded."""

    @cached_property
    def _weights(self) -> Floats:
        return np.array(self.weights)

    def of(self, state: State) -> Inputs:
        """Inputs of a complete state."""
        rises = state.temperatures - state.temperatures[:1]
        groups = rises @ self._weights.T
        start = self._weights @ state.temperatures[0]
        air = np.isfinite(state.ambient).all()
        # without the air's temperature the coldest group stands for it
        above = start - (state.ambient[0] if air else start.min())
        speed = AT_TOP_SPEED * (state.speed / (self.top_speed or 1.0)) ** 2
        shared = [(speed - speed[0])[:, None]]
        if air:
            drift = (state.ambient - state.ambient[0])[:, None]
            shared += [drift, *self._lagged(state.time, drift)]
        shared += [(1 - np.exp(-state.time / one))[:, None] * above for one in self.lags_s]
        return Inputs(
            state=state, rises=rises, groups=groups, group_temperatures=groups + start,
            linear=np.hstack([groups, *self._lagged(state.time, groups), *shared]),
            each_sensor=np.hstack([rises, *self._lagged(state.time, rises), *shared]),
        )  # fmt: skip

    def _lagged(self, time: Floats, values: Floats) -> list[Floats]:
        return [lag(time, values, constant) for constant in self.lags_s]


def input_maker(states: Sequence[State], lags_s: Sequence[float]) -> InputMaker:
    """Groups by fuzzy c-means over the training recordings, and the lags."""
    rises = np.vstack([one.temperatures - one.temperatures[:1] for one in states])
    weights = tuple(tuple(float(f"{w:.6g}") for w in row) for row in sensor_groups(rises, GROUPS))
    top = max(float(one.speed.max()) for one in states)
    return InputMaker(weights=weights, lags_s=tuple(lags_s), top_speed=top)


def rates(inputs: Inputs, smooth_s: float) -> Floats:
    """Rate of the mean group temperature from its past alone [K/h]; shape (T,).

    The difference to its answer through a first-order lag, over the lag's time constant.
    """
    mean = inputs.groups.mean(axis=1, keepdims=True)
    behind = mean - lag(inputs.time, mean, smooth_s)
    return behind[:, 0] / smooth_s * 3600
