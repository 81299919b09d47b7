"""Corrected command of feed axes by iterative learning control on the model.

The twin, and a network beside it, predict the error e(u) of an axis driven with the command u. With
u = r + c the axis is at its reference r when c = e(r + c).  The correction is learnt as iterative
learning control learns on a machine (Bristow, Tharayil, Alleyne: A survey of iterative learning
control, IEEE Control Systems Magazine 26(3), 2006):

    c <- Q (c + q G^-1 (e(r + c) - c))

G is the linear part of the loop from command to position.  Q, a zero-phase Gaussian low-pass, has
its -3 dB where G has them, so that Q / G is about 1 or less.  The learning factor q is 1, and is
halved when a step makes the predicted error larger; the best step is kept.  A share w of 0 to 1 at
each sample says how much of it is made: in a rapid at the limits of its axes none.
"""

from dataclasses import dataclass, field, replace
from math import ceil, inf, log, pi, sqrt
from typing import Annotated

import numpy as np
import numpy.typing as npt

from pipeline.machine.axis.drive_parameters import ServoParameters, check_steps, samples
from pipeline.schema.arrays import Bools, Complexes, Floats
from pipeline.schema.drive import FeedDriveParameters
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import Residual, driven

REACH = 4.0
"""Reach of the low-pass in time, in 1 / cut-off: 0.02 % of its weight lie beyond."""
SHORTEST = 0.2
"""Share of what was missed, at which a step that gains nothing ends the learning [1]."""
END = 1e-9
"""Distance of positions that count as the same [m]."""


@dataclass(frozen=True, kw_only=True)
class CorrectionSettings(Ranged, section="correction"):
    """Iterations of a program's correction."""

    iterations: Annotated[int, Range(least=1)] = 12
    """Greatest number of steps on the drive alone, and again with what the twin leaves over."""
    tolerance: NotNegative = 0.02
    """Relative gain of a step below which no further one is made [1]."""
    longest_s: Positive = 40.0
    """Longest part of a program, from its start, that the main job corrects [s]."""


@dataclass(frozen=True, kw_only=True)
class AxisBounds(Ranged, section="bounds"):
    """Greatest speed and acceleration of a command [m/s], [m/s^2]."""

    speed: Annotated[float, Range(above=0.0, finite=False, unit="m/s")] = inf
    acceleration: Annotated[float, Range(above=0.0, finite=False, unit="m/s^2")] = inf


@dataclass(frozen=True, kw_only=True)
class CorrectedAxis:
    """One axis with its corrected command; every array has shape (T,)."""

    time: Floats = field(repr=False)
    """Time [s]."""
    reference: Floats = field(repr=False)
    corrected: Floats = field(repr=False)
    """Reference position of the axis, and the command for it [m]."""
    error_before: Floats = field(repr=False)
    error_after: Floats = field(repr=False)
    """Error before and after: ``reference`` less predicted position, driven with ``reference`` and
    with ``corrected`` [m]."""
    half_width: Floats | None = field(repr=False, default=None)
    """Half width of the 90 % interval of ``error_after`` [m]; None without a residual."""
    cutoff: float
    """Cutoff of the correction [rad/s]."""
    limited: Bools = field(repr=False)
    """Samples where bounds keep the command from the requested one."""


@dataclass(frozen=True, kw_only=True)
class _Step:
    """A correction [m], what it leaves [m] with its 90 % half width, and where it is limited."""

    correction: Floats
    missed: Floats
    half_width: Floats | None
    limited: Bools

    def rms(self, share: Floats) -> float:
        return float(np.sqrt(np.mean((share * self.missed) ** 2)))


def corrected_command(
    letter: str,
    reference: npt.ArrayLike,
    period: float,
    drive: IdentifiedDrive,
    residual: Residual | None = None,
    *,
    bounds: AxisBounds | None = None,
    settings: CorrectionSettings | None = None,
    share: npt.ArrayLike | None = None,
) -> CorrectedAxis:
    """Command with which an axis is predicted to be where the program wants it.

    It begins and ends where the reference (T,) [m] does, and its bounds are no less than the
    reference itself reaches.  ``share`` (T,): part of the correction that is made, 0 to 1 [1].
    Raises ValueError when the reference is too short or not finite, the share has another length,
    or the drive has no servo or is unstable.
    """
    wanted, known = samples("reference", reference), settings or CorrectionSettings()
    check_steps(period, 1)
    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    if len(wanted) < 3:
        raise ValueError(f"reference has {len(wanted)} samples: give at least 3 to correct it")
    made = np.ones(len(wanted)) if share is None else np.asarray(share, float)
    if made.shape != wanted.shape:
        raise ValueError(f"share has shape {made.shape}: give one value for each of {len(wanted)}")
    learning = _Learning(drive.servo, drive.feed_drive, period, made)

    def step(correction: Floats, asked: Floats, beyond: Residual | None) -> _Step:
        u = wanted + correction
        position, command = driven(letter, drive, u, period)
        error, half_width = u - position, None
        if beyond is not None:
            left, half_width = beyond(letter, u, error, command, period)
            error = error + left
        return _Step(correction=correction, missed=error - correction, half_width=half_width,
                     limited=np.abs(correction - asked) > END)  # fmt: skip

    def learnt(best: _Step, beyond: Residual | None) -> _Step:
        factor = 1.0
        for _ in range(known.iterations):
            asked = learning.learnt(best.correction, factor * best.missed)
            kept = bounded(wanted, asked, period, bounds or AxisBounds(), learning.reach)
            following = step(kept, asked, beyond)
            if following.rms(made) >= best.rms(made):
                factor *= 0.5
                if factor < SHORTEST:
                    break
                continue
            gained, best = 1.0 - following.rms(made) / best.rms(made), following
            if gained < known.tolerance:
                break
        return best

    nothing = np.zeros(len(wanted))
    before = step(nothing, nothing, residual)
    best = learnt(before if residual is None else step(nothing, nothing, None), None)
    if residual is not None:  # it takes long and changes little: the drive alone is learnt first
        begun = replace(step(best.correction, best.correction, residual), limited=best.limited)
        best = learnt(min(before, begun, key=lambda one: one.rms(made)), residual)
    return CorrectedAxis(
        time=np.float64(period) * np.arange(len(wanted)), reference=wanted,
        corrected=wanted + best.correction, error_before=before.missed, error_after=best.missed,
        half_width=best.half_width, cutoff=learning.cutoff, limited=best.limited,
    )  # fmt: skip


class _Learning:
    """The filters of the iteration for T samples of a loop, of which a share (T,) is made."""

    def __init__(
        self, servo: ServoParameters, feed_drive: FeedDriveParameters, period: float, share: Floats
    ) -> None:
        from scipy.fft import next_fast_len

        length = len(share)
        self.cutoff = cutoff(servo, feed_drive, period)
        whole = ceil(REACH / self.cutoff / period)
        self.reach = min(whole, length // 2)
        self.length, self.pad = length, 2 * whole
        self.padded = next_fast_len(length + 2 * self.pad, real=True)
        omega = np.float64(2 * pi) * np.fft.rfftfreq(self.padded, period)
        self.low_pass = np.exp(-0.5 * log(2.0) * (omega / self.cutoff) ** 2)
        self.inverse = np.ones(len(omega), np.complex128)
        self.inverse[1:] = 1.0 / reference_response(servo, feed_drive, omega[1:])
        self.window = np.ones(length)
        rise = smooth_step(np.arange(self.reach) / max(self.reach, 1))
        self.window[: self.reach], self.window[length - self.reach :] = rise, rise[::-1]
        self.window *= share

    def learnt(self, correction: Floats, missed: Floats) -> Floats:
        """The next correction [m]; zero at both ends and where nothing of it is made."""
        spectrum = self._spectrum(correction) + self.inverse * self._spectrum(missed)
        whole = np.fft.irfft(self.low_pass * spectrum, self.padded)
        found: Floats = self.window * whole[self.pad : self.pad + self.length]
        return found

    def _spectrum(self, values: Floats) -> Complexes:
        after = self.padded - self.length - self.pad
        return np.fft.rfft(np.pad(self.window * values, (self.pad, after)))


def smooth_step(s: Floats) -> Floats:
    """From 0 to 1 over s from 0 to 1, its speed and acceleration zero at both ends."""
    found: Floats = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return found


def reference_response(
    servo: ServoParameters, feed_drive: FeedDriveParameters, omega: Floats
) -> Complexes:
    """Position for a commanded position of the linear loop at ``omega`` (F,) [rad/s], complex [1].

    With s = i w, the plant H = k / (M s + b), the PI loop L = H (V + R / s) and the lags,

    G = (L (K + f_v s) / (1 + T_x s) + H f_a s^2) / (s (1 + L / (1 + T_v s)) + L K / (1 + T_x s)).

    Sampling is left out; the axis is in slip, b that of its less viscous direction.
    """
    s = 1j * omega
    sides = feed_drive.friction.positive.viscous, feed_drive.friction.negative.viscous
    plant = feed_drive.force_constant / (feed_drive.mass * s + min(sides))
    loop = plant * (servo.proportional + servo.integral / s)
    late = 1.0 + servo.position_lag * s
    forward = loop * (servo.loop_gain + servo.velocity_feedforward * s) / late
    forward += plant * servo.acceleration_feedforward * s**2
    closed = s * (1.0 + loop / (1.0 + servo.velocity_lag * s)) + loop * servo.loop_gain / late
    found: Complexes = forward / closed
    return found


def cutoff(servo: ServoParameters, feed_drive: FeedDriveParameters, period: float) -> float:
    """Cutoff at which an axis follows its command by -3 dB [rad/s].

    At most a quarter of the sampling rate of the correction, ``period`` [s].
    """
    highest = 0.25 * pi / period
    omega = np.geomspace(min(1e-3 * servo.loop_gain, highest), highest, 2000)
    lower = np.abs(reference_response(servo, feed_drive, omega)) < sqrt(0.5)
    return float(omega[np.argmax(lower)]) if lower.any() else highest


def bounded(
    reference: Floats, correction: Floats, period: float, bounds: AxisBounds, reach: int
) -> Floats:
    """Correction with which the command keeps its bounds; the same object where it does.

    Where it does not, the command is as near to the requested one as the bounds let it be.  So that
    it ends where the reference ends, the correction is taken back before the end, first from
    ``reach`` samples before it.  Positions (T,) in [m], period in [s]; the correction is zero at
    both ends, and a bound is no less than the reference itself reaches.
    """
    from pipeline.machine.control.interpolate import follow_within

    own = _speed_and_acceleration(reference, period)
    most = [
        max(limit, float(one.max(initial=0.0)))
        for limit, one in zip((bounds.speed, bounds.acceleration), own, strict=True)
    ]
    found = _speed_and_acceleration(reference + correction, period)
    if all((one <= limit).all() for one, limit in zip(found, most, strict=True)):
        return correction
    length, taken = len(reference), max(reach, 1)
    speed, acceleration = most[0], min(most[1], 2.0 * most[0] / period)  # from -speed to speed
    kept, ending = np.empty(length), np.ones(length)
    while taken < length:
        ending[length - taken :] = smooth_step(np.arange(taken)[::-1] / taken)
        follow_within(reference + ending * correction, period, speed, acceleration, kept)
        if abs(kept[-1] - reference[-1]) < END:
            return kept - reference
        taken *= 2
    return np.zeros(length)


def _speed_and_acceleration(position: Floats, period: float) -> tuple[Floats, Floats]:
    """Magnitudes at the samples, (T,) each, the axis standing before and after."""
    speed = np.diff(position, append=position[-1]) / period
    acceleration = np.diff(speed, prepend=0.0) / period
    return np.abs(speed), np.abs(acceleration)
