"""Simulated recordings of cuts as the identification takes them, for tests."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.schema.cutting import CutConditions
from pipeline.submodels.cutting.identify import CuttingIdentification, identify_cutting_force
from pipeline.submodels.cutting.recordings import CuttingRecording, steady_revolution
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingSetup, Dynamometer
from tests.submodels.cutting.milling import Truth, milled

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
