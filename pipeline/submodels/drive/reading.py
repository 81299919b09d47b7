"""Recordings of feed drives from Parquet: axes on a uniform grid in SI, or reasons for none.

Rows that lack a value of a channel that is used count as missing.  Each axis that a recording does
not show has its reason, in one sentence.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.signals import recordings
from pipeline.signals.recordings import WORDS, Channel, Samples
from pipeline.signals.units import conversion
from pipeline.signals.windows import UniformSegment
from pipeline.submodels.drive.records import (
    AirRows,
    AxisChannels,
    AxisConstants,
    AxisRecord,
    DrivePrior,
    DriveRecords,
    MotorRecords,
    Recording,
    ShaftRecords,
    Tracked,
    check_axes,
    check_channels,
    check_constants,
    constants_of,
    names_of,
)

MOTION = {
    "position": "position", "reference": "position", "velocity": "velocity",
    "velocity_reference": "velocity", "acceleration": "acceleration",
    "acceleration_reference": "acceleration",
}  # fmt: skip
"""Channels of an axis' motion, and what they measure."""
DISTURBANCES = ("N", "m", "m/s")
"""Units in which a disturbance is read if it is declared in one that converts to them."""
MOTOR = {"u_d": "voltage", "u_q": "voltage", "i_d": "current", "i_q": "current",
         "speed": "angular_velocity", "torque": "torque"}  # fmt: skip
SHAFT = ("motor", "load", "command")
AIR = "air"
COMMAND_UNITS = {"AMPERE": "A", "VOLT": "V", "NEWTON": "N", "PERCENT": "%", "": "1"}


class Unusable(ValueError):  # noqa: N818 - a state of a channel, not a fault
    """Channel or axis that a recording does not show; the message is the reason."""


def read_recordings(
    signals: Path, records: DriveRecords, prior: DrivePrior, is_training: Callable[[str], bool]
) -> list[Recording]:
    """Recordings that ``records`` names, in the order of their names.

    One that shows no axis is there with the reasons.  What ``records`` or ``prior`` names and none
    of the files holds is a ValueError.
    """
    check_axes(records, prior)
    files = recordings.read_recordings(
        signals, {}, preferred=is_training, section="drive_records.recordings",
        patterns=[
            records.recordings,
            *(one.recordings for one in (records.motor, records.shaft) if one is not None),
        ],
    )  # fmt: skip
    check_constants(prior, {name for one in files for name in one.constants})
    shared = constants_of({one.name: one.constants for one in files})
    found = [
        part
        for one in files
        for part in read_file(one, records, prior, shared, trained=is_training(one.name))
    ]
    check_channels(records, found)
    return found


def read_file(
    file: recordings.Recording,
    records: DriveRecords,
    prior: DrivePrior,
    shared: Mapping[str, float],
    *,
    trained: bool,
) -> list[Recording]:
    """Recordings in one file, split at gaps; ``shared`` constants complete the file's."""
    name = file.name
    blank = Recording(name=name, trained=trained, sha256=file.sha256, notes=file.notes)
    motor, shaft = records.motor, records.shaft
    motor = motor if motor is not None and fnmatchcase(name, motor.recordings) else None
    shaft = shaft if shaft is not None and fnmatchcase(name, shaft.recordings) else None
    try:
        if motor is not None:
            declared = _motor_channels(motor)
        elif shaft is not None:
            declared = _shaft_channels(shaft)
        else:
            declared = _axis_channels(records)
        samples = replace(file, declared=declared).load()
        if not len(samples.time):
            raise Unusable(file.reason or next(iter(samples.lacking.values())))
        if motor is not None:
            return _motor(samples, blank)
        if shaft is not None:
            return _shafts(samples, blank, shaft)
        own = constants_of({name: file.constants})
        used = {one for letter in records.axes for one in names_of(prior.axis(letter))}
        if lent := sorted(used & set(shared) - set(own)):
            said = f"{', '.join(lent)} taken from the other recordings: this one does not hold it"
            blank = replace(blank, notes=(*blank.notes, said))
        return _drives(samples, blank, records, prior, {**shared, **own})
    except Unusable as error:
        return [replace(blank, lacking=dict.fromkeys(records.axes, str(error)))]


def _axis_channels(records: DriveRecords) -> dict[str, Channel]:
    """Channels of all axes, ``X position``, and of the rows free of cutting."""
    declared = {
        f"{letter} {key}": Channel(column=name, quantity=MOTION.get(key, ""))
        for letter, axis in records.axes.items()
        for key in (*MOTION, "command", "load")
        if (name := getattr(axis, key)) is not None
    }
    if records.air is not None:
        declared[AIR] = Channel(column=records.air.channel, quantity=WORDS)
    return declared


def _motor_channels(records: MotorRecords) -> dict[str, Channel]:
    if strange := [key for key in records.channels if key not in MOTOR]:
        raise Unusable(f"drive_records.motor.channels names {strange[0]!r}: {', '.join(MOTOR)}")
    return {
        key: Channel(column=name, quantity=MOTOR[key]) for key, name in records.channels.items()
    }


def _shaft_channels(records: ShaftRecords) -> dict[str, Channel]:
    return {
        f"{letter} {key}": Channel(column=name, quantity=quantity)
        for letter, one in records.axes.items()
        for key, name, quantity in (
            ("motor", one.motor, "position"), ("load", one.load, "position"),
            ("command", one.command, ""),
        )
    }  # fmt: skip


def _drives(
    samples: Samples,
    blank: Recording,
    records: DriveRecords,
    prior: DrivePrior,
    constants: Mapping[str, float],
) -> list[Recording]:
    channels: dict[str, dict[str, Floats]] = {}
    constants_of_axis: dict[str, AxisConstants] = {}
    units: dict[str, str] = {}
    load_units: dict[str, str] = {}
    lacking: dict[str, str] = {}
    for letter, names in records.axes.items():
        try:
            channels[letter], load_units[letter] = _moving(samples, letter, names)
            constants_of_axis[letter] = prior.axis(letter).resolved(constants)
            command, unit = _command(samples, letter, names)
            channels[letter] |= {"command": command}
            units[letter] = COMMAND_UNITS.get(unit, unit)
        except ValueError as error:  # what is wrong with a constant or a channel of this file
            lacking[letter] = str(error)
    channels = {letter: one for letter, one in channels.items() if letter in units or _both(one)}
    if not channels:
        return [replace(blank, lacking=lacking)]
    air = _air(samples, records.air)

    def record(letter: str, on_grid: dict[str, Floats]) -> AxisRecord:
        return AxisRecord(
            command=on_grid["command"], constants=constants_of_axis[letter],
            command_unit=units[letter], load_unit=load_units[letter], load=on_grid.get("load"),
            **{key: on_grid.get(key) for key in MOTION},
        )  # fmt: skip

    return [
        replace(
            one, axes={letter: record(letter, grids[letter]) for letter in units},
            tracked={
                letter: Tracked(reference=of["reference"], position=of["position"],
                                period=one.period)
                for letter, of in grids.items() if _both(of)
            },
            lacking=lacking, air=_near(piece, air) & one.air,
        )
        for piece, one, grids in _parts(samples, channels, blank)
    ]  # fmt: skip


def _both(channels: Mapping[str, Floats]) -> bool:
    return {"reference", "position"} <= set(channels)


def _motor(samples: Samples, blank: Recording) -> list[Recording]:
    if samples.lacking:
        raise Unusable(next(iter(samples.lacking.values())))
    parts = _parts(samples, {"": samples.channels}, blank)
    return [replace(one, motor=grids[""]) for _, one, grids in parts]


def _shafts(samples: Samples, blank: Recording, records: ShaftRecords) -> list[Recording]:
    found: dict[str, dict[str, Floats]] = {}
    for letter, channels in records.axes.items():
        recorded = {key: _recorded(samples, f"{letter} {key}") for key in SHAFT}
        values = {key: one for key, one in recorded.items() if one is not None}
        if len(values) < len(SHAFT):
            continue
        check_command(channels.command, samples.units[f"{letter} command"])
        if channels.reversed:
            values["command"] = -values["command"]
        found[letter] = values
    if not found:
        raise Unusable(
            "it shows both ends of no axis: record motor position, scale and current together, or "
            "correct drive_records.shaft"
        )
    return [replace(one, shafts=grids) for _, one, grids in _parts(samples, found, blank)]


def _parts(
    samples: Samples, channels: Mapping[str, Mapping[str, Floats]], blank: Recording
) -> Iterator[tuple[UniformSegment, Recording, dict[str, dict[str, Floats]]]]:
    """Stretches on a uniform grid of the rows with a value in all ``channels``, by group and name.

    Each is a recording, named where there are several, with its channels on the grid.
    """
    values = [one for group in channels.values() for one in group.values()]
    try:
        pieces = samples.segments(np.all(np.isfinite(values), axis=0))
    except ValueError as error:
        raise Unusable(str(error)) from error
    rows = len(samples.time)
    lost = rows - sum(len(one.rows) for one in pieces)
    left = (f"{lost} of {rows} rows left out: no value, a copy, or between gaps",) if lost else ()
    for number, piece in enumerate(pieces, start=1):
        name = blank.name if len(pieces) == 1 else f"{blank.name} (part {number})"
        filled = int(piece.filled.sum())
        said = (f"{filled} missing rows filled in and not learnt from",) if filled else ()
        grids = {of: {key: piece.on_grid(one) for key, one in group.items()}
                 for of, group in channels.items()}  # fmt: skip
        notes, air = blank.notes + said + left, ~piece.filled
        yield piece, replace(blank, name=name, period=piece.period, notes=notes, air=air), grids


def _recorded(samples: Samples, name: str) -> Floats | None:
    """A channel; None where it was not recorded, a reason where it cannot be used."""
    if name in samples.lacking and name not in samples.absent:
        raise Unusable(samples.lacking[name])
    return samples.channels.get(name)


def _moving(samples: Samples, letter: str, channels: AxisChannels) -> tuple[dict[str, Floats], str]:
    """Motion and load of an axis in SI, without what the recording lacks; unit of the load."""
    found = {
        key: values
        for key in MOTION
        if (values := _recorded(samples, f"{letter} {key}")) is not None
    }
    load_unit = ""
    if (load := _recorded(samples, f"{letter} load")) is not None:
        found["load"], load_unit = _load(load, samples.units[f"{letter} load"])
    if "position" not in found and "velocity" not in found:
        name = channels.position or channels.velocity
        raise Unusable(f"it has no channel {name!r}: record the position")
    motion = found.get("position", found.get("velocity"))
    if motion is not None and np.nanmax(motion) == np.nanmin(motion):
        raise Unusable("the axis does not move in it")
    return found, load_unit


def _command(samples: Samples, letter: str, channels: AxisChannels) -> tuple[Floats, str]:
    """Torque command of an axis, all rows, a positive one towards plus, and its unit."""
    values = _recorded(samples, f"{letter} command")
    if values is None:
        what = f"no channel {channels.command!r}" if channels.command else "no torque command"
        raise Unusable(f"it has {what}: record the torque command")
    known = values[np.isfinite(values)]
    if np.ptp(known) == 0:
        raise Unusable(
            f"{channels.command!r} is {known[0]:g} throughout: record the drive's current"
        )
    unit = samples.units[f"{letter} command"]
    check_command(str(channels.command), unit)
    return (-values if channels.reversed else values), unit


def _load(values: Floats, unit: str) -> tuple[Floats, str]:
    """A disturbance in the unit in which it is read, "" where its channel names none."""
    for si in DISTURBANCES if unit else ():
        try:
            factor, offset = conversion(unit, si)
        except ValueError:
            continue
        return values * factor + offset, si
    return values, COMMAND_UNITS.get(unit, unit) if unit else ""


def _air(samples: Samples, rows: AirRows | None) -> Bools:
    if rows is None:
        return np.ones(len(samples.time), bool)
    if AIR not in samples.words:
        raise Unusable(
            f"it has no channel {rows.channel!r} that tells rows free of cutting: record it or "
            "leave drive_records.air out"
        )
    return np.isin(samples.words[AIR], rows.values)


def _near(piece: UniformSegment, flags: Bools) -> Bools:
    """Flags of the rows on the grid: true where the rows on both sides are."""
    return np.asarray(piece.on_grid(flags.astype(np.float64)) > 1 - 1e-9)


def check_command(name: str, unit: str) -> None:
    """Refuse a torque command in a unit of motion; allowed: amperes, volts, percent, counts."""
    for motion in ("m", "m/s", "m/s^2", "rad", "rad/s", "s"):
        try:
            conversion(unit, motion)
        except ValueError:
            continue
        raise ValueError(
            f"its channel {name!r} is in {unit}, no unit of a torque command: name the channel of "
            "the drive's current, voltage or torque"
        )
