"""Clearance of shank and holder, cylinders above the cutting edges, over the current stock.

The tool is followed in steps of a cell; at each it cuts the columns under its end, and those that
still stand higher than the underside of shank or holder, within its radius, are in its way.  What
the holder's own cylinder touches stays: it does not cut.  What is above the holder is left out.
"""

from collections.abc import Sequence
from math import ceil, hypot, inf
from typing import NamedTuple

import numpy as np

from pipeline.cutting.engagement.engagement import ToolPath, grid_of
from pipeline.cutting.engagement.stock import HeightMap
from pipeline.cutting.engagement.sweep_columns import SKIN, cell_range, end_height
from pipeline.cutting.engagement.sweep_workspace import tool_profiles
from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import MM

BODIES = ("shank", "holder")


class Contacts(NamedTuple):
    """Contacts of tool bodies with the material; N of them, in the order of the path.

    ``piece`` of the path, ``body``: index into :data:`BODIES`, ``depth`` of its underside below the
    highest column in its way, at most along the piece [m].
    """

    piece: Ints
    body: Ints
    depth: Floats


def bodies(tool: Tool) -> Floats:
    """Radius of shank and holder and the height of their undersides above the tip [m]; (2, 2).

    One that is not listed, or no wider than the cutting edges, begins at infinity.
    """
    found = np.array([[0.0, inf], [0.0, inf]])
    if tool.flute_length_mm is not None and tool.shank_diameter > tool.diameter:
        found[0] = tool.shank_diameter / 2, tool.flute_length_mm * MM
    if tool.stickout_mm is not None and tool.holder_diameter_mm is not None:
        found[1] = tool.holder_diameter_mm / 2 * MM, tool.stickout_mm * MM
    return found


def contacts(path: ToolPath, tools: Sequence[Tool], stock: HeightMap) -> Contacts:
    """Contacts of a tool's shank or holder with the material along a path in the stock's frame.

    ``tools`` are those that ``path.tool`` counts; the stock is not changed.
    """
    each = np.array([bodies(tool) for tool in tools])
    top = float(stock.heights.max(initial=stock.floor))
    # only a tip this deep brings a body below the top of the blank
    lowest = np.minimum(path.start[:, 2], path.end[:, 2])
    deep = np.flatnonzero(lowest + each[path.tool, :, 1].min(axis=1) < top)
    depth = np.zeros((len(path), len(BODIES)))
    if len(deep):
        many = int(deep[-1]) + 1
        _follow(
            np.ascontiguousarray(path.start[:many]), np.ascontiguousarray(path.end[:many]),
            np.ascontiguousarray(path.tool[:many]), tool_profiles(tools), each,
            grid_of(stock, tools), depth,
        )  # fmt: skip
    piece, body = np.nonzero(depth > SKIN)
    return Contacts(piece, body, depth[piece, body])


@compiled
def _follow(start, end, tool_of, profiles, bodies, grid, depth):  # type: ignore[no-untyped-def]
    """Fill ``depth``, shape (pieces, 2) [m]."""
    for piece in range(start.shape[0]):
        x, y, z = start[piece, 0], start[piece, 1], start[piece, 2]
        dx, dy, dz = end[piece, 0] - x, end[piece, 1] - y, end[piece, 2] - z
        steps = max(1, ceil(hypot(dx, dy) / grid.cell))
        for step in range(steps + 1):
            share = step / steps
            if z + share * dz < grid.top:
                _pass(
                    grid, profiles, tool_of[piece], bodies, x + share * dx, y + share * dy,
                    z + share * dz, depth[piece],
                )  # fmt: skip


@compiled
def _pass(grid, profiles, tool, bodies, x, y, z, depth):  # type: ignore[no-untyped-def]
    """Cut the columns under a tool whose tip is at a place; how deep its bodies are in others."""
    heights, cell, radius = grid.heights, grid.cell, profiles.radius[tool]
    widest = radius
    for body in range(bodies.shape[1]):
        if z + bodies[tool, body, 1] < grid.top:
            widest = max(widest, bodies[tool, body, 0])
    first, after = cell_range(grid.y0, cell, y - widest, y + widest, heights.shape[0], 0)
    one, end = cell_range(grid.x0, cell, x - widest, x + widest, heights.shape[1], 0)
    for row in range(first, after):
        for column in range(one, end):
            if heights[row, column] <= z:
                continue
            dx = grid.x0 + (column + grid.x_shifts[row + grid.margin]) * cell - x
            dy = grid.y0 + (row + grid.y_shifts[column + grid.margin]) * cell - y
            r = hypot(dx, dy)
            if r < radius:
                left = z + end_height(
                    profiles.kind[tool], profiles.flat[tool], profiles.corner[tool],
                    profiles.cone[tool], r,
                )  # fmt: skip
                heights[row, column] = min(heights[row, column], np.float32(max(left, grid.floor)))
            for body in range(bodies.shape[1]):
                if r < bodies[tool, body, 0]:
                    above = heights[row, column] - z - bodies[tool, body, 1]
                    depth[body] = max(depth[body], above)
