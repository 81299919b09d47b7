"""Corrected command of feed axes by iterative learning control on the model; that of a program.

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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, log, pi, sqrt
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES, METRE, METRE_PER_SECOND
from pipeline.machine.axis.drive_parameters import (
    ServoParameters,
    check_steps,
    samples,
)
from pipeline.machine.control.interpolate import Trace
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Bools, Complexes, Floats
from pipeline.schema.drive import FeedDriveParameters
from pipeline.schema.files import replacing
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import Residual, commanded_positions, driven, moved_axes

REACH = 4.0
"""Reach of the low-pass in time, in 1 / cut-off: 0.02 % of its weight lie beyond."""
SHORTEST = 0.2
"""Share of what was missed, at which a step that gains nothing ends the learning [1]."""
END = 1e-9
"""Distance of positions that count as the same [m]."""


@dataclass(frozen=True, kw_only=True)
class CommandCorrectionSettings(Ranged, section="command_correction"):
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
    letter: str, reference: npt.ArrayLike, period: float, drive: IdentifiedDrive,
    residual: Residual | None = None, *, bounds: AxisBounds | None = None,
    settings: CommandCorrectionSettings | None = None, share: npt.ArrayLike | None = None,
) -> CorrectedAxis:  # fmt: skip
    """Command with which an axis is predicted to be where the program wants it.

    It begins and ends where the reference (T,) [m] does, and its bounds are no less than the
    reference itself reaches.  ``share`` (T,): part of the correction that is made, 0 to 1 [1].
    Raises ValueError when the reference is too short or not finite, the share has another length,
    or the drive has no servo or is unstable.
    """
    wanted, known = samples("reference", reference), settings or CommandCorrectionSettings()
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
        return self.window * whole[self.pad : self.pad + self.length]

    def _spectrum(self, values: Floats) -> Complexes:
        after = self.padded - self.length - self.pad
        return np.fft.rfft(np.pad(self.window * values, (self.pad, after)))


def smooth_step(s: Floats) -> Floats:
    """From 0 to 1 over s from 0 to 1, its speed and acceleration zero at both ends."""
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


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
    return forward / closed


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


HALF = "90 % half width [um]"


def corrected_program(
    plan: Plan, drives: Mapping[str, IdentifiedDrive], residual: Residual | None = None, *,
    settings: CommandCorrectionSettings | None = None, longest: float = inf,
) -> tuple[dict[str, CorrectedAxis], Bools]:  # fmt: skip
    """Linear axes with a servo that move in a program, each with its corrected command.

    Cuts are corrected.  In the rapids between them the correction fades out, for all axes at the
    same time, in the time that the slowest loop needs to forget.  The axes stand for a moment
    before and after the program, at times below 0 and beyond its end.  The bounds are the rapid
    speed and the acceleration of the control; ``longest`` [s] is the corrected time from the
    program's start.

    Returns the axes by letter, on the same T samples, and the samples (T,) in blocks that cut.
    Raises ValueError when no axis can be corrected, or a drive is unstable.
    """
    commanded = commanded_positions(plan)
    letters = moved_axes(commanded, drives)
    if not letters:
        raise ValueError(
            "no linear axis with an identified servo moves in the program: identify the drives of "
            "the axes that move, or correct another program"
        )
    period = float(commanded.time[1] - commanded.time[0])
    slowest = min(
        cutoff(one.servo, one.feed_drive, period)
        for one in (drives[letter] for letter in letters) if one.servo is not None
    )  # fmt: skip
    lead = ceil(REACH / slowest / period)
    whole = rows = len(commanded) + 2 * lead
    if longest / period < len(commanded) - 1:
        rows = ceil(longest / period) + 1 + lead
    time: Floats = np.float64(period) * (np.arange(min(rows + lead, whole)) - lead)
    cutting = in_cuts(plan, commanded, time)
    share = fading(cutting, lead)
    axes = {}
    for letter in letters:
        position = np.pad(commanded.position[:, AXES.index(letter)], lead, mode="edge")
        axis = corrected_command(
            letter, position[: len(time)], period, drives[letter], residual,
            bounds=axis_bounds(plan.path.control, letter), settings=settings, share=share,
        )  # fmt: skip
        axes[letter] = _rows(axis, rows, time)
    return axes, cutting[:rows]


def in_cuts(plan: Plan, commanded: Trace, time: Floats) -> Bools:
    """Samples (T,) of a corrected command, at ``time`` (T,) [s], in blocks that cut."""
    cuts = np.isin(plan.path.motion, (Motion.CUTTING, Motion.PER_TURN))[commanded.row]
    period = float(commanded.time[1] - commanded.time[0])
    rows = np.rint(time / period).astype(int)
    inside = (rows >= 0) & (rows < len(cuts))
    return inside & cuts[np.clip(rows, 0, len(cuts) - 1)]


def fading(cuts: Bools, reach: int) -> Floats:
    """1 in cuts, smoothly to 0 within ``reach`` samples before and after each, shape (T,)."""
    ways = [_since(cuts), _since(cuts[::-1])[::-1]]
    after, before = (1.0 - smooth_step(np.minimum(way / (reach + 1), 1.0)) for way in ways)
    return 1.0 - (1.0 - after) * (1.0 - before)


def _since(cuts: Bools) -> Floats:
    """Samples since the last cut, inf before the first."""
    rows = np.arange(len(cuts), dtype=float)
    return rows - np.maximum.accumulate(np.where(cuts, rows, -inf))


def _rows(axis: CorrectedAxis, rows: int, time: Floats) -> CorrectedAxis:
    """The first rows of an axis; at the end of what is cut off the correction is taken back."""
    arrays: dict[str, Any] = {
        name: one[:rows] for name, one in vars(axis).items() if isinstance(one, np.ndarray)
    }
    return replace(axis, **(arrays | {"time": time[:rows]}))


def axis_bounds(control: ControlParameters, letter: str) -> AxisBounds:
    """Rapid speed and acceleration that a control may command an axis; none of one it has not."""
    axis = control.axes.get(letter)
    if axis is None:
        return AxisBounds()
    limit = axis.acceleration_limit or control.filtered_acceleration(letter)
    return AxisBounds(speed=axis.rapid_speed * METRE_PER_SECOND, acceleration=limit * METRE)


@dataclass(frozen=True, kw_only=True)
class CorrectedProgram:
    """A program's corrected command with what it rests on."""

    machine: str
    origin: str
    program: str
    """Machine of the drives, origin of its records, and program."""
    champion: str
    """Bundle of sub-models used."""
    residual: str
    """Residual network used, or the reason why none was."""
    total: float
    """Total of the program [s]."""
    axes: Mapping[str, CorrectedAxis]
    """Axes by letter, on the same samples."""
    cutting: Bools
    """Samples in blocks that cut; errors of rapids do not touch the part; shape (T,)."""

    @property
    def figures(self) -> list[dict[str, Any]]:
        """Following error of each axis as predicted, before and after, whole and in cuts [um]."""
        cut = self.cutting if self.cutting.any() else np.ones(len(self.cutting), bool)
        return [
            {
                "axis": letter,
                "rms_before_um": _rms_um(axis.error_before),
                "max_before_um": round(float(np.abs(axis.error_before).max()) * 1e6, 3),
                "rms_after_um": _rms_um(axis.error_after),
                "max_after_um": round(float(np.abs(axis.error_after).max()) * 1e6, 3),
                "cut_rms_before_um": _rms_um(axis.error_before[cut]),
                "cut_rms_after_um": _rms_um(axis.error_after[cut]),
                "half_width_90_um": None if (w := axis.half_width) is None else _rms_um(w),
                "limited_percent": round(100.0 * float(axis.limited.mean()), 2),
            }
            for letter, axis in self.axes.items()
        ]


def _rms_um(values: Floats) -> float:
    return round(float(np.sqrt(np.mean(values**2))) * 1e6, 3)


def correction_table(figures: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """:attr:`CorrectedProgram.figures` as a table in lines."""
    yield (
        "axis  in cuts: RMS before [um]  RMS after  whole: RMS before [um]  RMS after  "
        f"max before [um]  max after  {HALF}  limited [%]"
    )
    for one in figures:
        half = "-" if one["half_width_90_um"] is None else f"{one['half_width_90_um']:.1f}"
        yield (
            f"{one['axis']:<4}  {one['cut_rms_before_um']:>24.1f}  "
            f"{one['cut_rms_after_um']:>9.1f}  {one['rms_before_um']:>22.1f}  "
            f"{one['rms_after_um']:>9.1f}  "
            f"{one['max_before_um']:>15.1f}  {one['max_after_um']:>9.1f}  {half:>20}  "
            f"{one['limited_percent']:>11.1f}"
        )


def write_corrected(done: CorrectedProgram, path: Path) -> None:
    """Write commanded and corrected positions [mm] over time [s] as CSV, after comments.

    Columns ``t``, ``X`` and ``X_corrected`` for each axis in the machine's frame, at the control's
    interpolation period, and ``cutting``: 1 in blocks that cut.
    """
    first = next(iter(done.axes.values()))
    columns = [first.time]
    for axis in done.axes.values():
        columns += [axis.reference / METRE, axis.corrected / METRE]
    table = np.column_stack([*columns, done.cutting]) + 0.0  # no -0
    names = ["t", *(name for letter in done.axes for name in (letter, f"{letter}_corrected"))]
    names.append("cutting")
    shapes = ["%.6f"] * len(columns) + ["%d"]
    with replacing(path) as part, part.open("w", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in _head(done, first))
        file.write(",".join(names) + "\n")
        np.savetxt(file, table, fmt=shapes, delimiter=",")


def _head(done: CorrectedProgram, first: CorrectedAxis) -> Iterator[str]:
    label = " (simulated)" if done.origin == "simulated" else ""
    period = float(first.time[1] - first.time[0])
    yield f"Kerf: corrected command of the feed axes of {done.machine}{label}"
    yield f"program: {done.program}; origin: {done.origin}; champion: {done.champion}"
    yield f"residual network: {done.residual}"
    yield (
        f"positions in the machine's frame [mm] at the interpolation period of {period:g} s: "
        "X where the program wants the axis, X_corrected what to command for that"
    )
    yield "t is the time of the program [s]; before 0 and after its end the axes stand"
    if first.time[-1] < done.total:
        yield f"only the first {first.time[-1]:.6g} s of {done.total:.6g} s"
    yield "following error as the twin predicts it, not measured:"
    yield from correction_table(done.figures)
