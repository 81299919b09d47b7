"""What the machine's file asks of its recordings, held against what they hold."""

from collections.abc import Collection, Mapping, Sequence
from string import ascii_uppercase
from typing import Any

from pipeline.identification.drive.known import DriveKnown, names_of
from pipeline.identification.drive.records import DriveRecords, Recording
from pipeline.signals.units import conversion

Entry = Mapping[str, Any]

MOTION = (
    "reference", "position", "velocity_reference", "velocity", "acceleration_reference",
    "acceleration",
)  # fmt: skip
"""Channels whose names are wrong where no recording holds them; a load may be missing."""


def check_axes(records: DriveRecords, known: DriveKnown) -> None:
    """Raise unless letters are letters, and stand in both sections.

    Raises
    ------
    ValueError
        When ``records`` names no axis or one that is no letter, or something is known, or a motor
        recorded, of an axis that ``records`` does not name.
    """
    there = ", ".join(records.axes)
    if not there:
        raise ValueError("drive_records.axes names no axis: name the channels of at least one")
    for letter in records.axes:
        if len(letter) != 1 or letter not in ascii_uppercase:
            raise ValueError(
                f"drive_records.axes names {letter!r}, which is no letter of an axis: write X, Y "
                "or the like"
            )
    asked = {f"drive.axes names {letter!r}": letter for letter in known.axes}
    if records.motor is not None:
        asked[f"drive_records.motor.axis is {records.motor.axis!r}"] = records.motor.axis
    for said, letter in asked.items():
        if letter not in records.axes:
            raise ValueError(
                f"{said}, drive_records.axes has {there}: correct the letter or name the axis' "
                "channels"
            )


def check_command(name: str, unit: str) -> None:
    """Raise when the channel ``name`` of a torque command is in a unit of motion.

    Raises
    ------
    ValueError
        A command may be in amperes, volts, percent or counts, but never in millimetres.
    """
    for motion in ("m", "m/s", "m/s^2", "rad", "rad/s", "s"):
        try:
            conversion(unit, motion)
        except ValueError:
            continue
        raise ValueError(
            f"its channel {name!r} is in {unit}, no unit of a torque command: name the channel of "
            "the drive's current, voltage or torque"
        )


def without_copies(entries: Mapping[str, Entry], records: DriveRecords) -> dict[str, Entry]:
    """Entries of the manifest; of files with the same bytes only one keeps its output.

    A copy under another name would be learnt from twice, or be judged by what was learnt from it:
    the one that may be learnt from is kept, else the first.

    Parameters
    ----------
    entries : mapping of str to mapping
        By the names of the raw files.
    records : DriveRecords
        Which ones may be learnt from.
    """
    kept: dict[str, str] = {}
    for name in sorted(entries, key=lambda one: (not records.is_training(one), one)):
        kept.setdefault(str(entries[name].get("sha256") or name), name)
    found = {}
    for name, entry in entries.items():
        first = kept[str(entry.get("sha256") or name)]
        reason = f"it is a copy of {first}: record another"
        found[name] = (
            entry if name == first else {**entry, "output": None, "reason": reason, "notes": None}
        )
    return found


def check_constants(known: DriveKnown, held: Collection[str]) -> None:
    """Raise unless every constant that ``known`` names stands in some recording.

    Parameters
    ----------
    known : DriveKnown
        What is known of the axes.
    held : collection of str
        Names of the constants of all recordings.

    Raises
    ------
    ValueError
        When none of the recordings holds one.
    """
    for letter, axis in known.axes.items():
        for name in names_of(axis):
            if name not in held:
                raise ValueError(
                    f"drive.axes.{letter} names the constant {name!r}, the recordings hold "
                    f"{', '.join(sorted(held)) or 'none'}: correct the name or write the number"
                )


def check_channels(records: DriveRecords, recordings: Sequence[Recording]) -> None:
    """Raise when no recording of an axis holds a channel that ``records`` names for it.

    Raises
    ------
    ValueError
        Without it a misspelt name would be a channel that is derived, or a servo that is not found.
    """
    for letter, channels in records.axes.items():
        shown = [one.axes[letter] for one in recordings if letter in one.axes]
        for key in MOTION:
            name = getattr(channels, key)
            if name and shown and all(getattr(one, key) is None for one in shown):
                raise ValueError(
                    f"drive_records.axes.{letter}.{key} names the channel {name!r}, of which no "
                    "recording holds a value: correct the name or leave it out"
                )
