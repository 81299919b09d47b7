"""Recordings of feed drives: which ones, their channels, and what stands in them, in SI."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.known import AxisConstants, AxisKnown, DriveKnown
from pipeline.identification.drive.settings import DriveFitSettings

__all__ = [
    "AirRows", "AxisChannels", "AxisConstants", "AxisKnown", "AxisRecord", "DriveFitSettings",
    "DriveKnown", "DriveRecords", "MotorRecords", "Recording", "read_recordings",
]  # fmt: skip

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class AxisChannels:
    """Channels of one axis, by their names in the recordings.

    Parameters
    ----------
    command : str
        Torque command: current or voltage.
    reference, position, velocity_reference, velocity, acceleration_reference, acceleration : \
str, optional
        Commanded and measured motion; velocity and acceleration that are not recorded are derived
        from the position.
    load : str, optional
        Force against positive motion, or a pattern of its name; used where a recording has it.
    reversed : bool
        Whether a positive command pushes in the negative direction.
    """

    command: str
    reference: str | None = None
    position: str | None = None
    velocity_reference: str | None = None
    velocity: str | None = None
    acceleration_reference: str | None = None
    acceleration: str | None = None
    load: str | None = None
    reversed: bool = False

    def __post_init__(self) -> None:
        if self.position is None and self.velocity is None:
            raise ValueError(
                f"drive_records: the axis of {self.command!r} has neither position nor velocity: "
                "name one of their channels"
            )


@dataclass(frozen=True, kw_only=True)
class AirRows:
    """Which rows are free of cutting load.

    Parameters
    ----------
    channel : str
        Of words.
    values : tuple of str
        Words of those rows.
    """

    channel: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class MotorRecords:
    """Recordings of a motor's voltages and currents.

    Parameters
    ----------
    recordings : str
        Pattern of their names below the machine's folder.
    axis : str
        Letter of the axis that it drives.
    channels : mapping of str to str
        ``u_d``, ``u_q``, ``i_d``, ``i_q``, ``speed`` and, where recorded, ``torque`` -> channel.
    pole_pairs : int
        p of the motor.
    held : bool
        Whether the voltages are the inverter's commands, each held until the next sample, as drives
        record them; else they are sampled like the currents.
    """

    recordings: str
    axis: str
    channels: Mapping[str, str]
    pole_pairs: int
    held: bool = True

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
class DriveRecords:
    """Recordings of a machine's drives, and what they serve for.

    Parameters
    ----------
    recordings : str
        Pattern of their names below the machine's folder.
    training : tuple of str
        Patterns of those that the drives are identified from; they are judged on the others.
    axes : mapping of str to AxisChannels
        By the axis' letter.
    air : AirRows, optional
        Rows that may be learnt from; all when absent.
    motor : MotorRecords, optional
        Recordings of a motor's voltages and currents.
    """

    recordings: str
    training: tuple[str, ...]
    axes: Mapping[str, AxisChannels]
    air: AirRows | None = None
    motor: MotorRecords | None = None

    def is_training(self, recording: str) -> bool:
        """Whether the drives may learn from ``recording``."""
        return any(fnmatchcase(recording, pattern) for pattern in self.training)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """One axis in one recording, T samples; None of what is not recorded.

    Parameters
    ----------
    command : ndarray, shape (T,)
        Torque command, in ``command_unit``.
    position, reference : ndarray, shape (T,), optional
        [m].
    velocity, velocity_reference : ndarray, shape (T,), optional
        [m/s].
    acceleration, acceleration_reference : ndarray, shape (T,), optional
        [m/s^2].
    load : ndarray, shape (T,), optional
        Against positive motion [N].
    command_unit : str
        "A", "V", or as the recording has it.
    constants : AxisConstants
        What is known of the axis, by this recording's constants.
    """

    command: Floats
    position: Floats | None = None
    reference: Floats | None = None
    velocity: Floats | None = None
    velocity_reference: Floats | None = None
    acceleration: Floats | None = None
    acceleration_reference: Floats | None = None
    load: Floats | None = None
    command_unit: str = "A"
    constants: AxisConstants = field(default_factory=AxisConstants)

    @property
    def force_constant(self) -> float:
        """Force for one unit of the command [N/A]; 1 where nobody knows it."""
        return self.constants.force_constant or 1.0

    @property
    def force_unit(self) -> str:
        """Newton, or the command's unit where nobody knows the force constant."""
        return self.command_unit if self.constants.force_constant is None else "N"


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One stretch of a recording on a uniform grid of T samples.

    Parameters
    ----------
    name : str
        Of the raw file; " (part 2)" is added where a gap in time cuts it into parts.
    trained : bool
        Whether the drives may learn from it.
    period : float
        From sample to sample [s].
    air : ndarray of bool, shape (T,)
        Samples that are free of cutting load and were recorded, not filled in.
    axes : mapping of str to AxisRecord
        Axes that it shows, by letter.
    lacking : mapping of str to str
        Axes that it does not show: why, and what to do.
    motor : mapping of str to ndarray, shape (T,)
        Of a motor's recording: ``u_d``, ``u_q`` [V], ``i_d``, ``i_q`` [A], ``speed`` [rad/s] and,
        where recorded, ``torque`` [N m].
    notes : tuple of str
        What was done to its rows.
    sha256 : str
        Of the raw file.
    """

    name: str
    trained: bool
    period: float = inf
    air: Flags = field(default_factory=lambda: np.zeros(0, bool))
    axes: Mapping[str, AxisRecord] = field(default_factory=dict)
    lacking: Mapping[str, str] = field(default_factory=dict)
    motor: Mapping[str, Floats] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    sha256: str = ""

    @property
    def file(self) -> str:
        """Name of the raw file below the machine's folder."""
        return self.name.partition(" (part ")[0]

    @property
    def samples(self) -> int:
        """T."""
        return len(self.air)

    @property
    def seconds(self) -> float:
        """How long it is [s]."""
        return self.period * self.samples if self.samples else 0.0


def read_recordings(signals: Path, records: DriveRecords, known: DriveKnown) -> list[Recording]:
    """Every recording that ``records`` names, in the order of their names.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote it.
    records : DriveRecords
        Which recordings, and their channels.
    known : DriveKnown
        What is known of the axes.

    Returns
    -------
    list of Recording
        A recording that shows no axis is there with the reasons.

    Raises
    ------
    ValueError
        When ``signals`` has no manifest, none of its files fits ``records.recordings``, or
        ``records`` or ``known`` names what none of them holds.
    """
    from pipeline.identification.drive.asked import (
        check_axes,
        check_channels,
        check_constants,
        without_copies,
    )
    from pipeline.identification.drive.reading import constants_held, read_file, shared_constants

    check_axes(records, known)
    try:
        files = json.loads((signals / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{signals}/manifest.json cannot be read: run `dvc repro`") from error
    patterns = [records.recordings, *([records.motor.recordings] if records.motor else [])]
    named = {
        name: entry
        for name, entry in sorted(files.items())
        if any(fnmatchcase(name, pattern) for pattern in patterns)
    }
    if not named:
        raise ValueError(
            f"no recording in {signals} fits drive_records.recordings = {records.recordings!r}: "
            "put recordings of the servo there or correct the pattern"
        )
    named = without_copies(named, records)
    check_constants(known, constants_held(named))
    shared = shared_constants(named)
    found = [
        one
        for name, entry in named.items()
        for one in read_file(signals, name, entry, records, known, shared)
    ]
    check_channels(records, found)
    return found
