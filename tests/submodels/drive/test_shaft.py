"""Stiffness, damping, play and motor's mass of simulated axes with two masses.

The axis with play of its own shares nothing with the shop floor or the twin: two masses pushed
along, smooth friction, the motor under a proportional speed loop, semi-implicit Euler; no tick, no
lag, no bristle.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from pipeline.report import pages
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import SpeedLoop, SpeedLoops
from pipeline.shop.drives.axis import follow
from pipeline.shop.drives.feed_records import _sweeps, both_ends
from pipeline.shop.drives.parameters import Axis, ShaftRecords
from pipeline.shop.drives.records import Move, travel
from pipeline.shop.parameters import AxisLimits
from pipeline.submodels.drive.estimates import SENSOR
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.drive.shaft import ShaftFit, identify_shaft
from pipeline.submodels.drive.shaft_signals import MASS, signals_of
from pipeline.submodels.drive.speed_loops import verdict_words
from pipeline.submodels.drive.speed_loops_page import loops_figure

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


STYLE = Path(pages.__file__).parent / "templates" / "style.css"
QUICK = [Move(length=(-1) ** k * 30.0, speed=400.0, pause=0.02) for k in range(10)]
SWEPT = [Move(length=sign * 80.0, speed=25.0) for sign in (1, -1)]


def recorded(axis: Axis, seed: int) -> list[Recording]:
    """Quick strokes and a frequency response of an axis, as the shop floor's recorder has them."""
    random, shaft = np.random.default_rng(seed), ShaftRecords()
    frequency = axis.cascade.position_frequency
    found = []
    for moves, swept in ((QUICK, False), (SWEPT, True)):
        command = travel(moves, AxisLimits().bounds, frequency)
        added = _sweeps(command, frequency, shaft) if swept else np.zeros(command.size)
        out = follow(axis, command * 1e-3, random, injected=added)
        both = both_ends(axis, out, shaft, random)
        current = out.current + 0.03 * random.standard_normal(out.current.size)
        ends = {"motor": 1e-3 * both["motor"], "load": 1e-3 * both["carriage"], "command": current}
        found.append(
            Recording(
                name=f"shaft/{len(found)}.csv", trained=True, period=1 / frequency,
                air=np.ones(current.size, bool), shafts={"X": ends},
            )
        )  # fmt: skip
    return found


@cache
def fitted(stiffness: float, carriage: float, seed: int) -> tuple[Axis, ShaftFit]:
    axis = Axis(stiffness=stiffness, carriage=carriage)
    fit = identify_shaft(
        recorded(axis, seed), "X", force_constant=axis.force_constant, force_unit="N",
        lead=axis.lead * 1e-3, widest=0.5,
    )  # fmt: skip
    assert fit is not None
    return axis, fit


@pytest.mark.parametrize(
    ("stiffness", "carriage", "damping_known"), [(180.0, 520.0, True), (90.0, 800.0, False)]
)
def test_shaft_is_recovered_from_both_ends(
    stiffness: float, carriage: float, damping_known: bool
) -> None:
    axis, fit = fitted(stiffness, carriage, 1)
    found = fit.parameters
    assert found["shaft_stiffness"].value == pytest.approx(1e6 * stiffness, rel=0.03)
    assert found["motor_mass"].value == pytest.approx(axis.motor_mass, rel=0.03)
    damping = found["shaft_damping"]
    assert damping.determined is damping_known
    if damping_known:
        assert damping.interval_95 is not None
        assert damping.interval_95[0] <= 1e3 * axis.damping <= damping.interval_95[1]
    else:
        assert damping.value is None
        assert "95 % interval" in damping.method
        assert "frequency response" in damping.remedy


PLAYED = (
    PlayAxis(),
    PlayAxis(stiffness=80e6, play=8e-6, motor_mass=900.0),
    PlayAxis(stiffness=200e6, play=1.5e-6, motor_mass=300.0),
)
"""Axes of a simulation that shares nothing with the shop floor's."""


def played(axis: PlayAxis, seed: int) -> ShaftFit:
    fit = identify_shaft(
        rig_recordings(axis, seed), "X", force_constant=axis.force_constant, force_unit="N",
        lead=axis.lead, widest=0.5,
    )  # fmt: skip
    assert fit is not None
    return fit


@pytest.mark.parametrize(
    ("axis", "seed"),
    [
        (PLAYED[1], 0),
        *(pytest.param(axis, seed, marks=pytest.mark.proof)
          for axis in PLAYED for seed in (0, 1) if (axis, seed) != (PLAYED[1], 0)),
    ],
)  # fmt: skip
def test_play_is_recovered_with_the_stiffness(axis: PlayAxis, seed: int) -> None:
    found = played(axis, seed).parameters
    assert found["backlash"].value == pytest.approx(axis.play, rel=0.04)
    assert found["shaft_stiffness"].value == pytest.approx(axis.stiffness, rel=0.04)
    assert found["motor_mass"].value == pytest.approx(axis.motor_mass, rel=0.05)
    assert found["backlash"].interval_95 is not None
    assert found["backlash"].interval_95[0] > 0.5 * axis.play


@pytest.mark.proof
@pytest.mark.parametrize("axis", PLAYED)
def test_intervals_of_play_hold_over_seeds(axis: PlayAxis) -> None:
    """Of each quantity that is determined, in 19 of 20 seeds."""
    true = {"shaft_stiffness": axis.stiffness, "backlash": axis.play,
            "motor_mass": axis.motor_mass, "shaft_damping": axis.damping}  # fmt: skip
    fits = [played(axis, seed).parameters for seed in range(20)]
    for name, value in true.items():
        ends = [one[name].interval_95 for one in fits if one[name].determined]
        held = [low <= value <= high for low, high in filter(None, ends)]
        assert len(held) == 20 or name == "shaft_damping"
        assert not held or np.mean(held) >= 0.95


def drawn(random: np.random.Generator) -> PlayAxis:
    """An axis whose constants are each anywhere within a ratio of 2.5 to 6."""

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** random.uniform())

    return PlayAxis(
        motor_mass=between(300.0, 900.0), carriage=between(400.0, 1000.0),
        stiffness=between(60e6, 240e6), play=between(1.5e-6, 9e-6), damping=between(1e4, 3e4),
        coulomb=between(150.0, 600.0), viscous=between(400.0, 1600.0),
        cogging=random.uniform(0.0, 40.0),
    )  # fmt: skip


@pytest.mark.proof
def test_intervals_hold_over_drawn_axes() -> None:
    """Errors are systematic: the seeds of one axis miss alike, only other axes do not.

    A current has the error of its sensor's class, which the intervals hold: they are honest, and
    those of what the records tell well are no wider than to miss once in a hundred.
    """
    random, held = np.random.default_rng(2026), defaultdict[str, list[bool]](list)
    sensors = np.random.default_rng(2027).uniform(-SENSOR, SENSOR, 100)
    for seed, sensor in enumerate(sensors):
        axis = replace(drawn(random), sensor=float(sensor))
        true = {"shaft_stiffness": axis.stiffness, "backlash": axis.play,
                "motor_mass": axis.motor_mass, "shaft_damping": axis.damping}  # fmt: skip
        found = played(axis, seed).parameters
        for name, value in true.items():
            ends = found[name].interval_95
            if found[name].determined and ends is not None:
                held[name].append(ends[0] <= value <= ends[1])
    assert all(len(held[name]) == 100 for name in true if name != "shaft_damping")
    assert len(held["shaft_damping"]) > 20
    assert {name: np.mean(one) >= 0.9 for name, one in held.items()} == dict.fromkeys(held, True)
    assert all(np.mean(held[name]) < 1 for name in true if name != "shaft_damping")


def test_force_of_a_place_is_none() -> None:
    """An axis that goes at a constant speed far from its zero has no acceleration."""
    place = 0.2 + 0.05 * np.arange(400) * 1e-3
    ends = {"motor": place, "load": place, "command": np.ones(400)}
    still = Recording(name="shaft/a.csv", trained=True, period=1e-3, air=np.ones(400, bool),
                      shafts={"X": ends})  # fmt: skip
    one = signals_of(still, "X", 1.0, None)
    assert np.abs(one.columns[one.good, MASS]).max() < 1e-6


def test_axis_without_play_has_an_interval_with_0() -> None:
    found = fitted(180.0, 520.0, 1)[1].parameters["backlash"]
    assert found.interval_95 is not None
    assert found.interval_95[0] == 0.0
    assert found.interval_95[1] < 0.3e-6


def test_stiff_axis_says_how_stiff_it_is_at_least() -> None:
    axis = Axis()
    records = [
        replace(one, shafts={"X": one.shafts["X"] | {"load": one.shafts["X"]["motor"]
                + 1e-7 * np.random.default_rng(3).standard_normal(one.samples)}})
        for one in recorded(axis, 2)
    ]  # fmt: skip
    fit = identify_shaft(
        records, "X", force_constant=axis.force_constant, force_unit="N", lead=None, widest=0.5
    )
    assert fit is not None
    found = fit.parameters["shaft_stiffness"]
    assert not found.determined
    assert "at least" in found.method
    assert found.value is None


def test_no_recording_of_both_ends_is_no_shaft() -> None:
    bare = Recording(name="servo/a.csv", trained=True)
    assert identify_shaft(
        [bare], "X", force_constant=1.0, force_unit="N", lead=None, widest=0.5
    ) is None  # fmt: skip


def loops(settling: float, following: float) -> SpeedLoops:
    def one(kind: str, ms: float, um: float) -> SpeedLoop:
        return SpeedLoop(
            kind=kind, gains="tuned alike", proportional=1.0, integral=1.0, settling_ms=ms,
            reaching_ms=ms, overshoot_percent=0.0, ripple_percent=0.0, following_um=um,
            time_ms=(0.0, 1.0, 2.0), speed_percent=(0.0, 90.0, 100.0),
        )  # fmt: skip

    both = (one("PI", 40.0, 300.0), one("fuzzy PI", settling, following))
    return SpeedLoops(axis="X", loops=both)


@pytest.mark.parametrize(
    ("settling", "following", "words"),
    [(20.0, 300.0, "helps:"), (39.0, 299.0, "not worth"), (20.0, 500.0, "in part")],
)
def test_verdict_on_fuzzy_loops(settling: float, following: float, words: str) -> None:
    assert words in verdict_words(loops(settling, following))


def test_loops_that_were_not_compared_have_their_reason() -> None:
    assert "no current_limit" in verdict_words(SpeedLoops(axis="X", reason="no current_limit"))


def test_figure_draws_both_loops() -> None:
    drawn = str(loops_figure(loops(20.0, 300.0), []).figures[0].svg)
    curves = re.findall(r'<path d="M[^"]+" class="curve ([^"]*)"', drawn)
    assert len(curves) == 2
    for kind in curves:  # a curve has no fill: without a stroke of its class it is not seen
        assert re.search(rf"^\.{kind} {{ stroke:", STYLE.read_text(), re.MULTILINE), kind
