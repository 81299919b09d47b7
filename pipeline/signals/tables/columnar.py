"""Recordings in columnar files: Parquet; WAV; TDMS, the format of NI's data loggers.

TDMS needs the extra ``tdms``.
"""

import struct
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.signals.formats import RecordSource, Rejection, TableLayout, Trace, UnreadableFile
from pipeline.signals.tables.arrays import (
    Array,
    ArrayCollector,
    in_group,
    raw_table,
)
from pipeline.signals.tables.cells import NANOSECONDS
from pipeline.signals.tables.table import (
    RawTable,
    assemble,
    columns_to_read,
    known_signal,
    layout_of,
    named_columns,
)


def read_parquet(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a Parquet file; a row's line is its number from 1, its unit in the metadata."""
    import pyarrow.parquet as pq

    layout = layout_of(source)
    if not path.stat().st_size:
        raise UnreadableFile("the file is empty")
    try:
        with pq.ParquetFile(path) as file:
            schema = file.schema_arrow
            flat = [f.name for f in schema if not pa.types.is_nested(f.type)]
            nested = set(named_columns(layout)) - set(flat)  # refused with the names there are
            needed = columns_to_read(layout, schema.names if nested else flat)
            table = file.read(columns=needed)
        table.validate(full=True)  # a damaged page may pass the reader and hold no text
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise UnreadableFile(
            f"the file is no whole Parquet file: {str(error).partition(chr(10))[0][:200]}"
        ) from error
    if table.num_columns != len(needed):
        raise UnreadableFile("columns have one name twice, or hold lists: write a flat table")
    units = {f.name: f.metadata[b"unit"].decode("utf-8", "replace")
             for f in schema if f.metadata and b"unit" in f.metadata}  # fmt: skip
    raw = RawTable(
        columns={name: table.column(name) for name in needed},
        lines=np.arange(1, table.num_rows + 1),
        units=units,
        left_out=[name for name in schema.names if name not in needed],
    )
    return assemble(raw, layout)


def read_wav(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a WAV file; a row's line is the number of its sample, from 1.

    Channels are ``#1``, ``#2``; shares of full scale become a quantity by ``full_scale``.
    """
    import warnings

    from scipy.io import wavfile

    layout = layout_of(source)
    try:
        _check_whole(path)
        with warnings.catch_warnings():  # chunks of notes and marks, which are not read
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            rate, data = wavfile.read(path)
    except (ValueError, OSError, EOFError, struct.error) as error:
        raise UnreadableFile(f"the file is no whole WAV file: {str(error)[:200]}") from error
    table = data.reshape(len(data), -1)
    shares = table if table.dtype.kind == "f" else _of_full_scale(table)
    collector = ArrayCollector(group=None, separator="/")
    for place in range(table.shape[1]):
        name = f"#{place + 1}"
        values = shares[:, place] * _full_scale(name, layout, table.dtype.kind != "f")
        collector.add(name, values.shape, values.dtype, values.view)
    return assemble(raw_table(collector.named_arrays(), layout, rate=float(rate)), layout)


def _check_whole(path: Path) -> None:
    """Refuse a file that ends before its samples do, as its header counts them."""
    total = path.stat().st_size
    with path.open("rb") as file:
        file.seek(12)
        while len(head := file.read(8)) == 8:
            name, size = struct.unpack("<4sI", head)
            if name == b"data" and (missing := file.tell() + size - total) > 0:
                raise ValueError(f"it ends {missing} of {size} bytes of samples early")
            file.seek(size + size % 2, 1)


def _of_full_scale(counts: Array) -> Array:
    """Counts as shares of full scale; 24 bits stand in the upper ones of 32, 8 bits from 128 on."""
    if counts.dtype == np.uint8:
        return (counts.astype(float) - 128) / 128
    return counts / (float(np.iinfo(counts.dtype).max) + 1)


def _full_scale(name: str, layout: TableLayout, counts: bool) -> float:
    """Value at full scale of a channel, in its unit."""
    for signal, column in layout.columns.items():
        if column.column != name:
            continue
        if column.full_scale is not None:
            return column.full_scale
        known = known_signal(signal)
        if counts and (column.unit or (known is not None and known.unit)):
            raise UnreadableFile(
                f"channel {name!r} holds counts: give full_scale, its value at full scale, beside "
                f"the unit of {signal!r} in the layout"
            )
    return 1.0


_SINCE_1904 = 2_082_844_800  # seconds from the format's zero, which stands for "not set", to 1970


def read_tdms(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a TDMS file; a row's line is its number, from 1.

    The layout's ``group`` is the group of the channels, else columns are ``group/channel``.
    Without ``time`` and ``rate`` the channels' own ``wf_increment`` and ``wf_start_time`` count.
    """
    layout = layout_of(source)
    try:
        from nptdms import TdmsFile
    except ImportError as error:
        raise UnreadableFile("TDMS needs the package npTDMS: pip install -e '.[tdms]'") from error
    if not path.stat().st_size:
        raise UnreadableFile("the file is empty")
    try:
        file = TdmsFile.read(path, raw_timestamps=True)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OSError, EOFError,
            OverflowError, MemoryError, NotImplementedError, struct.error) as error:  # fmt: skip
        raise UnreadableFile(f"the file is no whole TDMS file: {str(error)[:200]}") from error
    return assemble(_raw(file, layout), layout)


def _raw(file: Any, layout: TableLayout) -> RawTable:
    channels = {f"{group.name}/{one.name}": one for group in file.groups()
                for one in group.channels()}  # fmt: skip
    named = set(named_columns(layout))
    short = {label: in_group(label, layout.group, "/") for label in channels}
    rates: set[float] = set()
    starts: dict[str, int | None] = {}
    for label, channel in channels.items():
        if short[label] is None:
            continue
        if layout.time is None:
            rates |= _rate(label, channel.properties)
        if layout.rest or short[label] in named:
            _check_scales(label, (channel.properties, file[channel.group_name].properties,
                                  file.properties))  # fmt: skip
            starts[label] = _start(channel.properties)
    if layout.rate is None and len(rates) > 1:
        raise UnreadableFile(
            f"channels are sampled at {sorted(rates)} Hz: give the group of one rate in the layout"
        )
    rate = next(iter(rates), None)
    values = {at: _samples(at, one) for at, one in channels.items() if short[at] is not None}
    placed = _side_by_side({one: values[one] for one in starts}, starts, layout, rate)
    collector = ArrayCollector(group=layout.group, separator="/")
    for label, array in (values | placed).items():
        unit = channels[label].properties.get("unit_string")
        collector.add(label, array.shape, array.dtype, array.view, unit)
    dated = [at for at in starts.values() if at is not None and at > _DATED]
    start = f"{np.datetime64(min(dated), 'ns')}Z" if dated and layout.time is None else None
    raw = raw_table(collector.named_arrays(), layout, rate=rate, start=start)
    if not file.file_status.incomplete_final_segment:
        return raw
    reason = "the file ends inside its last segment: the samples from here on are lost"
    return replace(raw, rejected=[Rejection(line=len(raw.lines) + 1, reason=reason)])


def _samples(label: str, channel: Any) -> Array:
    try:
        values = channel[:]
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise UnreadableFile(f"channel {label!r} cannot be scaled: {error!r:.200}") from error
    return np.asarray(values.as_datetime64("ns") if hasattr(values, "as_datetime64") else values)


_SCALES = frozenset(["Polynomial", "Linear", "RTD", "Strain", "Table", "Thermistor",
                     "Thermocouple", "Add", "Subtract", "AdvancedAPI"])  # fmt: skip
"""Scales that npTDMS applies; it leaves the values of others as they are."""


def _check_scales(label: str, properties: tuple[Any, ...]) -> None:
    """Refuse a channel whose scale, its own or its group's or the file's, would not be applied."""
    for facts in properties:
        kinds = {str(v) for k, v in facts.items() if k.endswith("_Scale_Type")} - _SCALES
        if kinds and facts.get("NI_Scaling_Status") != "scaled":
            raise UnreadableFile(
                f"channel {label!r} has the scale {sorted(kinds)[0]!r}, which is not read: write "
                "the file with its scaled values"
            )


def _rate(label: str, facts: Any) -> set[float]:
    """Sampling rate [Hz] that a channel states, if it does."""
    increment, unit = facts.get("wf_increment"), facts.get("wf_xunit_string") or "s"
    if not isinstance(increment, int | float) or increment <= 0:
        return set()
    if unit not in NANOSECONDS:
        raise UnreadableFile(
            f"channel {label!r} is a waveform over {unit!r}, not over time: name another channel"
        )
    period = increment * NANOSECONDS[unit] / 10**9
    return {float(f"{1 / period:.12g}")}  # 1/0.0001 s is 10000 Hz, without float dust


_DATED = -_SINCE_1904 * 10**9 // 2
"""Starts above are dates [ns since 1970], those below offsets from the format's zero."""


def _start(facts: Any) -> int | None:
    """Time of a channel's first sample [ns since 1970], from 1904 without a date; None without."""
    start, offset = facts.get("wf_start_time"), facts.get("wf_start_offset")
    if start is None and not offset:
        return None
    # 2^-64 s are a fraction of a nanosecond: rounded once, together with the offset.
    nano = round(Fraction(start.second_fractions, 2**64) * 10**9) if start else 0
    seconds = start.seconds if start and start.seconds > _SINCE_1904 else 0
    if not seconds and not offset:
        return None
    return (seconds - _SINCE_1904) * 10**9 + nano + round(Fraction(offset or 0.0) * 10**9)


def _side_by_side(
    values: dict[str, Array], starts: dict[str, int | None], layout: TableLayout, rate: float | None
) -> dict[str, Array]:
    """Channels from the earliest start to the latest end, with nothing where one has no sample.

    A start between two samples of the earliest channel counts as at the nearer one.
    """
    rate = layout.rate or rate
    known = {label: at for label, at in starts.items() if at is not None}
    first, last = (f(known, key=known.__getitem__, default="") for f in (min, max))
    span = (known[last] - known[first]) / 1e9 if known else 0.0
    if not span or (rate and round(span * rate) == 0):
        return {}
    apart = f"channels {first!r} and {last!r} begin {span:g} s apart"
    if layout.time is not None:
        raise UnreadableFile(f"{apart}, and the layout names one time for both: leave time out")
    if rate is None:
        raise UnreadableFile(f"{apart} and state no wf_increment: give the layout's rate")
    if len(known) < len(starts):
        silent = next(label for label in starts if label not in known)
        raise UnreadableFile(f"{apart}, and {silent!r} states no start: leave it out of the layout")
    at = {label: round((known[label] - known[first]) / 1e9 * rate) for label in known}
    ends = {label: at[label] + len(values[label]) for label in known}
    if min(ends.values()) <= max(at.values()):
        raise UnreadableFile(f"{apart} and have no time in common: write a file for each")
    total = max(ends.values())
    return {label: _padded(values[label], at[label], total) for label in known}


def _padded(values: Array, before: int, total: int) -> Array:
    """Values from place ``before`` on, nothing (NaN, NaT, an empty word) elsewhere."""
    kind = values.dtype.kind
    dtype = float if kind in "biu" else object if kind in "SUO" else values.dtype
    whole = np.full(total, "" if dtype is object else "NaT" if kind in "Mm" else np.nan, dtype)
    whole[before : before + len(values)] = values
    return whole
