"""Shank and holder of a tool over the stock as it is when they pass."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.cutting.engagement.clearance import BODIES, bodies, contacts
from pipeline.cutting.engagement.stock import Box, height_map, rows_of
from pipeline.cutting.tool import Tool
from tests.cutting.tool_paths import through

MM = 1e-3
STOCK = height_map(Box(x_mm=(0, 60), y_mm=(0, 40), z_mm=(-50, 0)), 0.5 * MM)
TOOL = Tool(
    kind="flat", diameter_mm=10.0, flutes=2, flute_length_mm=20.0, stickout_mm=30.0,
    holder_diameter_mm=30.0,
)  # fmt: skip


def met(points, tool=TOOL):
    """Piece, body and depth [mm] of each contact along straight pieces through points [mm]."""
    found = contacts(through(points), [tool], STOCK)
    return [
        (piece, BODIES[body], pytest.approx(depth / MM, abs=1e-4))
        for piece, body, depth in zip(*(column.tolist() for column in found), strict=True)
    ]


@pytest.mark.parametrize(("depth", "deep"), [(25, 0), (30, 0), (30.1, 0.1), (38, 8)])
def test_a_holder_goes_as_deep_as_the_tip_passes_the_stickout(depth, deep):
    found = met([(-30, 20, -depth), (90, 20, -depth)])
    assert found == ([(0, "holder", deep)] if deep else [])


@pytest.mark.parametrize(("beside", "touches"), [(14.9, True), (15.1, False)])
def test_a_holder_beside_the_part_reaches_by_its_radius(beside, touches):
    assert bool(met([(-30, -beside, -40), (90, -beside, -40)])) is touches


def test_what_was_cut_before_is_in_nobodys_way():
    """A wide step first: the holder then has room over the slot in it."""
    step = [(x, y, -15) for y in range(1, 40, 4) for x in ((-30, 90) if y % 8 == 1 else (90, -30))]
    slot = [(90, 20, 5), (-30, 20, 5), (-30, 20, -40), (90, 20, -40)]
    assert met(slot)[0][1:] == ("holder", 10)
    assert met([*step, *slot]) == []


def test_a_shank_wider_than_the_flutes_begins_above_them():
    wide = Tool(kind="flat", diameter_mm=10.0, flutes=2, flute_length_mm=20.0,
                shank_diameter_mm=12.0, stickout_mm=60.0, holder_diameter_mm=30.0)  # fmt: skip
    slot = [(-30, 20, -25), (90, 20, -25)]
    assert met(slot, wide) == [(0, "shank", 5)]
    assert met(slot) == []
    assert not np.isfinite(bodies(Tool(kind="flat", diameter_mm=10.0, flutes=2))[:, 1]).any()


def test_contacts_are_those_of_columns_and_discs():
    """An independent restatement, column by column, along a path that goes down and up."""
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(0, 60, 12), rng.uniform(0, 40, 12),
                              rng.uniform(-45, -5, 12)])  # fmt: skip
    place = np.array([np.column_stack([x, y]) for x, y in rows_of(STOCK)]) / MM
    heights = np.zeros(STOCK.heights.shape)
    deepest = []
    for a, b in pairwise(points):
        steps = int(np.ceil(np.hypot(*(b - a)[:2]) / 0.5))
        most = 0.0
        for share in np.arange(steps + 1) / steps:
            tip = a + share * (b - a)
            r = np.hypot(*(place - tip[:2]).transpose(2, 0, 1))
            heights = np.where(r < 5, np.minimum(heights, tip[2]), heights)
            most = max(most, float((heights[r < 15] - tip[2] - 30).max(initial=0.0)))
        deepest.append(most)
    found = np.zeros(len(deepest))
    for piece, _, depth in zip(*contacts(through(points), [TOOL], STOCK), strict=True):
        found[piece] = depth / MM
    np.testing.assert_allclose(found, deepest, atol=1e-4)  # heights are single precision
