"""Nanoseconds that an axis takes for a step: compiled traces, plain Python.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from collections.abc import Callable
from time import process_time

import numpy as np
import pytest

from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.axis.three_loop import follow_position
from pipeline.machine.axis.three_loop_axis import servo_axis
from pipeline.twin.drive import simulate_drive
from pipeline.twin.drive_population import simulate_traces
from tests.twin.axes import AXIS, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=20.0,
)  # fmt: skip
SAMPLES = 30_000
ROW = drive_row(FULL.servo, FULL.feed_drive)[np.newaxis]
REFERENCE = to_and_fro(SAMPLES)


def least(run: Callable[[], object], rounds: int) -> float:
    """Least time of the processor [s] of some rounds; the first one compiles."""
    run()
    times = []
    for _ in range(rounds):
        begin = process_time()
        run()
        times.append(process_time() - begin)
    return min(times)


def traces(samples: int) -> Callable[[], object]:
    return lambda: simulate_traces(REFERENCE[:samples], T, ROW)


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
def test_compiled_is_fifty_times_as_fast_as_python(benchmark) -> None:
    benchmark.pedantic(traces(3000), rounds=30, warmup_rounds=1)
    fast = benchmark.stats["min"] / 3000
    plain = least(lambda: simulate_drive(REFERENCE[:3000], T, FULL), 2) / 3000
    assert plain > 50 * fast
