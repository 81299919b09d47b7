"""Free runs of a stored network over days with other parameters, beside estimates of its model.

What the network changes is added to the estimate, so that the forest's correction stays as it is.
A sensor that reads b too much starts the network b too high and reads that of the network plus b.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.si import NS
from pipeline.signals.windows import StateSegment
from pipeline.thermal.network import SpindleThermalParameters, temperatures
from pipeline.twin.spindle import (
    TARGET,
    SpindleModelFile,
    ambient_of,
    coolant_of,
    heat_of,
    spindle_stretches,
)

SINKS = ("cooling_rate", "body_cooling_rate", "coolant_rate")
"""Rates by which a network with a body that warms loses its heat."""
MOST_LN = 4.0
"""Greatest magnitude of a logarithm of a factor [1]."""


def factor(ln: Any) -> Any:
    """Factor [1] by its logarithm."""
    return np.exp(np.clip(ln, -MOST_LN, MOST_LN))


@dataclass(frozen=True, kw_only=True, eq=False)
class ThermalRuns:
    """Free runs over days beside W windows with the model's estimates."""

    model: SpindleModelFile
    t: Floats
    estimated: Floats
    """Begin of each window [s since 1970], and its estimate [degC]; shape (W,)."""
    runs: Sequence[tuple[Callable[..., Floats], Any, Any]]
    """Run of each day by network and start [K] below the measured one, its windows, their steps."""

    @classmethod
    def of(
        cls, model: SpindleModelFile, table: pd.DataFrame, states: Mapping[str, pd.DataFrame]
    ) -> "ThermalRuns":
        """Runs over the state tables of days; a day that the network cannot run over has none."""
        runs, t = [], table["t"].to_numpy(float)
        for day, state in states.items():
            found = spindle_stretches(state, day, model.records, step=model.fit.step_s,
                                      bridge_s=np.inf, shortest_s=0.0)  # fmt: skip
            places = np.flatnonzero(table["day"] == day)
            for one in list(found)[:1] if len(places) else []:
                time = pd.DatetimeIndex(one.frame.index).as_unit("ns").asi8 / NS
                steps = np.searchsorted(time, t[places], side="right") - 1
                run = _run(model, one)
                runs.append((run, places, np.maximum(steps, 0)))
        return cls(model=model, t=t, estimated=table["estimated"].to_numpy(float), runs=runs)

    def estimate(
        self, network: Callable[[float], SpindleThermalParameters], offset: Any = None
    ) -> Floats:
        """Estimate (W,) [degC] by networks of a run's begin [s]; ``offset`` (W,): read too much."""
        found = self.estimated.copy()
        for run, places, steps in self.runs:
            below = 0.0 if offset is None else float(offset[places[0]])
            change = run(network(float(self.t[places[0]])), below) - run(self.model.network)
            found[places] += change[steps]
        return found if offset is None else found + offset

    def scaled(self, air: float = 0.0, **ln: float) -> SpindleThermalParameters:
        """The champion's network with factors on rates and heat sources, and warmer air [K]."""
        network = self.model.network
        rates = {k: factor(x) * getattr(network, k) for k, x in ln.items() if hasattr(network, k)}
        heating = {k: v * factor(ln.get(k, 0.0)) for k, v in network.heating.items()}
        return replace(network, heating=heating, ambient=network.ambient + air, **rates)


def _run(model: SpindleModelFile, stretch: StateSegment) -> Callable[..., Floats]:
    frame = stretch.frame
    heat, start = heat_of(frame), float(frame[TARGET].iloc[0])
    air, coolant = ambient_of(frame, model.records), coolant_of(frame, model.records)

    def run(network: SpindleThermalParameters, below: float = 0.0) -> Floats:
        return temperatures(heat, start - below, network, stretch.step, ambient=air,
                            coolant=coolant)[0]  # fmt: skip

    return run
