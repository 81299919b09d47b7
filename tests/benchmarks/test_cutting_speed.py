"""Forces in microseconds, engagement of 20 000 blocks in seconds, stability in milliseconds."""

import tracemalloc
from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import Immersions, ToolPath, engage
from pipeline.cutting.engagement.stock import height_map, stock_of
from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import LoadTable, load_table
from pipeline.cutting.force.waveform import basis
from pipeline.cutting.stability.margins import StabilityTable, _kept, stability_table
from pipeline.cutting.tool import Kind, Tool
from tests.cutting.chatter import SLOT, X, Y, depth_limits
from tests.cutting.tool_paths import BALL, BULL_NOSE, FLAT, TURN, random_profile, stations, through

pytestmark = pytest.mark.benchmark(timer=process_time)
"""Time of the processor counts, not that of the clock: what else runs does not."""

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


@pytest.mark.parametrize("runout", [0.0, 10.0])
def test_waveform_of_a_fit(benchmark, runout: float) -> None:
    """100 angles, 30 slices, 4 teeth: 90 us, 130 us with runout."""
    angles = np.linspace(0, 2 * np.pi, 100)
    benchmark(lambda: basis(mill(runout), angles=angles, slices=30, **CUT))
    assert benchmark.stats["min"] < 2e-4


def test_peaks_of_a_long_program(benchmark) -> None:
    """20 000 blocks, one row of feeds."""
    loads = table(20_000)
    feeds, out = np.random.default_rng(1).uniform(0, 1e-4, 20_000), np.empty(20_000)
    benchmark(lambda: loads.peaks(feeds, out))
    assert benchmark.stats["min"] < 2e-3


def test_peaks_of_a_population(benchmark) -> None:
    """30 blocks, 512 individuals: microseconds each."""
    loads = table(30)
    feeds, out = np.random.default_rng(1).uniform(0, 1e-4, (512, 30)), np.empty((512, 30))
    benchmark(lambda: loads.peaks(feeds, out))
    assert benchmark.stats["min"] / 512 < 5e-6


@pytest.mark.benchmark(timer=process_time, min_rounds=2)
@pytest.mark.parametrize("runout", [0.0, 10.0])
def test_table_of_a_long_program(benchmark, runout: float) -> None:
    """2000 stations that differ: microseconds each."""
    rng = np.random.default_rng(0)
    engagement = stations([random_profile(rng) for _ in range(2000)], np.arange(2000), 2000)
    benchmark(lambda: load_table(engagement, [mill(runout)], [LAW], 1e-4))
    assert benchmark.stats["min"] / 2000 < (1e-3 if runout else 2e-4)


@pytest.mark.parametrize("kind", ["flat", "ball"])
def test_draws_of_a_ramp(benchmark, kind: Kind) -> None:
    """1024 draws of coefficients and runout at 3 feeds: 3.5 ms, of a ball 5.5 ms."""
    profile = random_profile(np.random.default_rng(0))
    turn = edge_turn(replace(mill(0.0), kind=kind), *profile, slope=-0.3)
    offsets = 3e-6 * np.random.default_rng(1).standard_normal((1024, 2))
    laws = np.tile(np.concatenate([LAW.cutting, LAW.edge]), (1024, 1))
    benchmark(lambda: drawn_loads(turn, laws, offsets, [1e-5, 4e-5, 1e-4]))
    assert benchmark.stats["min"] < 1.2e-2


@pytest.mark.benchmark(timer=process_time, min_rounds=2)
def test_table_of_a_ball_on_slopes(benchmark) -> None:
    """300 stations that differ, going down: 0.16 ms each."""
    rng = np.random.default_rng(0)
    ball = replace(mill(0.0), kind="ball")
    profiles = [random_profile(rng) for _ in range(300)]
    engagement = stations(profiles, np.arange(300), 300, slope=-0.3)
    benchmark(lambda: load_table(engagement, [ball], [LAW], 1e-4))
    assert benchmark.stats["min"] / 300 < 4e-4


BLOCKS = 20_000
STOCK = "box:0,160,0,120,-40,0"


def trochoid(y: float, z: float) -> np.ndarray:
    """A slot of 16 mm in circles 1.2 mm apart, in chords of about 1 mm."""
    turns = np.arange(0, 110, 1 / 19)
    angle = TURN * turns
    x = 15 + 1.2 * turns + 3 * np.cos(angle)
    return np.c_[x, y + 3 * np.sin(angle), np.full_like(x, z)]


def rows(z: float) -> np.ndarray:
    """Rows 4 mm apart over the whole block, each in blocks of 1 mm along a shallow wave."""
    x = np.arange(-6, 166.0)
    lines = []
    for k, y in enumerate(np.arange(0, 120, 4.0)):
        line = np.c_[x, y + 0.3 * np.sin(x / 7), np.full_like(x, z)]
        lines.append(line[::-1] if k % 2 else line)
    return np.concatenate(lines)


def contours(z: float) -> np.ndarray:
    """Around an island, 0.5 mm wide."""
    angle = np.linspace(0, TURN, 330)
    rings = [(60 - k / 2, 45 - k / 2) for k in range(4)]
    return np.concatenate(
        [np.c_[80 + a * np.cos(angle), 60 + b * np.sin(angle), 0 * angle + z] for a, b in rings]
    )


def program() -> ToolPath:
    """Clearing in circles, in rows, and finishing, level by level."""
    parts = []
    for level in range(1, 20):
        z = -2.0 * level
        parts += [rows(z), trochoid(30, z - 1), trochoid(90, z - 1), contours(z - 1)]
    points = np.concatenate(parts)
    assert len(points) > BLOCKS
    return through(points[: BLOCKS + 1])


@pytest.mark.parametrize(
    ("tool", "seconds"),
    [(FLAT, 1.0), (BALL, 3.0), (BULL_NOSE, 3.0)],
    ids=["flat", "ball", "bull nose"],
)
def test_engagement_of_20_000_blocks(benchmark, tool, seconds: float) -> None:
    path, stock = program(), height_map(stock_of(STOCK), 0.2e-3)
    engage(through([[0, 0, 0], [1, 0, -1]]), [tool], stock)
    found, _ = benchmark(engage, path, [tool], stock)
    assert len(found) > BLOCKS / 2
    assert benchmark.stats["min"] < seconds


@pytest.mark.proof
def test_memory_of_20_000_blocks() -> None:
    path, stock = program(), height_map(stock_of(STOCK), 0.2e-3)
    engage(through([[0, 0, 0], [1, 0, -1]]), [FLAT], stock)
    tracemalloc.start()
    engage(path, [FLAT], stock)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 150 * 2**20


SPEEDS = np.linspace(5000, 25_000, 200) / 60


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


def test_table_of_40_classes(benchmark) -> None:
    """The first look computes 64 speeds a class, with two modes."""
    speeds = np.linspace(5000, 25_000, 64)[:, None] * np.ones(40)

    def first_look() -> None:
        _kept.cache_clear()
        of_program(40).margins(speeds)

    benchmark.pedantic(first_look, rounds=2, warmup_rounds=1)
    assert benchmark.stats["min"] / (40 * 64) < 10e-3


@pytest.mark.parametrize(("blocks", "population"), [(20_000, 1), (30, 512)])
def test_margins(benchmark, blocks: int, population: int) -> None:
    table = of_program(blocks)
    speeds = np.random.default_rng(0).uniform(5000, 25_000, (population, blocks))
    table.margins(speeds)
    benchmark(lambda: table.margins(speeds))
    assert benchmark.stats["min"] / (blocks * population) < 50e-9
