"""Presliding friction from the command of a closed loop: stiffness, and relaxation.

The identified servo and mechanics follow the recorded reference with springs of many stiffnesses;
the one whose command comes nearest to the recorded one is taken, on a parabola through the sums of
squares over its logarithm.  What a wrong stiffness does to the command happens within micrometres
of each reversal; what other errors do is the same for all stiffnesses and does not count.  The
interval comes from leaving out one stretch of the records after the other (jackknife).

With that stiffness the time in which a standing axis loses its friction is identified likewise:
it shows where an axis stands after it has moved, and the command falls while nothing else happens.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import ServoParameters, drive_row
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import FeedDriveParameters
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import jackknife_half_width
from pipeline.twin.drive import stable
from pipeline.twin.program_axes import between

DEFLECTIONS = (1e-4, 2e-7)
"""Greatest and least deflection before sliding of the stiffnesses that are tried [m]."""
TIMES = (0.2, 60.0)
"""Least and greatest time that friction takes to let go of a standing axis [s]."""
TRIED = 41
COARSE = 5
"""Step through the values that are tried first [1]."""
ROUNDS = 6
"""Most rounds of both searches."""
STRETCHES = 8
"""Parts of all records that are left out in turn."""
SLOWEST = 2e-3
"""Longest sampling period that shows what happens within micrometres [s]."""
STEP = 2.5e-4
"""Longest step of the servo [s]."""
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
        return Parameter.estimated(
            self.value, self.low, self.high, unit, method=HOW, remedy=remedy,
            determined=self.determined,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PreslidingFit:
    """Friction of an axis before it slides."""

    stiffness: Estimate
    """Stiffness [N/m]."""
    time: Estimate | None = None
    """Time in which friction lets go of a standing axis, to 1/e [s]."""

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
    """Friction of ``axis`` before it slides; None where no recording could show it."""
    shown = [
        one for one in recordings
        if axis in one.axes and one.axes[axis].load is None and one.period <= SLOWEST
    ]  # fmt: skip
    friction = screw.friction
    level = max(friction.positive.static, friction.negative.static)
    if level <= 0.0:
        return None
    row = drive_row(servo, screw)
    loops = [loop for one in shown if (loop := _loop(one, axis, row)) is not None]
    stiffnesses = np.geomspace(level / DEFLECTIONS[0], level / DEFLECTIONS[1], TRIED)
    times, loss = np.geomspace(*TIMES, TRIED), 0.0
    found: list[PreslidingFit] = []
    # in turn, each with what is known of the other: their curves lie nearly across each other
    while len(found) < ROUNDS:
        before = (found[-1].stiffness, found[-1].time) if found else (None, None)
        springs = [(one, loss) for one in stiffnesses.tolist()]
        stiffness = _nearest(loops, row, springs, stiffnesses, widest, before[0])
        if stiffness is None:
            return None
        springs = [(stiffness.value, 1.0 / one) for one in times.tolist()]
        time = _nearest(loops, row, springs, times, widest, before[1])
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


class _Loop(NamedTuple):
    """Reference of a recording at the steps of the servo, its command, and steps in a sample."""

    reference: Floats
    command: Floats
    many: int
    step: float


def _loop(one: Recording, axis: str, row: Floats) -> _Loop | None:
    """The recording's loop; None without a reference, or where its steps are too long."""
    record = one.axes[axis]
    many = max(int(np.ceil(one.period / STEP - 1e-9)), 1)
    if record.reference is None or not stable(row, one.period / many):
        return None
    return _Loop(between(record.reference, many), record.command, many, one.period / many)


def _nearest(
    loops: Sequence[_Loop], row: Floats, springs: Sequence[tuple[float, float]], values: Floats,
    widest: float, near: Estimate | None,
) -> Estimate | None:  # fmt: skip
    """Value whose spring comes nearest to the recorded commands; None without a recording.

    The curve over the values has one valley: from the lowest of a coarse grid, or from the value
    ``near`` that was found before, it is followed down to the lowest of all.
    """
    last = len(values) - 1
    coarse = list(range(0, len(values), COARSE))
    if near is not None:
        coarse = [0, int(np.abs(values - near.value).argmin()), last]
    first = {k: [_squares(one, row, springs[k]) for one in loops] for k in coarse}
    finite = np.array([[np.isfinite(one).all() for one in each] for each in first.values()])
    kept = np.flatnonzero(finite.all(axis=0)).tolist()
    if not kept:
        return None
    known = {k: np.concatenate([one[n] for n in kept]) for k, one in first.items()}
    logs = np.log(values)

    def lowest(out: int | None) -> tuple[float, bool]:
        """Place of the least by a parabola through three points, and whether it is inside."""

        def total(k: int) -> float:
            parts = known[k] if out is None else np.delete(known[k], out)
            return float(parts.sum())

        while True:
            k = min(known, key=total)
            beside = [j for j in (k - 1, k + 1) if 0 <= j <= last and j not in known]
            if not beside:
                break
            for j in beside:
                known[j] = np.concatenate([_squares(loops[n], row, springs[j]) for n in kept])
        if not 0 < k < last:
            return float(logs[k]), False
        below, here, above = (total(j) for j in (k - 1, k, k + 1))
        shift = 0.5 * (below - above) / (below - 2 * here + above)
        return float(logs[k] + shift * (logs[1] - logs[0])), True

    whole, inside = lowest(None)
    left = [lowest(out) for out in range(len(next(iter(known.values()))))]
    places = np.array([place for place, _ in left])
    half = float(jackknife_half_width(places))
    low, high = np.exp(whole - half), np.exp(whole + half)
    best = float(np.exp(whole))
    sure = inside and all(one for _, one in left) and (high - low) / 2 <= widest * best
    return Estimate(best, float(low), float(high), bool(sure))


def _squares(loop: _Loop, row: Floats, spring: tuple[float, float]) -> Floats:
    """Sums of squares of the command's error with a spring, by stretch; shape (STRETCHES,)."""
    found = simulate(loop.reference, loop.step, row[np.newaxis], spring=spring)
    error = (found.command[0, :: loop.many] - loop.command) ** 2
    return np.array([part.sum() for part in np.array_split(error, STRETCHES)])
