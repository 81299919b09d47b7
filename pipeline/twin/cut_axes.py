"""Following error and motor command of the axes while a program cuts.

The force of :mod:`pipeline.twin.cut_force` is their load, at the place where the tool is: behind
the interpolator by what its filters and the servos take, one delay for the program.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import AXES
from pipeline.machine.control.interpolate import Trace
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import AxisInCut
from pipeline.schema.si import UM
from pipeline.twin.cut import Cut
from pipeline.twin.cut_force import CutForce, cut_force
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
PER_TOOTH, MOST_SUBSTEPS = 8, 32
"""Least samples in a tooth period, and the most in one interpolation period for that."""


@dataclass(frozen=True, kw_only=True)
class CutFollowing:
    """Axes along a program in air and in the cut, by letter, and the force between them."""

    air: dict[str, AxisFollowing]
    cut: dict[str, AxisFollowing]
    """The same axes at the same T times, without and with the force."""
    load: CutForce
    """Load of the cut at these times."""


def follow_cut(
    cut: Cut, drives: Mapping[str, IdentifiedDrive], commanded: Trace | None = None,
    residual: Residual | None = None,
) -> CutFollowing:  # fmt: skip
    """Axes along a program in air and under the force of its cut.

    An axis whose forces are in the unit of its command, its force constant not being listed, is
    left out: a load in newtons says nothing to it.

    Parameters
    ----------
    cut : Cut
        Of a planned program.
    drives : mapping of str to IdentifiedDrive
        By the axis' letter; those without a servo are left out.
    commanded : Trace, optional
        Positions that the axes follow, where they were recorded; by default those of the plan.
    residual : Residual, optional
        What the drives' model leaves over.  It is learnt beside that model without a load, so that
        it is asked in air, and added to the error under the force too.

    Raises
    ------
    ValueError
        When the program is too long to be held, or a drive is unstable.
    """
    path = commanded_positions(cut.plan) if commanded is None else commanded
    known = {letter: drive for letter, drive in drives.items() if drive.force_unit == NEWTON}
    air = follow_in_air(path, known, residual)
    load = cut_force(cut, path, _delay(path, air))
    step = float(path.time[1] - path.time[0])
    fastest = float(load.tooth_frequency.max(initial=0.0))
    many = int(np.clip(np.ceil(PER_TOOTH * fastest * step), SUBSTEPS, MOST_SUBSTEPS))
    loaded = {
        letter: _as_in_air(
            followed(letter, known[letter], path, _load(load, letter, step, many), many), one
        )
        for letter, one in air.items()
    }
    return CutFollowing(air=air, cut=loaded, load=load)


def _as_in_air(loaded: AxisFollowing, air: AxisFollowing) -> AxisFollowing:
    """An axis under the force with the residual that it has in air, if any."""
    if air.residual is None:
        return loaded
    return with_residual(loaded, air.residual, air.half_width)


def axes_in_cut(found: CutFollowing, lines: NDArray[np.integer]) -> tuple[AxisInCut, ...]:
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
        error, command = one.error[inside] / UM, one.command[inside]
        air = found.air[letter]
        behind, drawn = int(np.argmax(np.abs(error))), int(np.argmax(np.abs(command)))
        axes.append(AxisInCut(
            axis=letter,
            following_um=_figure(np.abs(error).max()),
            following_rms_um=_figure(np.sqrt(np.mean(error**2))),
            following_air_um=_figure(np.abs(air.error[inside]).max() / UM),
            following_line=int(lines[one.row[inside[behind]]]),
            command=_figure(np.abs(command).max()),
            command_rms=_figure(np.sqrt(np.mean(command**2))),
            command_air=_figure(np.abs(air.command[inside]).max()),
            command_line=int(lines[one.row[inside[drawn]]]),
            command_unit=one.command_unit,
            force_N=_figure(np.abs(found.load.force[inside, AXES.index(letter)]).max()),
            half_width_um=(
                inf if one.half_width is None
                else _figure(one.half_width[inside].max() / UM)
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


def _load(load: CutForce, letter: str, step: float, many: int) -> Floats:
    """Load against positive motion at ``many`` places a sample [N]; shape (T * many,)."""
    axis = AXES.index(letter)
    phase = 2 * np.pi * np.cumsum(np.repeat(load.tooth_frequency, many)) * step / many
    wave = np.repeat(load.ripple[:, axis], many) * np.sin(phase)
    pushed: Floats = wave - np.repeat(load.force[:, axis], many)
    return pushed
