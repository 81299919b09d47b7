"""Recordings of feed drives in SI, prior knowledge of the drives, and the settings of the fit."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from math import inf, isfinite
from string import ascii_uppercase
from typing import Annotated, Any, Literal

import numpy as np

from pipeline.machine.axis.motor import force_constant
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.search.genetic import GeneticSettings
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


Number = float | str | None
"""A value, or the name of a constant that stands beside the channels of the recordings."""
Coulomb = Literal["auto", "equal", "unequal"]


@dataclass(frozen=True, kw_only=True)
class AxisPrior:
    """Prior knowledge of one axis; each number may be the name of a constant of the recordings."""

    force_constant: Number = None
    """Force on the carriage for one unit of the command [N/A]; without it, and without torque
    constant and lead, forces are in the command's unit."""
    torque_constant: Number = None
    lead: Number = None
    """Torque constant [N m/A] and screw lead [mm/rev], in place of ``force_constant``."""
    position_gain: Number = None
    velocity_gain: Number = None
    integral_gain: Number = None
    velocity_feedforward: Number = None
    acceleration_feedforward: Number = None
    current_limit: Number = None
    """Gains, feed-forward and limit as in
    :class:`~pipeline.machine.axis.drive_parameters.ServoParameters`."""
    servo_period: Number = None
    """Period of the velocity loop [s]; the recorder's where it is not listed."""
    coulomb: Coulomb = "auto"
    """Split of Coulomb friction and a constant force, of which motion shows only the sum. "equal":
    Coulomb friction is equal in both directions, and the difference is the force (a vertical axis,
    an amplifier with an offset); "unequal": no such force; "auto": see
    :mod:`pipeline.submodels.drive.estimates`."""

    def __post_init__(self) -> None:
        if (self.torque_constant is None) != (self.lead is None):
            raise ValueError("drive: torque_constant and lead go together: give both or neither")
        if self.force_constant is not None and self.lead is not None:
            raise ValueError("drive: force_constant stands beside torque_constant: give one")
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "coulomb" and not isinstance(value, str):
                _number(item.name, value, {})

    @property
    def screw_lead(self) -> float | None:
        """Lead [m/rev]; None where it is not listed as a number."""
        return float(self.lead) * 1e-3 if isinstance(self.lead, int | float) else None

    def resolved(self, constants: Mapping[str, float]) -> AxisConstants:
        """Numbers in place of names."""
        force = _number("force_constant", self.force_constant, constants)
        torque = _number("torque_constant", self.torque_constant, constants)
        lead = _number("lead", self.lead, constants)
        if torque is not None and lead is not None:
            force = force_constant(torque, lead * 1e-3)
        names = [item.name for item in fields(AxisConstants) if item.name != "force_constant"]
        found = {name: _number(name, getattr(self, name), constants) for name in names}
        return AxisConstants(force_constant=force, **found)


def _number(name: str, given: Number, constants: Mapping[str, float]) -> float | None:
    if given is None:
        return None
    if isinstance(given, str):
        if given not in constants:
            there = ", ".join(sorted(constants)) or "none"
            raise ValueError(
                f"drive.{name} names the constant {given!r}, the recording holds {there}: "
                "correct the name or write the number"
            )
        given = constants[given]
    positive = name not in ("integral_gain", "velocity_feedforward", "acceleration_feedforward")
    if not isfinite(given) or given < 0 or (positive and given == 0):
        least = "positive" if positive else "at least 0"
        raise ValueError(f"drive.{name} = {given} must be finite and {least}: correct it")
    return float(given)


@dataclass(frozen=True, kw_only=True)
class DrivePrior:
    """Prior knowledge of the drives of a machine."""

    axes: Mapping[str, AxisPrior] = field(default_factory=dict)
    """Priors by axis letter."""

    def axis(self, letter: str) -> AxisPrior:
        """Prior knowledge of one axis; nothing when it is not named."""
        return self.axes.get(letter, AxisPrior())


def constants_of(entries: Mapping[str, Mapping[str, object]]) -> dict[str, float]:
    """Constants on which all recordings that hold them agree, by name."""
    seen: dict[str, set[float]] = {}
    for entry in entries.values():
        for name, value in entry.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                seen.setdefault(name, set()).add(float(value))
    return {name: values.pop() for name, values in seen.items() if len(values) == 1}


def names_of(prior: AxisPrior) -> list[str]:
    """Names of the constants that ``prior`` refers to."""
    values = [getattr(prior, item.name) for item in fields(prior) if item.name != "coulomb"]
    return [value for value in values if isinstance(value, str)]


FINEST = 1000
"""Greatest number of substeps in a sample [1]: a servo samples at most as much faster."""


@dataclass(frozen=True, kw_only=True)
class DriveFitSettings(Ranged, section="drive_fit"):
    """Settings of the identification of drives."""

    method: Literal["least_squares", "genetic"] = "least_squares"
    """Method whose optimum is kept."""
    compare: bool = True
    """Whether the other method runs too, for the report."""
    bandwidth_Hz: Annotated[float | None, Range(above=0.0, unit="Hz")] = None
    """Bandwidth of the parallel filter on motion and force [Hz]; by the records when None."""
    shortest_s: Annotated[float, Range(above=0.0, unit="s")] = 0.2
    """Least duration of a stretch of constant speed [s]."""
    widest: Positive = 0.5
    """Relative half width of the 95 % interval beyond which a parameter is not determined [1]."""
    substeps: Annotated[int, Range(above=0.0, most=FINEST)] = 4
    """Steps of the closed-loop simulation in one sample."""
    folds: Annotated[int, Range(least=2)] = 5
    """Greatest number of drives without some recordings, for the intervals of an axis."""
    genetic: GeneticSettings = field(default_factory=GeneticSettings)
    """Settings of the genetic algorithm."""


def check_axes(records: DriveRecords, prior: DrivePrior) -> None:
    """Check that axes are letters, named in both sections."""
    there = ", ".join(records.axes)
    if not there:
        raise ValueError("drive_records.axes names no axis: name the channels of at least one")
    for letter in records.axes:
        if len(letter) != 1 or letter not in ascii_uppercase:
            raise ValueError(
                f"drive_records.axes names {letter!r}, which is no letter of an axis: write X, Y "
                "or the like"
            )
    named = {f"drive.axes names {letter!r}": letter for letter in prior.axes}
    if records.motor is not None:
        named[f"drive_records.motor.axis is {records.motor.axis!r}"] = records.motor.axis
    if records.shaft is not None:
        named |= {f"drive_records.shaft.axes names {one!r}": one for one in records.shaft.axes}
    for place, letter in named.items():
        if letter not in records.axes:
            raise ValueError(
                f"{place}, drive_records.axes has {there}: correct the letter or name the axis' "
                "channels"
            )


def check_constants(prior: DrivePrior, held: Collection[str]) -> None:
    """Check that every constant that ``prior`` names stands in some recording."""
    for letter, axis in prior.axes.items():
        for name in names_of(axis):
            if name not in held:
                raise ValueError(
                    f"drive.axes.{letter} names the constant {name!r}, the recordings hold "
                    f"{', '.join(sorted(held)) or 'none'}: correct the name or write the number"
                )
