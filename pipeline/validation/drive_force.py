"""The force of a feed drive rebuilt from its recorded motion, against the recorded one."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.motion import Motion, motion
from pipeline.identification.drive.records import Recording
from pipeline.identification.drive.servo_records import low_passed
from pipeline.machine.friction import friction_force
from pipeline.twin.drive_file import IdentifiedDrive

Floats = NDArray[np.float64]

LEAST = 1.0
"""Motion that a force is judged by [s]."""


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


def force_comparison(recording: Recording, axis: str, drive: IdentifiedDrive) -> ForceComparison:
    """Force by M a + F_f(v) + F_g + F_d, both sides through the filter of the identification."""
    found = motion(recording, axis, drive.bandwidth_Hz, drive.delay)
    measured, modelled = _filtered(found, _modelled(found, drive))
    rows = found.known & found.moving
    return ForceComparison(
        measured=measured[rows], modelled=modelled[rows],
        direction=np.sign(found.velocity[rows]), period=found.period,
    )  # fmt: skip


def _modelled(found: Motion, drive: IdentifiedDrive) -> Floats:
    screw = drive.feed_drive
    force: Floats = (
        screw.mass * found.acceleration
        + friction_force(found.velocity, screw.friction)
        + screw.offset
    )
    if found.load is None or drive.force_unit != "N":
        return force
    return force + found.load


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
