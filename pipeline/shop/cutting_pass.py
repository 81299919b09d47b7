"""One straight pass of an end mill through a block: wear, geometry, forces."""

from dataclasses import dataclass
from math import pi, tan
from typing import TYPE_CHECKING

import numpy as np

from pipeline.shop.cutting_conditions import Conditions, engaged
from pipeline.shop.cutting_parameters import EndMill, Workpiece
from pipeline.shop.s_curve import Floats

if TYPE_CHECKING:
    from pipeline.shop.cutting_force import Block, Law


def wear(tool: EndMill, length: float) -> float:
    """Flank wear after a tooth was ``length`` [m] in the material [m]."""
    settled = tool.break_in * (1 - np.exp(-length / tool.break_in_length))
    return float(settled + tool.wear_rate * length) * 1e-6


def cut_length(conditions: Conditions, tool: EndMill, way: float) -> float:
    """How long a tooth is in the material over a pass of ``way`` [mm], in [m]."""
    begin, end = engaged(conditions, tool.diameter)
    return way / conditions.feed * conditions.speed * (end - begin) * tool.radius


def edge_law(workpiece: Workpiece, worn: float) -> "Law":
    """What the forces' kernel wants of the material, for a flank ``worn`` [m]."""
    from pipeline.shop.cutting_force import Law

    return Law(
        cutting=workpiece.cutting, edge=workpiece.edge, flank=workpiece.flank(worn),
        thickness=workpiece.thickness * 1e-3, exponent=workpiece.exponent,
        ploughing=workpiece.ploughing * 1e-6,
    )  # fmt: skip


def block_of(conditions: Conditions, tool: EndMill, length: float) -> "Block":
    """The material of a pass ``length`` [mm] long."""
    from pipeline.shop.cutting_force import Block

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
    """Teeth of ``tool`` down to ``depth`` in slices of at most ``slice_height`` [mm].

    The offset of the axis adds its component along the direction to each edge point.
    """
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
    """Of T steps: angle of the first tooth [rad], place of the tool's centre along the feed [m]."""

    angle: Floats
    x: Floats


def pass_forces(
    conditions: Conditions, tool: EndMill, workpiece: Workpiece, worn: float, motion: Motion,
    length: float, slice_height: float,
) -> Floats:  # fmt: skip
    """Forces on the tool and torque at each step, shape (T, 4); see :mod:`.cutting_force`.

    Parameters
    ----------
    conditions, tool, workpiece
        What cuts what; of the conditions only immersion, depth and width count.
    worn : float
        Width of the flank's land [m].
    motion : Motion
        Where the tool is at each step.
    length : float
        Of the block [mm].
    slice_height : float
        Greatest height of a slice [mm].
    """
    from pipeline.shop.cutting_force import forces

    teeth = edges(tool, conditions.depth, slice_height)
    out: Floats = forces(
        edge_law(workpiece, worn), block_of(conditions, tool, length), teeth.radii,
        np.array(tool.sharpness), teeth.lag, teeth.height, motion.angle, motion.x,
        np.gradient(motion.x, motion.angle),
    )  # fmt: skip
    return out
