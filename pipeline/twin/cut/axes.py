"""Force of the cut along a program, and following error and motor command of the axes under it.

The force is taken where the tool is: behind the interpolator by one delay for the program.  Its
mean over a turn is that of the station at the feed for each tooth of that moment
(:mod:`pipeline.cutting.force.load_table`); about the mean stands one harmonic at tooth passing of
the same standard deviation, of any phase, which makes the friction of an axis at rest give way.

Frames.  The force of a station lies along the feed, to its left and along the tool; it is turned
into the coordinates of the blank by the piece of the path, and into the machine's by the rotation
of the work offset.  A positive coordinate moves the tool along the axis relative to the workpiece,
whichever of the two the axis carries (ISO 841), so that the force on the tool helps positive motion
in both cases, and the load against it is minus that force.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import AXES, RADIAN
from pipeline.machine.control.interpolate import Trace
from pipeline.machine.control.path import Motion
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.drive import AxisInCut
from pipeline.twin.cut.loads import Cut
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import (
    SUBSTEPS,
    AxisFollowing,
    Residual,
    commanded_positions,
    follow_in_air,
    followed,
    with_residual,
)

NEWTON = "N"
"""Unit of the forces of a drive whose force constant is known."""
MICROMETRE = 1e-6
PER_TOOTH, MOST_SUBSTEPS = 8, 32
"""Least samples in a tooth period, and the most in one interpolation period for that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CutForce:
    """Force of the cut at T times."""

    force: Floats = field(repr=False)
    """Force on the tool along X, Y, Z of the machine [N]; 0 in air."""
    ripple: Floats = field(repr=False)
    """Amplitude of its harmonic at tooth passing [N]."""
    tooth_frequency: Floats = field(repr=False)
    """Tooth frequency [Hz]; 0 in air."""
    cutting: Bools = field(repr=False)
    """Whether the tool is in the material at feed, and its command not in a rapid yet."""
    f_z: Floats = field(repr=False)
    """Feed for each tooth, 0 in air [m]."""


def cut_force(cut: Cut, trace: Trace, delay: float = 0.0) -> CutForce:
    """Force of a cut of M rows at the T times of a trace; ``delay`` of filters and servo [s]."""
    begins = _begins(cut)
    place = begins[trace.row] + np.minimum(trace.distance, np.diff(begins)[trace.row])
    speed = np.gradient(place, trace.time) if len(place) > 1 else np.zeros(len(place))
    since = trace.time - delay
    station = _stations(cut, begins, np.interp(since, trace.time, place))
    at = np.flatnonzero(station >= 0)
    here = station[at]
    engagement = cut.engagement
    flutes = np.array([tool.flutes for tool in cut.tools], dtype=np.float64)
    teeth = flutes[engagement.tool[here]] * cut.plan.spindle_speed[engagement.block[here]] / 60
    slow = np.interp(since[at], trace.time, speed)
    f_z, frequency = np.zeros(len(place)), np.zeros(len(place))
    force, ripple = np.zeros((len(place), 3)), np.zeros((len(place), 3))
    frequency[at] = teeth
    f_z[at] = np.divide(slow, teeth, out=np.zeros(len(at)), where=teeth > 0)
    forces = cut.table.mean_forces(here, f_z[at])
    turn = _turn(cut, here)
    force[at] = np.einsum("qij,qj->qi", turn, forces[:, :3])
    # components that vary independently: variances go with the squares of the turn
    ripple[at] = np.sqrt(2 * np.einsum("qij,qj->qi", turn**2, forces[:, 3:] ** 2))
    path = cut.plan.path
    rapid = np.isin(path.motion, (Motion.RAPID, Motion.INDEPENDENT))[trace.row]
    return CutForce(
        force=force, ripple=ripple, tooth_frequency=frequency,
        cutting=(station >= 0) & ~rapid, f_z=f_z,
    )  # fmt: skip


def _begins(cut: Cut) -> Floats:
    """Path length of the program before each row, and of all of it [m]; shape (M + 1,)."""
    path, moves = cut.plan.path, cut.plan.path.moves
    linear = np.any(moves.start[:, :3] != moves.end[:, :3], axis=1) | (moves.angle != 0)
    lengths = np.where(path.moving & linear, path.length, 0.0)
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _stations(cut: Cut, begins: Floats, place: Floats) -> Rows:
    """Station at each place along the program [m], -1 in air; shape (T,)."""
    engagement, pieces = cut.engagement, cut.path.pieces
    fed = np.flatnonzero(engagement.feed & (engagement.upper > engagement.lower).any(axis=1))
    if not len(fed):
        return np.full(len(place), -1)
    # a row's pieces are chords, a little shorter than its arc
    lengths = pieces.length
    gone = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    whole = np.bincount(pieces.block, lengths, minlength=engagement.blocks)
    piece, block = engagement.piece[fed], engagement.block[fed]
    first = np.searchsorted(pieces.block, block, side="left")
    scale = np.diff(begins)[block] / whole[block]
    begin = begins[block] + scale * (gone[piece] - gone[first] + engagement.along[fed])
    end = begin + scale * engagement.length[fed]
    order = np.argsort(begin, kind="stable")
    nearest = np.searchsorted(begin[order], place, side="right") - 1
    at = order[np.maximum(nearest, 0)]
    inside = (nearest >= 0) & (place <= end[at])
    return np.where(inside, fed[at], -1)


def _turn(cut: Cut, station: Rows) -> Floats:
    """From the frame of stations to forces on the tool in the machine's axes; shape (Q, 3, 3)."""
    pieces, piece = cut.path.pieces, cut.engagement.piece[station]
    way = (pieces.end - pieces.start)[piece, :2]
    angle = np.arctan2(way[:, 1], way[:, 0]) + cut.path.frame.rotation * RADIAN
    c, s = np.cos(angle), np.sin(angle)
    left = np.where(pieces.direction[piece] < 0, -1.0, 1.0)  # M4 cuts its mirror image
    turn = np.zeros((len(station), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1] = c, -s * left
    turn[:, 1, 0], turn[:, 1, 1] = s, c * left
    turn[:, 2, 2] = -1.0
    return turn


@dataclass(frozen=True, kw_only=True)
class CutFollowing:
    """Axes along a program in air and in the cut, by letter, and the force between them."""

    air: dict[str, AxisFollowing]
    cut: dict[str, AxisFollowing]
    """Axes at the same T times, without and with the force."""
    load: CutForce
    """Load of the cut at these times."""


def follow_cut(
    cut: Cut, drives: Mapping[str, IdentifiedDrive], commanded: Trace | None = None,
    residual: Residual | None = None,
) -> CutFollowing:  # fmt: skip
    """Axes along a program in air and under the force of its cut.

    The axes follow the positions ``commanded``, by default those of the plan; the ``residual`` is
    taken in air, and added to the error under the force too.  Drives without a servo, or whose
    forces are in the unit of the command, are left out.  Raises ValueError when the program is too
    long to be held, or a drive is unstable.
    """
    path = commanded_positions(cut.plan) if commanded is None else commanded
    known = {letter: drive for letter, drive in drives.items() if drive.force_unit == NEWTON}
    air = follow_in_air(path, known, residual)
    load = cut_force(cut, path, _delay(path, air))
    step = float(path.time[1] - path.time[0])
    fastest = float(load.tooth_frequency.max(initial=0.0))
    many = int(np.clip(np.ceil(PER_TOOTH * fastest * step), SUBSTEPS, MOST_SUBSTEPS))
    loaded = {}
    for letter, one in air.items():
        pushed = _load(load, letter, step, many)
        loaded[letter] = followed(letter, known[letter], path, pushed, many)
        if one.residual is not None:
            loaded[letter] = with_residual(loaded[letter], one.residual, one.half_width)
    return CutFollowing(air=air, cut=loaded, load=load)


def axes_in_cut(following: CutFollowing, lines: NDArray[np.integer]) -> tuple[AxisInCut, ...]:
    """Peaks and RMS values of each axis in the material; ``lines`` (M,) of the program's rows."""
    inside = np.flatnonzero(following.load.cutting)
    if not len(inside):
        return ()
    axes = []
    for letter, one in following.cut.items():
        error, command = one.error[inside] / MICROMETRE, one.command[inside]
        air = following.air[letter]
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
            force_N=_figure(np.abs(following.load.force[inside, AXES.index(letter)]).max()),
            half_width_um=(
                inf if one.half_width is None
                else _figure(one.half_width[inside].max() / MICROMETRE)
            ),
        ))  # fmt: skip
    return tuple(axes)


def half_widths(axes: Iterable[AxisInCut]) -> str:
    """Half width of the 90 % interval of each axis' following error, in words."""
    return ", ".join(
        f"{one.axis} {one.half_width_um:.3g} um" if isfinite(one.half_width_um)
        else f"{one.axis} not learnt"
        for one in axes
    ) or "no axis is in the cut"  # fmt: skip


def _figure(value: float) -> float:
    return float(f"{value:.6g}")


def _delay(commanded: Trace, air: Mapping[str, AxisFollowing]) -> float:
    """Delay of the axes behind the interpolator by least squares of e = v T [s]."""
    square, product = 0.0, 0.0
    for letter, one in air.items():
        axis = AXES.index(letter)
        programmed = commanded.programmed[:, axis]
        speed = np.gradient(programmed, commanded.time)
        behind = programmed - commanded.position[:, axis] + one.error
        square, product = square + float(speed @ speed), product + float(speed @ behind)
    return max(product / square, 0.0) if square > 0 else 0.0


def _load(load: CutForce, letter: str, step: float, many: int) -> Floats:
    """Load against positive motion at ``many`` places a sample [N]; shape (T * many,)."""
    axis = AXES.index(letter)
    phase = 2 * np.pi * np.cumsum(np.repeat(load.tooth_frequency, many)) * step / many
    wave = np.repeat(load.ripple[:, axis], many) * np.sin(phase)
    return wave - np.repeat(load.force[:, axis], many)
