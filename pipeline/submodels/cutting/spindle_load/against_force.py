"""Tangential force by the spindle's load, beside that of a dynamometer on the same machine.

The mean tangential force of all teeth over a revolution is
N a_p / (2 pi) (K_tc f_z (cos phi_st - cos phi_ex) + K_te (phi_ex - phi_st)) [N]; K_tc and K_te are
those of the load, and nothing of the dynamometer is in them.
"""

from collections.abc import Mapping

import numpy as np

from pipeline.schema.cutting import CutConditions
from pipeline.schema.model import Parameter

N_MM2, N_MM = 1e6, 1e3
NORMAL_95, NORMAL_90 = 1.96, 1.645
"""Halves of 95 and 90 % intervals over the standard deviation [1]."""


def tangential_by_load(
    found: Mapping[str, Parameter], conditions: CutConditions
) -> tuple[float, float] | None:
    """Mean tangential force and half of its 90 % interval [N].

    None where the load did not determine K_tc and K_te.
    """
    c = conditions
    width = c.flutes * c.a_p / (2 * np.pi)
    chip = width * c.f_z * (np.cos(c.phi_st) - np.cos(c.phi_ex))
    force = variance = 0.0
    for name, size in (("K_tc", chip * N_MM2), ("K_te", width * (c.phi_ex - c.phi_st) * N_MM)):
        one = found.get(name)
        if one is None or one.value is None or one.interval_95 is None:
            return None
        force += size * one.value
        half = (one.interval_95[1] - one.interval_95[0]) / 2
        variance += (size * half / NORMAL_95) ** 2
    return float(force), NORMAL_90 * float(np.sqrt(variance))
