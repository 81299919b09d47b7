"""Microseconds that a decision's time, cost and limits take: planner and load table together."""

import time

import numpy as np
import pytest

from pipeline.optimisation.methods.feeds import BlockModel
from pipeline.optimisation.problem.arrays import Groups
from pipeline.schema.limits import CutLimit
from tests.machine.programs import row_times
from tests.optimisation.problem_parts import cut_on, problem_on

POPULATION = 4096


@pytest.fixture(scope="module")
def problem():
    """A pocket in 30 blocks."""
    lines = ["T1 M6", "G0 X-10 Y10 S6000 M3", "Z2", "G1 Z-1 F200", "X60 F600"]
    for way in range(14):
        lines += [f"Y{12 + 2 * way}", f"X{0 if way % 2 == 0 else 60}"]
    cut = cut_on("\n".join([*lines, "G0 Z5", "M30", ""]))
    return problem_on(cut, CutLimit(load_N=200.0, chip_um=(1.0, 100.0)))


@pytest.fixture(scope="module")
def groups(problem):
    moves = problem.cut.plan.path.moves
    found = Groups(
        feed=problem.editable.block, speed=np.where(problem.editable.speed, 0, -1),
        own_feed=moves.feed, own_speed=moves.speed,
    )  # fmt: skip
    assert found.feeds == 30
    return found


@pytest.mark.benchmark(timer=time.process_time)
def test_fitness_of_a_population(benchmark, problem, groups) -> None:
    """Time, cost, energy, tool life and violation of 30 blocks: 3.2 us."""
    rng = np.random.default_rng(0)
    feeds = rng.uniform(200, 2000, (POPULATION, groups.feeds))
    speeds = rng.uniform(3000, 9000, (POPULATION, groups.speeds))
    benchmark(lambda: problem.evaluate(groups, feeds, speeds))
    assert benchmark.stats["min"] / POPULATION < 5e-6


@pytest.mark.benchmark(timer=time.process_time)
def test_planner_and_peaks_of_a_population(benchmark, problem, groups) -> None:
    """The time of the program and the peak load of each block alone."""
    rng, cut = np.random.default_rng(0), problem.cut
    feeds = groups.row_feeds(rng.uniform(200, 2000, (POPULATION, groups.feeds)))
    speeds = groups.row_speeds(rng.uniform(3000, 9000, (POPULATION, groups.speeds)))
    peaks = np.empty(feeds.shape)

    def fitness() -> None:
        row_times(cut.plan.path, feeds, speeds)
        cut.table.peaks(cut.commanded_feed_per_tooth(feeds, speeds), peaks)

    benchmark(fitness)
    assert benchmark.stats["min"] / POPULATION < 5e-6


@pytest.mark.benchmark(timer=time.process_time)
def test_rows_at_many_speeds(benchmark, problem) -> None:
    """Objectives of each row and what power allows, at 64 speeds, as the direct solution asks."""
    speeds = np.linspace(2000, 9000, 64)[:, np.newaxis] * np.ones(len(problem))
    feeds = np.broadcast_to(problem.cut.plan.path.moves.feed, speeds.shape)
    rows = BlockModel.alone(problem, "time")

    def grid() -> None:
        rows.demands(feeds, speeds)
        problem.power_f_z(speeds)

    benchmark(grid)
    assert benchmark.stats["min"] < 2e-3
