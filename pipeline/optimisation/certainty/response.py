"""Loads of each class' representative in each draw, over the feed for each tooth."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.drawn_peaks import drawn_peaks, edge_turn
from pipeline.optimisation.certainty.critical import Critical
from pipeline.optimisation.certainty.draws import Draws, ToolDraws
from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

NODES = np.array([0.01, 0.1, 0.25, 0.42, 0.6, 0.8, 1.0])
"""Feeds at which a class is computed, over its greatest."""
CLOSE = 1.25
"""Two nodes next to each other, greater over less."""
FEW, MANY = 2, 6
DEPTHS = 7
"""Depths at which a class is computed."""
FLOOR = 1e-4
"""Height up to which material counts as lying on the tool's tip [m]."""
SKIN = 1e-6
"""Height that is left in the material [m]."""
STEEP = np.sqrt(0.5)
"""Slope from which on a tool cuts with its end: a plunge is as deep as it goes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Loads of the representatives of C classes, in D draws.

    Parameters
    ----------
    f_z : ndarray, shape (C, K)
        Feeds, rising [m].
    expected : ndarray, shape (C, K)
        Without uncertainty [N].
    values : ndarray, shape (C, K, D)
        In the draws [N].
    """

    f_z: Floats = field(repr=False)
    expected: Floats = field(repr=False)
    values: Floats = field(repr=False)


def nodes_below(most: Floats) -> Floats:
    """Feeds of classes whose greatest are given, shape (C,), down to none; shape (C, K)."""
    return most[:, None] * NODES


def nodes_between(least: Floats, most: Floats) -> Floats:
    """Feeds of classes that span the given ones, shape (C, K)."""
    span = float((most / least).max(initial=1.0))
    many = int(np.clip(np.ceil(np.log(span) / np.log(CLOSE)) + 1, FEW, MANY))
    return np.geomspace(least, most * (1 + 1e-9), many, axis=1)


def responses(cut: Cut, found: Critical, f_z: Floats, draws: Draws) -> Responses:
    """Loads of all representatives at feeds of shape (C, K)."""
    values, expected = np.empty((*f_z.shape, len(draws))), np.empty(f_z.shape)
    for one in range(found.classes):
        drawn = draws.tools[cut.numbers[found.tool[one]]]
        _fill(cut, int(found.station[one]), f_z[one], drawn, expected[one], values[one])
    values *= draws.model
    return Responses(f_z=f_z, expected=expected, values=values)


def _fill(
    cut: Cut, station: int, f_z: Floats, drawn: ToolDraws, expected: Floats, out: Floats
) -> None:
    """Fill ``expected`` of shape (K,) and ``out`` of shape (K, D) for one station."""
    engagement = cut.engagement
    tool, law = cut.tools[engagement.tool[station]], cut.laws[engagement.tool[station]]
    slope = float(engagement.slope[station])
    lower = engagement.lower[station].astype(np.float64)
    upper = engagement.upper[station].astype(np.float64)
    nominal = np.concatenate([law.cutting, law.edge])[np.newaxis]
    offset = tool.runout * np.array([[np.cos(tool.runout_angle), np.sin(tool.runout_angle)]])

    def nominal_peaks(depth: float) -> Floats:
        turn = edge_turn(tool, *deeper(lower, upper, depth, slope), slope=slope)
        return drawn_peaks(turn, nominal, offset, f_z, m_c=law.m_c)[:, 0]

    turn = edge_turn(tool, lower, upper, slope=slope)
    expected[:] = drawn_peaks(turn, nominal, offset, f_z, m_c=law.m_c)[:, 0]
    out[:] = drawn_peaks(turn, drawn.coefficients, drawn.offsets, f_z, m_c=law.m_c)
    reach = float(np.abs(drawn.depth).max(initial=0.0))
    if reach == 0.0 or tool.kind == "drill" or abs(slope) > STEEP or not (expected > 0).all():
        return
    depths = np.linspace(-reach, reach, DEPTHS)
    shifted = np.stack([nominal_peaks(depth) for depth in depths.tolist()])
    for k in range(len(f_z)):
        out[k] *= np.interp(drawn.depth, depths, shifted[:, k] / expected[k])


def deeper(lower: Floats, upper: Floats, depth: float, slope: float = 0.0) -> tuple[Floats, Floats]:
    """Heights in the material of a tool that stands deeper by ``depth`` [m]; no arc changes.

    What lies on the tool's tip stays there, for the material below is as much as before; on its way
    down a tool's end stays in the material at any depth.
    """
    there = upper > lower
    least = SKIN if slope < 0 else 0.0
    raised = np.where(there, np.maximum(upper + depth, least), upper)
    low = np.where(there & (lower > 2 * FLOOR), np.maximum(lower + depth, 0.0), lower)
    return np.minimum(low, raised), raised
