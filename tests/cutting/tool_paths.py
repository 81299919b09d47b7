"""Paths and stocks that several tests cut."""

import numpy as np

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engaged_arc
from pipeline.cutting.engagement.stock import Box, HeightMap, height_map
from pipeline.cutting.tool import Tool

MM = 1e-3
TURN = 2 * np.pi
FLAT = Tool(kind="flat", diameter_mm=10, flutes=2)
BALL = Tool(kind="ball", diameter_mm=10, flutes=2)
BULL_NOSE = Tool(kind="bull_nose", diameter_mm=10, flutes=2, corner_radius_mm=2)
DRILL = Tool(kind="drill", diameter_mm=10, flutes=2, point_angle_deg=118)


def through(points_mm, *, direction: int = 1, feed: bool = True) -> ToolPath:
    """Straight pieces through points (Q + 1, 3) [mm], each a block of its own."""
    points = np.asarray(points_mm, float) * MM
    many = len(points) - 1
    return ToolPath(
        start=points[:-1].copy(),
        end=points[1:].copy(),
        block=np.arange(many, dtype=np.int32),
        tool=np.zeros(many, np.int32),
        feed=np.full(many, feed),
        direction=np.full(many, direction, np.int8),
    )


def arcs(found: Engagement) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of the longest engaged arc of each station [rad], NaN without one."""
    return engaged_arc(found.upper - found.lower)


def radial_depth(found: Engagement, tool: Tool) -> np.ndarray:
    """a_e [m]: width across the feed of the longest engaged arc, at full diameter."""
    begin, end = arcs(found)
    # what is engaged behind the tool is as wide as the tool
    return np.nan_to_num(tool.radius * (np.cos(begin) - np.cos(np.minimum(end, np.pi))))


def block(x=(0, 60), y=(-20, 20), z=(-20, 0), resolution=0.2) -> HeightMap:
    """A box [mm]."""
    return height_map(Box(x_mm=x, y_mm=y, z_mm=z), resolution * MM)


def cleared(stock: HeightMap, where, height_mm: float | None = None) -> HeightMap:
    """The stock with the columns at which ``where(x, y)`` [mm] lowered to a height."""
    from dataclasses import replace

    from pipeline.cutting.engagement.stock import rows_of

    heights = stock.heights.copy()
    low = stock.floor if height_mm is None else height_mm * MM
    for row, (x, y) in enumerate(rows_of(stock)):
        heights[row, where(x / MM, y / MM)] = low
    return replace(stock, heights=heights)
