"""Volume removed against exact solids: within 0.5 %, and closer on a finer map."""

import numpy as np
import pytest

from pipeline.cutting.engagement import engage
from pipeline.cutting.tool import Tool
from pipeline.cutting.tool_path import ToolPath
from tests.cutting.tool_paths import BALL, BULL_NOSE, DRILL, FLAT, MM, TURN, block, through

RESOLUTIONS = 0.4, 0.2, 0.1
SMALL_DRILL = Tool(kind="drill", diameter_mm=5, flutes=2, point_angle_deg=118)


def ball_groove(length: float, depth: float, radius: float = 5.0) -> float:
    """A ball that goes straight: segment of a circle times its way, and a cap at both ends."""
    half = np.arccos(1 - depth / radius)
    segment = radius**2 * (half - np.sin(half) * np.cos(half))
    return segment * length + np.pi * depth**2 * (3 * radius - depth) / 3


def bull_nose_groove(length: float, depth: float) -> float:
    """A corner of 2 about a flat of 3: its section times its way, and its own volume."""
    levels = (np.arange(20000) + 0.5) / 20000 * depth
    width = 3 + np.sqrt(4 - np.maximum(2 - levels, 0) ** 2)
    return float((2 * width * length + np.pi * width**2).mean() * depth)


def ramp(length: float, depth: float, radius: float = 5.0) -> float:
    """A flat end that goes down: each place is as deep as when the tool leaves it."""
    cell = 0.01
    x = np.arange(-radius, length + radius, cell) + cell / 2
    y = (np.arange(-radius, radius, cell) + cell / 2)[:, None]
    half = np.sqrt(radius**2 - y**2)
    end = np.minimum(x + half, length)
    swept = (x - half < length) & (end > 0)
    return float((swept * end * (depth / length)).sum() * cell**2)


def hole(drill: Tool, depth: float) -> float:
    """Cylinder, and cone at its bottom; the depth is the tip's."""
    radius = drill.diameter_mm / 2
    point = radius / np.tan(drill.point_angle / 2)
    return np.pi * radius**2 * (depth - point * 2 / 3)


def pocket_path() -> ToolPath:
    """Rows 6 mm apart within a rectangle of 30 by 24, and once around."""
    rows = [[x, y, -3] for k, y in enumerate(range(-12, 13, 6)) for x in ((0, 30), (30, 0))[k % 2]]
    return through([*rows, [30, -12, -3], [0, -12, -3], [0, 12, -3], [30, 12, -3]])


CASES: dict[str, tuple[Tool, ToolPath, float]] = {
    "slot": (FLAT, through([[0, 0, -3], [30, 0, -3]]), (10 * 30 + np.pi * 25) * 3),
    "slot across": (FLAT, through([[0, 0, -3], [24, 9, -3]]), (10 * 657**0.5 + np.pi * 25) * 3),
    "pocket": (FLAT, pocket_path(), (40 * 34 - (4 - np.pi) * 25) * 3),
    "ramp": (FLAT, through([[0, 0, 0], [30, 0, -4]]), ramp(30, 4)),
    "ramp up": (FLAT, through([[30, 0, -4], [0, 0, 0]]), ramp(30, 4)),
    "ball": (BALL, through([[0, 0, -1.5], [30, 0, -1.5]]), ball_groove(30, 1.5)),
    "ball in pieces": (
        BALL,
        through(np.c_[np.linspace(0, 30, 61), np.zeros(61), np.full(61, -1.5)]),
        ball_groove(30, 1.5),
    ),
    "bull nose": (
        BULL_NOSE, through([[0, 0, -2.5], [30, 0, -2.5]]), bull_nose_groove(30, 2.5)
    ),
    "drill": (DRILL, through([[0.3, 0.1, 5], [0.3, 0.1, -12]]), hole(DRILL, 12)),
    "small drill": (
        SMALL_DRILL, through([[0.3, 0.1, 5], [0.3, 0.1, -12]]), hole(SMALL_DRILL, 12)
    ),
    "pecks": (
        DRILL, through([[0, 0, z] for z in (5, -4, 2, -3.5, -8, 2, -7.5, -12)]), hole(DRILL, 12)
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_volume_of_a_solid(case: str) -> None:
    tool, path, exact = CASES[case]
    errors = []
    for resolution in RESOLUTIONS:
        stock = block(x=(-20, 50), y=(-30, 30), resolution=resolution)
        found, left = engage(path, [tool], stock)
        removed = found.volume.sum()
        assert removed == pytest.approx(stock.volume - left.volume, rel=1e-9)
        errors.append(abs(removed / MM**3 / exact - 1))
    assert errors[1] < 0.005 and errors[2] < 0.002, errors
    # columns on the rim, as if at random: cell^1.5
    assert errors[2] < 0.35 * max(errors[0], 0.002), errors


@pytest.mark.parametrize("tool", [BALL, BULL_NOSE, DRILL], ids=lambda tool: tool.kind)
@pytest.mark.parametrize("depth", [3.0, 12.0, 30.0])
def test_what_a_formed_end_leaves_on_its_way_down(tool: Tool, depth: float) -> None:
    path = through([[0, 0, 0], [20, 0, -depth]])
    _, left = engage(path, [tool], block(x=(-10, 30), y=(-8, 8), z=(-40, 0), resolution=0.25))
    steps = np.linspace(0, 1, 4001)
    radius, corner = 5.0, tool.corner_radius / MM
    x_shifts, y_shifts = left.shifts()
    for row in range(3, left.heights.shape[0], 7):
        x = left.x0 / MM + (np.arange(left.heights.shape[1]) + x_shifts[row]) * 0.25
        y = left.y0 / MM + (row + y_shifts) * 0.25
        # the lowest of many places of the tool
        r = np.hypot(x - 20 * steps[:, None], y)
        if tool.kind == "drill":
            end = r / np.tan(tool.point_angle / 2)
        else:
            out = np.clip(r - radius + corner, 0, corner)
            end = corner - np.sqrt(corner**2 - out**2)
        low = np.where(r < radius, end - depth * steps[:, None], 0).min(axis=0).clip(max=0)
        # 4001 places miss the lowest by less than the tip moves between two, but at the tool's rim
        assert np.quantile(low - left.heights[row] / MM, 0.95) < depth / 4000
        # heights are kept to 7 digits
        assert np.all(left.heights[row] / MM < low + 4e-6)


def test_volumes_of_stations_are_those_of_their_places() -> None:
    # half of the way is twice as deep
    stock = block(x=(-20, 50), y=(-30, 30))
    path = through([[-15, 0, -1], [10, 0, -1], [45, 0, -1]])
    found, _ = engage(path, [FLAT], stock)
    first = found.volume[found.piece == 0].sum() / MM**3
    assert first == pytest.approx(25 * 10 + np.pi * 25, rel=0.005)
    middle = found.piece == 1
    assert found.volume[middle].sum() / MM**3 == pytest.approx(35 * 10, rel=0.005)
    turn = np.linspace(0, TURN, 200)
    circle = through(np.c_[15 * np.cos(turn), 15 * np.sin(turn), np.full(200, -2)])
    found, _ = engage(circle, [FLAT], block(x=(-30, 30), y=(-30, 30)))
    rate = found.block_volume[20:-20] / (circle.length[20:-20] * 10 * MM * 2 * MM)
    # a tool of 10 on a circle of 15 sweeps a ring of the same width
    assert np.abs(rate.mean() - 1) < 0.005
    assert rate.std() < 0.1
