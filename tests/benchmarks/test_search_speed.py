"""Microseconds of an evaluation: what a search adds, and what time, cost and limits take."""

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from pipeline.optimisation.methods.feeds import BlockModel
from pipeline.optimisation.problem.arrays import Groups
from pipeline.schema.limits import CutLimit
from pipeline.search import methods
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from tests.machine.programs import row_times
from tests.optimisation.problem_parts import cut_on, problem_on

pytestmark = pytest.mark.benchmark(timer=process_time)
"""Time of the processor counts, not that of the clock: what else runs does not."""

SETTINGS = GeneticSettings(population=64, generations=200)


def nothing(x: np.ndarray) -> np.ndarray:
    return x[:, 0]


@pytest.mark.parametrize("population", [64, 256])
@pytest.mark.parametrize("dimensions", [4, 10])
def test_overhead_of_an_evaluation(benchmark, population: int, dimensions: int) -> None:
    settings = replace(SETTINGS, population=population)
    low, high = np.zeros(dimensions), np.ones(dimensions)
    found = benchmark(lambda: minimise(nothing, low, high, settings))
    # 1.4 us at 64 and 0.5 us at 256 on a quiet core
    assert benchmark.stats["min"] / found.evaluations < 4e-6


@pytest.mark.parametrize("name", methods.METHODS)
def test_overhead_of_each_search(benchmark, name: str) -> None:
    """30 variables and 30 individuals, as the functions of the whales' paper have."""
    low, high = np.zeros(30), np.ones(30)
    found = benchmark(
        lambda: methods.minimise(name, nothing, low, high, population=30, generations=200)
    )
    # on a core that others use too: whale 1.4 us, swarm 1.2, wolf 1.7, random 0.4, genetic 3.1,
    # whose powers of real exponents take a third of it
    most = 6e-6 if name == "genetic" else 4e-6
    assert benchmark.stats["min"] / found.evaluations < most


def test_it_is_much_lighter_than_pymoo(benchmark) -> None:
    """At least ten times; 31 when it was written."""
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    class Nothing(Problem):
        def __init__(self) -> None:
            super().__init__(n_var=4, n_obj=1, xl=np.zeros(4), xu=np.ones(4))

        def _evaluate(self, x, out, *args, **kwargs) -> None:
            out["F"] = nothing(x)

    few = replace(SETTINGS, generations=50)

    def seconds(search) -> float:
        begin = process_time()
        search()
        return process_time() - begin

    benchmark.pedantic(lambda: minimise(nothing, np.zeros(4), np.ones(4), few), rounds=9)
    other = min(
        seconds(lambda: minimize(Nothing(), GA(pop_size=64), ("n_gen", 50), seed=1))
        for _ in range(3)
    )
    assert other / benchmark.stats["min"] > 10


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


def test_fitness_of_a_population(benchmark, problem, groups) -> None:
    """Time, cost, energy, tool life and violation of 30 blocks: 3.2 us."""
    rng = np.random.default_rng(0)
    feeds = rng.uniform(200, 2000, (POPULATION, groups.feeds))
    speeds = rng.uniform(3000, 9000, (POPULATION, groups.speeds))
    benchmark(lambda: problem.evaluate(groups, feeds, speeds))
    assert benchmark.stats["min"] / POPULATION < 5e-6


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
