"""Thrust of a drill's chisel edge, the ridge between the lips: a strongly negative rake.

The chisel edge is across the axis, so its chip is f_z thick whatever the point angle.  It is
0.18 D long for a standard point (Shaw and Oxford 1957, Trans. ASME 79; webs of 0.12 to 0.2 D,
thinned ones less).  With plane flanks its rake is tan(gamma) = -tan(p / 2) sin(psi), p being the
point angle and psi that between chisel edge and lips.  The specific force rises by 1 % with each
degree of negative rake (tool makers' k_c = k_c1.1 h^-m_c (1 - gamma / 100)).  On a rake that steep
metal stands before the edge; thrust is assumed to equal the cutting force there.  Published shares
of the chisel edge in the thrust are 40 to 70 %.
"""

import numpy as np

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.si import DEGREE

LENGTH = 0.18
"""Length of the chisel edge over the diameter [1]."""
ANGLE = 55.0 * DEGREE
"""Acute angle between the chisel edge and the lips, seen along the axis [rad]."""
POINTED = ("", "spot_drill", "centre_drill")
"""Roles of drills that have a chisel edge; a tap or a countersink has none."""


def chisel_length(tool: Tool) -> float:
    """Length of the chisel edge [m]; 0 for tools without one."""
    return LENGTH * tool.diameter if tool.kind == "drill" and tool.role in POINTED else 0.0


def chisel_rake(tool: Tool) -> float:
    """Rake angle at the chisel edge [deg], negative.

    Examples
    --------
    >>> round(chisel_rake(Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0)), 1)
    -53.7
    """
    half = min(tool.point_angle / 2, 89 * DEGREE)
    return -float(np.degrees(np.arctan(np.tan(half) * np.sin(ANGLE))))


def chisel_thrust(tool: Tool, law: ForceLaw) -> float:
    """Thrust that the chisel edge adds to that of lips up to the axis, over f_z^(1 - m_c).

    All teeth together, in full material; the lips' own part below the chisel edge is taken off.
    """
    half = chisel_length(tool) / 2
    power = 1.0 - law.m_c
    tangential, radial = float(law.cutting[0]), float(law.cutting[1])
    steeper = 1.0 - chisel_rake(tool) / 100
    lips = radial * np.sin(tool.point_angle / 2) ** power
    return float(tool.flutes * half * (steeper * tangential - lips))


def chisel_engaged(tool: Tool, lower: Floats, upper: Floats) -> Floats:
    """Share of a drill's chisel edge in material [1]; shape (S,).

    ``lower`` and ``upper`` (S, F) are the heights on the tool between which there is material, by
    angle [m].
    """
    half = chisel_length(tool) / 2
    height = max(half / np.tan(tool.point_angle / 2), 1e-9)
    inside = (np.minimum(upper, height) - lower) / height
    return np.asarray(np.clip(inside, 0.0, 1.0).mean(axis=1))
