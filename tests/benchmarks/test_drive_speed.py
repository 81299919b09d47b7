"""Nanoseconds of a step of an axis, and of a sample of the recursive estimator."""

from time import process_time

import numpy as np
import pytest

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import drive_row
from pipeline.machine.axis.three_loop import follow_position, servo_axis
from pipeline.submodels.drive.recursive import RecursiveSettings, recursive_inertia
from tests.twin.axes import AXIS, T, to_and_fro, with_drive, with_servo

pytestmark = pytest.mark.benchmark(timer=process_time)
"""Time of the processor counts, not that of the clock: what else runs does not."""

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=20.0,
)  # fmt: skip
SAMPLES = 30_000
ROW = drive_row(FULL.servo, FULL.feed_drive)[np.newaxis]


def test_traces(benchmark) -> None:
    benchmark(lambda: simulate(to_and_fro(SAMPLES), T, ROW))
    assert benchmark.stats["min"] / SAMPLES < 60e-9


def test_three_loops(benchmark) -> None:
    """A second of motion with the loops of current, speed and position in a tenth of one."""
    reference = 0.05 * 1e-3 * np.arange(1001)
    axis = servo_axis()
    benchmark(lambda: follow_position(reference, 1e-3, axis))
    assert benchmark.stats["min"] < 0.1


MANY = 200_000
PERIOD = 1e-4


def record() -> tuple[np.ndarray, np.ndarray]:
    torque = np.random.default_rng(0).normal(1.0, 3.0, MANY)
    return np.cumsum(torque - 1.0) * PERIOD / 0.003, torque


@pytest.mark.parametrize("excitation", [0.0, 0.1])
def test_a_step(benchmark, excitation: float) -> None:
    speed, torque = record()
    some = RecursiveSettings(excitation=excitation)
    benchmark(lambda: recursive_inertia(speed, torque, PERIOD, some))
    # 17 to 20 ns of recursion on a quiet core, the rest is memory for what it hands back
    assert benchmark.stats["min"] / MANY < 60e-9


def in_python(speed: np.ndarray, torque: np.ndarray, forgetting: float) -> np.ndarray:
    """The same recursion written with arrays of three."""
    theta, P = np.array([0.0, 1.0, 0.0]), 1e4 * np.eye(3)
    for k in range(1, len(speed)):
        phi = np.array([-speed[k - 1], torque[k - 1], -1.0])
        gain = P @ phi / (forgetting + phi @ P @ phi)
        theta = theta + gain * (speed[k] - speed[k - 1] - phi @ theta)
        P = (P - np.outer(gain, phi @ P)) / forgetting
    return theta


def test_it_is_much_faster_than_the_same_in_numpy(benchmark) -> None:
    """At least fifty times; two hundred and fifty when it was written."""
    speed, torque = record()
    some = RecursiveSettings(excitation=0.0)

    def seconds(many: int, run) -> float:
        begin = process_time()
        run(speed[:many], torque[:many])
        return (process_time() - begin) / many

    benchmark.pedantic(
        lambda: recursive_inertia(speed, torque, PERIOD, some), rounds=5, warmup_rounds=1
    )
    ours = benchmark.stats["min"] / MANY
    plain = min(seconds(3000, lambda w, m: in_python(w, m, 0.99)) for _ in range(3))
    assert plain / ours > 50
