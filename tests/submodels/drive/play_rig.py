"""An axis with play of its own: two masses pushed along, written for the tests alone.

It shares nothing with the shop floor or the twin: smooth friction, the motor under a proportional
speed loop, semi-implicit Euler; no tick, no lag, no bristle.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.schema.arrays import Floats
from pipeline.submodels.drive.records import Recording

STEPS = 20
"""Steps of the integration in a sample."""


@dataclass(frozen=True, kw_only=True)
class PlayAxis:
    """Its constants in SI; current is in A, ``force_constant`` in N/A."""

    stiffness: float = 120e6
    damping: float = 18e3
    play: float = 4e-6
    motor_mass: float = 500.0
    carriage: float = 700.0
    coulomb: float = 350.0
    viscous: float = 900.0
    force_constant: float = 400.0
    cogging: float = 25.0
    teeth: int = 24
    lead: float = 0.012
    sensor: float = 0.0
    """Relative error of the current's sensor [1]."""


@njit
def _moved(
    speeds: np.ndarray, added: np.ndarray, period: float, k: float, d: float, play: float,
    m: float, c: float, fc: float, b: float, cogging: float, order: float,
) -> np.ndarray:  # fmt: skip
    out = np.empty((speeds.size, 3))
    x, v, y, w, force = 0.0, 0.0, 0.0, 0.0, 0.0
    h = period / STEPS
    for n in range(speeds.size):
        out[n] = (x, y, force)
        after = min(n + 1, speeds.size - 1)
        for s in range(STEPS):
            share = (s + 1) / STEPS
            speed = speeds[n] + share * (speeds[after] - speeds[n])
            force = 60.0 * (m + c) * (speed - v) + added[n] + share * (added[after] - added[n])
            gap = x - y
            shaft = 0.0
            if gap > play / 2:
                shaft = max(k * (gap - play / 2) + d * (v - w), 0.0)
            elif gap < -play / 2:
                shaft = min(k * (gap + play / 2) + d * (v - w), 0.0)
            v += h * (force + cogging * np.sin(order * x) - shaft) / m
            w += h * (shaft - fc * np.tanh(w / 2e-4) - b * w) / c
            x += h * v
            y += h * w
    return out


def _speeds(seconds: float, rate: int, top: float, stroke: float, jerk: float) -> Floats:
    """Back and forth at a trapezoid of speeds, smoothed over ``jerk`` [s]."""
    time = np.arange(int(seconds * rate)) / rate
    level = top * np.sign(np.sin(np.pi * time * top / stroke))
    window = np.ones(max(int(jerk * rate), 1))
    return np.asarray(np.convolve(level, window / window.size)[: time.size])


def rig_recordings(axis: PlayAxis, seed: int, rate: int = 1000) -> list[Recording]:
    """Reversals slow and quick, and a feed under a swept current, with encoders' noise."""
    random = np.random.default_rng(seed)
    slow = _speeds(6.0, rate, 0.01, 0.01, 0.02)
    quick = _speeds(6.0, rate, 0.25, 0.1, 0.08)
    feed = _speeds(6.0, rate, 0.03, 0.09, 0.05)
    time = np.arange(feed.size) / rate
    swept = 250.0 * np.sin(2 * np.pi * (5 * time + 10 * time**2))
    quiet = np.zeros(slow.size + quick.size)
    tests = ((np.concatenate([slow, quick]), quiet), (feed, swept))
    return [_read(axis, random, speeds, added, rate) for speeds, added in tests]


def _read(
    axis: PlayAxis, random: np.random.Generator, speeds: Floats, added: Floats, rate: int
) -> Recording:
    out = _moved(
        speeds, added, 1 / rate, axis.stiffness, axis.damping, axis.play, axis.motor_mass,
        axis.carriage, axis.coulomb, axis.viscous, axis.cogging,
        2 * np.pi * axis.teeth / axis.lead,
    )  # fmt: skip
    pitch = 12e-6 * out[:, 1] + 0.3e-6 * np.sin(2 * np.pi * out[:, 0] / axis.lead)
    noise = random.standard_normal((len(out), 3))
    ends = {
        "motor": out[:, 0] + 5e-9 * noise[:, 0],
        "load": np.round((out[:, 1] + pitch + 30e-9 * noise[:, 1]) / 50e-9) * 50e-9,
        "command": (1 + axis.sensor) * out[:, 2] / axis.force_constant + 0.02 * noise[:, 2],
    }
    return Recording(
        name=f"shaft/{len(speeds)}.csv", trained=True, period=1 / rate,
        air=np.ones(len(out), bool), shafts={"X": ends},
    )  # fmt: skip
