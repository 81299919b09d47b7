"""Mills of the simulated shop with another material, tool, dynamometer and chances each.

Ranges are those of the sources in :mod:`pipeline.shop.cutting.parameters`: aluminium to tool steel,
sharp to honed edges, new edges that break in, amplifiers with and without drift.
"""

from dataclasses import replace

import numpy as np


def other_mill(shop, seed):
    """Parameters of ``shop`` with everything drawn that a cutting test does not know."""
    random = np.random.default_rng(seed)
    cutting, draw = shop.cutting, random.uniform
    tangential = float(np.exp(draw(np.log(600), np.log(3000))))
    edge = draw(10, 50)
    workpiece = replace(
        cutting.workpiece, tangential=tangential, radial=tangential * draw(0.2, 0.5),
        axial=tangential * draw(0.1, 0.3), exponent=draw(0.0, 0.25), edge_tangential=edge,
        edge_radial=edge * draw(0.8, 2.0), edge_axial=draw(-2, 6),
        ploughing=float(np.exp(draw(np.log(1), np.log(12)))), flank_pressure=draw(200, 900),
        flank_friction=draw(0.3, 0.5),
    )  # fmt: skip
    sharpness = 1 + random.normal(0, 0.1, cutting.tool.flutes).clip(-0.25, 0.25)
    tool = replace(
        cutting.tool, runout=draw(1, 12), runout_angle=draw(-180, 180), tilt=draw(0, 1),
        tilt_angle=draw(-180, 180), sharpness=tuple((sharpness / sharpness.mean()).tolist()),
        break_in=draw(3, 20),
    )  # fmt: skip
    dynamometer = replace(
        cutting.dynamometer, offset=draw(0.5, 5.0), crosstalk=draw(0.005, 0.02),
        depth_error=draw(4, 15), range=4000.0,
    )  # fmt: skip
    other = replace(cutting, workpiece=workpiece, tool=tool, dynamometer=dynamometer)
    return replace(shop, seed=seed, cutting=other)
