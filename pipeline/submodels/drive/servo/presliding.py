"""Stiffness of friction before it slides, from the command of a closed loop about its reversals.

The identified servo and mechanics follow the recorded reference with springs of many stiffnesses;
the one whose command comes nearest to the recorded one is taken, on a parabola through the sums of
squares over its logarithm.  What a wrong stiffness does to the command happens within micrometres
of each reversal; what other errors do is the same for all stiffnesses and does not count.  The
interval comes from leaving out one stretch of the records after the other (jackknife).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.machine.axis.feed_drive import FeedDriveParameters, drive_row
from pipeline.machine.axis.presliding import presliding_trace
from pipeline.machine.axis.servo import ServoParameters
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.records import Recording
from pipeline.twin.drive import stable
from pipeline.twin.program_axes import between

DEFLECTIONS = (1e-4, 2e-7)
"""Greatest and least deflection before sliding of the stiffnesses that are tried [m]."""
TRIED = 25
STRETCHES = 8
"""Parts of all records that are left out in turn."""
SLOWEST = 2e-3
"""Longest sampling period that shows what happens within micrometres [s]."""
STEP = 2.5e-4
"""Longest step of the servo [s]."""
NORMAL = 1.96
HOW = "closed loop on recorded references, its command against the recorded one"
REMEDY = "record reversals of the axis, reference and current at 1 kHz or more, without a load"


@dataclass(frozen=True, kw_only=True)
class PreslidingFit:
    """Stiffness of an axis' friction before it slides, with its 95 % interval [N/m]."""

    stiffness: float
    low: float
    high: float
    determined: bool

    def parameter(self, force_unit: str) -> Parameter:
        """The stiffness as it is stored."""
        known = self.determined
        return Parameter(
            value=float(f"{self.stiffness:.5g}") if known else None, unit=f"{force_unit}/m",
            interval_95=(float(f"{self.low:.5g}"), float(f"{self.high:.5g}")) if known else None,
            determined=known, method=HOW, remedy="" if known else REMEDY,
        )  # fmt: skip


def identify_presliding(
    recordings: Sequence[Recording], axis: str, servo: ServoParameters,
    screw: FeedDriveParameters, widest: float,
) -> PreslidingFit | None:  # fmt: skip
    """Stiffness of ``axis`` before it slides; None where no recording could show it.

    Parameters
    ----------
    recordings : sequence of Recording
        For training; those with a load are left out.
    axis : str
        Its letter.
    servo, screw : ServoParameters, FeedDriveParameters
        As identified.
    widest : float
        Greatest half width of a determined interval, as a share.
    """
    friction = screw.friction
    level = max(friction.positive.static, friction.negative.static)
    if level <= 0.0:
        return None
    stiffnesses = np.geomspace(level / DEFLECTIONS[0], level / DEFLECTIONS[1], TRIED)
    row = drive_row(servo, screw)
    squares = [
        _squares(one, axis, row, stiffnesses)
        for one in recordings
        if axis in one.axes and one.axes[axis].load is None and one.period <= SLOWEST
        and one.axes[axis].reference is not None
    ]  # fmt: skip
    squares = [one for one in squares if one.size and np.isfinite(one).all()]
    if not squares:
        return None
    parts = np.concatenate(squares, axis=1)  # (stiffnesses, stretches)
    logs = np.log(stiffnesses)
    whole, inside = _lowest(logs, parts.sum(axis=1))
    left = [_lowest(logs, np.delete(parts, k, axis=1).sum(axis=1)) for k in range(parts.shape[1])]
    places = np.array([place for place, _ in left])
    many = len(places)
    error = float(np.sqrt((many - 1) / many * ((places - places.mean()) ** 2).sum()))
    low, high = np.exp(whole - NORMAL * error), np.exp(whole + NORMAL * error)
    best = float(np.exp(whole))
    sure = inside and all(one for _, one in left) and (high - low) / 2 <= widest * best
    return PreslidingFit(
        stiffness=best, low=float(low), high=float(high),
        determined=bool(sure),
    )  # fmt: skip


def _squares(one: Recording, axis: str, row: Floats, stiffnesses: Floats) -> Floats:
    """Sums of squares of the command's error by stiffness and stretch; shape (K, STRETCHES)."""
    record = one.axes[axis]
    many = max(int(np.ceil(one.period / STEP - 1e-9)), 1)
    if record.reference is None or not stable(row, one.period / many):
        return np.zeros((len(stiffnesses), 0))
    fine = between(record.reference, many)
    load, position, command = np.zeros(len(fine)), np.empty(len(fine)), np.empty(len(fine))
    found = []
    for stiffness in stiffnesses.tolist():
        presliding_trace(fine, load, row, stiffness, one.period / many, position, command)
        error = (command[::many] - record.command) ** 2
        found.append([part.sum() for part in np.array_split(error, STRETCHES)])
    return np.array(found)


def _lowest(logs: Floats, sums: Floats) -> tuple[float, bool]:
    """Place of a curve's least by a parabola through three points; whether it is inside."""
    k = int(np.argmin(sums))
    if not 0 < k < len(sums) - 1:
        return float(logs[k]), False
    below, here, above = sums[k - 1 : k + 2].tolist()
    shift = 0.5 * (below - above) / (below - 2 * here + above)
    return float(logs[k] + shift * (logs[1] - logs[0])), True
