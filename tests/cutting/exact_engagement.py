"""Engagement restated: each point of the tool's surface is in the material and moves into it."""

from collections.abc import Callable

import numpy as np

from pipeline.cutting.tool import Tool

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
