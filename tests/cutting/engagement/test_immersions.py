"""Arcs of stations: what of an engagement counts for chatter, and stations that cannot be."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, immersions
from tests.cutting.stability.test_margins import PROGRAM


def engagement(lower: np.ndarray, upper: np.ndarray, path: ToolPath, piece, slope) -> Engagement:
    many = len(upper)
    return Engagement(
        piece=np.array(piece, np.int32), block=np.array(piece, np.int32),
        tool=np.zeros(many, np.int32), along=np.zeros(many), length=np.ones(many), lower=lower,
        upper=upper, volume=np.ones(many), slope=np.array(slope), feed=path.feed[piece], blocks=5,
        resolution=1e-4,
    )  # fmt: skip


def pieces() -> ToolPath:
    points = np.array([[0, 0, 0], [0, -1, 0], [0, -1, -1], [1, -1, -1], [2, -1, -1]], float)
    return ToolPath(
        start=points[:-1], end=points[1:], block=np.arange(4, dtype=np.int32),
        tool=np.zeros(4, np.int32), feed=np.array([True, True, False, True]),
        direction=np.array([1, 1, 1, -1], np.int8),
    )  # fmt: skip


def test_stations_of_an_engagement() -> None:
    """72 bins of 5 deg: a half-immersion cut along -y, a plunge, a rapid, a trailing edge."""
    upper = np.zeros((5, 72), np.float32)
    lower = np.zeros_like(upper)
    upper[0, 18:36], lower[0, 18:36] = 3e-3, 1e-3  # 90 to 180 deg, 2 mm of edge
    upper[1, :] = 1e-3
    upper[2, :36] = 1e-3
    upper[3, 40:50] = 1e-3  # behind the tool: no chip
    upper[4, 4:6], upper[4, 10:12] = 1e-3, 4e-3  # two arcs
    path = pieces()
    found = immersions(
        path, engagement(lower, upper, path, [0, 1, 2, 3, 3], [0.0, -1.0, 0.0, 0.0, 0.0])
    )
    np.testing.assert_array_equal(found.block, [0, 3])
    np.testing.assert_allclose(np.rad2deg(found.entry), [90, 20], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(found.exit), [180, 60], atol=1e-9)
    np.testing.assert_allclose(found.depth, [2e-3, 4e-3], rtol=1e-6)
    np.testing.assert_allclose(found.lowest, [1e-3, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.highest, [3e-3, 4e-3], rtol=1e-6)
    np.testing.assert_allclose(found.feed_direction, [-pi / 2, 0.0], atol=1e-12)
    np.testing.assert_array_equal(found.direction, [1, -1])
    np.testing.assert_array_equal(found.unjudged, [False, True, True, True, False])


def test_an_arc_ends_within_a_bin() -> None:
    """Seen along the feed, as the first and the last angle are engaged in part."""
    path = pieces()
    upper = np.zeros((1, 72), np.float32)
    upper[0, 28], upper[0, 29:36] = 0.4e-3, 1e-3
    found = immersions(path, engagement(np.zeros_like(upper), upper, path, [3], [0.0]))
    begin, end = np.cos(np.deg2rad([140, 145]))
    np.testing.assert_allclose(np.cos(found.entry), end + 0.4 * (begin - end), rtol=1e-6)
    np.testing.assert_allclose(found.exit, pi, rtol=1e-9)


def test_ramps_are_milling_up_to_a_steepness() -> None:
    """Up to dz / ds = 0.7, some 45 deg; what is steeper drills and is not judged."""
    path = pieces()
    upper = np.zeros((4, 72), np.float32)
    upper[:, :36] = 1e-3
    steep = engagement(np.zeros_like(upper), upper, path, [0, 0, 3, 3], [-0.65, 0.65, -0.75, 0.75])
    found = immersions(path, steep)
    np.testing.assert_array_equal(found.block, [0, 0])
    np.testing.assert_array_equal(found.unjudged, [False, False, False, True, False])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth": [1e-3, 0.0, 1e-3, 1e-3]}, r"depth\[1\] = 0 must be above 0 m"),
        ({"depth": [1e-3, 1e-3, np.nan, 1e-3]}, r"depth\[2\] = nan must be above 0 m"),
        ({"exit": [3.0, 1.0, 3.0, 3.0]}, r"station 1 has entry = 1\.5708, exit = 1,"),
        ({"feed_direction": [0.0, 0.0, 0.0, np.inf]}, "station 3 has .* feed_direction = inf"),
    ],
)
def test_stations_that_cannot_be(change: dict, message: str) -> None:
    given = {k: np.array(v) if isinstance(v, list) else v for k, v in change.items()}
    with pytest.raises(ValueError, match=message):
        replace(PROGRAM, **given)
