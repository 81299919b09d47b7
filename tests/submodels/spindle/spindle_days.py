"""Days of a spindle whose network is known, as stretches ready to be fitted."""

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
