"""Simulated recordings of cuts as the identification takes them, for tests.

The simulation of milling on a dynamometer is independent: every tooth is cut into slices, every
slice into time steps; a chip is what stands between the edge and the surfaces that the teeth before
left.  Modes act in the frequency domain of the whole record.  Nothing of it is shared with the
rooms that it tests.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.schema.cutting import CutConditions
from pipeline.submodels.cutting.identify import CuttingIdentification, identify_cutting_force
from pipeline.submodels.cutting.recordings import CuttingRecording, steady_revolution
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingSetup, Dynamometer

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What was cut, in N/mm^2, N/mm, mm, degrees."""

    cutting: tuple[float, float, float] = (850.0, 240.0, 140.0)
    edge: tuple[float, float, float] = (22.0, 25.0, 4.0)
    flutes: int = 3
    diameter: float = 12.0
    helix: float = 30.0
    runout: float = 0.006
    runout_angle: float = 25.0
    exponent: float = 0.0
    growth: float = 0.0
    worn: tuple[float, ...] = ()
    natural: tuple[float, float, float] | None = None
    damping: float = 0.05


def milled(
    truth: Truth, *, rpm: float, f_z: float, a_p: float, entry: float, leave: float,
    seconds: float, rate: float, phase: float = 0.4, slices: int = 24,
) -> Floats:  # fmt: skip
    """Forces on the tool along the feed, to the left of it and along the axis [N], (T, 3)."""
    steps = round(seconds * rate * 4)
    theta = phase + np.arange(steps) / (rate * 4) * rpm * np.pi / 30
    lag = np.tan(np.radians(truth.helix)) / (truth.diameter / 2)
    pitch = 2 * np.pi / truth.flutes
    out = np.zeros((steps, 3))
    for j in range(truth.flutes):
        worn = truth.worn[j] if truth.worn else 1.0
        for s in range(slices):
            z = a_p * (s + 0.5) / slices
            phi = (theta - pitch * j - lag * z) % (2 * np.pi)

            def radius(tooth: int, height: float = z) -> float:
                turn = np.radians(truth.runout_angle) + pitch * tooth + lag * height
                return float(truth.runout * np.cos(turn))

            chips = [
                m * f_z * np.sin(phi) + radius(j) - radius(j - m)
                for m in range(1, truth.flutes + 1)
            ]
            h = np.min(chips, axis=0)
            cut = (phi >= entry) & (phi <= leave) & (h > 0)
            h = np.where(cut, h, 0.05)
            power = h * (h / 0.05) ** -truth.exponent
            grown = 1 - np.exp(-h / truth.growth) if truth.growth else 1.0
            t, r, a = (
                (c * power + e * worn * grown) * cut * a_p / slices
                for c, e in zip(truth.cutting, truth.edge, strict=True)
            )
            out[:, 0] -= t * np.cos(phi) + r * np.sin(phi)
            out[:, 1] += t * np.sin(phi) - r * np.cos(phi)
            out[:, 2] += a
    return shown(out, truth, rate)


def shown(force: Floats, truth: Truth, rate: float) -> Floats:
    """What channels with modes show of forces at four times their rate."""
    if truth.natural is None:
        return force[::4]
    frequency = np.fft.rfftfreq(len(force), 1 / (4 * rate))
    spectrum = np.fft.rfft(force, axis=0)
    for k, natural in enumerate(truth.natural):
        r = frequency / natural
        spectrum[:, k] /= 1 - r**2 + 2j * truth.damping * r
    return np.asarray(np.fft.irfft(spectrum, len(force), axis=0)[::4])


Floats = NDArray[np.float64]

RATE = 1e4
SETTINGS = CuttingFitSettings(compare=False)
Test = tuple[float, float, float, float, float]
"""Speed [rev/min], feed for each tooth [mm], depth [mm], entry and exit [rad]."""


def known_of(truth: Truth) -> CuttingSetup:
    """What a machine's file would say of it."""
    tool = Tool(kind="flat", diameter_mm=truth.diameter, flutes=truth.flutes, helix_deg=truth.helix)
    return CuttingSetup(tool=tool, dynamometer=Dynamometer(feed="x", normal="y", axial="z"))


@cache
def clean(truth: Truth, test: Test, phase: float) -> Floats:
    """Forces without noise; the spindle turns 0.2 % faster than it was set."""
    rpm, f_z, a_p, entry, leave = test
    return milled(
        truth, rpm=1.002 * rpm, f_z=f_z, a_p=a_p, entry=entry, leave=leave, seconds=0.4,
        rate=RATE, phase=phase,
    )  # fmt: skip


def recording(
    truth: Truth, test: Test, number: int, random: np.random.Generator, zero: float = 1.0,
) -> CuttingRecording:  # fmt: skip
    """One recording with noise of 1.5 N and a zero that is off by ``zero`` N."""
    force = clean(truth, test, 0.3 + number)
    force = force + random.normal(0, 1.5, force.shape) + random.normal(0, zero, 3)
    rpm, f_z, a_p, entry, leave = test
    conditions = CutConditions(
        speed=rpm / 60, f_z=f_z * 1e-3, a_p=a_p * 1e-3, phi_st=entry, phi_ex=leave,
        flutes=truth.flutes,
    )  # fmt: skip
    revolution, zero_measured = steady_revolution(
        force, RATE, conditions, known_of(truth), SETTINGS
    )
    return CuttingRecording(
        name=f"{number}.csv", sha256=str(number), role="training", conditions=conditions,
        revolution=revolution, zero_measured=zero_measured,
    )  # fmt: skip


def recordings(
    truth: Truth, tests: Sequence[Test], seed: int = 0, zero: float = 1.0
) -> list[CuttingRecording]:
    """All tests of a series."""
    random = np.random.default_rng(seed)
    return [recording(truth, one, k, random, zero) for k, one in enumerate(tests)]


@cache
def identified(truth: Truth, tests: tuple[Test, ...], seed: int = 0) -> CuttingIdentification:
    """What is identified from all tests of a series."""
    return identify_cutting_force(recordings(truth, tests, seed), known_of(truth), SETTINGS)


SLOT = Truth(flutes=2, runout=0.004, runout_angle=0.0, natural=(1900.0, 1500.0, 2600.0))
SLOTS: tuple[Test, ...] = tuple((6000.0, f, 2.0, 0.0, np.pi) for f in (0.05, 0.1, 0.15))
