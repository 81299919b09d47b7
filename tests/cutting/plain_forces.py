"""Forces of milling once more, in plain numpy: what the compiled ones are judged by.

Teeth are points of thin discs; their chips are the distances between surfaces, which are computed
as radii from the tool's axis of now.
"""

import numpy as np

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from tests.cutting.closed_forms import edge_forces


def meridian(tool: Tool, low: float, high: float, discs: int):
    """Heights, angle kappa, distances from the axis and widths of the edge of discs."""
    z = np.linspace(low, high, discs + 1)
    corner = tool.corner_radius
    kappa, length = np.full(discs + 1, np.pi / 2), z
    if corner:
        kappa = np.arccos(1 - np.minimum(z, corner) / corner)
        length = corner * kappa + np.maximum(z - corner, 0)
    z, kappa = (z[1:] + z[:-1]) / 2, (kappa[1:] + kappa[:-1]) / 2
    return z, kappa, tool.radius - corner * (1 - np.sin(kappa)), np.diff(length)


def plain_forces(
    law: ForceLaw, tool: Tool, f_z: float, low: float, high: float, inside, angles, discs=2000
):
    """F_x, F_y, F_z and torque at angles; ``inside(phi, z)`` says where there is material."""
    z, kappa, radius, b = meridian(tool, low, high, discs)
    lag = z * np.tan(tool.helix) / tool.radius
    teeth = tool.flutes

    def offset(tooth):
        """How far a tooth stands out of the others."""
        pitch = 2 * np.pi / teeth
        return tool.runout * np.cos(tool.runout_angle + pitch * (tooth % teeth) + lag)

    out = np.zeros((len(angles), 4))
    for row, theta in enumerate(angles):
        for j in range(teeth):
            phi = theta - 2 * np.pi * j / teeth - lag
            step = f_z * np.sin(phi)
            surfaces = [radius + offset(j - m) - m * step for m in range(1, teeth + 1)]
            h = (radius + offset(j) - np.max(surfaces, axis=0)) * np.sin(kappa)
            h[(step <= 0) | ~inside(phi % (2 * np.pi), z)] = 0.0
            tangential, radial, axial = edge_forces(law, h) * b
            # from the workpiece into the axis, down the meridian, and against the motion
            outward = radial * np.sin(kappa) + axial * np.cos(kappa)
            out[row, 0] += np.sum(-tangential * np.cos(phi) - outward * np.sin(phi))
            out[row, 1] += np.sum(tangential * np.sin(phi) - outward * np.cos(phi))
            out[row, 2] += np.sum(axial * np.sin(kappa) - radial * np.cos(kappa))
            out[row, 3] += np.sum(tangential * radius)
    return out
