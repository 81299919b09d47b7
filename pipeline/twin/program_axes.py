"""What the axes make of a program: how far they are behind, and what their drives draw.

The control's positions, sampled at its interpolation period, are each axis' reference.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES
from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.planner import Plan
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.drive_population import simulate_traces

Floats = npt.NDArray[np.float64]

MOST = 20_000_000
"""Positions that are held at once."""
SUBSTEPS = 4
"""Samples of the servo in one interpolation period: velocity loops run that much faster."""


@dataclass(frozen=True, kw_only=True)
class AxisFollowing:
    """One axis along a program, T positions.

    Parameters
    ----------
    time : (T,) array
        [s].
    error : (T,) array
        Commanded less actual position [m].
    command : (T,) array
        Of the motor [``command_unit``].
    row : (T,) array of int32
        Row of ``Moves`` that the control is in.
    command_unit : str
        A or V.
    """

    time: Floats = field(repr=False)
    error: Floats = field(repr=False)
    command: Floats = field(repr=False)
    row: npt.NDArray[np.int32] = field(repr=False)
    command_unit: str

    @property
    def rms_error(self) -> float:
        """Root mean square of ``error`` [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst(self) -> int:
        """Where the error is greatest, an index."""
        return int(np.argmax(np.abs(self.error)))


def follow_program(plan: Plan, drives: Mapping[str, IdentifiedDrive]) -> dict[str, AxisFollowing]:
    """Linear axes of ``drives`` that move in a program, in air.

    Parameters
    ----------
    plan : Plan
        Of the control.
    drives : mapping of str to IdentifiedDrive
        By the axis' letter; those without a servo are left out.

    Raises
    ------
    ValueError
        When the program is too long to be held, or a drive is unstable.
    """
    period = plan.path.control.interpolation_period
    if plan.total > MOST * period:
        raise ValueError(
            f"{plan.total:.0f} s at {period} s are more than {MOST} positions: simulate a shorter "
            "program, or raise control.interpolation_period"
        )
    commanded = trace(plan)
    found = {}
    for letter, drive in drives.items():
        if drive.servo is None or letter not in "XYZ":
            continue
        reference = commanded.position[:, AXES.index(letter)]
        if np.ptp(reference) == 0:
            continue
        row = drive_row(drive.servo, drive.feed_drive)
        traces = simulate_traces(between(reference, SUBSTEPS), period / SUBSTEPS, row[np.newaxis])
        position, command = (one[0, ::SUBSTEPS] for one in (traces.position, traces.command))
        if not np.isfinite(position).all():
            raise ValueError(f"the drive of axis {letter} is unstable: identify it again")
        found[letter] = AxisFollowing(
            time=commanded.time, error=reference - position, command=command, row=commanded.row,
            command_unit=drive.command_unit,
        )  # fmt: skip
    return found


def between(values: Floats, substeps: int) -> Floats:
    """Values at ``substeps`` places a sample on a smooth curve; the last one holds.

    On straight lines the acceleration that is fed forward would be a row of spikes.

    Parameters
    ----------
    values : (T,) array
        Samples.
    substeps : int
        Places.

    Returns
    -------
    (T * substeps,) array
    """
    from scipy.interpolate import CubicSpline

    if substeps == 1 or len(values) < 2:
        return np.repeat(values, substeps)
    places = np.minimum(np.arange(len(values) * substeps) / substeps, len(values) - 1.0)
    found: Floats = CubicSpline(np.arange(len(values)), values)(places)
    return found
