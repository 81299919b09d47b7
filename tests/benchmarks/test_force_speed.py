"""Microseconds that forces take: waveforms of a fit, tables of programs, look-ups of many."""

import time
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import LoadTable, load_table
from pipeline.cutting.force.waveform import basis
from pipeline.cutting.tool import Kind, Tool
from tests.cutting.tool_paths import random_profile, stations

LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
CUT = {"f_z": 5e-5, "a_p": 7e-3, "phi_st": 0.0, "phi_ex": np.pi}


def mill(runout: float) -> Tool:
    return Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0, runout_um=runout)


def table(blocks: int) -> LoadTable:
    """Of one station a block, a hundred different ones."""
    rng = np.random.default_rng(0)
    profiles = [random_profile(rng) for _ in range(100)]
    every = [profiles[k % 100] for k in range(blocks)]
    return load_table(stations(every, np.arange(blocks), blocks), [mill(0.0)], [LAW], 1e-4)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("runout", [0.0, 10.0])
def test_waveform_of_a_fit(benchmark, runout: float) -> None:
    """100 angles, 30 slices, 4 teeth: 90 us, 130 us with runout."""
    angles = np.linspace(0, 2 * np.pi, 100)
    benchmark(lambda: basis(mill(runout), angles=angles, slices=30, **CUT))
    assert benchmark.stats["min"] < 2e-4


@pytest.mark.benchmark(timer=time.process_time)
def test_peaks_of_a_long_program(benchmark) -> None:
    """20 000 blocks, one row of feeds."""
    loads = table(20_000)
    feeds, out = np.random.default_rng(1).uniform(0, 1e-4, 20_000), np.empty(20_000)
    benchmark(lambda: loads.peaks(feeds, out))
    assert benchmark.stats["min"] < 2e-3


@pytest.mark.benchmark(timer=time.process_time)
def test_peaks_of_a_population(benchmark) -> None:
    """30 blocks, 512 individuals: microseconds each."""
    loads = table(30)
    feeds, out = np.random.default_rng(1).uniform(0, 1e-4, (512, 30)), np.empty((512, 30))
    benchmark(lambda: loads.peaks(feeds, out))
    assert benchmark.stats["min"] / 512 < 5e-6


@pytest.mark.benchmark(timer=time.process_time, min_rounds=2)
@pytest.mark.parametrize("runout", [0.0, 10.0])
def test_table_of_a_long_program(benchmark, runout: float) -> None:
    """2000 stations that differ: microseconds each."""
    rng = np.random.default_rng(0)
    engagement = stations([random_profile(rng) for _ in range(2000)], np.arange(2000), 2000)
    benchmark(lambda: load_table(engagement, [mill(runout)], [LAW], 1e-4))
    assert benchmark.stats["min"] / 2000 < (1e-3 if runout else 2e-4)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("kind", ["flat", "ball"])
def test_draws_of_a_ramp(benchmark, kind: Kind) -> None:
    """1024 draws of coefficients and runout at 3 feeds: 3.5 ms, of a ball 5.5 ms."""
    profile = random_profile(np.random.default_rng(0))
    turn = edge_turn(replace(mill(0.0), kind=kind), *profile, slope=-0.3)
    offsets = 3e-6 * np.random.default_rng(1).standard_normal((1024, 2))
    laws = np.tile(np.concatenate([LAW.cutting, LAW.edge]), (1024, 1))
    benchmark(lambda: drawn_loads(turn, laws, offsets, [1e-5, 4e-5, 1e-4]))
    assert benchmark.stats["min"] < 1.2e-2


@pytest.mark.benchmark(timer=time.process_time, min_rounds=2)
def test_table_of_a_ball_on_slopes(benchmark) -> None:
    """300 stations that differ, going down: 0.16 ms each."""
    rng = np.random.default_rng(0)
    ball = replace(mill(0.0), kind="ball")
    profiles = [random_profile(rng) for _ in range(300)]
    engagement = stations(profiles, np.arange(300), 300, slope=-0.3)
    benchmark(lambda: load_table(engagement, [ball], [LAW], 1e-4))
    assert benchmark.stats["min"] / 300 < 4e-4
