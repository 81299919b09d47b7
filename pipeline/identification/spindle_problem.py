"""One least-squares problem of the spindle's network: settings, bounds, residuals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.signals.windows import Stretch
from pipeline.thermal.network import SOURCES, Floats, SpindleThermalParameters, temperatures
from pipeline.twin.spindle import TARGET, SpindleRecords, ambient_of, heat_of

RATE_BOUNDS = (1 / (7 * 86400), 1 / 20)  # [1/s]: a week to 20 s covers any spindle's time constants
RATIO_BOUNDS = (1e-3, 10.0)  # [1] of the measured node's capacity to the body's
AMBIENT_BOUNDS = (-20.0, 60.0)  # [degC]
OFFSET_BOUNDS = (-20.0, 30.0)  # [K]
HEATING_BOUND = 1.0  # [K/s] at a source's root mean square: no motor heats faster


@dataclass(frozen=True, kw_only=True)
class SpindleFitSettings:
    """How the network is fitted.

    Parameters
    ----------
    step_s : float
        Step of the simulation [s].
    bridge_s : float
        Unknown inputs are held this long [s]; a longer gap ends a stretch.
    shortest_s : float
        Stretches and working days shorter than this are not used [s].
    window_s : float
        Length of the windows that days left out are judged on, and of the blocks within which
        residuals hang together [s].
    outlier_K : float
        Residuals beyond this count less (soft L1).
    nodes : tuple of int
        Numbers of nodes to try.
    time_constants_s : tuple of float
        Time constants from which the fit starts; the best end is kept.
    """

    step_s: float = 10.0
    bridge_s: float = 600.0
    shortest_s: float = 3600.0
    window_s: float = 3600.0
    outlier_K: float = 1.0
    nodes: tuple[int, ...] = (1, 2)
    time_constants_s: tuple[float, ...] = (300.0, 1500.0, 7200.0)

    def __post_init__(self) -> None:
        for name in ("step_s", "shortest_s", "window_s", "outlier_K"):
            if not getattr(self, name) > 0:
                raise ValueError(f"spindle_fit.{name} = {getattr(self, name)} must be positive")
        if not self.bridge_s >= 0:
            raise ValueError(f"spindle_fit.bridge_s = {self.bridge_s} must be at least 0")
        if not self.time_constants_s or not all(t > 0 for t in self.time_constants_s):
            raise ValueError(
                f"spindle_fit.time_constants_s = {self.time_constants_s} must be positive, "
                "one at least"
            )
        if not self.nodes or set(self.nodes) - {1, 2}:
            raise ValueError(f"spindle_fit.nodes = {self.nodes} must be 1, 2 or both")


class Problem:
    """One least-squares problem: which sources, how many nodes, over which stretches.

    The unknowns are the logarithm of rates and of the capacity ratio, the surround, and each
    source's heating at its root mean square over the records, so that all are of similar size.
    """

    def __init__(
        self,
        pieces: Sequence[Stretch],
        records: SpindleRecords,
        settings: SpindleFitSettings,
        sources: Sequence[str],
        nodes: int,
    ) -> None:
        self.pieces, self.records, self.settings = pieces, records, settings
        self.sources, self.nodes = list(sources), nodes
        heat = np.concatenate([heat_of(p.frame) for p in pieces])
        rms = np.sqrt(np.mean(heat**2, axis=0))
        self.scale = {name: float(rms[list(SOURCES).index(name)]) for name in self.sources}
        self.rates = ["cooling_rate"] if nodes == 1 else ["coupling_rate", "body_cooling_rate"]
        self.surround = "ambient_offset" if records.ambient else "ambient"
        self.logs = [*self.rates, *([] if nodes == 1 else ["capacity_ratio"])]
        self.names = [*self.logs, self.surround, *self.sources]
        block = 0
        blocks, masks = [], []
        for piece in pieces:
            n = len(piece.frame)
            blocks.append(block + np.arange(n) * piece.step // settings.window_s)
            block = int(blocks[-1][-1]) + 1
            masks.append(piece.frame[TARGET].notna().to_numpy())
        self.measured = [p.frame[TARGET].to_numpy(float) for p in pieces]
        self.heat = [heat_of(p.frame) for p in pieces]
        self.surrounds = [ambient_of(p.frame, records) for p in pieces]
        self.masks = masks
        self.blocks = np.concatenate([b[m] for b, m in zip(blocks, masks, strict=True)]).astype(int)

    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest of every unknown."""
        low, high = [], []
        for name in self.names:
            if name in self.rates:
                a, b = np.log(RATE_BOUNDS)
            elif name == "capacity_ratio":
                a, b = np.log(RATIO_BOUNDS)
            elif name == self.surround:
                a, b = OFFSET_BOUNDS if self.records.ambient else AMBIENT_BOUNDS
            else:
                a, b = 0.0, HEATING_BOUND
            low.append(a)
            high.append(b)
        return np.array(low), np.array(high)

    def start(self, time_constant: float) -> Floats:
        """Where to start from when the time constant [s] is about this."""
        first = float(np.median([np.nanmin(t) for t in self.measured]))
        guess = {
            "cooling_rate": -np.log(time_constant),
            "coupling_rate": -np.log(time_constant),
            "body_cooling_rate": -np.log(8 * time_constant),
            "capacity_ratio": np.log(0.2),
            "ambient": np.clip(first, *AMBIENT_BOUNDS),
            "ambient_offset": 0.0,
        }
        x = np.array([guess.get(name, 2.0 / time_constant) for name in self.names])
        return self._inside(x)

    def position(self, parameters: SpindleThermalParameters) -> Floats:
        """Where ``parameters`` lie, or the nearest place inside the bounds."""
        x = []
        for name in self.names:
            if name in self.scale:
                x.append(parameters.heating.get(name, 0.0) * self.scale[name])
            else:
                value = getattr(parameters, name)
                x.append(np.log(value) if name in self.logs else value)
        return self._inside(np.array(x))

    def _inside(self, x: Floats) -> Floats:
        low, high = self.bounds()
        return np.clip(x, low + 1e-9, high - 1e-9)

    def parameters(self, x: Floats) -> SpindleThermalParameters:
        """The network at ``x``."""
        value = dict(zip(self.names, x, strict=True))
        plain = {k: float(np.exp(v) if k in self.logs else v) for k, v in value.items()}
        heating = {s: plain.pop(s) / self.scale[s] for s in self.sources}
        plain.setdefault("cooling_rate", 0.0)
        return SpindleThermalParameters(heating=heating, **plain)

    def residuals(self, x: Floats) -> Floats:
        """Modelled minus measured temperature [K] where it is known, shape (N,)."""
        parameters = self.parameters(x)
        return np.concatenate(
            [
                (temperatures(h, t[0], parameters, p.step, ambient=a)[0] - t)[m]
                for p, h, a, t, m in zip(
                    self.pieces, self.heat, self.surrounds, self.measured, self.masks, strict=True
                )
            ]
        )
