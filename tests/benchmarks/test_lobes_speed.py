"""Milliseconds for stability: a table of classes, margins of a population, the check.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from time import process_time

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import Immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.margins import StabilityTable, _kept, stability_table
from pipeline.cutting.tool import Tool
from tests.cutting.chatter import SLOT, X, Y, depth_limits

SPEEDS = np.linspace(5000, 25_000, 200) / 60


@pytest.mark.benchmark(timer=process_time)
def test_check_of_21_speeds(benchmark) -> None:
    depth_limits([X], SLOT, SPEEDS[::10], highest=5e-3)
    run = lambda: depth_limits([X], SLOT, SPEEDS[::10], highest=5e-3)  # noqa: E731
    benchmark.pedantic(run, rounds=3)
    assert benchmark.stats["min"] / 20 < 80e-3


def of_program(blocks: int) -> StabilityTable:
    """Blocks of a pocket: 40 classes."""
    pick = np.arange(blocks) % 40
    program = Immersions(
        block=np.arange(blocks, dtype=np.int32), tool=np.zeros(blocks, np.int32),
        depth=np.full(blocks, 1e-3), entry=np.where(pick % 2, 0.0, np.pi / 2),
        exit=np.full(blocks, np.pi), feed_direction=np.deg2rad(5.0 * (pick // 2)),
        direction=np.ones(blocks, np.int8), blocks=blocks, unjudged=np.zeros(blocks, np.bool_),
    )  # fmt: skip
    return stability_table(
        program, [[X, Y]], [ForceLaw.linear(K_tc=600.0, K_rc=200.0)],
        [Tool(kind="flat", diameter_mm=10.0, flutes=2)], nodes_rpm=np.linspace(5000, 25_000, 64),
    )  # fmt: skip


@pytest.mark.benchmark(timer=process_time)
def test_table_of_40_classes(benchmark) -> None:
    """The first look computes 64 speeds a class, with two modes."""
    speeds = np.linspace(5000, 25_000, 64)[:, None] * np.ones(40)

    def first_look() -> None:
        _kept.cache_clear()
        of_program(40).margins(speeds)

    benchmark.pedantic(first_look, rounds=2, warmup_rounds=1)
    assert benchmark.stats["min"] / (40 * 64) < 10e-3


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize(("blocks", "population"), [(20_000, 1), (30, 512)])
def test_margins(benchmark, blocks: int, population: int) -> None:
    table = of_program(blocks)
    speeds = np.random.default_rng(0).uniform(5000, 25_000, (population, blocks))
    table.margins(speeds)
    benchmark(lambda: table.margins(speeds))
    assert benchmark.stats["min"] / (blocks * population) < 50e-9
