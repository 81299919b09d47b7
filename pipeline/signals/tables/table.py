"""Traces from raw tables: columns become channels in the units of the table of signals.

A row whose time or number cannot be read is rejected with its line; a row whose clock runs
backwards is kept in its place, as ``notes`` in the metadata of the trace's schema say.
"""

import difflib
import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.schema.arrays import Bools, Ints
from pipeline.signals.columns import COLUMNS, Column
from pipeline.signals.formats import (
    EXCERPT,
    RecordSource,
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
)
from pipeline.signals.recorder_faults import recorder_faults
from pipeline.signals.tables.cells import (
    NANOSECONDS,
    TIME_UNITS,
    Cells,
    clocks_said,
    instants,
    numbers,
    one_array,
    regular,
    seconds,
    start_of,
    words,
)
from pipeline.signals.units import conversion, mtconnect_unit

_NO_UNIT = ("", "-", "[-]", "[]", "n/a", "none", "()")
_KIND = re.compile(r"_(ref|meas|hat)$")


@dataclass(frozen=True, kw_only=True)
class TraceChannel:
    """One channel: ``raw`` is its column in the file; ``factor``, ``offset`` lead to ``unit``."""

    name: str
    raw: str
    unit: str
    factor: float = 1.0
    offset: float = 0.0
    text: bool = False

    @property
    def field(self) -> pa.Field:
        """Arrow field, the unit as metadata."""
        kind = pa.string() if self.text else pa.float64()
        return pa.field(self.name, kind, metadata={"unit": self.unit})

    def converted(self, values: pa.Array) -> pa.Array:
        """Values [unit of the file] in the channel's unit, shape (T,)."""
        if self.factor != 1.0:
            values = pc.multiply(values, self.factor)
        return pc.add(values, self.offset) if self.offset else values


def known_signal(name: str) -> Column | None:
    """Signal of the table of signals that ``name`` is, or ends with; None for a free name."""
    stem = _KIND.sub("", name)
    parts = stem.split("_")
    for first in range(len(parts)):
        column = COLUMNS.get("_".join(parts[first:]))
        if column is not None and (first == 0 or column.unit):
            return column
    return None


def named_channels(layout: TableLayout, units: dict[str, str]) -> list[TraceChannel]:
    """Channels that the layout names; ``units`` are those that the file states, by raw name.

    A wrong unit of the layout is a ValueError; one of the file makes the file unreadable.
    """
    channels = []
    for name, source in layout.columns.items():
        known = known_signal(name)
        if known.text if known else name in layout.text:
            channels.append(TraceChannel(name=name, raw=source.column, unit="", text=True))
            continue
        found = _stated(units.get(source.column))
        if source.unit is not None and found is not None:
            _check_agreement(source.column, source.unit, found)
        unit = source.unit if source.unit is not None else found
        if known is None and unit is None:
            raise _free_without_unit(name)
        target = known.unit if known else None
        try:
            channels.append(_channel(name, source.column, unit, target))
        except ValueError as error:
            message = f"signal {name!r} from column {source.column!r}: {error}"
            raise (ValueError if source.unit is not None else UnreadableFile)(message) from error
    return channels


def rest_channels(
    layout: TableLayout, available: Iterable[str], units: dict[str, str], taken: set[str | None]
) -> list[TraceChannel]:
    """Channels for the columns that the layout does not name, under the file's own names.

    A taken name, or one of the table of signals, gets ``raw_`` before it.
    """
    if not layout.rest:
        return []
    named = {source.column for source in layout.columns.values()} | {layout.time, layout.date}
    channels = []
    used = set(taken) | set(COLUMNS)
    for raw in available:
        if raw in named:
            continue
        name = raw
        while name in used:
            name = f"raw_{name}"
        used.add(name)
        unit = _stated(units.get(raw))
        try:
            channels.append(_channel(name, raw, unit, None))
        except ValueError:
            channels.append(TraceChannel(name=name, raw=raw, unit=unit or ""))
    return channels


def _channel(name: str, raw: str, unit: str | None, target: str | None) -> TraceChannel:
    if target is None:
        target = mtconnect_unit(unit or "")
    factor, offset = conversion(target if unit is None else unit, target)
    return TraceChannel(name=name, raw=raw, unit=target, factor=factor, offset=offset)


def _stated(unit: str | None) -> str | None:
    return None if unit is None or unit.strip().lower() in _NO_UNIT else unit.strip()


def _check_agreement(column: str, ours: str, theirs: str) -> None:
    """Refuse a layout's unit that is not the one the file itself states."""
    try:
        same = conversion(theirs, ours) == (1.0, 0.0)
    except ValueError:
        try:
            mtconnect_unit(theirs)
        except ValueError:
            return  # the file's word is not a unit we know; the layout decides
        same = False
    if not same:
        raise UnreadableFile(
            f"column {column!r} is in {theirs!r} by the file and in {ours!r} by the layout: "
            "correct the layout"
        )


def check_time_unit(layout: TableLayout, units: dict[str, str]) -> None:
    """Refuse a ``time_unit`` that is not the unit the file itself states for its time column."""
    found = _stated(units.get(layout.time or ""))
    unit = layout.time_unit.removeprefix("unix_")
    if found is not None and unit != "iso":
        _check_agreement(str(layout.time), unit, found)


def _free_without_unit(name: str) -> ValueError:
    near = ", ".join(difflib.get_close_matches(name, COLUMNS)) or "none"
    return ValueError(
        f"signal {name!r} is not in the table of signals (near: {near}): correct its name, or give "
        "its unit ('' for none) to keep it as a channel of its own"
    )


LISTED = 100
"""Lines of one kind that the notes name; the count is always the whole one."""


@dataclass(frozen=True, kw_only=True)
class RawTable:
    """A table as found in a file."""

    columns: dict[str, Cells]
    """Raw name -> cells, for the columns of :func:`columns_to_read`; shape (T,)."""
    lines: Ints
    """Line of the file, or number of the record, of each row; from 1; shape (T,)."""
    units: dict[str, str] = field(default_factory=dict)
    """Raw name -> unit that the file itself states."""
    rejected: list[Rejection] = field(default_factory=list)
    """Rows that did not become cells."""
    left_out: list[str] = field(default_factory=list)
    """Columns of the file that are not read."""
    notes: dict[str, Any] = field(default_factory=dict)
    """Further content of the file (constants beside the channels)."""
    rate: float | None = None
    start: str | None = None
    """Sampling rate [Hz] and first instant that the file itself states."""
    excerpt: Callable[[int], str] | None = None
    """Beginning of the row with a number (from 0) in ``lines``."""


def layout_of(source: RecordSource) -> TableLayout:
    """The source's layout; where it contradicts itself, a ValueError that says what to write."""
    layout = source.table
    if layout is None:
        raise ValueError(f"records {source.files!r} ({source.format}) need a table layout: add one")
    if layout.time_unit not in TIME_UNITS:
        allowed = ", ".join(TIME_UNITS)
        raise ValueError(f"time_unit {layout.time_unit!r} is not one of {allowed}: correct it")
    if layout.rate is not None and not 0 < layout.rate < np.inf:
        raise ValueError(f"rate {layout.rate} Hz of the table's layout is not above 0: correct it")
    if not layout.columns and not layout.rest:
        raise ValueError("the table's layout names no columns: add some, or rest = true")
    for name in ("time", "t"):
        if name in layout.columns:
            raise ValueError(f"{name!r} is the name of the time column, not of a signal: rename it")
    _check_full_scales(source, layout)
    for name in layout.text:
        if name not in layout.columns:
            raise ValueError(f"text names {name!r}, which is no signal of the layout: correct it")
    if layout.start is not None:
        start_of(layout)
    return layout


def _check_full_scales(source: RecordSource, layout: TableLayout) -> None:
    for name, column in layout.columns.items():
        if column.full_scale is None:
            continue
        if source.format != "wav":
            raise ValueError(
                f"full_scale of {name!r} is of a WAV file's counts, the format is "
                f"{source.format}: leave it out"
            )
        if not column.full_scale or not np.isfinite(column.full_scale):
            raise ValueError(
                f"full_scale = {column.full_scale} of {name!r} leaves nothing: correct it"
            )


def columns_to_read(layout: TableLayout, available: Sequence[str]) -> list[str]:
    """Raw names to read, in the file's order; one that is missing makes the file unreadable."""
    named, there = named_columns(layout), set(available)
    missing = [name for name in named if name not in there]
    if missing:
        raise missing_columns(missing, available)
    return [name for name in available if layout.rest or name in named]


def named_columns(layout: TableLayout) -> list[str]:
    """Raw names that the layout itself names."""
    named = [layout.time, layout.date, *(source.column for source in layout.columns.values())]
    return list(dict.fromkeys(name for name in named if name is not None))


def missing_columns(missing: Sequence[str], available: Iterable[str]) -> UnreadableFile:
    """The error for columns that a file lacks."""
    pool = list(available)
    folded = {name.casefold(): name for name in pool}
    near: set[str] = set()
    for name in missing:
        close = difflib.get_close_matches(name.casefold(), folded, n=2, cutoff=0.4)
        near.update(folded[word] for word in close)
    which = ", ".join(repr(name) for name in missing)
    there = ", ".join(repr(n) for n in [n for n in pool if n in near] or pool[:8]) or "none"
    plural = "s" if len(missing) > 1 else ""
    return UnreadableFile(
        f"column{plural} {which} missing; the file has {there}: correct the names in the layout"
    )


def assemble(raw: RawTable, layout: TableLayout) -> Trace:
    """Trace of a raw table: ``time`` [ns UTC] or ``t`` [s], the layout's signals, then the rest."""
    layout = replace(layout, rate=layout.rate or raw.rate, start=layout.start or raw.start)
    reasons: dict[int, str] = {}
    time_field, time = _time(raw, layout, reasons)
    fields, arrays = [time_field], [time]
    channels = named_channels(layout, raw.units)
    for channel in channels:
        fields.append(channel.field)
        arrays.append(_values(channel, raw, layout, reasons))
    taken = {channel.name for channel in channels} | {"time", "t", layout.time, layout.date}
    for channel in rest_channels(layout, raw.columns, raw.units, taken):
        channel, values = _rest(channel, raw, layout)
        fields.append(channel.field)
        arrays.append(values)
    keep = np.ones(len(raw.lines), bool)
    keep[list(reasons)] = False
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields)).filter(pa.array(keep))
    rejected = _rejections(raw, reasons)
    if rejected and not table.num_rows:
        first = rejected[0]
        raise UnreadableFile(
            f"no row of {len(rejected)} can be read, the first at line {first.line}: {first.reason}"
        )
    notes = raw.notes | _notes(table.column(0), raw.lines[keep], raw.left_out)
    if faults := recorder_faults(table):
        notes["faults"] = [asdict(one) for one in faults]
    table = table.replace_schema_metadata({"notes": json.dumps(notes, sort_keys=True)})
    return Trace(table=table, rejected=rejected)


def _time(raw: RawTable, layout: TableLayout, reasons: dict[int, str]) -> tuple[pa.Field, pa.Array]:
    """Field and values of ``time`` or ``t``; adds to ``reasons`` by row."""
    instant = pa.field("time", pa.timestamp("ns", tz="UTC"), metadata={"unit": ""})
    elapsed = pa.field("t", pa.float64(), metadata={"unit": "SECOND"})
    if layout.time is None:
        if layout.rate is None:
            raise ValueError("the table's layout gives neither time nor rate: add one of them")
        earlier = np.sort([r.line for r in raw.rejected if r.line is not None]).astype(np.int64)
        # A rejected row took its sampling period too: those after it keep their time.
        place = np.arange(len(raw.lines)) + np.searchsorted(earlier, raw.lines)
        if layout.start is None:
            return elapsed, pa.array(place / layout.rate, pa.float64())
        time = regular(place, layout.rate, start_of(layout))
        return instant, pa.array(time).cast(instant.type)
    check_time_unit(layout, raw.units)
    cells = one_array(raw.columns[layout.time])
    if layout.date is not None:
        cells = pc.binary_join_element_wise(words(raw.columns[layout.date]), words(cells), " ")
    counts = layout.time_unit in NANOSECONDS and layout.start is None
    if counts and not pa.types.is_timestamp(cells.type):
        values, bad = seconds(cells, layout)
        kind = elapsed
    else:
        time, bad = instants(cells, layout)
        values, kind = pa.array(time).cast(instant.type), instant
    for row in np.flatnonzero(bad):
        wall = str(cells[int(row)].as_py())
        if clocks := clocks_said(wall, layout.time_zone):
            reasons.setdefault(int(row), f"time {layout.time!r} holds {wall!r}, which {clocks}")
    _note_bad(reasons, bad, cells, f"time {layout.time!r} holds {{}}: no {_expected(layout)}")
    return kind, values


def _expected(layout: TableLayout) -> str:
    """Expected form of a time cell, for people, and the setting that may read it."""
    if layout.time_unit != "iso":
        return f"time in {layout.time_unit!r}: correct the layout's time_unit"
    form = f"as {layout.time_format!r}: correct" if layout.time_format else "in ISO 8601: give"
    example = "" if layout.time_format else ", for example '%d.%m.%Y %H:%M:%S'"
    return f"instant of {layout.time_zone} time {form} the layout's time_format{example}"


def _values(
    channel: TraceChannel, raw: RawTable, layout: TableLayout, reasons: dict[int, str]
) -> pa.Array:
    """A signal in its own unit; adds to ``reasons`` by row."""
    cells = one_array(raw.columns[channel.raw])
    if channel.text:
        return words(cells)
    values, bad = numbers(cells, layout.decimal)
    _note_bad(reasons, bad, cells, f"column {channel.raw!r} holds {{}}: no finite number")
    return channel.converted(values)


def _rest(
    channel: TraceChannel, raw: RawTable, layout: TableLayout
) -> tuple[TraceChannel, pa.Array]:
    """A column that the layout does not name: numbers if all are, else words as they stand."""
    cells = one_array(raw.columns[channel.raw])
    if not (pa.types.is_temporal(cells.type) or pa.types.is_nested(cells.type)):
        values, bad = numbers(cells, layout.decimal)
        if not bad.any() or not pa.types.is_string(cells.type):
            return channel, channel.converted(values)
    return replace(channel, text=True, unit=""), words(cells)


def _note_bad(reasons: dict[int, str], bad: Bools, cells: pa.Array, sentence: str) -> None:
    for row in np.flatnonzero(bad):
        value = cells[int(row)].as_py()
        shown = "nothing" if value is None or value == "" else repr(str(value))[:EXCERPT]
        reasons.setdefault(int(row), sentence.replace("{}", shown))


def _rejections(raw: RawTable, reasons: dict[int, str]) -> list[Rejection]:
    ours = [
        Rejection(
            line=int(raw.lines[row]),
            reason=reason,
            excerpt=raw.excerpt(row)[:EXCERPT] if raw.excerpt else "",
        )
        for row, reason in reasons.items()
    ]
    return sorted(raw.rejected + ours, key=lambda rejection: rejection.line or 0)


def _notes(time: pa.ChunkedArray, lines: Ints, left_out: list[str]) -> dict[str, Any]:
    """Notes on the time and the columns left out."""
    notes: dict[str, Any] = {"columns_left_out": left_out} if left_out else {}
    kind = pa.int64() if pa.types.is_timestamp(time.type) else time.type
    steps = np.diff(time.cast(kind).to_numpy())
    for name, rows in (("clock_backwards", steps < 0), ("repeated_stamps", steps == 0)):
        if rows.any():
            found = lines[1:][rows]
            notes[name] = {"count": len(found), "lines": found[:LISTED].tolist()}
    return notes
