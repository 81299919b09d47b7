"""Corrected command of a program: its axes, their table, their file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.gcode.moves import AXES, METRE, METRE_PER_SECOND
from pipeline.machine.control.interpolate import Trace
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.files import replacing
from pipeline.twin.correction import (
    REACH,
    AxisBounds,
    CorrectedAxis,
    CorrectionSettings,
    corrected_command,
    cutoff,
    smooth_step,
)
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import Residual, commanded_positions, moved_axes

HALF = "90 % half width [um]"


def corrected_program(
    plan: Plan,
    drives: Mapping[str, IdentifiedDrive],
    residual: Residual | None = None,
    *,
    settings: CorrectionSettings | None = None,
    longest: float = inf,
) -> tuple[dict[str, CorrectedAxis], Bools]:
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
    lead = max(_reach(drives[letter], period) for letter in letters)
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
    found: Bools = inside & cuts[np.clip(rows, 0, len(cuts) - 1)]
    return found


def fading(cuts: Bools, reach: int) -> Floats:
    """1 in cuts, smoothly to 0 within ``reach`` samples before and after each, shape (T,)."""
    ways = [_since(cuts), _since(cuts[::-1])[::-1]]
    after, before = (1.0 - smooth_step(np.minimum(way / (reach + 1), 1.0)) for way in ways)
    found: Floats = 1.0 - (1.0 - after) * (1.0 - before)
    return found


def _since(cuts: Bools) -> Floats:
    """Samples since the last cut, inf before the first."""
    rows = np.arange(len(cuts), dtype=float)
    found: Floats = rows - np.maximum.accumulate(np.where(cuts, rows, -inf))
    return found


def _reach(drive: IdentifiedDrive, period: float) -> int:
    if drive.servo is None:
        return 0
    return ceil(REACH / cutoff(drive.servo, drive.feed_drive, period) / period)


def _rows(axis: CorrectedAxis, rows: int, time: Floats) -> CorrectedAxis:
    """The first rows of an axis; at the end of what is cut off the correction is taken back."""
    half_width = None if axis.half_width is None else axis.half_width[:rows]
    return replace(
        axis, time=time[:rows], reference=axis.reference[:rows], corrected=axis.corrected[:rows],
        error_before=axis.error_before[:rows], error_after=axis.error_after[:rows],
        half_width=half_width, limited=axis.limited[:rows],
    )  # fmt: skip


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
                "rms_before_um": round(_rms(axis.error_before) * 1e6, 3),
                "max_before_um": round(float(np.abs(axis.error_before).max()) * 1e6, 3),
                "rms_after_um": round(_rms(axis.error_after) * 1e6, 3),
                "max_after_um": round(float(np.abs(axis.error_after).max()) * 1e6, 3),
                "cut_rms_before_um": round(_rms(axis.error_before[cut]) * 1e6, 3),
                "cut_rms_after_um": round(_rms(axis.error_after[cut]) * 1e6, 3),
                "half_width_90_um": None
                if axis.half_width is None
                else round(_rms(axis.half_width) * 1e6, 3),
                "limited_percent": round(100.0 * float(axis.limited.mean()), 2),
            }
            for letter, axis in self.axes.items()
        ]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
