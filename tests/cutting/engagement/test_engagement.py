"""What a path may be, the volume it removes, and properties of any path."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pipeline.cutting.engagement import engagement
from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engage, engaged_arc
from pipeline.cutting.tool import Tool
from tests.cutting.tool_paths import (
    BALL,
    BULL_NOSE,
    DRILL,
    FLAT,
    MM,
    TURN,
    arcs,
    block,
    radial_depth,
    through,
)

WIDE = Tool(kind="flat", diameter_mm=200, flutes=8)


@pytest.mark.parametrize(
    "points",
    [
        [[100, 0, -3], [200, 50, -3]],
        [[-10, 0, 0], [70, 0, 0]],
        [[-10, 0, 5], [70, 0, 0.001]],
        [[10, 0, 50], [10, 0, 1]],
        [[10, 0, -3], [10, 0, -3]],
        [[-50, -50, -3], [-50, 50, -3]],
    ],
    ids=["beside", "on its top", "down to it", "plunge above", "without length", "past it"],
)
@pytest.mark.parametrize("tool", [FLAT, BALL, DRILL], ids=lambda tool: tool.kind)
def test_a_path_that_meets_nothing_has_no_station(points, tool) -> None:
    stock, path = block(), through(points)
    found, left = engage(path, [tool], stock)
    assert len(found) == 0 and found.blocks == 1
    np.testing.assert_array_equal(left.heights, stock.heights)
    assert found.axial_depth.shape == arcs(found)[0].shape == (0,)


def test_a_path_without_pieces() -> None:
    found, left = engage(through([[0, 0, 0]]), [FLAT], block())
    assert len(found) == 0 and found.blocks == 0
    assert left.volume == block().volume


def test_a_tool_wider_than_the_stock_takes_all_of_it() -> None:
    stock = block(x=(0, 50), y=(-20, 20), z=(-10, 0), resolution=0.5)
    found, left = engage(through([[-120, 0, -2], [170, 0, -2]]), [WIDE], stock)
    assert found.volume.sum() / MM**3 == pytest.approx(50 * 40 * 2, rel=1e-6)
    assert np.all(left.heights == np.float32(-2 * MM))
    # in the middle of its way the rim is in the stock ahead: over 40 mm across its front
    k = np.argmax(found.volume)
    assert radial_depth(found, WIDE)[k] == pytest.approx(40 * MM, rel=0.02)


def test_a_rapid_through_material_cuts_and_is_marked() -> None:
    path = through([[-10, 0, -3], [70, 0, -3]], feed=False)
    found, _ = engage(path, [FLAT], block())
    assert len(found) > 0 and not found.feed.any()
    assert found.volume.sum() > 0


def test_a_spindle_that_stands_counts_as_clockwise() -> None:
    points = [[-10, 17, -3], [70, 17, -3]]
    standing, _ = engage(through(points, direction=0), [FLAT], block())
    turning, _ = engage(through(points, direction=1), [FLAT], block())
    np.testing.assert_array_equal(standing.upper, turning.upper)


def test_tools_take_turns() -> None:
    path = through([[-10, 0, -3], [70, 0, -3], [70, 0, -3], [-10, 0, -4]])
    path = replace(path, tool=np.array([1, 1, 0], np.int32))
    found, _ = engage(path, [BALL, FLAT], block())
    assert set(found.tool[found.piece == 0]) == {1}
    assert set(found.tool[found.piece == 2]) == {0}
    # the ball goes where the flat end has been: only down
    assert found.axial_depth[found.piece == 2].max() < 1.05 * MM


def test_a_block_of_several_pieces_has_all_of_their_stations() -> None:
    path = through([[-10, 0, -3], [20, 0, -3], [20, 10, -3], [70, 10, -3]])
    path = replace(path, block=np.array([2, 2, 7], np.int32))
    found, _ = engage(path, [FLAT], block())
    assert set(found.block) == {2, 7} and found.blocks == 8
    np.testing.assert_array_equal(found.block, path.block[found.piece])


@pytest.mark.parametrize("tool", [FLAT, BALL], ids=lambda tool: tool.kind)
def test_a_full_buffer_changes_nothing(monkeypatch, tool) -> None:
    turn = np.linspace(0, 6 * TURN, 900)
    radius = 2 + turn / TURN * 2
    path = through(np.c_[radius * np.cos(turn), radius * np.sin(turn), np.full(900, -2)])
    long = through([[-30, 3, -4], [30, -9, -4], [30, 12, -1], [-30, 3, -6]])
    stock = block(x=(-20, 20))
    for one in (path, long):
        whole, _ = engage(one, [tool], stock)
        monkeypatch.setattr(engagement, "_ROWS", 67)
        parts, _ = engage(one, [tool], stock)
        monkeypatch.undo()
        for name in whole.__dataclass_fields__.keys() - {"rings"}:
            np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
        for name in whole.rings.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(parts.rings, name), getattr(whole.rings, name))


def test_what_lies_far_away_costs_nothing() -> None:
    # 2000 km at a step of half a millimetre would be 4e9 steps
    found, left = engage(through([[-1e9, 0, -3], [1e9, 0, -3]]), [FLAT], block())
    assert left.volume < block().volume
    # positions of 1e6 m are rounded to 1e-10 m
    # from where the rim meets the stock, 5 mm before it, until its sides leave it
    assert found.length.sum() == pytest.approx(65 * MM, abs=1 * MM)


@pytest.mark.parametrize("tool", [-1, 1, 5])
def test_a_tool_that_is_not_there_is_named(tool: int) -> None:
    path = replace(through([[0, 0, 0], [1, 0, 0]]), tool=np.array([tool], np.int32))
    with pytest.raises(ValueError, match=f"names tool {tool} of 1 that there are"):
        engage(path, [FLAT], block())


def test_arcs_go_around_phi_0() -> None:
    depth = np.zeros((3, 72))
    depth[0, [70, 71, 0, 1, 2]] = 1
    depth[1] = 1
    begin, end = engaged_arc(depth)
    np.testing.assert_allclose(np.degrees([begin[0], end[0]]), [350, 375])
    assert (begin[1], end[1]) == (0, TURN)
    assert np.isnan(begin[2]) and np.isnan(end[2])


def test_the_longest_of_two_arcs_counts() -> None:
    depth = np.zeros((1, 72))
    depth[0, 2:5], depth[0, 20:34] = 1, 2
    begin, end = engaged_arc(depth)
    np.testing.assert_allclose(np.degrees([begin[0], end[0]]), [100, 170])


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
    "bull nose": (BULL_NOSE, through([[0, 0, -2.5], [30, 0, -2.5]]), bull_nose_groove(30, 2.5)),
    "drill": (DRILL, through([[0.3, 0.1, 5], [0.3, 0.1, -12]]), hole(DRILL, 12)),
    "small drill": (SMALL_DRILL, through([[0.3, 0.1, 5], [0.3, 0.1, -12]]), hole(SMALL_DRILL, 12)),
    "pecks": (
        DRILL,
        through([[0, 0, z] for z in (5, -4, 2, -3.5, -8, 2, -7.5, -12)]),
        hole(DRILL, 12),
    ),
}


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
    volume = np.bincount(found.block, found.volume)
    rate = volume[20:-20] / (circle.length[20:-20] * 10 * MM * 2 * MM)
    # a tool of 10 on a circle of 15 sweeps a ring of the same width
    assert np.abs(rate.mean() - 1) < 0.005
    assert rate.std() < 0.1


BOX = {"x": (-20, 20), "y": (-20, 20), "z": (-10, 0), "resolution": 0.4}
COORDINATE = st.floats(-30, 30).map(lambda value: round(value, 3))
HEIGHT = st.one_of(st.sampled_from([-1.0, -2.0, -4.0]), st.floats(-13, 3)).map(
    lambda value: round(value, 3)
)
POINT = st.tuples(COORDINATE, COORDINATE, HEIGHT)
PATH = st.lists(POINT, min_size=2, max_size=8)
TOOL = st.sampled_from([FLAT, BALL, BULL_NOSE, DRILL, Tool(kind="flat", diameter_mm=3, flutes=2)])
# with a radius of 12 cells
WIDE_TOOL = st.sampled_from([FLAT, BALL, BULL_NOSE, DRILL])
DIRECTION = st.sampled_from([1, -1])


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=TOOL, direction=DIRECTION)
def test_volumes_balance(points, tool, direction) -> None:
    stock = block(**BOX)
    before = stock.heights.copy()
    found, left = engage(through(points, direction=direction), [tool], stock)
    np.testing.assert_array_equal(stock.heights, before)
    assert np.all(found.volume >= 0)
    assert np.all(left.heights <= stock.heights)
    assert left.heights.min() >= np.float32(stock.floor)
    total = stock.volume - left.volume
    np.testing.assert_allclose(found.volume.sum(), total, rtol=1e-9, atol=1e-18)


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=TOOL)
def test_stations_lie_on_their_pieces_in_order(points, tool) -> None:
    path = through(points)
    found, _ = engage(path, [tool], block(**BOX))
    assert np.all(np.diff(found.piece) >= 0)
    end = found.along + found.length
    assert np.all(found.length > 0)
    assert np.all(end <= path.length[found.piece] * (1 + 1e-9))
    same = np.diff(found.piece) == 0
    assert np.all(found.along[1:][same] >= end[:-1][same] - 1e-12)
    assert np.all(found.lower >= 0) and np.all(found.upper >= found.lower)
    fed = np.bincount(found.block, found.length, found.blocks)
    assert np.all(fed <= path.length * (1 + 1e-9) + 1e-12)
    begin, end = arcs(found)
    arc = end - begin
    assert np.all(np.isnan(arc) | ((arc > 0) & (arc <= 2 * np.pi + 1e-9)))


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=TOOL)
def test_the_same_path_removes_nothing_the_second_time(points, tool) -> None:
    path = through(points)
    _, left = engage(path, [tool], block(**BOX))
    again, still = engage(path, [tool], left)
    np.testing.assert_array_equal(still.heights, left.heights)
    assert again.volume.sum() == 0


def steep(path: ToolPath) -> bool:
    """Whether a piece has next to no way in the plane, on which few columns tell its sides."""
    return bool(np.any(np.abs(path.end - path.start)[:, 2] > 0.7 * path.length))


def transformed(points, matrix) -> np.ndarray:
    points = np.array(points)
    points[:, :2] = points[:, :2] @ np.array(matrix)
    return points


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=WIDE_TOOL, matrix=st.sampled_from([((0, 1), (-1, 0)), ((0, -1), (1, 0))]))
def test_a_quarter_turn_changes_nothing(points, tool, matrix) -> None:
    path = through(points)
    assume(not steep(path))
    stock = block(**BOX)
    found, left = engage(path, [tool], stock)
    turned, other = engage(through(transformed(points, matrix)), [tool], stock)
    alike(path, tool, found, turned)
    # the box is its own image, but its columns are not: areas are as good as the rims are long
    rim = path.length.sum() / MM * 2 + 10 * np.pi * len(path)
    assert abs(left.volume - other.volume) / MM**3 < 10 * 2 * (0.4**3 * rim) ** 0.5


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=WIDE_TOOL)
def test_a_mirrored_path_with_the_spindle_the_other_way(points, tool) -> None:
    stock = block(**BOX)
    path = through(points)
    assume(not steep(path))
    found, _ = engage(path, [tool], stock)
    mirror = through(transformed(points, ((1, 0), (0, -1))), direction=-1)
    mirrored, _ = engage(mirror, [tool], stock)
    alike(path, tool, found, mirrored)


def alike(path: ToolPath, tool: Tool, one: Engagement, other: Engagement) -> None:
    """Block by block as much engaged, at each angle; within what a few steps and columns are."""
    step = max(2 * 0.4, 0.1 * tool.diameter_mm / 2) * MM
    for block_ in range(one.blocks):
        sums = [
            ((e.upper - e.lower) * e.length[:, None])[e.block == block_].sum(axis=0, dtype=float)
            for e in (one, other)
        ]
        # a limit that lies a cell off in each of the angles that it crosses, over two steps
        reach = 10 * MM * (2 * step + 0.1 * path.length[block_])
        assert np.all(np.abs(sums[0] - sums[1]) < reach)
        total = max(sums[0].sum(), sums[1].sum())
        assert abs(sums[0].sum() - sums[1].sum()) < 0.05 * total + 18 * reach * 0.4


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=TOOL, bins=st.sampled_from([36, 72, 180]))
def test_the_number_of_angles_changes_no_volume(points, tool, bins) -> None:
    path = through(points)
    found, left = engage(path, [tool], block(**BOX))
    other, still = engage(path, [tool], block(**BOX), bins=bins)
    np.testing.assert_array_equal(still.heights, left.heights)
    assert other.upper.shape[1] == bins
    np.testing.assert_allclose(other.volume.sum(), found.volume.sum())


@settings(deadline=None, max_examples=40)
@given(points=PATH, tool=TOOL, cut=st.integers(1, 6))
def test_a_path_in_two_parts_leaves_the_same_stock(points, tool, cut) -> None:
    path = through(points)
    cut = min(cut, len(path))
    parts = [
        replace(path, **{n: getattr(path, n)[part] for n in path.__dataclass_fields__})
        for part in (slice(None, cut), slice(cut, None))
    ]
    whole = engage(path, [tool], block(**BOX))[1]
    _, left = engage(parts[0], [tool], block(**BOX))
    _, left = engage(parts[1], [tool], left)
    np.testing.assert_array_equal(left.heights, whole.heights)
