"""Forces of an end mill on true tooth paths, with runout, tilt and wear, step by step (numba).

Seen from above the spindle turns clockwise (M3) and the tool goes along +x; y is to the left of it.
A tooth stands at the angle φ from +y in the sense of its motion: its edge point is at
c + R (sin φ, cos φ) about the tool's centre c.  The chip thickness is the distance from the edge
point back along its radius to where the teeth before it, on their own trochoids and radii, left the
material, or to the face of the block.
"""

from dataclasses import dataclass
from math import pi, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.shop.cutting.parameters import Conditions, EndMill, Workpiece, engaged

X, Y, AXIAL, TORQUE, CHIP, RUBBING = range(6)
"""Columns of the forces: on the tool along the feed and to the left of it, along the axis as the
edge lifts the material [N]; against the spindle [N m]; sum of the tangential forces of the chips,
and of edges and flanks [N]."""
ROUNDS = 2
"""Iterations of the search for where an earlier tooth crossed the radius; each adds two digits."""


class EdgeCoefficients(NamedTuple):
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


@compiled_with()
def edge_force(k: EdgeCoefficients, h: float, sharpness: float) -> tuple[float, float, float]:
    """Tangential, radial, axial force of an edge for each width of a chip ``h`` [m] thick [N/m]."""
    if h <= 0.0:
        return 0.0, 0.0, 0.0
    section = h * (h / k.thickness) ** -k.exponent
    whole = 1.0 - np.exp(-h / k.ploughing)
    return (
        k.cutting[0] * section + (k.edge[0] * sharpness + k.flank[0]) * whole,
        k.cutting[1] * section + (k.edge[1] * sharpness + k.flank[1]) * whole,
        k.cutting[2] * section + (k.edge[2] * sharpness + k.flank[2]) * whole,
    )


@compiled_with()
def chip_thickness(
    radii: np.ndarray, tooth: int, s: int, sine: float, cosine: float, feed: float, x: float,
    block: Block,
) -> float:  # fmt: skip
    """Thickness of the chip at slice ``s`` of a tooth at the angle of ``sine`` and ``cosine`` [m].

    ``radii`` (F, S) are those of each tooth in each slice [m]; the tool moves by ``feed`` for each
    radian of its turn and has its centre at ``x`` [m].
    """
    flutes, own = radii.shape[0], radii[tooth, s]
    across, ahead = own * cosine, x + own * sine
    if across < block.low or across > block.high or ahead < 0.0 or ahead > block.length:
        return 0.0
    pitch = 2 * np.pi / flutes
    left = 0.0
    for back in range(flutes, 0, -1):  # its own path first: behind the tool it ends the search
        before = radii[(tooth - back) % flutes, s]
        bend, moved = 0.0, 0.0
        for _ in range(ROUNDS):
            moved = feed * (back * pitch - bend)
            share = moved * cosine / before
            bend = share + share**3 / 6
        left = max(left, before * (1 - bend**2 / 2) - moved * sine)
        if left >= own:
            return 0.0
    h = own - left
    if sine > 0.0:
        h = min(h, ahead / sine)
    return max(h, 0.0)


@compiled_with()
def forces(
    edge: EdgeCoefficients, flank: np.ndarray, block: Block, radii: np.ndarray,
    sharpness: np.ndarray, lag: np.ndarray, height: float, angle: np.ndarray, x: np.ndarray,
    feed: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Forces on the tool at each step, shape (T, 6).

    ``radii`` (F, S) are those of each tooth in each slice [m], ``sharpness`` (F,) and ``flank``
    (F, 3) the factor of its own edge force and the force of its land [N/m]; the edge in a slice,
    ``height`` [m], is ``lag`` (S,) behind its tip [rad].  The first tooth's tip is at ``angle``
    [rad], the tool's centre at ``x`` [m], moving by ``feed`` for each radian [m]; (T,) each.
    """
    flutes, slices = radii.shape
    out = np.zeros((angle.size, 6))
    ahead, behind = np.cos(lag), np.sin(lag)
    for k in range(angle.size):
        for tooth in range(flutes):
            own = EdgeCoefficients(
                edge.cutting, edge.edge, (flank[tooth, 0], flank[tooth, 1], flank[tooth, 2]),
                edge.thickness, edge.exponent, edge.ploughing,
            )  # fmt: skip
            tip = angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(tip), np.cos(tip)
            for s in range(slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = chip_thickness(radii, tooth, s, sine, cosine, feed[k], x[k], block)
                if h <= 0.0:
                    continue
                t, r, axial = edge_force(own, h, sharpness[tooth])
                chip = edge.cutting[0] * h * (h / edge.thickness) ** -edge.exponent
                out[k, X] -= (t * cosine + r * sine) * height
                out[k, Y] += (t * sine - r * cosine) * height
                out[k, AXIAL] += axial * height
                out[k, TORQUE] += t * radii[tooth, s] * height
                out[k, CHIP] += chip * height
                out[k, RUBBING] += (t - chip) * height
    return out


def wear(tool: EndMill, length: float) -> float:
    """Flank wear after a length of cut ``length`` [m], in [m]."""
    settled = tool.break_in * (1 - np.exp(-length / tool.break_in_length))
    return float(settled + tool.wear_rate * length) * 1e-6


def cut_length(conditions: Conditions, tool: EndMill, length: float) -> float:
    """Length of cut of a tooth over a pass of ``length`` [mm], in [m]."""
    begin, end = engaged(conditions, tool.diameter)
    return length / conditions.feed * conditions.speed * (end - begin) * tool.radius


def edge_coefficients(workpiece: Workpiece, VB: float) -> EdgeCoefficients:
    """Force of an edge in the material, with a flank land ``VB`` wide [m], in SI."""
    return EdgeCoefficients(
        cutting=workpiece.cutting, edge=workpiece.edge, flank=workpiece.flank(VB),
        thickness=workpiece.thickness * 1e-3, exponent=workpiece.exponent,
        ploughing=workpiece.ploughing * 1e-6,
    )  # fmt: skip


def block_of(conditions: Conditions, tool: EndMill, length: float) -> Block:
    """The material of a pass ``length`` [mm] long."""
    inner = tool.radius - conditions.width * 1e-3
    low = inner if conditions.immersion == "up" else -np.inf
    high = -inner if conditions.immersion == "down" else np.inf
    return Block(length=length * 1e-3, low=low, high=high)


@dataclass(frozen=True, kw_only=True)
class Edges:
    """The teeth in slices of ``height`` [m]: radii (F, S) [m], lag of each slice (S,) [rad]."""

    radii: Floats
    lag: Floats
    height: float


def edges(tool: EndMill, depth: float, slice_height: float) -> Edges:
    """Teeth of ``tool``, runout included, down to ``depth`` in slices of ``slice_height`` [mm]."""
    count = int(np.ceil(depth / slice_height))
    up = (np.arange(count) + 0.5) * depth / count
    lag = up * 1e-3 * tan(tool.helix_angle) / tool.radius
    to = np.exp(1j * np.deg2rad([tool.runout_angle, tool.tilt_angle]))
    offset = tool.runout * to[0] + tool.tilt * up * to[1]
    place = -2 * pi * np.arange(tool.flutes)[:, None] / tool.flutes - lag
    radii = tool.radius + (offset * np.exp(-1j * place)).real * 1e-6
    return Edges(radii=radii, lag=lag, height=depth / count * 1e-3)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion of the tool in T steps: angle of the first tooth [rad], x of its centre [m]."""

    angle: Floats
    x: Floats


def pass_forces(
    conditions: Conditions, tool: EndMill, workpiece: Workpiece, motion: Motion, *,
    flank: ArrayLike, length: float, slice_height: float, feed: Floats | None = None,
) -> Floats:  # fmt: skip
    """Forces on the tool and torque at each step, shape (T, 6); columns X to RUBBING.

    ``flank`` (3,) or (F, 3): force of the land of all teeth or of each [N/m]; block ``length`` and
    greatest ``slice_height`` [mm]; ``feed`` (T,) for each radian [m], the motion's by default.
    """
    teeth = edges(tool, conditions.depth, slice_height)
    out: Floats = forces(
        edge_coefficients(workpiece, 0.0), np.zeros((tool.flutes, 3)) + np.asarray(flank, float),
        block_of(conditions, tool, length), teeth.radii, np.array(tool.sharpness), teeth.lag,
        teeth.height, motion.angle, motion.x,
        np.gradient(motion.x, motion.angle) if feed is None else feed,
    )  # fmt: skip
    return out
