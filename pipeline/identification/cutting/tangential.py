"""The mean tangential force of all teeth, from mean forces along and across the feed.

A slice of a tooth gives F_x = -F_t cos(phi) - F_r sin(phi) and F_y = F_t sin(phi) - F_r cos(phi).
The mean tangential force is thus not in the means alone: it takes how force spreads over the arc.
That is taken from the linear-edge law fitted to the cut's own harmonics, and scaled so that the
model's mean of F_y, which F_t carries, is the measured one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.mean_force import regressors
from pipeline.identification.cutting.mean_regression import linear_means
from pipeline.identification.cutting.problem import Cut

Floats = NDArray[np.float64]


def mean_tangential(cuts: Sequence[Cut]) -> tuple[Floats, Floats]:
    """Mean tangential force of all teeth [N], and what is known of it as a share; (R,) each.

    Parameters
    ----------
    cuts : sequence of Cut
        The recordings.
    """
    values = linear_means(cuts)
    force, share = [], []
    for one in cuts:
        c = one.conditions
        table = regressors(flutes=c.flutes, f_z=c.f_z, a_p=c.a_p, phi_st=c.phi_st, phi_ex=c.phi_ex)
        carried = float(table[1, [0, 3]] @ values[[0, 3]])
        rest = float(table[1, [1, 4]] @ values[[1, 4]])
        width = c.flutes * c.a_p / (2 * np.pi)
        chip = c.f_z * (np.cos(c.phi_st) - np.cos(c.phi_ex))
        whole = width * (values[0] * chip + values[3] * (c.phi_ex - c.phi_st))
        measured = float(one.lines[0, 1].real) - rest
        force.append(whole * measured / carried if carried > 0 else np.nan)
        share.append(float(np.sqrt(one.variance[0, 1])) / max(abs(measured), 1e-9))
    return np.array(force), np.array(share)
