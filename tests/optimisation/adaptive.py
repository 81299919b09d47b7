"""A slot milled in loops: hundreds or thousands of arcs whose engagement grows and falls."""

from itertools import pairwise

import numpy as np


def trochoid(
    loops: int, feed: float, *, speed: float = 5000.0, diameter: float = 10.0, width: float = 20.0,
    step: float = 1.0, depth: float = 15.0, arcs: int = 8,
) -> str:  # fmt: skip
    """A slot along X at y = 30 of ``width``, in loops ``step`` apart of ``arcs`` arcs each [mm]."""
    radius = (width - diameter) / 2
    begin = -(width + diameter) / 2
    lines = [
        "(ADAPTIVE ROUGHING)", "G21 G90 G17", "T1 M6", f"S{speed:g} M3",
        f"G0 X{begin - radius:.4f} Y30 Z5", f"G0 Z-{depth:g}",
    ]  # fmt: skip
    angle = np.pi + np.linspace(0.0, 2 * np.pi, arcs + 1)
    for k in range(loops):
        centre = np.array([begin + step * k, 30.0])
        points = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        lines.append(f"G1 X{points[0, 0]:.4f} Y{points[0, 1]:.4f} F{feed:g}")
        for start, end in pairwise(points):
            i, j = centre - start
            lines.append(f"G3 X{end[0]:.4f} Y{end[1]:.4f} I{i:.4f} J{j:.4f}")
    return "\n".join([*lines, "G0 Z5", "M30", ""])
