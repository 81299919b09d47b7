"""Forces of an end mill on any way through a swept blank, tooth after tooth (numba).

Seen from above the spindle turns clockwise (M3); a tooth stands at the angle φ from +Y in the sense
of its motion, its edge point at c + R (sin φ, cos φ) about the tool's centre c.  The chip is as
thick as the way from the edge point back along its radius to where the teeth before it, about the
centres of their own moments and on their own radii, left the material; there is one where the
material of that place was not swept before.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from pipeline.shop.cutting_force import Law, edge_force

RECENT = 0.6
"""Way within which what the tool has swept is looked up turn by turn, not in the cells [mm]."""
CLEAR = 0.02
"""How far inside an earlier circle a place counts as swept by it [mm]."""
STILL = 1e-7
"""Changes of height that count as none [mm]."""


class Cutter(NamedTuple):
    """The mounted tool: lengths in mm, angles in rad; runout and tilt as of ``EndMill``."""

    radius: float
    lag: float  # of the edge for each mm up [rad/mm]
    runout: float
    runout_angle: float
    tilt: float  # [1]
    tilt_angle: float


class Layers(NamedTuple):
    """The blank: box [mm], first ways by cell, slices by their layer and heights."""

    low_x: float
    high_x: float
    low_y: float
    high_y: float
    first: np.ndarray  # (L, rows, columns) [mm]
    corner_x: float
    corner_y: float
    cell: float
    layer: np.ndarray  # (S,)
    low: np.ndarray  # (S,) [mm]
    high: np.ndarray


class Steps(NamedTuple):
    """Of the tool, (N,) each: first tooth's angle [rad]; x, y, z of the tip, its way [mm]."""

    angle: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    way: np.ndarray


@njit(cache=True, nogil=True)
def forces(
    law: Law, cutter: Cutter, sharpness: np.ndarray, layers: Layers, steps: Steps, turn: int,
    begin: int,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """Forces on the tool along X and Y [N] from the step ``begin`` on, and how often a tooth cut.

    Parameters
    ----------
    law, cutter
        Of the edge, of the tool.
    sharpness : (F,) array
        Factor of each tooth's own edge force.
    layers, steps
        The blank; the tool's motion in equal parts of a turn.
    turn : int
        Steps of a turn, a multiple of F.
    begin : int
        First step that counts, at least one turn after the first.

    Returns
    -------
    (N - begin, 2) array, int
        Forces; steps in which a tooth cuts in its lowest slice, of all teeth together.
    """
    flutes, slices = sharpness.size, layers.layer.size
    radii, ahead, behind = np.zeros((flutes, slices)), np.zeros(slices), np.zeros(slices)
    height = np.zeros(slices)
    out = np.zeros((steps.angle.size - begin, 2))
    level, lowest, count = np.inf, 0, 0
    for k in range(begin, steps.angle.size):
        if abs(steps.z[k] - level) > STILL:
            level = steps.z[k]
            lowest = _edges(cutter, layers, level, radii, ahead, behind, height)
        for tooth in range(flutes):
            tip = steps.angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(tip), np.cos(tip)
            for s in range(lowest, slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = _chip(radii, tooth, s, sine, cosine, steps, k, turn)
                if h <= 0.0 or not _there(layers, s, radii[tooth, s], sine, cosine, steps, k,
                                          turn, cutter.radius):  # fmt: skip
                    continue
                t, r, _ = edge_force(law, h * 1e-3, sharpness[tooth])
                out[k - begin, 0] -= (t * cosine + r * sine) * height[s] * 1e-3
                out[k - begin, 1] += (t * sine - r * cosine) * height[s] * 1e-3
                count += s == lowest
    return out, count


@njit(cache=True, nogil=True)
def _edges(
    cutter: Cutter, layers: Layers, level: float, radii: np.ndarray, ahead: np.ndarray,
    behind: np.ndarray, height: np.ndarray,
) -> int:  # fmt: skip
    """Radii, lags and heights of the slices above the tip at ``level``; the lowest of them."""
    flutes, slices = radii.shape
    lowest = slices
    for s in range(slices - 1, -1, -1):
        if s < slices - 1 and layers.high[s] - level <= STILL:
            break
        low = max(layers.low[s], level)
        height[s] = max(layers.high[s] - low, 0.0)
        lowest = s
        up = (layers.high[s] + low) / 2 - level
        lag = up * cutter.lag
        ahead[s], behind[s] = np.cos(lag), np.sin(lag)
        for tooth in range(flutes):
            place = -2 * np.pi * tooth / flutes - lag
            radii[tooth, s] = (
                cutter.radius + cutter.runout * np.cos(cutter.runout_angle - place)
                + cutter.tilt * up * np.cos(cutter.tilt_angle - place)
            )  # fmt: skip
    return lowest


@njit(cache=True, nogil=True)
def _chip(
    radii: np.ndarray, tooth: int, s: int, sine: float, cosine: float, steps: Steps, k: int,
    turn: int,
) -> float:  # fmt: skip
    """Thickness between a tooth's way and those of the teeth before it [mm]; see ``chip``."""
    flutes, own = radii.shape[0], radii[tooth, s]
    part = turn // flutes
    left = 0.0
    for back in range(flutes, 0, -1):  # one's own way first: behind the tool it ends the search
        then, before = k - back * part, radii[(tooth - back) % flutes, s]
        dx, dy = steps.x[then] - steps.x[k], steps.y[then] - steps.y[k]
        # that tooth crossed this radius a little off the full pitches: its centre had gone on
        bend = -(dx * cosine - dy * sine) / before
        gone = 1.0 - bend / (2 * np.pi * back / flutes)
        bend *= gone
        left = max(left, before * (1 - bend * bend / 2) + (dx * sine + dy * cosine) * gone)
        if left >= own:
            return 0.0
    return own - left


@njit(cache=True, nogil=True)
def _there(
    layers: Layers, s: int, own: float, sine: float, cosine: float, steps: Steps, k: int,
    turn: int, radius: float,
) -> bool:  # fmt: skip
    """Whether an edge point is in material: in the blank, and not swept in an earlier turn."""
    x, y = steps.x[k] + own * sine, steps.y[k] + own * cosine
    if x < layers.low_x or x > layers.high_x or y < layers.low_y or y > layers.high_y:
        return False
    first = layers.first[layers.layer[s]]
    row = min(int((y - layers.corner_y) / layers.cell), first.shape[0] - 1)
    column = min(int((x - layers.corner_x) / layers.cell), first.shape[1] - 1)
    since = steps.way[k] - first[max(row, 0), max(column, 0)]
    if since > RECENT:
        return False
    then = k - turn
    if since <= steps.way[k] - steps.way[then]:
        return True
    clear = (radius - CLEAR) ** 2
    while then >= 0 and steps.way[k] - steps.way[then] <= RECENT:
        if (x - steps.x[then]) ** 2 + (y - steps.y[then]) ** 2 < clear:
            return False
        then -= turn
    return True
