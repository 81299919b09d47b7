"""The force of a feed drive rebuilt from its recorded motion, against the recorded one."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.loads import Factor, in_newton, judged_load
from pipeline.identification.drive.motion import Motion, motion
from pipeline.identification.drive.records import Recording
from pipeline.identification.drive.servo_records import low_passed
from pipeline.machine.axis.friction import friction_force
from pipeline.twin.drive_file import IdentifiedDrive

Floats = NDArray[np.float64]

LEAST = 1.0
"""Motion that a force is judged by [s]."""
TOLD = 0.5
"""Half width of its interval, as a share, up to which a load's factor is taken from its record."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceComparison:
    """Recorded and modelled force of one axis while it moves in air, N rows.

    Parameters
    ----------
    measured, modelled : ndarray, shape (N,)
        In the drive's unit of force.
    direction : ndarray, shape (N,)
        Of motion, -1 or 1.
    period : float
        From row to row [s].
    """

    measured: Floats = field(repr=False)
    modelled: Floats = field(repr=False)
    direction: Floats = field(repr=False)
    period: float

    @property
    def seconds(self) -> float:
        """Motion in it [s]."""
        return len(self.measured) * self.period


def in_unit_of_drive(recording: Recording, axis: str, drive: IdentifiedDrive) -> Recording:
    """The recording with the drive's force constant, where a load told it and nothing else does."""
    if drive.force_unit != "N" or recording.axes[axis].constants.force_constant is not None:
        return recording
    return in_newton([recording], axis, drive.feed_drive.force_constant)[0]


def factor_of_load(recording: Recording, axis: str, drive: IdentifiedDrive) -> Factor | None:
    """In which direction and unit the recording's channel of load counts; None without a load.

    A recording does not say it.  It is the one number that is taken from the recording that is
    judged; 1, against positive motion in newton, where the recording does not tell it.
    """
    if recording.axes[axis].load is None or drive.force_unit != "N":
        return None
    factor = judged_load(recording, axis, drive.feed_drive, drive.bandwidth_Hz, drive.delay)
    told = factor is not None and factor.is_told(TOLD)
    return factor if told else Factor(value=1, half_width=inf)


def force_comparison(
    recording: Recording, axis: str, drive: IdentifiedDrive, factor: Factor | None
) -> ForceComparison:
    """Force by M a + F_f(v) + F_g + c F_d, both sides through the filter of the identification."""
    found = motion(recording, axis, drive.bandwidth_Hz, drive.delay)
    measured, modelled = _filtered(found, _modelled(found, drive, factor))
    rows = found.known & found.moving
    return ForceComparison(
        measured=measured[rows], modelled=modelled[rows],
        direction=np.sign(found.velocity[rows]), period=found.period,
    )  # fmt: skip


def _modelled(found: Motion, drive: IdentifiedDrive, factor: Factor | None) -> Floats:
    screw = drive.feed_drive
    force: Floats = (
        screw.mass * found.acceleration
        + friction_force(found.velocity, screw.friction)
        + screw.offset
    )
    if found.load is None or factor is None:
        return force
    return force + factor.value * found.load


def _filtered(found: Motion, modelled: Floats) -> tuple[Floats, Floats]:
    if found.bandwidth is None:
        return found.force, modelled
    both = low_passed(np.stack((found.force, modelled)), found.period, found.bandwidth)
    return both[0], both[1]


def constant_level(training: Sequence[ForceComparison]) -> float:
    """The plain guess: one level against motion, from recordings that may be learnt from."""
    total = sum(float(one.measured @ one.direction) for one in training)
    rows = sum(len(one.measured) for one in training)
    return total / rows if rows else 0.0


def relative_error_percent(modelled: Floats, measured: Floats) -> float | None:
    """||modelled - measured|| / ||measured|| [%]; None where nothing was measured."""
    size = float(np.linalg.norm(measured))
    return 100 * float(np.linalg.norm(modelled - measured)) / size if size > 0 else None
