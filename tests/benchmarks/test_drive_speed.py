"""Nanoseconds that an axis takes for a step.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from time import process_time

import numpy as np
import pytest

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import drive_row
from pipeline.machine.axis.three_loop import follow_position, servo_axis
from tests.twin.axes import AXIS, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=20.0,
)  # fmt: skip
SAMPLES = 30_000
ROW = drive_row(FULL.servo, FULL.feed_drive)[np.newaxis]


@pytest.mark.benchmark(timer=process_time)
def test_traces(benchmark) -> None:
    benchmark(lambda: simulate(to_and_fro(SAMPLES), T, ROW))
    assert benchmark.stats["min"] / SAMPLES < 60e-9


@pytest.mark.benchmark(timer=process_time)
def test_three_loops(benchmark) -> None:
    """A second of motion with the loops of current, speed and position in a tenth of one."""
    reference = 0.05 * 1e-3 * np.arange(1001)
    axis = servo_axis()
    benchmark(lambda: follow_position(reference, 1e-3, axis))
    assert benchmark.stats["min"] < 0.1
