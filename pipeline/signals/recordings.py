"""Recordings for sub-models: wide tables of ingested records as channels in SI, with conditions.

A recording is one Parquet file in ``data/signals/<machine>/traces/``, with its raw file's hash in
``manifest.json`` and its row in ``runs.parquet``.  A lack of a recording is a sentence in
:attr:`Samples.lacking` or :attr:`Recording.reason`, never an exception.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.store import structured
from pipeline.signals.columns import unit_of
from pipeline.signals.conditions import Condition, ConditionSources, conditions_in_runs
from pipeline.signals.recorder_faults import RecorderFault, without_faults
from pipeline.signals.units import conversion
from pipeline.signals.windows import UniformSegment, uniform_segments

QUANTITIES: Mapping[str, str] = {
    "position": "m", "displacement": "m", "velocity": "m/s", "acceleration": "m/s^2",
    "angle": "rad", "angular_velocity": "rad/s", "angular_acceleration": "rad/s^2",
    "force": "N", "torque": "N m", "current": "A", "voltage": "V", "power": "W", "energy": "J",
    "temperature": "K", "pressure": "Pa", "mass": "kg", "time": "s", "frequency": "Hz",
    "flow": "m^3/s", "ratio": "1", "strain": "1",
}  # fmt: skip
"""Kinds of quantities and the SI unit in which their channels are given."""

WORDS = "words"
"""Kind of a channel whose values are words (a state, a phase of the process), not numbers."""


@dataclass(frozen=True, kw_only=True)
class Channel(Ranged, section="channel"):
    """Declaration of one channel: where it stands in a recording, and what it measures."""

    column: str
    """Name of the column, or a pattern of it (``"*pulses*"``), whose first match counts."""
    quantity: str = ""
    """Kind of quantity: one of ``QUANTITIES``, ``"words"``, any other name together with ``unit``,
    or ``""`` for numbers that are given in whatever unit they were recorded."""
    unit: str = ""
    """Unit of the column where the recording itself gives none.  For a quantity that is not in
    ``QUANTITIES`` it is also the unit in which the channel is given."""
    factor: Annotated[float, Range()] = 1.0
    """Applied after the conversion to SI: -1 reverses the sign, a gain scales."""
    remedy: str = "record it or correct its name"
    """Remedy where a recording lacks it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.factor == 0:
            raise ValueError(f"channel {self.column!r}: factor = 0 leaves nothing of it")
        if self.quantity in ("", WORDS):
            return
        if self.quantity not in QUANTITIES and not self.unit:
            raise ValueError(
                f"channel {self.column!r}: quantity {self.quantity!r} is none of "
                f"{', '.join(QUANTITIES)}: name its unit"
            )
        if self.unit:
            try:
                conversion(self.unit, self.si_unit)
            except ValueError as error:
                raise ValueError(f"channel {self.column!r}: {error}") from error

    @property
    def si_unit(self) -> str:
        """Unit in which the channel is given; ``""`` where that is the recording's own."""
        return QUANTITIES.get(self.quantity, self.unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Rows of one recording: T of them, on the recorder's own clock."""

    time: Floats = field(default_factory=lambda: np.zeros(0))
    """Time since the start [s]; NaN where a row has none.  Empty where nothing can be read; shape
    (T,)."""
    channels: Mapping[str, Floats] = field(default_factory=dict)
    """Declared name -> values in SI (in its ``units``); NaN where a row has no value;
    shape (T,)."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each of ``channels``."""
    words: Mapping[str, Any] = field(default_factory=dict)
    """Channels of words; ``""`` where a row has none; shape (T,)."""
    lacking: Mapping[str, str] = field(default_factory=dict)
    """Declared channels that the recording does not give, with the reason and the remedy."""
    absent: frozenset[str] = frozenset()
    """Names in ``lacking`` that were not recorded: no such column, or no value in it."""

    def complete(self, names: Iterable[str] | None = None) -> Bools:
        """Rows with a time and a value in each of the channels ``names`` (all); shape (T,)."""
        chosen = self.channels if names is None else names
        rows = np.isfinite(self.time)
        for name in chosen:
            rows = rows & np.isfinite(self.channels[name])
        return rows

    def segments(self, rows: Bools) -> list[UniformSegment]:
        """Stretches of ``rows`` without a gap on even grids; rows without a time are left out."""
        at = np.flatnonzero(rows & np.isfinite(self.time))
        pieces = uniform_segments(self.time[at])
        if not pieces:
            raise ValueError("it has more gaps than rows")
        return [replace(piece, rows=at[piece.rows]) for piece in pieces]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One recording; its role (training, held out, golden) is the caller's."""

    name: str
    """Name of the raw file below the machine's folder."""
    sha256: str = ""
    """Hash of the raw file's bytes."""
    file: Path | None = None
    """Parquet of the recording; None where the raw file is no table, is a copy or could not be
    read."""
    start: str | None = None
    """Time of the first row (ISO 8601, UTC); None where its clock only counts from the start."""
    rows: int = 0
    """Number of rows [1]."""
    conditions: Mapping[str, Condition] = field(default_factory=dict)
    """Tool, material, feed, speed and whatever else is recorded of it."""
    constants: Mapping[str, Any] = field(default_factory=dict)
    """Values beside the channels of its file (a sampling rate, a gain), as the file has them."""
    declared: Mapping[str, Channel] = field(default_factory=dict)
    """Channels that :meth:`load` reads."""
    reason: str = ""
    """Reason why it cannot be used, ``""`` where it can."""
    notes: tuple[str, ...] = ()
    """Further notes on it."""
    faults: tuple[RecorderFault, ...] = ()
    """Faults of its channels; where one is certain, the channel is not read."""

    def load(self, names: Iterable[str] | None = None) -> Samples:
        """Read the channels ``names`` (all that are declared) from the Parquet file."""
        chosen = list(self.declared) if names is None else list(names)
        if strange := [name for name in chosen if name not in self.declared]:
            raise ValueError(
                f"channel {strange[0]!r} is not declared: declare it, or use one of "
                f"{', '.join(self.declared) or 'none'}"
            )
        if self.file is None:
            return Samples(lacking=dict.fromkeys(chosen, self.reason or "it is no table"))
        channels = {name: self.declared[name] for name in chosen}
        try:
            with pq.ParquetFile(self.file) as parquet:
                names_there = parquet.schema_arrow.names
                columns = {name: _column(names_there, one.column) for name, one in channels.items()}
                wanted = {"t", "time", *(c for c in columns.values() if c is not None)}
                table = parquet.read(columns=[name for name in names_there if name in wanted])
            table = without_faults(table, self.faults)
        except (OSError, pa.ArrowException):
            place = f"{self.file.parent.name}/{self.file.name}"
            return Samples(
                lacking=dict.fromkeys(chosen, f"{place} cannot be read: run `dvc repro`")
            )
        try:
            time = _time(table)
        except ValueError as error:
            return Samples(lacking=dict.fromkeys(chosen, str(error)))
        numbers, units, words, lacking, absent = {}, {}, {}, {}, set()
        for name, channel in channels.items():
            try:
                column = columns[name]
                if column is None:
                    raise _NotRecordedError(
                        f"it has no channel {channel.column!r}: {channel.remedy}"
                    )
                if channel.quantity == WORDS:
                    texts = table[column].cast(pa.string()).to_pylist()
                    words[name] = np.array([text or "" for text in texts])
                else:
                    numbers[name], units[name] = _values(table, column, channel)
            except ValueError as error:
                lacking[name] = str(error)
                absent |= {name} if isinstance(error, _NotRecordedError) else set()
        return Samples(
            time=time, channels=numbers, units=units, words=words, lacking=lacking,
            absent=frozenset(absent),
        )  # fmt: skip


def read_recordings(
    signals: Path,
    channels: Mapping[str, Channel],
    *,
    patterns: Sequence[str] = ("*",),
    conditions: ConditionSources | None = None,
    preferred: Callable[[str], bool] = lambda name: False,
    section: str = "recordings",
) -> list[Recording]:
    """Recordings of a machine whose names fit ``patterns``, in the order of their names.

    No channel is read before :meth:`Recording.load`.  Of several files with the same bytes the one
    is kept whose name is ``preferred``; the others have that reason and no file.  ``section`` is
    the key of the patterns, for the ValueError where no file fits.
    """
    try:
        files = json.loads((signals / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{signals}/manifest.json cannot be read: run `dvc repro`") from error
    entries = {
        name: entry
        for name, entry in sorted(files.items())
        if any(fnmatchcase(name, pattern) for pattern in patterns)
    }
    if not entries:
        shown = ", ".join(map(repr, patterns))
        raise ValueError(
            f"no recording in {signals} fits {section} = {shown}: put recordings there or correct "
            "the pattern"
        )
    originals = _originals(entries, preferred)
    rows = conditions_in_runs(signals / "runs.parquet")
    sources = conditions or ConditionSources()
    found = []
    for name, entry in entries.items():
        one = replace(_recording(signals, name, entry), declared=channels)
        if originals[name] != name:
            reason = f"it is a copy of {originals[name]}: record another"
            found.append(replace(one, file=None, constants={}, reason=reason))
            continue
        try:
            one = replace(one, conditions=sources.of(name, rows.get(name)))
        except ValueError as error:
            one = replace(one, reason=str(error))
        found.append(one)
    return found


def _originals(
    entries: Mapping[str, Mapping[str, Any]], preferred: Callable[[str], bool]
) -> dict[str, str]:
    """For each file the one that is kept of those with the same bytes."""
    kept: dict[str, str] = {}
    for name in sorted(entries, key=lambda one: (not preferred(one), one)):
        kept.setdefault(str(entries[name].get("sha256") or name), name)
    return {name: kept[str(entry.get("sha256") or name)] for name, entry in entries.items()}


def _recording(signals: Path, name: str, entry: Mapping[str, Any]) -> Recording:
    notes = entry.get("notes") or {}
    constants = notes.get("constants")
    faults = tuple(structured(one, RecorderFault, name) for one in notes.get("faults", ()))
    output = entry.get("output")
    table = isinstance(output, str) and output.startswith("traces/")
    return Recording(
        name=name,
        sha256=str(entry.get("sha256") or ""),
        file=signals / str(output) if table else None,
        start=entry.get("first"),
        rows=int(entry.get("rows") or 0),
        constants=dict(constants) if isinstance(constants, dict) else {},
        reason="" if table else entry.get("reason") or "it is no table",
        notes=tuple(f"{one.channel} {one.said}" for one in faults), faults=faults,
    )  # fmt: skip


class _NotRecordedError(ValueError):
    """A channel that the recorder did not write."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LogItems:
    """Numbers of a log's data items, each of which holds until its next report."""

    time: Floats
    """Time since the first row [s], ascending; shape (N,)."""
    item: Any
    """Name of the data item; shape (N,)."""
    number: Floats
    """NaN where the item became unavailable or reported a word; shape (N,)."""

    @staticmethod
    def read(path: Path) -> "LogItems":
        """Observations in ``path``, as the ingest wrote them."""
        table = pq.read_table(path, columns=["time", "data_item", "number"]).to_pandas()
        table = table.sort_values("time", kind="stable")
        since = table["time"] - table["time"].iloc[0] if len(table) else table["time"].diff()
        return LogItems(
            time=since.dt.total_seconds().to_numpy(float), item=table["data_item"].to_numpy(object),
            number=table["number"].to_numpy(float),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.time)

    def times(self, item: str) -> Floats:
        """Times at which an item reported [s]."""
        return self.time[self.item == item]

    def held(self, item: str, times: Floats) -> Floats:
        """Last number of an item at ``times`` [s]; NaN before its first."""
        rows = self.item == item
        values = np.append(self.number[rows], np.nan)
        last = np.searchsorted(self.time[rows], times, side="right") - 1
        return values[last]


def _column(names: Sequence[str], column: str) -> str | None:
    """The column called so, else the first that fits the pattern."""
    if column in names:
        return column
    return next((name for name in names if fnmatchcase(name, column)), None)


def _values(table: pa.Table, column: str, channel: Channel) -> tuple[Floats, str]:
    """Values of a column of numbers in SI, NaN where it has none, and their unit."""
    kind = table.schema.field(column)
    if not (pa.types.is_floating(kind.type) or pa.types.is_integer(kind.type)):
        raise ValueError(f"its channel {column!r} holds words: name a channel of numbers")
    values: Floats = table[column].cast(pa.float64()).to_numpy(zero_copy_only=False).copy()
    values[~np.isfinite(values)] = np.nan
    if np.isnan(values).all():
        raise _NotRecordedError(f"its channel {column!r} holds no value: {channel.remedy}")
    recorded = unit_of(kind)
    unit = recorded or channel.unit
    if channel.quantity:
        try:
            factor, offset = conversion(unit, channel.si_unit)
        except ValueError as error:
            raise ValueError(
                f"its channel {column!r} is in {unit or 'no unit'}: {error}"
            ) from error
        if recorded or (factor, offset) != (1.0, 0.0):
            values = values * factor + offset
        unit = channel.si_unit
    return (values if channel.factor == 1.0 else values * channel.factor), unit


def _time(table: pa.Table) -> Floats:
    """Time of the rows since the start [s]."""
    if "t" not in table.column_names and "time" not in table.column_names:
        raise ValueError("it has no time: name its time column or its rate in the table's layout")
    if not table.num_rows:
        raise ValueError("it has no rows: record it again")
    if "t" in table.column_names:
        return np.array(table["t"].to_numpy(zero_copy_only=False), np.float64)
    stamps = table["time"].cast(pa.int64())
    present = stamps.is_valid().to_numpy()
    ns = stamps.fill_null(0).to_numpy()
    if not present.any():
        raise ValueError("it has no time: name its time column or its rate in the table's layout")
    time: Floats = np.asarray((ns - ns[present][0]) * 1e-9, np.float64)
    return np.where(present, time, np.nan)
