"""What differs from one cut of a part to the next.

Sources of the orders of magnitude:

- Specific cutting force from batch to batch of one material: tensile strength and hardness of a
  wrought alloy of one temper scatter by 3 to 5 % from lot to lot (MMPDS-01, design mechanical
  properties, and the spread that EN 485-2 leaves for one temper); the force goes with them.
- Offset of a tool from the spindle's axis: ISO 15488 (table 4) allows collets of up to 10 mm bore
  15 um of total indicated runout (class 2, the usual one) or 10 um (class 1), wider ones 5 um more;
  the offset is half of it.  Its two components are normal, so that the offset is Rayleigh's.
- Sharpness of teeth: Kline, DeVor (1983) and grinders' tolerances: edge radii of one tool differ by
  5 to 10 %.
- Length of a tool on a presetter, and the touched top of a blank: repeatability of 5 to 10 um.
"""

from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from pipeline.shop.cutting_parameters import EndMill, Workpiece
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial_job import TrialJob

BATCH = 0.04
"""Standard deviation of a batch's specific force [1]."""
SHARPNESS = 0.08
"""Standard deviation of a tooth's own edge force [1]."""
USED = 15.0
"""What a tooth of a newish tool has cut before at most [m]."""
LENGTH, TOP = 8e-3, 8e-3
"""Standard deviations of a tool's length and of the blank's top [mm]."""
RAYLEIGH = sqrt(pi / 2)
"""Mean of Rayleigh's distribution over its scale."""


@dataclass(frozen=True, kw_only=True)
class Chance:
    """One part: its batch, the tools as mounted this time.

    Parameters
    ----------
    workpiece : Workpiece
        Of this batch.
    tools : dict of int to EndMill
        With this mounting's runout, tilt and teeth.
    used : dict of int to float
        What a tooth of each has cut before [m].
    deeper : dict of int to float
        By how much more each cuts at the blank's top than is programmed [mm].
    speed_error : float
        Of the spindle [1].
    angle : float
        Of the spindle when the run begins [rad].
    """

    workpiece: Workpiece
    tools: dict[int, EndMill]
    used: dict[int, float]
    deeper: dict[int, float]
    speed_error: float
    angle: float


def chance(job: TrialJob, parameters: ShopParameters, random: np.random.Generator) -> Chance:
    """Draw one part; ``EndMill.runout`` and ``tilt`` are the means of all mountings."""
    batch = float(np.clip(random.normal(1.0, BATCH), 0.8, 1.2))
    work, top = job.workpiece, float(random.normal(0.0, TOP))
    tools, used, deeper = {}, {}, {}
    for number, tool in sorted(job.tools.items()):
        teeth = np.clip(random.normal(1.0, SHARPNESS, tool.flutes), 0.7, 1.3)
        tools[number] = replace(
            tool,
            runout=min(float(random.rayleigh(tool.runout / RAYLEIGH)), 200.0),
            runout_angle=float(random.uniform(-180, 180)),
            tilt=min(float(random.rayleigh(tool.tilt / RAYLEIGH)), 20.0),
            tilt_angle=float(random.uniform(-180, 180)),
            sharpness=tuple(teeth.tolist()),
        )
        used[number] = float(random.uniform(0.0, USED))
        deeper[number] = top + float(random.normal(0.0, LENGTH))
    error = parameters.cutting.dynamometer.speed_error
    return Chance(
        workpiece=replace(
            work, tangential=work.tangential * batch, radial=work.radial * batch,
            axial=work.axial * batch, edge_tangential=work.edge_tangential * batch,
            edge_radial=work.edge_radial * batch, edge_axial=work.edge_axial * batch,
        ), tools=tools, used=used, deeper=deeper, speed_error=float(random.uniform(-error, error)),
        angle=float(random.uniform(0, 2 * pi)),
    )  # fmt: skip
