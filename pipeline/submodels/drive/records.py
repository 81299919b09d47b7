"""Recordings of feed drives in SI: selection, channels, and their content on a uniform grid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.signals.conditions import samples_sha256

BLOCK = " (block "
"""Stands in the name of a block of a recording's own time."""


@dataclass(frozen=True, kw_only=True)
class AxisChannels:
    """Channels of one axis, by their names in the recordings."""

    command: str | None = None
    """Torque command: current or voltage; without it only the loop gain is identified."""
    reference: str | None = None
    position: str | None = None
    velocity_reference: str | None = None
    velocity: str | None = None
    acceleration_reference: str | None = None
    acceleration: str | None = None
    """str, optional Commanded and measured motion; velocity and acceleration that are not recorded
    are derived from the position."""
    load: str | None = None
    """Disturbance, or a pattern of its name; used where a recording has it, where the records show
    it to enter.  Declared is a force against positive motion."""
    reversed: bool = False
    """Whether a positive command pushes in the negative direction."""

    def __post_init__(self) -> None:
        if self.position is None and self.velocity is None:
            raise ValueError(
                f"drive_records: the axis of {self.command!r} has neither position nor velocity: "
                "name one of their channels"
            )


@dataclass(frozen=True, kw_only=True)
class AirRows:
    """Rows free of cutting load."""

    channel: str
    """Channel of words."""
    values: tuple[str, ...]
    """Its words in those rows."""


@dataclass(frozen=True, kw_only=True)
class MotorRecords:
    """Recordings of a motor's voltages and currents."""

    recordings: str
    """Pattern of their names below the machine's folder."""
    axis: str
    """Letter of the axis that it drives."""
    channels: Mapping[str, str]
    """``u_d``, ``u_q``, ``i_d``, ``i_q``, ``speed`` and, where recorded, ``torque`` -> channel."""
    pole_pairs: int
    """p of the motor."""
    held: bool = True
    """Whether the voltages are the inverter's commands, each held until the next sample, as drives
    record them; else they are sampled like the currents."""
    dc_link: float | None = None
    """Voltage between the inverter's rails [V], from its data sheet."""

    def __post_init__(self) -> None:
        missing = {"u_d", "u_q", "i_d", "i_q", "speed"} - set(self.channels)
        if missing:
            raise ValueError(
                f"drive_records.motor.channels lacks {', '.join(sorted(missing))}: name them"
            )
        if self.pole_pairs < 1:
            raise ValueError(
                f"drive_records.motor.pole_pairs = {self.pole_pairs} must be at least 1"
            )


@dataclass(frozen=True, kw_only=True)
class ShaftChannels:
    """Channels of both ends of an axis' drive train, by their names in the recordings."""

    motor: str
    """Position of the motor's encoder, as travel of the carriage."""
    load: str
    """Position of the carriage, by a scale."""
    command: str
    """Current of the motor, or another command that its force is proportional to."""
    reversed: bool = False
    """Whether a positive command pushes in the negative direction."""


@dataclass(frozen=True, kw_only=True)
class ShaftRecords:
    """Recordings of both ends of drive trains."""

    recordings: str
    """Pattern of their names below the machine's folder."""
    axes: Mapping[str, ShaftChannels]
    """Channels by axis letter."""


@dataclass(frozen=True, kw_only=True)
class DriveRecords:
    """Recordings of a machine's drives and their use."""

    recordings: str
    """Pattern of their names below the machine's folder."""
    axes: Mapping[str, AxisChannels]
    """Channels by axis letter."""
    air: AirRows | None = None
    """Rows to fit; all when absent."""
    motor: MotorRecords | None = None
    """Recordings of a motor's voltages and currents."""
    shaft: ShaftRecords | None = None
    """Recordings of both ends of drive trains."""


@dataclass(frozen=True, kw_only=True)
class AxisConstants:
    """Prior knowledge of an axis in SI; None of what is not listed."""

    force_constant: float | None = None
    """Force on the carriage for one unit of the command [N/A]."""
    position_gain: float | None = None
    velocity_gain: float | None = None
    integral_gain: float | None = None
    velocity_feedforward: float | None = None
    acceleration_feedforward: float | None = None
    current_limit: float | None = None
    """Gains, feed-forward and limit as in
    :class:`~pipeline.machine.axis.drive_parameters.ServoParameters`."""
    servo_period: float | None = None
    """Period of the velocity loop [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """Axis in a recording, shape (T,) each; None where a channel is not recorded."""

    command: Floats
    """Torque command, in ``command_unit``."""
    position: Floats | None = None
    reference: Floats | None = None
    """Measured and commanded position [m]."""
    velocity: Floats | None = None
    velocity_reference: Floats | None = None
    """Measured and commanded speed [m/s]."""
    acceleration: Floats | None = None
    acceleration_reference: Floats | None = None
    """Measured and commanded acceleration [m/s^2]."""
    load: Floats | None = None
    """Disturbance, declared as against positive motion, in ``load_unit``."""
    load_unit: str = ""
    """N, m, m/s, or as the recording has it; empty where it names none."""
    command_unit: str = "A"
    """A, V, or as the recording has it."""
    constants: AxisConstants = field(default_factory=AxisConstants)
    """Prior knowledge of the axis, with this recording's constants."""

    @property
    def force_constant(self) -> float:
        """Force for one unit of the command [N/A]; 1 where it is not listed."""
        return self.constants.force_constant or 1.0

    @property
    def force_unit(self) -> str:
        """Newton, or the command's unit where the force constant is not listed."""
        return self.command_unit if self.constants.force_constant is None else "N"


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """Commanded and actual position of one axis in a stretch of T samples."""

    reference: Floats = field(repr=False)
    position: Floats = field(repr=False)
    """Positions [m]; shape (T,) each."""
    period: float
    """Sampling period [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Stretch of a recording on a uniform grid of T samples."""

    name: str
    """Name of the raw file; " (part 2)" is added where a gap in time cuts it into parts."""
    trained: bool
    """Whether the drives are fitted on it."""
    period: float = inf
    """Sampling period [s]."""
    air: Bools = field(default_factory=lambda: np.zeros(0, bool))
    """Recorded samples, not interpolated ones, that are free of cutting load; shape (T,)."""
    axes: Mapping[str, AxisRecord] = field(default_factory=dict)
    """Axes that it shows, by letter."""
    tracked: Mapping[str, Tracked] = field(default_factory=dict)
    """Axes whose commanded and actual position it has, with or without a command of the motor."""
    lacking: Mapping[str, str] = field(default_factory=dict)
    """Axes that it does not show, with reason and remedy."""
    motor: Mapping[str, Floats] = field(default_factory=dict)
    """Motor of a motor's recording: ``u_d``, ``u_q`` [V], ``i_d``, ``i_q`` [A], ``speed`` [rad/s]
    and, where recorded, ``torque`` [N m]; shape (T,)."""
    shafts: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict)
    """Shafts of a recording of both ends of drive trains, by the axis' letter: positions ``motor``
    and ``load`` [m], and ``command`` in the command's unit; shape (T,)."""
    notes: tuple[str, ...] = ()
    """Changes to its rows."""
    sha256: str = ""
    """SHA-256 of the raw file."""

    @property
    def file(self) -> str:
        """Name of the raw file below the machine's folder."""
        return self.name.partition(BLOCK)[0].partition(" (part ")[0]

    @property
    def samples(self) -> int:
        """Number of samples T [1]."""
        return len(self.air)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return self.period * self.samples if self.samples else 0.0


def of_axis(recordings: Sequence[Recording], axis: str) -> list[Recording]:
    """Recordings that show an axis, without what they show besides."""
    return [
        replace(one, axes={axis: one.axes[axis]}, motor={}, shafts={})
        for one in recordings if axis in one.axes
    ]  # fmt: skip


BLOCKS = 4
"""Blocks in which the only recording is judged, each by a drive of the others [1]."""


def blocks_of(parts: Sequence[Recording]) -> list[Recording]:
    """Parts of a recording in about :data:`BLOCKS` blocks, cut where slow, hashed one by one."""
    total = sum(one.seconds for one in parts)
    cut = [block for one in parts for block in _cut(one, round(BLOCKS * one.seconds / total))]
    return [
        replace(block, name=f"{block.name}{BLOCK}{k} of {len(cut)} of its own time)")
        for k, block in enumerate(cut, start=1)
    ]


def _cut(one: Recording, many: int) -> list[Recording]:
    """Blocks of a recording of about equal length, from and to where its axes are slowest."""
    speed = np.zeros(one.samples)
    for axis in one.axes.values():
        moved = axis.velocity if axis.position is None else np.gradient(axis.position)
        if moved is not None:
            speed += np.abs(moved) / max(float(np.abs(moved).max()), 1e-300)
    wide = one.samples // (4 * max(many, 1))
    middles = [one.samples * k // many for k in range(1, many)]
    cuts = [m - wide + int(np.argmin(speed[m - wide : m + wide])) for m in middles]
    ends = [0, *cuts, one.samples]
    return [_within(one, slice(a, b)) for a, b in pairwise(ends)]


def _within(one: Recording, rows: slice) -> Recording:
    axes = {}
    for letter, axis in one.axes.items():
        part: dict[str, Any] = {k: v[rows] for k, v in vars(axis).items() if hasattr(v, "dtype")}
        axes[letter] = replace(axis, **part)
    hashed = samples_sha256((letter, axis.command) for letter, axis in sorted(axes.items()))
    return replace(one, axes=axes, air=one.air[rows], tracked={}, sha256=hashed)


MOTION = (
    "reference", "position", "velocity_reference", "velocity", "acceleration_reference",
    "acceleration",
)  # fmt: skip
"""Channels that some recording must hold where they are named; a load may be missing."""


def check_channels(records: DriveRecords, recordings: Sequence[Recording]) -> None:
    """Check that some recording of an axis holds each channel that ``records`` names for it."""
    for letter, channels in records.axes.items():
        shown = [one.axes[letter] for one in recordings if letter in one.axes]
        for key in MOTION:
            name = getattr(channels, key)
            if name and shown and all(getattr(one, key) is None for one in shown):
                raise ValueError(
                    f"drive_records.axes.{letter}.{key} names the channel {name!r}, of which no "
                    "recording holds a value: correct the name or leave it out"
                )
