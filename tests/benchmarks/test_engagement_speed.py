"""Seconds that the engagement of a program of 20 000 blocks takes on one core, and its memory."""

import tracemalloc

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import ToolPath, engage
from pipeline.cutting.engagement.stock import height_map, stock_of
from tests.cutting.tool_paths import BALL, BULL_NOSE, FLAT, TURN, through

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
