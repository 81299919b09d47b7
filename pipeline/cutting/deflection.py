"""How far the tip of a tool bends: a cantilever of a fluted part and a shank.

Holder and spindle count as rigid, the force as one on the tip: of an end mill in its holder alone,
a bound for cuts that reach up the flute.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.tool import Tool

Floats = NDArray[np.float64]

FLUTED = 0.8
"""Effective diameter of a fluted part over its outer one (Kops and Vo 1990)."""


def tip_stiffness(tool: Tool) -> float:
    """Force across the axis over what the tip gives way [N/m]; NaN without the tool's stickout.

    1 / k = l_f^3 / (3 E I_f) + (l^3 - l_f^3) / (3 E I_s), with I = pi d^4 / 64, the fluted length
    l_f (all of the stickout l where the tool does not say) and the diameters 0.8 D and the shank's.

    Examples
    --------
    A rod of carbide 10 mm thick, 40 mm long, with next to no flutes:

    >>> rod = Tool(kind="flat", diameter_mm=10.0, flutes=2, stickout_mm=40.0, flute_length_mm=0.01)
    >>> round(tip_stiffness(rod) / (3 * 600e9 * np.pi * 0.01**4 / 64 / 0.04**3), 6)
    1.0
    """
    if tool.stickout is None:
        return float("nan")
    fluted = tool.stickout
    if tool.flute_length_mm is not None:
        fluted = min(tool.flute_length_mm * 1e-3, tool.stickout)
    give = fluted**3 / _rigidity(tool, FLUTED * tool.diameter)
    give += (tool.stickout**3 - fluted**3) / _rigidity(tool, tool.shank_diameter)
    return 1.0 / give


def tip_deflection(tool: Tool, force: ArrayLike) -> Floats:
    """How far the tip gives way under a force across the axis [m].

    Parameters
    ----------
    tool : Tool
        Its stickout, flute length, diameters and modulus of elasticity count.
    force : array_like
        On the tip, across the axis [N], any shape.

    Returns
    -------
    ndarray
        Of the shape of ``force``; NaN without the tool's stickout.
    """
    return np.asarray(force, dtype=np.float64) / tip_stiffness(tool)


def _rigidity(tool: Tool, diameter: float) -> float:
    """3 E I [N m^2]."""
    return float(3 * tool.youngs_modulus * np.pi * diameter**4 / 64)
