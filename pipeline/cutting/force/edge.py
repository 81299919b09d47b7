"""Cutting edge of a tool and its motion, as the compiled kernels of forces take them."""

from typing import cast

import numpy as np

from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats, Ints

LIP = 4
"""Number of elements of a drill's lip."""


def edge_shape(tool: Tool) -> Floats:
    """Dimensions of an edge; shape (6,), columns of :mod:`pipeline.cutting.force.edge_kernel`."""
    half = tool.point_angle / 2 if tool.kind == "drill" else np.pi / 2
    cosine = 0.0 if half == np.pi / 2 else float(np.cos(half))
    sine = float(np.sin(half))
    lag = float(np.tan(tool.helix)) / tool.radius
    face = tool.radius * cosine / sine
    return np.array([tool.radius, tool.corner_radius, lag, cosine, sine, face])


def element_counts(tool: Tool, *, slope: float, slices: int) -> Ints:
    """Numbers of elements of the face, the corner and the side; shape (3,)."""
    face = LIP if tool.kind == "drill" else int(slope < 0)
    return np.array([face, slices, slices if tool.helix else 1])


def radius_differences(tool: Tool) -> Floats:
    """Cosine and sine parts of r_j - r_(j-m), by which tooth j stands out over the m-th before it.

    Shape (N, N, 2) [m]; at a lag the difference is the one times its cosine less the other times
    its sine.
    """
    teeth = np.arange(tool.flutes)
    turned = tool.runout * np.exp(1j * (tool.runout_angle + 2 * np.pi / tool.flutes * teeth))
    out = turned[:, None] - turned[teeth[:, None] - teeth]
    return cast(Floats, out.view(np.float64).reshape(tool.flutes, tool.flutes, 2))


def bin_middles(bins: int) -> Floats:
    """Sine and cosine of the angles of an engagement's bins; shape (F, 2)."""
    phi = (np.arange(bins) + 0.5) * (2 * np.pi / bins)
    return np.stack([np.sin(phi), np.cos(phi)], axis=1)


def piece_buffer(elements: int, shape: Floats, height: float, bins: int) -> Floats:
    """Buffer for all pieces into which bins divide elements of an edge up to a height [m]."""
    *_, lag, _, _, _ = shape
    crossed = int(abs(lag) * height * bins / (2 * np.pi))
    return np.empty((3 * elements + crossed, 9))


def motion(f_z: float, slope: float) -> Floats:
    """Feed for each tooth [m], cosine and sine of the motion's slope; shape (3,)."""
    return np.array([f_z, np.sqrt(1.0 - slope**2), slope])


def edge_elements(
    tool: Tool, depth: tuple[float, float], *, slope: float, slices: int, side: bool = True
) -> tuple[Floats, Floats]:
    """Elements of the edge between two heights, with or without its side; their Gauss points."""
    from pipeline.cutting.force.edge_kernel import divide

    many = element_counts(tool, slope=slope, slices=slices)
    many[2] *= side
    elements, pairs = np.empty((many.sum(), 7)), np.empty((many.sum(), 2, 5))
    n = divide(edge_shape(tool), *depth, many, elements, pairs)
    return elements[:n], pairs[:n]
