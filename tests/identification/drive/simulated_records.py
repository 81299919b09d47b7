"""Recordings of the simulated axis, as a servo tuning tool would take them."""

import numpy as np

from pipeline.identification.drive.records import AxisConstants, AxisRecord, Recording
from tests.identification.drive.simulated_axis import SimulatedAxis, reciprocation, simulate

SPEEDS = np.geomspace(2e-4, 0.4, 12)
COG = 2.5e-3
"""Slow strokes travel two cogs of the simulated motor [m]."""


def recording(
    axis: SimulatedAxis, seed: int, *, speeds=SPEEDS, repeats=2, load=None, known=True,
    name="reciprocation.csv", **options,
) -> Recording:  # fmt: skip
    """Strokes forth and back at ``speeds``, every one ``repeats`` times."""
    settings = {"plateau": 0.5, "travel": COG, **options}
    reference = np.concatenate([reciprocation(speeds, **settings) for _ in range(repeats)])
    pushed = None if load is None else load(len(reference))
    position, current = simulate(axis, reference, seed, pushed)
    constants = AxisConstants(force_constant=axis.force_constant if known else None)
    record = AxisRecord(
        command=current, position=position, reference=reference + position[0],
        load=pushed, constants=constants,
    )  # fmt: skip
    return Recording(name=name, trained=True, period=1e-3, air=np.ones(len(position), bool),
                     axes={"X": record}, sha256="0" * 64)  # fmt: skip


def truth(axis: SimulatedAxis) -> dict[str, float]:
    """Parameters as the fit names them."""
    found = {"mass": axis.mass}
    for sign in ("positive", "negative"):
        way = getattr(axis, sign)
        found |= {
            f"coulomb_{sign}": way.coulomb, f"static_{sign}": way.static,
            f"stribeck_velocity_{sign}": way.stribeck_velocity, f"viscous_{sign}": way.viscous,
        }  # fmt: skip
    return found
