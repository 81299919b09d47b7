"""Days of a spindle's winding in its housing, in watts and joules: not the twin's own equations.

Two lumps, stepped forward by explicit Euler at a second: the winding has a sensor of whole degrees;
it is heated by the motor that holds its position, the housing by its bearings and by what it loses.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.signals.windows import StateSegment
from pipeline.thermal.network import SOURCES, heat_sources

STEP = 60.0  # s of the stretches that are fitted


@dataclass(frozen=True, kw_only=True)
class Winding:
    """Heat capacities [J/K], conductances [W/K], losses [W] and the shop's temperature [degC]."""

    winding_J_K: float = 6000.0
    housing_J_K: float = 120_000.0
    to_housing_W_K: float
    to_air_W_K: float = 12.0
    hold_W: float
    friction_W: float = 350.0
    friction_in_winding: float = 1.0
    at_speed: float = 600.0  # rad/s
    air: float = 22.0

    @property
    def hold_K_s(self) -> float:
        """Heating of the winding alone while it is held [K/s]."""
        return self.hold_W / self.winding_J_K

    @property
    def rate(self) -> float:
        """Exchange of the winding with the housing over its capacity [1/s]."""
        return self.to_housing_W_K / self.winding_J_K


def winding_of(minutes: float, rise_K: float = 13.0, **more: float) -> Winding:
    """A winding of a time constant that rises by about ``rise_K`` in ten minutes of being held."""
    conductance = 6000.0 / (60 * minutes)
    reached = 1 - np.exp(-10.0 / minutes)
    return Winding(to_housing_W_K=conductance, hold_W=float(rise_K * conductance / reached), **more)


def _phases(rng: np.random.Generator, seconds: int, held: bool) -> np.ndarray:
    """Speed [rad/s] and hold [1] of a day, (2, seconds): turning, rest, and ten minutes held."""
    speed, hold, at = np.zeros(seconds), np.zeros(seconds), 0
    while at < seconds:
        until = at + int(rng.uniform(300, 1800))
        kind = rng.choice(["turn", "turn", "rest", "held" if held else "turn"])
        if kind == "turn":
            speed[at:until] = rng.uniform(100, 600)
        elif kind == "held":
            until = at + int(rng.uniform(400, 800))
            hold[at:until] = 1.0
        at = until
    return np.stack([speed, hold])


def winding_day(
    truth: Winding, seed: int, number: int, *, held: bool, hours: float = 8.0, twice: bool = False
) -> StateSegment:
    """One day as the fit sees it; the air differs by a degree from day to day.

    ``twice``: it is held for 13 minutes in two of its hours alone, not again and again.
    """
    rng = np.random.default_rng([seed, number])
    seconds = int(hours * 3600)
    speed, hold = _phases(rng, seconds, held and not twice)
    if held and twice:
        for start in (int(0.3 * seconds), int(0.65 * seconds)):
            hold[start : start + 780], speed[start : start + 780] = 1.0, 0.0
    air = truth.air + rng.normal(0, 0.5)
    winding = housing = air
    seen = np.empty(seconds)
    share = truth.friction_in_winding
    for second in range(seconds):
        seen[second] = winding
        friction = truth.friction_W * (speed[second] / truth.at_speed) ** (5 / 3)
        exchanged = truth.to_housing_W_K * (winding - housing)
        own = truth.hold_W * hold[second] + share * friction - exchanged
        of_housing = (1 - share) * friction + exchanged - truth.to_air_W_K * (housing - air)
        winding += own / truth.winding_J_K
        housing += of_housing / truth.housing_J_K
    measured = np.round(seen + rng.normal(0, 0.1, seconds))
    return _stretch(number, speed, hold, measured)


def _stretch(
    number: int, speed: np.ndarray, hold: np.ndarray, measured: np.ndarray
) -> StateSegment:
    every = int(STEP)
    heat = heat_sources(speed, 0 * speed, hold).reshape(-1, every, len(SOURCES)).mean(axis=1)
    day = (pd.Timestamp("2026-01-05") + pd.Timedelta(days=number)).strftime("%Y-%m-%d")
    frame = pd.DataFrame(
        heat, columns=list(SOURCES),
        index=pd.date_range(f"{day}T06:00", periods=len(heat), freq="60s", tz="UTC"),
    ).assign(spindle_temperature=measured[::every])  # fmt: skip
    return StateSegment(day=day, frame=frame, step=STEP, bridged=0)


def winding_days(
    truth: Winding, seed: int, days: int = 5, held: int = 2, **how: Any
) -> list[StateSegment]:
    """Days of a seed, the spindle held on day number ``held`` only."""
    return [winding_day(truth, seed, n, held=n == held, **how) for n in range(days)]
