"""What a recorded load tells: the force constant nobody knew, or the factor of the load's channel.

k A = (the drive's own force) + c F_d.  With k known, c says in which direction and which unit the
channel counts; without, forces are in the command's unit and c is 1 / k.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.intervals import dynamics_certainty
from pipeline.identification.drive.inverse_dynamics import Dynamics
from pipeline.identification.drive.motion import motion
from pipeline.identification.drive.records import Recording
from pipeline.identification.drive.regressors import Regressors, regressors
from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.submodels.least_squares import Certainty

Floats = NDArray[np.float64]

ROWS = 30
"""Of a recording that a factor is found from."""


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A number with half of its 95 % interval; ``zero`` is what a load's channel adds at rest."""

    value: float
    half_width: float
    zero: float = 0.0

    def is_told(self, widest: float) -> bool:
        """Whether the interval is no wider than that share."""
        return self.value != 0 and self.half_width <= widest * abs(self.value)


def load_factor(found: Dynamics, sure: Certainty) -> Factor | None:
    """Factor c of the load in training recordings; None where none has a load."""
    if "load" not in found.names or not found.sought[found.names.index("load")]:
        return None
    at = int(np.count_nonzero(found.sought[: found.names.index("load")]))
    return Factor(value=found.value("load"), half_width=float(sure.half_width[at]))


def force_constant_by_load(found: Dynamics, sure: Certainty, widest: float) -> Factor | None:
    """K = 1 / c [N/A] of a fit in the command's unit; None where the load does not tell it."""
    factor = load_factor(found, sure)
    if factor is None or not factor.is_told(widest) or factor.value < 0:
        return None
    k = 1 / factor.value
    return Factor(value=k, half_width=factor.half_width * k**2)


def in_newton(recordings: Sequence[Recording], axis: str, force_constant: float) -> list[Recording]:
    """The recordings with the force constant of ``axis`` known [N/A]."""
    changed = []
    for one in recordings:
        record = one.axes[axis]
        constants = replace(record.constants, force_constant=force_constant)
        axes = {**one.axes, axis: replace(record, constants=constants)}
        changed.append(replace(one, axes=axes))
    return changed


def judged_load(
    recording: Recording,
    axis: str,
    drive: FeedDriveParameters,
    bandwidth: float | None,
    delay: float = 0.0,
) -> Factor | None:
    """Factor c of the load of a recording that the drive was not found from.

    Only the factor and the zero of the load's channel are sought: all else is the drive's, so that
    the motor's force is the drive's plus c F_d plus the zero.

    Parameters
    ----------
    recording : Recording
        That shows the axis.
    axis : str
        Its letter.
    drive : FeedDriveParameters
        As identified.
    bandwidth : float or None
        Of the parallel filter [Hz].
    delay : float
        How long the motion is behind the command [s].

    Returns
    -------
    Factor or None
        None where the recording has no load that comes and goes while the axis moves.
    """
    if recording.axes[axis].load is None:
        return None
    try:
        rows = regressors([motion(recording, axis, bandwidth, delay)])
    except ValueError:
        return None  # it hardly moves
    columns = [rows.names.index(name) for name in ("load", "load_zero")]
    own = rows.force - drive_force(rows, drive)
    slopes = rows.linear[:, columns]
    if len(own) < ROWS or np.ptp(slopes[:, 0]) == 0:
        return None
    values = np.linalg.lstsq(slopes, own, rcond=None)[0]
    only = np.isin(rows.names + ("",) * 4, ("load", "load_zero"))
    whole = np.zeros(len(only))
    whole[columns] = values
    found = Dynamics(
        names=rows.names + ("dip_positive", "dip_negative", "log_velocity_positive",
                            "log_velocity_negative"),
        values=whole, sought=only, weights=np.ones(len(own)), residuals=own - slopes @ values,
        evaluations=1,
    )  # fmt: skip
    factor = load_factor(found, dynamics_certainty(rows, found))
    return None if factor is None else replace(factor, zero=float(values[1]))


def drive_force(rows: Regressors, drive: FeedDriveParameters) -> Floats:
    """Force of the motor by an identified drive, without load [N]; shape (N,)."""
    ways = drive.friction.positive, drive.friction.negative
    value = {
        "mass": drive.mass,
        "viscous_positive": ways[0].viscous, "viscous_negative": ways[1].viscous,
        "level_positive": ways[0].coulomb + drive.offset,
        "level_negative": ways[1].coulomb - drive.offset,
    }  # fmt: skip
    linear = np.array([value.get(name, 0.0) for name in rows.names])
    dips = np.array([one.static - one.coulomb for one in ways])
    logs = np.log([one.stribeck_velocity for one in ways])
    force: Floats = rows.linear @ linear + rows.dip_columns(logs) @ dips
    return force
