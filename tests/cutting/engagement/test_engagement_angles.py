"""Engaged arcs of a flat end mill against closed forms, at several resolutions."""

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import Engagement, engage
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
    cleared,
    radial_depth,
    through,
)

LEVELS = 4000


def surface(tool: Tool, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radius [m] and height over radius of the tool's surface at heights above the tip [m]."""
    radius, corner = tool.radius, tool.corner_radius
    if tool.kind == "drill":
        cotangent = 1 / np.tan(tool.point_angle / 2)
        within = height < radius * cotangent
        return np.where(within, height / cotangent, radius), np.where(within, cotangent, np.inf)
    if corner == 0:
        return np.full_like(height, radius), np.full_like(height, np.inf)
    down = np.clip(1 - height / corner, 0, None)
    across = np.sqrt(1 - np.minimum(down, 1) ** 2)
    rise = np.divide(across, down, out=np.full_like(down, np.inf), where=down > 0)
    return radius - corner + corner * across, rise


def engaged_height(
    tool: Tool,
    angles: np.ndarray,
    before: Callable,
    *,
    tip: float = 0.0,
    slope: float = 0.0,
    top: float = 0.03,
) -> np.ndarray:
    """Height engaged at each angle [m], where ``before(x, y)`` is the material's height [m].

    x along the feed and y to its left from the tool's axis; a spindle that turns clockwise.
    """
    height = (np.arange(LEVELS) + 0.5) * (top / LEVELS)
    radius, rise = surface(tool, height)
    sine, cosine = np.sin(angles)[:, None], np.cos(angles)[:, None]
    into = np.where(np.isinf(rise), sine > 0, np.where(np.isinf(rise), 0, rise) * sine > slope)
    inside = before(radius * sine, radius * cosine) > tip + height
    return (into & inside).sum(axis=1) * (top / LEVELS)


R = 5.0
RESOLUTIONS = 0.4, 0.2, 0.1


def longest(found: Engagement) -> int:
    return int(np.argmax(found.length))


def arc(found: Engagement, axial_depth_mm: float) -> np.ndarray:
    """Engaged angle altogether [rad]."""
    depth = found.upper - found.lower
    return depth.sum(axis=1) / (axial_depth_mm * MM) * TURN / depth.shape[1]


@pytest.mark.parametrize("angle", [0, 17, 45, 90, 211])
@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_a_slot_is_engaged_over_the_whole_front(angle: float, resolution: float) -> None:
    turn = np.radians(angle)
    ends = np.array([-1, 1])[:, None] * 12 * np.array([np.cos(turn), np.sin(turn)])
    path = through(np.c_[ends, [-3, -3]])
    found, _ = engage(path, [FLAT], block(x=(-20, 20), z=(-10, 0), resolution=resolution))
    # nothing changes on the way: one station, and no column may be missing or too much
    assert len(found) == 1
    assert found.length[0] == pytest.approx(24 * MM)
    np.testing.assert_allclose(found.upper[0, :36], 3 * MM, rtol=1e-6)
    assert not found.lower.any() and not found.upper[0, 36:].any()
    assert np.ravel(arcs(found)) == pytest.approx((0, np.pi), abs=1e-6)
    assert found.axial_depth[0] == pytest.approx(3 * MM, rel=1e-6)
    assert radial_depth(found, FLAT)[0] == pytest.approx(10 * MM, rel=1e-6)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("wide", [0.1, 0.5, 1.0, 3.0, 5.0, 8.0])
def test_a_shoulder_ends_at_acos(wide: float, backwards: bool, direction: int) -> None:
    ends = np.array([[-10, R - wide, -2], [70, R - wide, -2]])
    path = through(ends[::-1] if backwards else ends, direction=direction)
    immersion = np.arccos(1 - 2 * wide / 10)
    # material on the right with M3: the tooth leaves it where it moves against the feed
    down = (direction > 0) != backwards
    errors = []
    for resolution in RESOLUTIONS:
        stock = block(y=(-20, 0), z=(-5, 0), resolution=resolution)
        found, _ = engage(path, [FLAT], stock)
        k = longest(found)
        begin, end = (one[k] for one in arcs(found))
        inner, outer = (begin, end) if down else (np.pi - begin, np.pi - end)[::-1]
        errors.append(abs(inner - (np.pi - immersion)))
        # at the outer end hardly a column is met: a step at the stock's edge that was joined shows
        assert abs(outer - np.pi) < np.radians(2.5)
        # a thin arc of two angles has none that is engaged over its whole width and way
        assert found.axial_depth[k] == pytest.approx(2 * MM, rel=0.04)
    # columns of one cell, spread over the 60 mm of the station: error across the feed ~ cell^2 / 60
    bounds = [4 * c**2 / 60 / (R * np.sin(immersion)) for c in RESOLUTIONS]
    assert np.all(np.array(errors) < bounds), (np.degrees(errors), np.degrees(bounds))


def corner_error(resolution: float) -> tuple[float, float]:
    """Greatest and mean error of the engaged angle on the way into an inside corner [rad]."""
    side, wall, radial_depth = 10.0, 40.0, 1.0
    stock = cleared(
        block(x=(-5, 60), y=(-20, 30), z=(-5, 0), resolution=resolution),
        lambda x, y: (x < wall) & (y > 0),
    )
    y = R - radial_depth
    found, _ = engage(through([[side, y, -2], [wall - 1, y, -2]]), [FLAT], stock)
    phi = (np.arange(3600) + 0.5) * np.pi / 3600
    error = np.empty(len(found))
    for k in range(len(found)):
        part = (np.arange(200) + 0.5) / 200
        x = side + (found.along[k] + found.length[k] * part[:, None]) / MM
        # the rim is beyond the wall ahead, or beyond the one on the right
        engaged = (x + R * np.sin(phi) > wall) | (y + R * np.cos(phi) < 0)
        error[k] = arc(found, 2.0)[k] - engaged.mean() * np.pi
    return float(np.abs(error).max()), float(np.abs(error) @ found.length / found.length.sum())


def test_engagement_rises_in_an_inside_corner() -> None:
    errors = np.degrees([corner_error(resolution) for resolution in (0.4, 0.2, 0.1, 0.05)])
    # a step in which the front wall is met first holds few columns: first order at most
    assert np.all(errors[:, 0] < [6, 3, 1.5, 0.75])
    assert np.all(errors[:, 1] < [0.8, 0.4, 0.2, 0.1])


def circle_errors(resolution: float) -> np.ndarray:
    """Errors of the engaged angle on a circle within a round pocket [rad]."""
    way, cleared_to = 10.0, 12.0
    stock = block(x=(-25, 25), y=(-25, 25), z=(-5, 0), resolution=resolution)
    stock = cleared(stock, lambda x, y: x**2 + y**2 < cleared_to**2)
    stock = cleared(stock, lambda x, y: (x - way) ** 2 + y**2 < R**2)
    turn = np.linspace(0, np.pi, 200)
    path = through(np.c_[way * np.cos(turn), way * np.sin(turn), np.full(200, -2)])
    found, _ = engage(path, [FLAT], stock)
    assert arcs(found)[1][60] == pytest.approx(np.pi, abs=1e-6)
    # the rim is outside of the cleared circle up to this angle from the outward direction
    engaged = np.arccos((cleared_to**2 - way**2 - R**2) / (2 * way * R))
    settled = found.piece > 40
    return arc(found, 2.0)[settled] - engaged


def test_a_circle_in_a_pocket_is_engaged_more_than_a_straight_wall() -> None:
    errors = [np.degrees(circle_errors(resolution)) for resolution in (0.4, 0.2, 0.1, 0.05)]
    means = np.abs([error.mean() for error in errors])
    # chords of 0.16 mm look two cells ahead, along the tangent: into the wall
    assert np.all(means < [3, 1.5, 0.75, 0.375])
    assert np.all([error.std() for error in errors] < np.array([2, 1, 0.5, 0.25]))
    # straight along a wall of the same width the arc is acos(1 - 2 a_e / D) = 66 degrees, not 79
    assert means.max() < 79 - 66


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_the_front_of_a_ramp_is_as_deep_as_the_tip(resolution: float) -> None:
    found, _ = engage(
        through([[5, 0, 0], [45, 0, -4]]), [FLAT], block(z=(-10, 0), resolution=resolution)
    )
    slope = 4 / np.hypot(40, 4)
    np.testing.assert_allclose(found.slope, -slope)
    middle = (found.along + found.length / 2) * slope
    half = found.length / 2 * slope
    depth = found.upper[:, :36].mean(axis=1)
    # within the station's own range of depth, a few columns off its middle
    assert np.all(np.abs(depth - middle) < np.maximum(0.3 * half, 0.1 * resolution * MM))
    assert not found.upper[:, 36:].any()
    # no station spans more than 5 % of its depth, from the first to the last of its steps
    step = max(2 * resolution, 0.5) * MM * slope
    assert np.all(2 * half <= 0.05 * (middle + half) + step)


def test_a_helix_is_engaged_all_around_its_front() -> None:
    turn = np.linspace(0, 4 * TURN, 401)
    path = through(np.c_[20 + 3 * np.cos(turn), 3 * np.sin(turn), -turn / TURN])
    found, _ = engage(path, [FLAT], block(x=(0, 40), resolution=0.2))
    # a hole of 16 mm, 4 deep, with a ramp of a turn left at its bottom
    hole = np.pi * 8**2 * 4
    assert hole - np.pi * 8**2 < found.volume.sum() / MM**3 < hole
    # after the first turn a turn's pitch is removed: nowhere deeper, and only in front
    later = found.piece > 105
    assert np.all(found.axial_depth[later] < 1.02 * MM)
    assert np.all(found.axial_depth[later] > 0.9 * MM)


DEPTH = 1.0
STEP_OVER = 2.0
ANGLES = (np.arange(72) + 0.5) * TURN / 72


def beside_a_groove(tool: Tool):
    """Height about a tool that goes beside the groove that it cut before, ``STEP_OVER`` away."""
    levels = np.linspace(0, 5 * MM, 20001)
    radius, _ = surface(tool, levels)

    def height(x, y):
        off = np.abs(y + STEP_OVER * MM)
        # a radius that several levels have is the wall's: the lowest of them
        within = np.searchsorted(radius, off)
        bottom = levels[np.minimum(within, len(levels) - 1)]
        bottom = np.where(within < len(levels), bottom, np.inf)
        return np.minimum(0, -DEPTH * MM + bottom) + 0 * x

    return height


@pytest.mark.parametrize("tool", [BALL, BULL_NOSE], ids=lambda tool: tool.kind)
@pytest.mark.parametrize("pieces", [1, 160])
def test_a_pass_beside_another(tool: Tool, pieces: int) -> None:
    x = np.linspace(-10, 70, pieces + 1)
    first = through([[-10, 0, -DEPTH], [70, 0, -DEPTH]])
    second = through(np.c_[x, np.full_like(x, STEP_OVER), np.full_like(x, -DEPTH)])
    _, left = engage(first, [tool], block(z=(-5, 0)))
    found, _ = engage(second, [tool], left)
    exact = engaged_height(tool, ANGLES, beside_a_groove(tool), tip=-DEPTH * MM, top=2 * DEPTH * MM)
    middle = np.abs(found.along + 0.5 * MM * found.piece * (pieces > 1) - 40 * MM) < 15 * MM
    if pieces == 1:
        middle = found.length == found.length.max()
    depth = (found.upper - found.lower)[middle].mean(axis=0)
    # an end is taken in 12 slices, of which the highest is cut in part: half of a twelfth
    assert np.abs(depth - exact).sum() < 0.05 * exact.sum()
    assert depth.sum() == pytest.approx(exact.sum(), rel=0.05)
    # what lies outside of the slices' middles is a share of one slice, 0.08 mm high
    assert np.all(found.lower[middle] < 0.08 * MM)


def ramp_errors(tool: Tool, slope: float, resolution: float) -> np.ndarray:
    """Relative errors of the engaged height along a ramp of a flat surface [1]."""
    ends = np.array([[5, 0, 0], [5 + 4 / abs(slope), 0, -4]])
    if slope > 0:
        ends[:, 2] = [-4, 0]
    found, _ = engage(through(ends), [tool], block(z=(-9, 0), resolution=resolution))
    middle = (found.along + found.length / 2) * slope / np.hypot(1, slope) + ends[0, 2] * MM
    front, errors = slice(36), []
    # not where the tool dips in or leaves: no cell's width of its end is engaged there
    for k in np.flatnonzero((middle < -0.8 * MM) & (middle > -3.6 * MM)):
        exact = engaged_height(
            tool, ANGLES, lambda x, y: 0 * x * y, tip=middle[k], slope=slope, top=6 * MM
        )
        depth = (found.upper - found.lower)[k]
        errors.append(depth[front].sum() / exact[front].sum() - 1)
    return np.abs(errors)


@pytest.mark.parametrize("tool", [BALL, BULL_NOSE], ids=lambda tool: tool.kind)
@pytest.mark.parametrize(
    ("slope", "bounds"), [(0.3, (0.28, 0.1, 0.05)), (-0.3, (0.04, 0.03, 0.03))]
)
def test_a_ramp_up_and_down(tool: Tool, slope: float, bounds: tuple[float, ...]) -> None:
    errors = [ramp_errors(tool, slope, resolution) for resolution in (0.4, 0.2, 0.1)]
    # uphill the tool moves away from what its lowest part has cut: slices of few cells there
    assert np.all(np.array([error.max() for error in errors]) < bounds)
    assert np.all(np.array([error.mean() for error in errors]) < np.array(bounds) / 2)


def test_uphill_the_lowest_part_of_a_ball_does_not_cut() -> None:
    slope = 0.5
    path = through([[5, 0, -4], [13, 0, -4 + 8 * slope]])
    found, _ = engage(path, [BALL], block(z=(-9, 0), resolution=0.1))
    # abreast of the feed the surface rises by the slope at R (1 - cos(atan(slope)))
    lowest = 5 * (1 - np.cos(np.arctan(slope))) * MM
    deep = slice(2, len(found) // 2)
    # a slice of 7.5 degrees, 0.3 mm high there, is cut or not
    assert found.lower[deep, 17:19].mean() == pytest.approx(lowest, abs=0.16 * MM)
    # the wall beside it does not move away: there the part that cuts begins higher
    assert np.all(found.lower[deep, 5] > 2 * lowest)


def test_a_drill_engages_its_point_only() -> None:
    found, _ = engage(through([[0, 0, 2], [0, 0, -12]]), [DRILL], block(x=(-20, 20)))
    point = 5 / np.tan(np.radians(59)) * MM
    k = int(np.argmax(found.length))
    np.testing.assert_allclose(found.upper[k], point, rtol=1e-4)
    np.testing.assert_allclose(found.lower[k], 0, atol=1e-6)
    assert found.plunge.all()
    # it takes the point's height until it is all in, one station a step, and then nothing changes
    assert found.along[k] == pytest.approx(2 * MM + point, abs=0.6 * MM)
    assert found.along[k] + found.length[k] == pytest.approx(14 * MM)


def test_a_flat_plunge_is_as_thick_as_the_map_resolves() -> None:
    tool = Tool(kind="flat", diameter_mm=6, flutes=2)
    found, _ = engage(through([[0, 0, 1], [0, 0, -5]]), [tool], block(x=(-20, 20), resolution=0.25))
    assert len(found) == 1
    np.testing.assert_allclose(found.upper - found.lower, 0.25 * MM, rtol=1e-6)
    assert found.slope[0] == -1
    assert found.volume[0] / found.length[0] <= np.pi * tool.radius**2


def test_a_plunge_at_an_edge_is_engaged_on_the_material_side() -> None:
    stock = block(x=(0, 20), y=(-20, 20))
    found, _ = engage(through([[0, 0, 1], [0, 0, -5]]), [BALL], stock)
    k = int(np.argmax(found.length))
    # the reference is +x, phi = 0 to its left: the material is in front
    assert found.upper[k, 1:35].min() > 4.5 * MM
    # near the tip an angle without a column has its neighbour's
    assert np.all((found.upper - found.lower)[k, 37:71] < 0.1 * MM)


def test_a_cut_below_the_floor_is_engaged_above_it() -> None:
    flat = Tool(kind="flat", diameter_mm=10, flutes=2)
    found, left = engage(through([[-10, 0, -8], [70, 0, -8]]), [flat], block(z=(-5, 0)))
    k = int(np.argmax(found.length))
    np.testing.assert_allclose(found.lower[k, :36], 3 * MM, rtol=1e-6)
    # but for the air of a step at the edge that was joined
    np.testing.assert_allclose(found.upper[k, :36], 8 * MM, rtol=0.05)
    assert left.heights.min() == np.float32(-5 * MM)
