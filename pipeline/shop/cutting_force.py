"""Forces of an end mill on true tooth paths, with runout and tilt, step by step (numba).

Seen from above the spindle turns clockwise (M3) and the tool goes along +x; y is to the left of it.
A tooth stands at the angle φ from +y in the sense of its motion: its edge point is at
c + R (sin φ, cos φ) about the tool's centre c.  The chip is as thick as the way from the edge point
back along its radius to where the teeth before it, on their own trochoids and radii, left the
material, or to the face of the block.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

X, Y, AXIAL, TORQUE = range(4)
"""Columns of the forces: on the tool along the feed and to the left of it, along the axis as the
edge lifts the material [N]; against the spindle [N m]."""
ROUNDS = 2
"""Of the search for the place where an earlier tooth crossed the radius; each gains two digits."""


class Law(NamedTuple):
    """Force of an edge: cutting [Pa] and edge [N/m], tangential, radial, axial."""

    cutting: tuple[float, float, float]
    edge: tuple[float, float, float]
    flank: tuple[float, float, float]
    thickness: float  # [m], where ``cutting`` holds
    exponent: float
    ploughing: float  # [m]


class Block(NamedTuple):
    """The material: 0 <= x <= length, from y = low to high [m] about the tool's centre."""

    length: float
    low: float
    high: float


@njit(cache=True)
def edge_force(law: Law, h: float, sharpness: float) -> tuple[float, float, float]:
    """Tangential, radial, axial force of an edge for each width of a chip ``h`` [m] thick [N/m]."""
    if h <= 0.0:
        return 0.0, 0.0, 0.0
    section = h * (h / law.thickness) ** -law.exponent
    whole = 1.0 - np.exp(-h / law.ploughing)
    return (
        law.cutting[0] * section + (law.edge[0] * sharpness + law.flank[0]) * whole,
        law.cutting[1] * section + (law.edge[1] * sharpness + law.flank[1]) * whole,
        law.cutting[2] * section + (law.edge[2] * sharpness + law.flank[2]) * whole,
    )


@njit(cache=True)
def chip(
    radii: np.ndarray, tooth: int, s: int, sine: float, cosine: float, feed: float, x: float,
    block: Block,
) -> float:  # fmt: skip
    """Thickness of the chip at slice ``s`` of a tooth at the angle of ``sine`` and ``cosine`` [m].

    Parameters
    ----------
    radii : (F, S) array
        Of each tooth in each slice [m].
    tooth, s : int
        Which of them.
    sine, cosine : float
        Of the edge point's angle [1].
    feed : float
        Of the tool for each radian of its turn [m].
    x : float
        Of the tool's centre [m].
    block : Block
        The material.
    """
    flutes, own = radii.shape[0], radii[tooth, s]
    across, ahead = own * cosine, x + own * sine
    if across < block.low or across > block.high or ahead < 0.0 or ahead > block.length:
        return 0.0
    pitch = 2 * np.pi / flutes
    left = 0.0
    for back in range(flutes, 0, -1):  # one's own way first: behind the tool it ends the search
        before = radii[(tooth - back) % flutes, s]
        bend, way = 0.0, 0.0
        for _ in range(ROUNDS):
            way = feed * (back * pitch - bend)
            share = way * cosine / before
            bend = share + share**3 / 6
        left = max(left, before * (1 - bend**2 / 2) - way * sine)
        if left >= own:
            return 0.0
    thick = own - left
    if sine > 0.0:
        thick = min(thick, ahead / sine)
    return max(thick, 0.0)


@njit(cache=True)
def forces(
    law: Law, block: Block, radii: np.ndarray, sharpness: np.ndarray, lag: np.ndarray,
    height: float, angle: np.ndarray, x: np.ndarray, feed: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Forces on the tool at each step, shape (T, 4).

    Parameters
    ----------
    law, block
        What is cut.
    radii : (F, S) array
        Of each tooth in each slice [m].
    sharpness : (F,) array
        Factor of each tooth's own edge force.
    lag : (S,) array
        By which the edge in a slice is behind its tip [rad].
    height : float
        Of a slice [m].
    angle, x, feed : (T,) arrays
        Of the first tooth's tip [rad], of the tool's centre [m], the latter for each radian [m].
    """
    flutes, slices = radii.shape
    out = np.zeros((angle.size, 4))
    ahead, behind = np.cos(lag), np.sin(lag)
    for k in range(angle.size):
        for tooth in range(flutes):
            tip = angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(tip), np.cos(tip)
            for s in range(slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = chip(radii, tooth, s, sine, cosine, feed[k], x[k], block)
                if h <= 0.0:
                    continue
                t, r, axial = edge_force(law, h, sharpness[tooth])
                out[k, X] -= (t * cosine + r * sine) * height
                out[k, Y] += (t * sine - r * cosine) * height
                out[k, AXIAL] += axial * height
                out[k, TORQUE] += t * radii[tooth, s] * height
    return out
