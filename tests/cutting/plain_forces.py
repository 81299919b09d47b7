"""Forces of milling once more, in plain numpy: what the compiled ones are judged by.

Teeth are points of thin discs; their chips are the distances between surfaces, which are computed
as radii from the tool's axis of now.
"""

import numpy as np

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from tests.cutting.closed_forms import edge_forces


def meridian(tool: Tool, low: float, high: float, discs: int):
    """Heights, angle kappa, distances from the axis, lags and widths of the edge of discs."""
    z = np.linspace(low, high, discs + 1)
    corner = tool.corner_radius
    kappa, length = np.full(discs + 1, np.pi / 2), z
    if corner:
        kappa = np.arccos(1 - np.minimum(z, corner) / corner)
        length = corner * kappa + np.maximum(z - corner, 0)
    z, kappa = (z[1:] + z[:-1]) / 2, (kappa[1:] + kappa[:-1]) / 2
    lag = z * np.tan(tool.helix) / tool.radius
    return z, kappa, tool.radius - corner * (1 - np.sin(kappa)), lag, np.diff(length)


def face(tool: Tool, discs: int):
    """The same of an end's face, which has no lag: the lips of a drill, the flat of other tools."""
    half = tool.point_angle / 2 if tool.kind == "drill" else np.pi / 2
    reach = tool.radius - tool.corner_radius
    radius = (np.arange(discs) + 0.5) * (reach / discs)
    each = np.ones(discs)
    height = radius / np.tan(half) if tool.kind == "drill" else 0 * each
    width = reach / discs / np.sin(half)
    return height, (np.pi / 2 - half) * each, radius, 0 * each, width * each


def point_height(tool: Tool) -> float:
    """Height of a drill's point [m]; 0 of other tools."""
    return tool.radius / np.tan(tool.point_angle / 2) if tool.kind == "drill" else 0.0


def plain_forces(
    law: ForceLaw, tool: Tool, f_z: float, low: float, high: float, inside, angles, discs=2000,
    slope: float = 0.0,
):  # fmt: skip
    """F_x, F_y, F_z and torque at angles; ``inside(phi, z)`` says where there is material.

    On a slope the end's face cuts too: a flat one on its way down alone.
    """
    point = point_height(tool)
    z, kappa, radius, lag, b = meridian(tool, max(low, point), max(high, point), discs)
    if slope or point:
        tip = face(tool, discs)
        lag = lag - point * np.tan(tool.helix) / tool.radius
        z, kappa, radius, lag, b = (
            np.append(one, of) for one, of in zip(tip, (z, kappa, radius, lag, b), strict=True)
        )
    ahead, down = f_z * np.sqrt(1 - slope**2) * np.sin(kappa), -f_z * slope * np.cos(kappa)
    teeth = tool.flutes

    def offset(tooth):
        """How far a tooth stands out of the others."""
        pitch = 2 * np.pi / teeth
        return tool.runout * np.cos(tool.runout_angle + pitch * (tooth % teeth) + lag)

    out = np.zeros((len(angles), 4))
    for row, theta in enumerate(angles):
        for j in range(teeth):
            phi = theta - 2 * np.pi * j / teeth - lag
            # along the normal of the envelope, from this tooth to where those before it were
            step = ahead * np.sin(phi) + down
            out_of = np.sin(kappa) * offset(j)
            surfaces = [np.sin(kappa) * offset(j - m) - m * step for m in range(1, teeth + 1)]
            h = out_of - np.max(surfaces, axis=0)
            h[(step <= 1e-9 * f_z) | ~inside(phi % (2 * np.pi), z)] = 0.0
            tangential, radial, axial = edge_forces(law, h) * b
            # from the workpiece into the axis, down the meridian, and against the motion
            outward = radial * np.sin(kappa) + axial * np.cos(kappa)
            out[row, 0] += np.sum(-tangential * np.cos(phi) - outward * np.sin(phi))
            out[row, 1] += np.sum(tangential * np.sin(phi) - outward * np.cos(phi))
            out[row, 2] += np.sum(axial * np.sin(kappa) - radial * np.cos(kappa))
            out[row, 3] += np.sum(tangential * radius)
    return out
