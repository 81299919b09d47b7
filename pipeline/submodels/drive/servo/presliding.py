"""Friction before it slides, from the command of a closed loop: stiffness, and how it lets go.

The identified servo and mechanics follow the recorded reference with springs of many stiffnesses;
the one whose command comes nearest to the recorded one is taken, on a parabola through the sums of
squares over its logarithm.  What a wrong stiffness does to the command happens within micrometres
of each reversal; what other errors do is the same for all stiffnesses and does not count.  The
interval comes from leaving out one stretch of the records after the other (jackknife).

With that stiffness the time in which a standing axis loses its friction is found in the same way:
it shows where an axis stands after it has moved, and the command falls while nothing else happens.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
TIMES = (0.2, 60.0)
"""Least and greatest time that friction takes to let go of a standing axis [s]."""
TRIED = 41
ROUNDS = 6
"""Most rounds of both searches."""
STRETCHES = 8
"""Parts of all records that are left out in turn."""
SLOWEST = 2e-3
"""Longest sampling period that shows what happens within micrometres [s]."""
STEP = 2.5e-4
"""Longest step of the servo [s]."""
NORMAL = 1.96
HOW = "closed loop on recorded references, its command against the recorded one"
REVERSALS = "record reversals of the axis, reference and current at 1 kHz or more, without a load"
STANDSTILLS = (
    "record the axis standing for some seconds after it has moved, reference and current at 1 kHz "
    "or more, without a load; where its command does not fall then, friction holds"
)


class Estimate(NamedTuple):
    """A value with its 95 % interval, and whether the records determine it."""

    value: float
    low: float
    high: float
    determined: bool

    def parameter(self, unit: str, remedy: str) -> Parameter:
        """The value as it is stored."""
        known = self.determined
        return Parameter(
            value=float(f"{self.value:.5g}") if known else None, unit=unit,
            interval_95=(float(f"{self.low:.5g}"), float(f"{self.high:.5g}")) if known else None,
            determined=known, method=HOW, remedy="" if known else remedy,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PreslidingFit:
    """Friction of an axis before it slides.

    Parameters
    ----------
    stiffness : Estimate
        [N/m].
    time : Estimate or None
        In which friction lets go of a standing axis, to 1/e [s].
    """

    stiffness: Estimate
    time: Estimate | None = None

    def parameters(self, force_unit: str) -> dict[str, Parameter]:
        """Both as they are stored."""
        known = {"presliding_stiffness": self.stiffness.parameter(f"{force_unit}/m", REVERSALS)}
        if self.time is not None:
            known["presliding_time"] = self.time.parameter("s", STANDSTILLS)
        return known


def identify_presliding(
    recordings: Sequence[Recording], axis: str, servo: ServoParameters,
    screw: FeedDriveParameters, widest: float,
) -> PreslidingFit | None:  # fmt: skip
    """Friction of ``axis`` before it slides; None where no recording could show it.

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
    shown = [
        one for one in recordings
        if axis in one.axes and one.axes[axis].load is None and one.period <= SLOWEST
    ]  # fmt: skip
    friction = screw.friction
    level = max(friction.positive.static, friction.negative.static)
    if level <= 0.0:
        return None
    stiffnesses = np.geomspace(level / DEFLECTIONS[0], level / DEFLECTIONS[1], TRIED)
    row = drive_row(servo, screw)
    times, loss = np.geomspace(*TIMES, TRIED), 0.0
    found: list[PreslidingFit] = []
    # in turn, each with what is known of the other: their curves lie nearly across each other
    while len(found) < ROUNDS:
        springs = [(one, loss) for one in stiffnesses.tolist()]
        stiffness = _nearest(shown, axis, row, springs, stiffnesses, widest)
        if stiffness is None:
            return None
        springs = [(stiffness.value, 1.0 / one) for one in times.tolist()]
        time = _nearest(shown, axis, row, springs, times, widest)
        found.append(PreslidingFit(stiffness=stiffness, time=time))
        if time is None or not time.determined:
            break
        if len(found) > 1 and _same(found[-2], found[-1]):
            return found[-1]
        loss = 1.0 / time.value
    # without a time that holds the stiffness is that of friction that holds
    time = found[-1].time
    return PreslidingFit(
        stiffness=found[0].stiffness, time=None if time is None else time._replace(determined=False)
    )


def _same(before: PreslidingFit, found: PreslidingFit) -> bool:
    """Whether a round has moved neither value by more than 1 %."""
    if before.time is None or found.time is None:
        return False
    pairs = ((before.stiffness, found.stiffness), (before.time, found.time))
    return all(abs(one.value - two.value) <= 0.01 * two.value for one, two in pairs)


def _nearest(
    recordings: Sequence[Recording], axis: str, row: Floats,
    springs: Sequence[tuple[float, float]], values: Floats, widest: float,
) -> Estimate | None:  # fmt: skip
    """Value whose spring comes nearest to the recorded commands; None without a recording."""
    squares = [_squares(one, axis, row, springs) for one in recordings]
    squares = [one for one in squares if one.size and np.isfinite(one).all()]
    if not squares:
        return None
    parts = np.concatenate(squares, axis=1)  # (values, stretches)
    logs = np.log(values)
    whole, inside = _lowest(logs, parts.sum(axis=1))
    left = [_lowest(logs, np.delete(parts, k, axis=1).sum(axis=1)) for k in range(parts.shape[1])]
    places = np.array([place for place, _ in left])
    many = len(places)
    error = float(np.sqrt((many - 1) / many * ((places - places.mean()) ** 2).sum()))
    low, high = np.exp(whole - NORMAL * error), np.exp(whole + NORMAL * error)
    best = float(np.exp(whole))
    sure = inside and all(one for _, one in left) and (high - low) / 2 <= widest * best
    return Estimate(best, float(low), float(high), bool(sure))


def _squares(
    one: Recording, axis: str, row: Floats, springs: Sequence[tuple[float, float]]
) -> Floats:
    """Sums of squares of the command's error by spring and stretch; shape (K, STRETCHES)."""
    record = one.axes[axis]
    many = max(int(np.ceil(one.period / STEP - 1e-9)), 1)
    if record.reference is None or not stable(row, one.period / many):
        return np.zeros((len(springs), 0))
    fine = between(record.reference, many)
    load, position, command = np.zeros(len(fine)), np.empty(len(fine)), np.empty(len(fine))
    found = []
    for spring in springs:
        presliding_trace(fine, load, row, spring, one.period / many, position, command)
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
