"""Following error and motor command of the axes along a program, in air and in the cut.

The control's positions, sampled at its interpolation period, are each axis' reference.  In the cut
the mean force of :mod:`pipeline.twin.cut_force` is the axes' load, at the place where the tool is:
behind the interpolator by what its filters and the servos take, one delay for the program.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES
from pipeline.machine.axis.feed_drive import drive_row
from pipeline.machine.control.interpolate import Trace, trace
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import AxisInCut
from pipeline.twin.cut import Cut
from pipeline.twin.cut_force import CutForce, cut_force
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.drive_population import simulate_traces

MOST = 20_000_000
"""Positions that are held at once."""
NEWTON = "N"
"""Unit of the forces of a drive whose force constant is known."""
MICROMETRE = 1e-6
SUBSTEPS = 4
"""Samples of the servo in one interpolation period: velocity loops run that much faster."""
PER_TOOTH, MOST_SUBSTEPS = 8, 32
"""Least samples in a tooth period, and the most in one interpolation period for that."""


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


@dataclass(frozen=True, kw_only=True)
class CutFollowing:
    """Axes along a program in air and in the cut, by letter, and the force between them.

    Parameters
    ----------
    air, cut : dict of str to AxisFollowing
        The same axes at the same T times, without and with the force.
    load : CutForce
        Of the cut at these times.
    """

    air: dict[str, AxisFollowing]
    cut: dict[str, AxisFollowing]
    load: CutForce


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
    return _in_air(plan, _trace(plan), drives)


def follow_cut(cut: Cut, drives: Mapping[str, IdentifiedDrive]) -> CutFollowing:
    """The same axes in air and under the force of the cut.

    An axis whose forces are in the unit of its command, its force constant not being listed, is
    left out: a load in newtons says nothing to it.

    Parameters
    ----------
    cut : Cut
        Of a planned program.
    drives : mapping of str to IdentifiedDrive
        By the axis' letter.

    Raises
    ------
    ValueError
        As :func:`follow_program`.
    """
    plan, commanded = cut.plan, _trace(cut.plan)
    known = {letter: drive for letter, drive in drives.items() if drive.force_unit == NEWTON}
    air = _in_air(plan, commanded, known)
    load = cut_force(cut, commanded, _delay(commanded, air))
    loaded = {letter: _followed(letter, known[letter], commanded, load) for letter in air}
    return CutFollowing(air=air, cut=loaded, load=load)


def axes_in_cut(found: CutFollowing, lines: npt.NDArray[np.integer]) -> tuple[AxisInCut, ...]:
    """Peaks and RMS values of each axis while the tool is in the material; none where it is not.

    Parameters
    ----------
    found : CutFollowing
        Of a program of M rows.
    lines : (M,) array of int
        Line of each row.
    """
    inside = np.flatnonzero(found.load.cutting)
    if not len(inside):
        return ()
    axes = []
    for letter, one in found.cut.items():
        error, command = one.error[inside] / MICROMETRE, one.command[inside]
        air = found.air[letter]
        behind, drawn = int(np.argmax(np.abs(error))), int(np.argmax(np.abs(command)))
        axes.append(AxisInCut(
            axis=letter,
            following_um=_figure(np.abs(error).max()),
            following_rms_um=_figure(np.sqrt(np.mean(error**2))),
            following_air_um=_figure(np.abs(air.error[inside]).max() / MICROMETRE),
            following_line=int(lines[one.row[inside[behind]]]),
            command=_figure(np.abs(command).max()),
            command_rms=_figure(np.sqrt(np.mean(command**2))),
            command_air=_figure(np.abs(air.command[inside]).max()),
            command_line=int(lines[one.row[inside[drawn]]]),
            command_unit=one.command_unit,
            force_N=_figure(np.abs(found.load.force[inside, AXES.index(letter)]).max()),
        ))  # fmt: skip
    return tuple(axes)


def _figure(value: float) -> float:
    return float(f"{value:.6g}")


def _trace(plan: Plan) -> Trace:
    period = plan.path.control.interpolation_period
    if plan.total > MOST * period:
        raise ValueError(
            f"{plan.total:.0f} s at {period} s are more than {MOST} positions: simulate a shorter "
            "program, or raise control.interpolation_period"
        )
    return trace(plan)


def _in_air(
    plan: Plan, commanded: Trace, drives: Mapping[str, IdentifiedDrive]
) -> dict[str, AxisFollowing]:
    return {
        letter: _followed(letter, drive, commanded)
        for letter, drive in drives.items()
        if drive.servo is not None
        and letter in "XYZ"
        and np.ptp(commanded.position[:, AXES.index(letter)]) > 0
    }


def _followed(
    letter: str, drive: IdentifiedDrive, commanded: Trace, load: CutForce | None = None
) -> AxisFollowing:
    """One axis along its reference, in air or under the force of a cut."""
    if drive.servo is None:
        raise ValueError(f"axis {letter} has no servo: {drive.servo_reason}")
    axis = AXES.index(letter)
    reference, row = commanded.position[:, axis], drive_row(drive.servo, drive.feed_drive)
    step = float(commanded.time[1] - commanded.time[0])
    fastest = 0.0 if load is None else float(load.tooth_frequency.max(initial=0.0))
    many = int(np.clip(np.ceil(PER_TOOTH * fastest * step), SUBSTEPS, MOST_SUBSTEPS))
    fine = between(reference, many)
    push = np.zeros(len(fine)) if load is None else _load(load, axis, step, many)
    if drive.presliding_stiffness is None:
        traces = simulate_traces(fine, step / many, row[np.newaxis], load=push)
        position, command = traces.position[0], traces.command[0]
    else:
        from pipeline.machine.axis.presliding import presliding_trace

        position, command = np.empty(len(fine)), np.empty(len(fine))
        presliding_trace(
            fine, push, row, drive.presliding_stiffness, step / many, position, command
        )
    if not np.isfinite(position).all():
        raise ValueError(f"the drive of axis {letter} is unstable: identify it again")
    return AxisFollowing(
        time=commanded.time, error=reference - position[::many], command=command[::many],
        row=commanded.row, command_unit=drive.command_unit,
    )  # fmt: skip


def _load(load: CutForce, axis: int, step: float, many: int) -> Floats:
    """Load against positive motion at ``many`` places a sample [N]; shape (T * many,)."""
    phase = 2 * np.pi * np.cumsum(np.repeat(load.tooth_frequency, many)) * step / many
    wave = np.repeat(load.ripple[:, axis], many) * np.sin(phase)
    pushed: Floats = wave - np.repeat(load.force[:, axis], many)
    return pushed


def _delay(commanded: Trace, air: Mapping[str, AxisFollowing]) -> float:
    """Time by which the axes are behind the interpolator, by least squares [s].

    The distance between both goes with the speed: e = v T.
    """
    square, product = 0.0, 0.0
    for letter, one in air.items():
        axis = AXES.index(letter)
        programmed = commanded.programmed[:, axis]
        speed = np.gradient(programmed, commanded.time)
        behind = programmed - commanded.position[:, axis] + one.error
        square, product = square + float(speed @ speed), product + float(speed @ behind)
    return max(product / square, 0.0) if square > 0 else 0.0


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
