"""What people ask of an engagement: arc from entry to exit, radial depth, thickest chip."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement import Engagement
from pipeline.cutting.engagement_arc import engaged_arc
from pipeline.cutting.tool import Tool

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Stations:
    """N stations; every array has shape (N,).

    Parameters
    ----------
    entry, exit : ndarray
        Of the longest engaged arc on the side where chips are, 0 to pi [rad].
    radial : ndarray
        Width of that arc across the feed [m].
    thickness : ndarray
        Of the thickest chip, over the feed for each tooth [1].
    """

    entry: Floats
    exit: Floats
    radial: Floats
    thickness: Floats


def stations(engagement: Engagement, tools: tuple[Tool, ...]) -> Stations:
    """Arcs of the stations of an engagement.

    A plunge cuts all around: 0 to 2 pi, as wide as the tool.
    """
    inside = engagement.upper > engagement.lower
    ahead = inside & (np.sin(engagement.angles) > 0)
    entry, leave = engaged_arc(np.where(ahead, engagement.upper - engagement.lower, 0.0))
    plunge = np.abs(engagement.slope) > np.sqrt(0.5)
    whole = plunge & (inside.mean(axis=1) > 0.5)
    radius = np.array([tool.radius for tool in tools])[engagement.tool]
    width = np.cos(entry) - np.cos(leave)
    return Stations(
        entry=np.where(whole, 0.0, np.nan_to_num(entry)),
        exit=np.where(whole, 2 * np.pi, np.nan_to_num(leave)),
        radial=radius * np.where(whole, 2.0, np.nan_to_num(width)),
        thickness=_thickness(engagement, tools, ahead, plunge),
    )


def _thickness(
    engagement: Engagement, tools: tuple[Tool, ...], ahead: NDArray[np.bool_],
    plunge: NDArray[np.bool_],
) -> Floats:  # fmt: skip
    """sin(phi) sin(kappa) at its greatest; of a drill the sine of half its point."""
    corner = np.array([tool.corner_radius for tool in tools])[engagement.tool]
    deep = np.divide(
        engagement.upper, corner[:, None], out=np.ones(engagement.upper.shape),
        where=corner[:, None] > 0,
    )  # fmt: skip
    steep = np.sqrt(1 - (1 - np.clip(deep, 0.0, 1.0)) ** 2)
    chip = np.where(ahead, np.sin(engagement.angles) * steep, 0.0).max(axis=1, initial=0.0)
    point = np.array([
        np.sin(tool.point_angle / 2) if tool.kind == "drill" else 1.0 for tool in tools
    ])[engagement.tool]  # fmt: skip
    thickest: Floats = np.where(plunge, point, chip)
    return thickest
