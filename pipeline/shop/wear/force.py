"""Forces of an end mill whose teeth are worn apart, and the rates of work that make it audible.

The edge is that of :mod:`pipeline.shop.cutting.force`: size effect, ploughing that grows with the
chip, runout and tilt on true tooth paths.  Here each tooth has a land of its own, on which pressure
and friction act (Smithey, Kapoor, DeVor 2000), and the cutting force in the chip and the rubbing
one at edge and flank are kept apart, since both emit sound (Kannatey-Asibu, Dornfeld 1982).
"""

from dataclasses import asdict

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.shop.cutting.force import (
    Block,
    EdgeCoefficients,
    Motion,
    block_of,
    chip_thickness,
    edge_coefficients,
    edge_force,
    edges,
)
from pipeline.shop.cutting.parameters import Conditions, EndMill, Workpiece
from pipeline.shop.wear.parameters import Steel

X, Y, AXIAL, CHIP, RUBBING = range(5)
"""Columns of the forces: on the tool along the feed and to the left of it, along the axis as the
edge lifts the material; sum of the tangential forces of the chips, and of edges and flanks [N]."""
SLICE = 0.5
"""Greatest height of a slice of the edges [mm]; its lag is below one degree."""


@compiled_with()
def worn_forces(
    edge: EdgeCoefficients, block: Block, radii: np.ndarray, sharpness: np.ndarray,
    land: np.ndarray, lag: np.ndarray, height: float, angle: np.ndarray, x: np.ndarray,
    feed: float,
) -> np.ndarray:  # fmt: skip
    """Forces at each step, shape (T, 5); columns X, Y, AXIAL, CHIP, RUBBING.

    The force of the ``edge`` is that with a land of one metre.  ``radii`` (F, S) are those of each
    tooth in each slice [m], ``sharpness`` (F,) and ``land`` (F,) its own edge force [1] and flank
    wear [m]; the edge in a slice, ``height`` [m], is ``lag`` (S,) behind its tip [rad].  The first
    tooth's tip is at ``angle`` [rad], the tool's centre at ``x`` [m], (T,) each, moving by ``feed``
    for each radian [m].
    """
    flutes, slices = radii.shape
    out = np.zeros((angle.size, 5))
    ahead, behind = np.cos(lag), np.sin(lag)
    for tooth in range(flutes):
        flank = (edge.flank[0] * land[tooth], edge.flank[1] * land[tooth], 0.0)
        own = EdgeCoefficients(
            edge.cutting, edge.edge, flank, edge.thickness, edge.exponent, edge.ploughing
        )
        for k in range(angle.size):
            tip = angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(tip), np.cos(tip)
            for s in range(slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = chip_thickness(radii, tooth, s, sine, cosine, feed, x[k], block)
                if h <= 0.0:
                    continue
                t, r, axial = edge_force(own, h, sharpness[tooth])
                chip = own.cutting[0] * h * (h / own.thickness) ** -own.exponent
                out[k, X] -= (t * cosine + r * sine) * height
                out[k, Y] += (t * sine - r * cosine) * height
                out[k, AXIAL] += axial * height
                out[k, CHIP] += chip * height
                out[k, RUBBING] += (t - chip) * height
    return out


def workpiece(steel: Steel, hardness: float) -> Workpiece:
    """A batch of the material, ``hardness`` [1] against its usual one; the force follows it."""
    values = asdict(steel)
    for name in ("tangential", "radial", "axial", "edge_tangential", "edge_radial",
                 "flank_pressure"):  # fmt: skip
        values[name] *= hardness
    return Workpiece(**values)


def cut_forces(
    conditions: Conditions, mill: EndMill, material: Workpiece, land: Floats, motion: Motion,
    length: float,
) -> Floats:  # fmt: skip
    """Forces on the tool at each step of a cut as it truly is, shape (T, 5).

    ``land`` (F,) is the flank wear of each tooth [um], ``length`` that of the block [mm].
    """
    teeth = edges(mill, conditions.depth, min(SLICE, conditions.depth / 4))
    per_radian = (motion.x[-1] - motion.x[0]) / (motion.angle[-1] - motion.angle[0])
    out: Floats = worn_forces(
        edge_coefficients(material, 1.0), block_of(conditions, mill, length), teeth.radii,
        np.array(mill.sharpness), land * 1e-6, teeth.lag, teeth.height, motion.angle, motion.x,
        per_radian,
    )  # fmt: skip
    return out
