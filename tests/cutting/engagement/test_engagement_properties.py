"""Properties of any path: volumes balance, nothing is cut twice, mirrors and turns do nothing."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engage
from pipeline.cutting.tool import Tool
from tests.cutting.tool_paths import BALL, BULL_NOSE, DRILL, FLAT, MM, arcs, block, through

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


def in_the_plane(points) -> np.ndarray:
    points = np.array(points)
    points[:, 2] = -2.0
    return points


def work(found: Engagement) -> np.ndarray:
    """Engaged height times way of each block [m^2]."""
    depth = (found.upper - found.lower).sum(axis=1, dtype=float)
    return np.bincount(found.block, depth * found.length, found.blocks)


@settings(deadline=None)
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


@settings(deadline=None)
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


@settings(deadline=None)
@given(points=PATH, tool=TOOL)
def test_the_same_path_removes_nothing_the_second_time(points, tool) -> None:
    path = through(points)
    _, left = engage(path, [tool], block(**BOX))
    again, still = engage(path, [tool], left)
    np.testing.assert_array_equal(still.heights, left.heights)
    assert again.volume.sum() == 0


@settings(deadline=None)
@given(points=PATH)
def test_a_flat_end_in_the_plane_meets_nothing_the_second_time(points) -> None:
    path = through(in_the_plane(points))
    _, left = engage(path, [FLAT], block(**BOX))
    again, _ = engage(path, [FLAT], left)
    assert len(again) == 0


@settings(deadline=None)
@given(points=PATH, tool=TOOL)
def test_the_spindle_the_other_way_turns_the_angles_around(points, tool) -> None:
    clockwise, _ = engage(through(points), [tool], block(**BOX))
    other, _ = engage(through(points, direction=-1), [tool], block(**BOX))
    np.testing.assert_allclose(other.volume.sum(), clockwise.volume.sum())
    # phi becomes pi - phi; a column on the limit of two angles may change its side
    swapped = np.concatenate([other.upper[:, 35::-1], other.upper[:, :35:-1]], axis=1)
    if len(other) == len(clockwise) > 0:
        # a plunge has no direction of feed about which to fill what no column met
        off = (np.abs(swapped - clockwise.upper) > 1e-6)[~clockwise.plunge]
        assert off.sum() <= 0.05 * off.size
    # the end of a plunge is filled from its +x side on, which the mirror does not turn
    rtol = 0.25 if clockwise.plunge.any() else 0.1
    np.testing.assert_allclose(work(other), work(clockwise), rtol=rtol, atol=2e-8)


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


@settings(deadline=None)
@given(points=PATH, tool=TOOL, bins=st.sampled_from([36, 72, 180]))
def test_the_number_of_angles_changes_no_volume(points, tool, bins) -> None:
    path = through(points)
    found, left = engage(path, [tool], block(**BOX))
    other, still = engage(path, [tool], block(**BOX), bins=bins)
    np.testing.assert_array_equal(still.heights, left.heights)
    assert other.upper.shape[1] == bins
    np.testing.assert_allclose(other.volume.sum(), found.volume.sum())


@settings(deadline=None)
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
