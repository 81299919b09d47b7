"""Recordings of feed drives from Parquet: axes on a uniform grid in SI, or why one is not shown.

Rows that lack a value of a channel that is used count as missing.  Each axis that a recording does
not show has its reason, in one sentence.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.signals import recordings
from pipeline.signals.recorder_faults import without_faults
from pipeline.signals.sampling import UniformSegment, uniform_segments
from pipeline.signals.units import conversion
from pipeline.submodels.drive.prior import (
    DrivePrior,
    check_axes,
    check_constants,
    constants_of,
    names_of,
)
from pipeline.submodels.drive.records import (
    AirRows,
    AxisChannels,
    AxisConstants,
    AxisRecord,
    DriveRecords,
    MotorRecords,
    Recording,
    ShaftRecords,
    Tracked,
    check_channels,
)

SI = {
    "position": "m", "reference": "m", "velocity": "m/s", "velocity_reference": "m/s",
    "acceleration": "m/s^2", "acceleration_reference": "m/s^2",
}  # fmt: skip
DISTURBANCES = ("N", "m", "m/s")
"""Units in which a disturbance is read if it is declared in one that converts to them."""
MOTOR_SI = {"u_d": "V", "u_q": "V", "i_d": "A", "i_q": "A", "speed": "rad/s", "torque": "N m"}
SHAFT_SI = {"motor": "m", "load": "m"}
COMMAND_UNITS = {"AMPERE": "A", "VOLT": "V", "NEWTON": "N", "PERCENT": "%", "": "1"}


class Unusable(ValueError):  # noqa: N818 - a state of a channel, not a fault
    """Channel or axis that a recording does not show; the message is the reason."""


def read_recordings(
    signals: Path, records: DriveRecords, prior: DrivePrior, is_training: Callable[[str], bool]
) -> list[Recording]:
    """Recordings that ``records`` names, in the order of their names.

    Returns
    -------
    list of Recording
        A recording that shows no axis is there with the reasons.

    Raises
    ------
    ValueError
        When ``signals`` has no manifest, none of its files fits ``records.recordings``, or
        ``records`` or ``prior`` names what none of them holds.
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
    """Recordings in one file: one for each stretch without a gap in time."""
    name = file.name
    blank = Recording(name=name, trained=trained, sha256=file.sha256, notes=file.notes)
    if file.file is None:
        return [_nothing(blank, records, file.reason)]
    try:
        table = without_faults(pq.read_table(file.file), file.faults)
    except (OSError, pa.ArrowException):
        place = f"{file.file.parent.name}/{file.file.name}"
        return [_nothing(blank, records, f"{place} cannot be read: run `dvc repro`")]
    try:
        if records.motor is not None and fnmatchcase(name, records.motor.recordings):
            return _motor(table, blank, records.motor)
        if records.shaft is not None and fnmatchcase(name, records.shaft.recordings):
            return _shafts(table, blank, records.shaft)
        own = constants_of({name: file.constants})
        used = {one for letter in records.axes for one in names_of(prior.axis(letter))}
        if lent := sorted(used & set(shared) - set(own)):
            said = f"{', '.join(lent)} taken from the other recordings: this one does not hold it"
            blank = replace(blank, notes=(*blank.notes, said))
        return _drives(table, blank, records, prior, {**shared, **own})
    except Unusable as error:
        return [_nothing(blank, records, str(error))]


def _drives(
    table: pa.Table,
    blank: Recording,
    records: DriveRecords,
    prior: DrivePrior,
    constants: Mapping[str, float],
) -> list[Recording]:
    """Recordings of the axes in one table."""
    channels: dict[str, dict[str, Floats]] = {}
    constants_of_axis: dict[str, AxisConstants] = {}
    units: dict[str, str] = {}
    lacking: dict[str, str] = {}
    for letter, names in records.axes.items():
        try:
            channels[letter] = _moving(table, names)
            constants_of_axis[letter] = prior.axis(letter).resolved(constants)
            command, unit = _command(table, names)
            channels[letter] |= {"command": command}
            units[letter] = COMMAND_UNITS.get(unit, unit)
        except ValueError as error:  # what is wrong with a constant or a channel of this file
            lacking[letter] = str(error)
    channels = {letter: one for letter, one in channels.items() if letter in units or _both(one)}
    if not channels:
        return [replace(blank, lacking=lacking)]
    air = _air(table, records.air)

    def record(letter: str, on_grid: dict[str, Floats]) -> AxisRecord:
        return AxisRecord(
            command=on_grid["command"], constants=constants_of_axis[letter],
            command_unit=units[letter],
            load_unit=_load_unit(table, _named(table, records.axes[letter].load)),
            load=on_grid.get("load"), **{key: on_grid.get(key) for key in SI},
        )  # fmt: skip

    return [
        replace(
            one,
            axes={letter: record(letter, grids[letter]) for letter in units},
            tracked={
                letter: Tracked(
                    reference=of["reference"], position=of["position"], period=one.period
                )
                for letter, of in grids.items()
                if _both(of)
            },
            lacking=lacking,
            air=_near(piece, air[rows]) & one.air,
        )
        for one, grids, piece, rows in _parts(table, blank, channels)
    ]


def _both(channels: Mapping[str, Floats]) -> bool:
    """Whether commanded and actual position are there."""
    return {"reference", "position"} <= set(channels)


def _motor(table: pa.Table, blank: Recording, records: MotorRecords) -> list[Recording]:
    """Recordings of the motor in one table."""
    found = {}
    for key, name in records.channels.items():
        if key not in MOTOR_SI:
            raise Unusable(f"drive_records.motor.channels names {key!r}: {', '.join(MOTOR_SI)}")
        values = _channel(table, name, MOTOR_SI[key])
        if values is None:
            raise Unusable(f"it has no channel {name!r}: record it or correct its name")
        found[key] = values
    return [replace(one, motor=of[""]) for one, of, *_ in _parts(table, blank, {"": found})]


def _shafts(table: pa.Table, blank: Recording, records: ShaftRecords) -> list[Recording]:
    """Recordings of both ends of the drive trains in one table."""
    found: dict[str, dict[str, Floats]] = {}
    for letter, channels in records.axes.items():
        names = {"motor": channels.motor, "load": channels.load, "command": channels.command}
        if not set(names.values()) <= set(table.column_names):
            continue
        both = {key: _channel(table, name, SHAFT_SI.get(key)) for key, name in names.items()}
        values = {key: one for key, one in both.items() if one is not None}
        if len(values) < len(names):
            continue
        check_command(channels.command, _unit(table.schema.field(channels.command)))
        if channels.reversed:
            values["command"] = -values["command"]
        found[letter] = values
    if not found:
        raise Unusable(
            "it shows both ends of no axis: record motor position, scale and current together, or "
            "correct drive_records.shaft"
        )
    return [replace(one, shafts=grids) for one, grids, *_ in _parts(table, blank, found)]


def _parts(
    table: pa.Table, blank: Recording, channels: Mapping[str, Mapping[str, Floats]]
) -> Iterator[tuple[Recording, dict[str, dict[str, Floats]], UniformSegment, Ints]]:
    """A recording for each stretch without a gap, named where there are several, and its channels.

    They stand on its grid, by letter and name; then the stretch, and the rows that have a value in
    all channels.
    """
    time, every = _time(table), [v for axis in channels.values() for v in axis.values()]
    rows = np.flatnonzero(np.isfinite(time) & np.all([np.isfinite(one) for one in every], axis=0))
    try:
        pieces = uniform_segments(time[rows])
    except ValueError as error:
        raise Unusable(str(error)) from error
    if not pieces:
        raise Unusable("it has more gaps than rows")
    many = table.num_rows
    lost = many - sum(len(one.rows) for one in pieces)
    left = (f"{lost} of {many} rows left out: no value, a copy, or between gaps",) if lost else ()
    for number, piece in enumerate(pieces, start=1):
        name = blank.name if len(pieces) == 1 else f"{blank.name} (part {number})"
        filled = int(piece.filled.sum())
        said = (f"{filled} missing rows filled in and not learnt from",) if filled else ()
        one = replace(
            blank, name=name, period=piece.period, notes=blank.notes + said + left,
            air=~piece.filled,
        )  # fmt: skip
        grids = {
            letter: {key: piece.on_grid(values[rows]) for key, values in axis.items()}
            for letter, axis in channels.items()
        }
        yield one, grids, piece, rows


def _nothing(blank: Recording, records: DriveRecords, reason: str) -> Recording:
    return replace(blank, lacking=dict.fromkeys(records.axes, reason))


def _moving(table: pa.Table, channels: AxisChannels) -> dict[str, Floats]:
    """Motion and load of an axis in SI, all rows, without what the recording lacks."""
    found = {
        key: values
        for key in SI
        if (values := _channel(table, _named(table, getattr(channels, key)), SI[key])) is not None
    }
    name = _named(table, channels.load)
    unit = _load_unit(table, name)
    if (load := _channel(table, name, unit if unit in DISTURBANCES else None)) is not None:
        found["load"] = load
    if "position" not in found and "velocity" not in found:
        name = channels.position or channels.velocity
        raise Unusable(f"it has no channel {name!r}: record the position")
    motion = found.get("position", found.get("velocity"))
    if motion is not None and np.nanmax(motion) == np.nanmin(motion):
        raise Unusable("the axis does not move in it")
    return found


def _command(table: pa.Table, channels: AxisChannels) -> tuple[Floats, str]:
    """Torque command of an axis, all rows, a positive one towards plus, and its unit."""
    name = _named(table, channels.command)
    values = _channel(table, name, None)
    if name is None or values is None:
        what = f"no channel {channels.command!r}" if name else "no torque command"
        raise Unusable(f"it has {what}: record the torque command")
    known = values[np.isfinite(values)]
    if np.ptp(known) == 0:
        raise Unusable(
            f"{channels.command!r} is {known[0]:g} throughout: record the drive's current"
        )
    unit = _unit(table.schema.field(name))
    check_command(name, unit)
    return (-values if channels.reversed else values), unit


def _named(table: pa.Table, pattern: str | None) -> str | None:
    """The channel called so, or the first that fits the pattern."""
    if pattern is None or pattern in table.column_names:
        return pattern
    return next((name for name in table.column_names if fnmatchcase(name, pattern)), pattern)


def _load_unit(table: pa.Table, name: str | None) -> str:
    """Unit in which a disturbance is read; "" where its channel names none."""
    unit = "" if name is None or name not in table.column_names else _unit(table.schema.field(name))
    for si in DISTURBANCES if unit else ():
        try:
            conversion(unit, si)
        except ValueError:
            continue
        return si
    return COMMAND_UNITS.get(unit, unit) if unit else ""


def _channel(table: pa.Table, name: str | None, unit: str | None) -> Floats | None:
    """A channel in ``unit``, NaN where it has no value; None when there is no such channel."""
    if name is None or name not in table.column_names:
        return None
    field = table.schema.field(name)
    if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
        raise Unusable(f"its channel {name!r} holds words: name a channel of numbers")
    values: Floats = table[name].cast(pa.float64()).to_numpy(zero_copy_only=False).copy()
    values[~np.isfinite(values)] = np.nan
    if np.isnan(values).all():
        return None
    found = _unit(field)
    if unit is None:
        return values
    try:
        factor, offset = conversion(found, unit)
    except ValueError as error:
        raise Unusable(f"its channel {name!r} is in {found or 'no unit'}: {error}") from error
    return values * factor + offset


def _unit(field: pa.Field) -> str:
    return (field.metadata or {}).get(b"unit", b"").decode()


def _air(table: pa.Table, rows: AirRows | None) -> Bools:
    if rows is None:
        return np.ones(table.num_rows, bool)
    if rows.channel not in table.column_names:
        raise Unusable(
            f"it has no channel {rows.channel!r} that tells rows free of cutting: record it or "
            "leave drive_records.air out"
        )
    words = table[rows.channel].cast(pa.string()).to_pylist()
    return np.isin(np.array([word or "" for word in words]), rows.values)


def _time(table: pa.Table) -> Floats:
    if "t" in table.column_names:
        return np.array(table["t"].to_numpy(zero_copy_only=False), np.float64)
    if "time" not in table.column_names:
        raise Unusable("it has no time: name its time column or its rate in the table's layout")
    ns = table["time"].cast(pa.int64()).to_numpy()
    return np.asarray((ns - ns[0]) * 1e-9, np.float64)


def _near(piece: UniformSegment, flags: Bools) -> Bools:
    """Flags of the rows on the grid: true where the rows on both sides are."""
    return np.asarray(piece.on_grid(flags.astype(np.float64)) > 1 - 1e-9)


def check_command(name: str, unit: str) -> None:
    """Check that the channel ``name`` of a torque command is not in a unit of motion."""
    for motion in ("m", "m/s", "m/s^2", "rad", "rad/s", "s"):
        try:
            conversion(unit, motion)
        except ValueError:
            continue
        raise ValueError(
            f"its channel {name!r} is in {unit}, no unit of a torque command: name the channel of "
            "the drive's current, voltage or torque"
        )
