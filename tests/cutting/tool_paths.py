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


BINS = 72


def arc(phi_st: float, phi_ex: float, a_p: float, low: float = 0.0, bins: int = BINS):
    """Profile of a constant engagement: heights between angles, whole bins only."""
    phi = (np.arange(bins) + 0.5) * (2 * np.pi / bins)
    inside = (phi >= phi_st) & (phi < phi_ex)
    return np.where(inside, low, 0.0), np.where(inside, a_p, 0.0)


def stations(profiles, block, blocks: int, *, tool=None, slope=0.0, length=1e-3) -> Engagement:
    """Stations of profiles (lower, upper), in order; other columns as given or all the same."""
    many = len(profiles)
    each = {
        name: np.broadcast_to(np.asarray(value, dtype=np.float64), (many,)).copy()
        for name, value in (("slope", slope), ("length", length))
    }
    return Engagement(
        piece=np.arange(many, dtype=np.int32),
        block=np.asarray(block, dtype=np.int32),
        tool=np.zeros(many, np.int32) if tool is None else np.asarray(tool, dtype=np.int32),
        along=np.zeros(many),
        lower=np.array([one[0] for one in profiles], dtype=np.float32).reshape(many, BINS),
        upper=np.array([one[1] for one in profiles], dtype=np.float32).reshape(many, BINS),
        volume=np.zeros(many),
        feed=np.ones(many, dtype=bool),
        blocks=blocks,
        resolution=1e-4,
        **each,
    )


def random_profile(rng: np.random.Generator, least: float = 0.2):
    """An arc of uneven depth, as a stock that was cut before leaves it."""
    begin = rng.uniform(0, np.pi - least)
    lower, upper = arc(begin, rng.uniform(begin + least, np.pi), rng.uniform(1e-3, 6e-3))
    phi = (np.arange(BINS) + 0.5) * (2 * np.pi / BINS)
    return lower, upper * (1 + 0.2 * np.sin(3 * phi + rng.uniform(0, 6)))
