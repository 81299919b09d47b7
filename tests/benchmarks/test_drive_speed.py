"""Nanoseconds that an axis takes for a step: lanes and compiled traces.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from collections.abc import Callable
from time import process_time

import numpy as np
import pytest
from numba import njit, types

from pipeline.machine.axis import simd_population
from pipeline.machine.axis.three_loop import follow_position
from pipeline.machine.axis.three_loop_axis import servo_axis
from pipeline.twin.drive_population import drive_table, population_errors, simulate_traces
from tests.twin.axes import AXIS, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=20.0,
)  # fmt: skip
INDIVIDUALS, AXES, SAMPLES = 64, 3, 30_000
LANES = drive_table([[FULL] * AXES] * INDIVIDUALS)
REFERENCE = np.stack([to_and_fro(SAMPLES)] * AXES, axis=1)


def least(run: Callable[[], object], rounds: int) -> float:
    """Least time of the processor [s] of some rounds; the first one compiles."""
    run()
    times = []
    for _ in range(rounds):
        begin = process_time()
        run()
        times.append(process_time() - begin)
    return min(times)


def lanes(samples: int, **options: object) -> Callable[[], object]:
    return lambda: population_errors(REFERENCE[:samples], T, LANES, threads=1, **options)


def traces(samples: int) -> Callable[[], object]:
    return lambda: simulate_traces(REFERENCE[:samples, 0], T, LANES[:1, 0])


@pytest.mark.benchmark(timer=process_time)
def test_population(benchmark) -> None:
    """All physics; a load is one of them."""
    load = np.full_like(REFERENCE, 10.0)
    benchmark(lanes(SAMPLES, load=load))
    assert benchmark.stats["min"] / (INDIVIDUALS * AXES * SAMPLES) < 3e-9


@pytest.mark.benchmark(timer=process_time)
def test_own_references(benchmark) -> None:
    own = np.tile(REFERENCE, (INDIVIDUALS, 1, 1))
    benchmark(lambda: population_errors(own, T, LANES, threads=1))
    assert benchmark.stats["min"] / (INDIVIDUALS * AXES * SAMPLES) < 6e-9


def test_population_on_all_processors(benchmark) -> None:
    """Half a minute of three axes, 64 times: an optimiser's generation."""
    benchmark(lambda: population_errors(REFERENCE, T, LANES))
    assert benchmark.stats["min"] < 50e-3


@pytest.mark.benchmark(timer=process_time)
def test_traces(benchmark) -> None:
    benchmark(traces(SAMPLES))
    assert benchmark.stats["min"] / SAMPLES < 60e-9


@pytest.mark.benchmark(timer=process_time)
def test_three_loops(benchmark) -> None:
    """A second of motion with the loops of current, speed and position in a tenth of one."""
    reference = 0.05 * 1e-3 * np.arange(1001)
    axis = servo_axis()
    benchmark(lambda: follow_position(reference, 1e-3, axis))
    assert benchmark.stats["min"] < 0.1


@pytest.mark.benchmark(timer=process_time)
def test_lanes_are_five_times_as_fast_as_one_by_one(benchmark) -> None:
    benchmark.pedantic(lanes(3000), rounds=30, warmup_rounds=1)
    many = benchmark.stats["min"] / (INDIVIDUALS * AXES * 3000)
    one = least(traces(3000), 30) / 3000
    assert one > 5 * many


@pytest.mark.benchmark(timer=process_time)
def test_steps_of_the_mechanics_alone_are_vectors_too(benchmark) -> None:
    benchmark.pedantic(lanes(3000, substeps=4), rounds=20, warmup_rounds=1)
    whole = least(lanes(3000), 20)
    # in scalars they would take more than ten times as long
    assert benchmark.stats["min"] < 5 * whole


def test_lanes_are_vectors() -> None:
    number, whole = types.float64, types.int64
    grid, row = types.Array(number, 2, "C"), types.Array(number, 1, "C")
    loop = njit(_nrt=False)(simd_population._follow_one.py_func)
    loop.compile((grid, grid, number, whole, whole, whole, row))
    (code,) = loop.inspect_asm().values()
    products = [line for line in code.splitlines() if "\tvfm" in line or "\tvfnm" in line]
    wide = [line for line in products if "ymm" in line or "zmm" in line]
    # as many as the servo and the mechanics have
    assert len(wide) >= 19
