"""Days of a spindle whose network is known, and of a winding in watts and joules.

The winding in its housing does not have the twin's own equations: two lumps, stepped forward by
explicit Euler at a second.  It has a sensor of whole degrees and is heated by the motor that holds
its position, the housing by its bearings and by what it loses.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.signals.columns import column
from pipeline.signals.windows import StateSegment
from pipeline.thermal.network import (
    SOURCES,
    SpindleThermalParameters,
    heat_sources,
    temperatures,
)
from pipeline.twin.spindle import SpindleRecords

RECORDS = SpindleRecords()

ONE = SpindleThermalParameters(
    heating={"bearing_friction": 6e-7, "copper": 0.08}, cooling_rate=1 / 900, ambient=24.0
)
TWO = SpindleThermalParameters(
    heating={"bearing_friction": 6e-7, "copper": 0.08},
    cooling_rate=0.0,
    ambient=22.0,
    coupling_rate=1 / 600,
    capacity_ratio=0.4,
    body_cooling_rate=1 / 5000,
)


def schedule(rng: np.random.Generator, steps: int, step: float) -> NDArray[np.float64]:
    """Speed [rad/s], load [1] and hold [1] of a working day, (3, steps): phases of 5 to 25 min."""
    speed, load, hold = np.zeros((3, steps))
    at = 0
    while at < steps:
        until = at + int(rng.uniform(300, 1500) / step)
        kind = rng.choice(["rest", "air", "cut", "cut"])
        if kind != "rest":
            speed[at:until] = rng.uniform(100, 900)
        if kind == "cut":
            load[at:until] = rng.uniform(0.1, 1.2)
        hold[at:until] = kind == "rest" and rng.random() < 0.5
        at = until
    return np.stack([speed, load, hold])


def correlated(
    rng: np.random.Generator, steps: int, step: float, deviation: float, over_s: float
) -> NDArray[np.float64]:
    """First-order autoregressive noise of a given deviation and correlation time."""
    phi = np.exp(-step / over_s)
    noise = np.empty(steps)
    noise[0] = rng.normal(0, deviation)
    for i, shock in enumerate(rng.normal(0, deviation * np.sqrt(1 - phi**2), steps - 1)):
        noise[i + 1] = phi * noise[i] + shock
    return noise


def day_of(
    truth: SpindleThermalParameters,
    seed: int,
    *,
    number: int = 0,
    hours: float = 6.0,
    step: float = 60.0,
    noise_K: float = 0.0,
    whole_degrees: bool = False,
    gap: bool = False,
    excited: tuple[str, ...] = ("speed", "load"),
    ambient: NDArray[np.float64] | None = None,
) -> StateSegment:
    """One day, as :func:`pipeline.twin.spindle.spindle_stretches` would give it."""
    rng = np.random.default_rng([seed, number])
    steps = int(hours * 3600 / step)
    speed, load, hold = schedule(rng, steps, step)
    heat = heat_sources(
        speed * ("speed" in excited), load * ("load" in excited), hold * ("hold" in excited)
    )
    start = truth.ambient if ambient is None else ambient[0] + truth.ambient_offset
    T = temperatures(heat, start, truth, step, ambient=ambient)[0]
    if noise_K:
        T = T + correlated(rng, steps, step, noise_K, 300.0)
    if whole_degrees:
        T = np.round(T)
    if gap:
        at = int(rng.integers(steps // 4, steps // 2))
        T[at : at + steps // 8] = np.nan
    day = (pd.Timestamp("2026-01-05") + pd.Timedelta(days=number)).strftime("%Y-%m-%d")
    frame = pd.DataFrame(
        heat,
        columns=list(SOURCES),
        index=pd.date_range(f"{day}T06:00", periods=steps, freq=f"{step:g}s", tz="UTC"),
    ).assign(spindle_temperature=T)
    if ambient is not None:
        frame["ambient_temperature"] = ambient
    return StateSegment(day=day, frame=frame, step=step, bridged=0)


def days_of(
    truth: SpindleThermalParameters, seed: int, days: int, **how: object
) -> list[StateSegment]:
    """Several days; see :func:`day_of`."""
    return [day_of(truth, seed, number=n, **how) for n in range(days)]  # type: ignore[arg-type]


def state_table(
    truth: SpindleThermalParameters, seed: int, day: str, hours: float = 4.0
) -> pd.DataFrame:
    """A clean state table of one day at 1 s in the units of the tables, indexed by time."""
    rng = np.random.default_rng(seed)
    steps = int(hours * 3600)
    speed, load, _ = schedule(rng, steps, 1.0)
    T = temperatures(heat_sources(speed, load, np.zeros(steps)), truth.ambient, truth, 1.0)[0]
    return pd.DataFrame(
        {
            "spindle_speed": speed / column("spindle_speed").factor,
            "spindle_load": load / column("spindle_load").factor,
            "spindle_temperature": np.round(T),
        },
        index=pd.date_range(f"{day}T06:00", periods=steps, freq="s", tz="UTC", name="time"),
    )


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
