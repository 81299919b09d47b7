"""Rounded and pointed ends: engaged heights against a restatement that samples the surface."""

import numpy as np
import pytest

from pipeline.cutting.engagement import engage
from pipeline.cutting.tool import Tool
from tests.cutting.exact_engagement import engaged_height, surface
from tests.cutting.tool_paths import BALL, BULL_NOSE, DRILL, MM, TURN, block, through

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
