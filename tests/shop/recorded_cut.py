"""Servo tool's record of a trial cut: each axis' commands, position and current under its force.

The chain is the shop's own: its control's commands, its cascade, screw and guideways, and the
forces of its teeth, step by step.  A positive command moves the tool along the positive axis
against the workpiece, whichever of the two moves (ISO 841), so that the force on the tool along
the axis helps positive motion and its opposite is the axis' load.

The tool's way through the blank is that of the axes in air: what the force makes of it, some um
that the integral takes back within 0.1 s, changes the chip by far less than a batch of material.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.shop.drives.axis import follow
from pipeline.shop.drives.parameters import RATE
from pipeline.shop.drives.records import Column, axis_columns, smoothed
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.cutting import Chance, _cuts, chance, check_cut
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.motion import (
    Swept,
    Track,
    commands_at,
    control_of,
    program_steps,
    swept,
    tip_shift,
)

SETTLE = 0.3
"""Standstill after the program [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxesRecord:
    """Axes X, Y, Z at T samples of the servo tool, its noise and steps included."""

    time: Floats
    """Time [s]."""
    line: Ints
    """Line of the program."""
    cutting: Bools
    """Samples in which a tooth cuts."""
    command: Floats
    position: Floats
    """Positions in the machine's frame [mm]; shape (T, 3)."""
    current: Floats
    """Current that makes torque [A]; shape (T, 3)."""
    force: Floats
    """Force on the tool, its mean over a tick of the position loop [N]; shape (T, 3)."""

    @property
    def following_error(self) -> Floats:
        """Commanded less measured position [mm]; shape (T, 3)."""
        return self.command - self.position


def record_axes(
    text: bytes | str, name: str, job: TrialJob, parameters: ShopParameters, seed: int, *,
    cut: bool = True,
) -> AxesRecord:  # fmt: skip
    """Record the axes while one part is cut, or while the same program runs in air.

    ``seed`` is that of the differences of the part; without ``cut`` there is no blank.

    Raises
    ------
    GcodeError, ValueError
        As :func:`pipeline.shop.trial.trials.prepare`.
    """
    axes = list(parameters.drives.axes.values())
    frequency = parameters.drives.x.cascade.position_frequency
    random = np.random.Generator(np.random.PCG64([parameters.seed, seed, *b"trial axes"]))
    program = program_steps(text, name, job, parameters.control)
    plan = control_of(program, job, parameters, random).run(program)
    count = int(np.ceil((plan.duration + SETTLE) * frequency))
    time: Floats = np.arange(count, dtype=np.float64) / frequency
    command, line, tool = commands_at(plan, job, parameters.control, time)
    command = np.stack([smoothed(column, frequency) for column in command.T], axis=1)
    # in air first: where the tool goes, and with it what it cuts
    force: Floats = np.zeros((count, 3))
    if cut:
        air = [follow(axis, command[:, k] * 1e-3, random) for k, axis in enumerate(axes)]
        tip = np.stack([one.carriage * 1e3 for one in air], axis=1)
        for number in np.unique(tool).tolist():
            tip[tool == number] -= tip_shift(parameters.control, job, number)
        track = Track(
            cycle=1 / frequency, tip=tip, line=line, tool=tool, speed=plan.spindle_speed(time)
        )
        blank = swept(tip, tool, program.steps, job)
        check_cut(name, track, blank, job)
        part = chance(job, parameters, random)
        force = mean_forces(track, blank, part, parameters, random)
    columns: list[Column] = []
    for k, letter in enumerate(parameters.drives.axes):
        columns += axis_columns(
            letter, axes[k], command[:, k], parameters.drives.tool, random, load=-force[:, k]
        )
    rows = slice(None, None, frequency // RATE)
    _, position, current = (
        np.stack([column.values for column in columns[k::3]], axis=1) for k in range(3)
    )
    return AxesRecord(
        time=time[rows], line=line[rows], cutting=np.any(force != 0, axis=1)[rows],
        command=command[rows], position=position, current=current, force=force[rows],
    )  # fmt: skip


def mean_forces(
    track: Track, blank: Swept, part: Chance, parameters: ShopParameters,
    random: np.random.Generator,
) -> Floats:  # fmt: skip
    """Force on the tool along X, Y, Z in each cycle of a track, its mean over it [N]; (T, 3)."""
    total: Floats = np.zeros((track.line.size, 3))
    for force, moment in _cuts(track, blank, part, parameters, random):
        if moment.size < 2:
            continue
        first, last = int(moment[0] / track.cycle), int(moment[-1] / track.cycle) + 1
        edges = np.arange(first, last + 1) * track.cycle
        steps = np.diff(moment)[:, None] * (force[1:] + force[:-1]) / 2
        impulse = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        rows = slice(first, min(last, len(total)))
        for axis in range(3):
            gained = np.diff(np.interp(edges, moment, impulse[:, axis])) / track.cycle
            total[rows, axis] += gained[: rows.stop - first]
    return total
