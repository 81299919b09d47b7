"""Recordings in columnar files: Parquet; HDF5; TDMS, the format of NI's data loggers.

HDF5 gives datasets of a group, columns of a matrix or fields of a compound dataset.  TDMS needs the
extra ``tdms``.
"""

import struct
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.signals.formats import RecordSource, Rejection, TableLayout, Trace, UnreadableFile
from pipeline.signals.tables.arrays import Array, ArrayCollector, NamedArray, raw_table
from pipeline.signals.tables.table import (
    RawTable,
    assemble,
    columns_to_read,
    layout_of,
    named_columns,
)


def read_parquet(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a Parquet file; a row's line is its number, from 1.

    Parameters
    ----------
    path : Path
        The file.
    source : RecordSource
        With the table's layout.  A field's metadata ``unit`` counts as stated by the file.
    root : Path
        Folder of the machine's raw files; tables need nothing else from it.

    Raises
    ------
    UnreadableFile
        When the file is no Parquet, is cut, or lacks a column.
    ValueError
        When the layout is wrong.
    """
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
        raise UnreadableFile(f"the file is no whole Parquet file: {_first(error)}") from error
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


def _first(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0][:200]


def read_hdf5(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of an HDF5 file; a row's line is its number, from 1.

    Parameters
    ----------
    path : Path
        The file.
    source : RecordSource
        With the table's layout; its ``group`` is the path of a group or of a compound dataset,
        columns are paths below it.  An attribute ``unit`` or ``units`` counts as stated by the
        file.
    root : Path
        Folder of the machine's raw files; tables need nothing else from it.

    Raises
    ------
    UnreadableFile
        When the file is no HDF5, is cut, or lacks a column.
    ValueError
        When the layout is wrong.
    """
    import h5py

    layout = layout_of(source)
    try:
        with h5py.File(path, "r") as file:
            raw = raw_table(named_arrays(file, layout.group, "/"), layout)
    except (OSError, KeyError, RuntimeError) as error:
        raise UnreadableFile(f"the file is no whole HDF5 file: {str(error)[:200]}") from error
    return assemble(raw, layout)


def named_arrays(file: Any, group: str | None, separator: str) -> list[NamedArray]:
    """All arrays of an open HDF5 file, their names joined with a separator."""
    found = ArrayCollector(group=group, separator=separator)
    try:
        for name, data in _datasets(file):
            _add(found, name.replace("/", separator), data)
    except (ValueError, TypeError) as error:  # a damaged type or shape
        raise UnreadableFile(f"the file is damaged: {str(error)[:200]}") from error
    return found.found()


def _add(found: ArrayCollector, label: str, data: Any) -> None:
    if data.dtype.names:
        for part in data.dtype.names:
            load = partial(_dataset_values, data, part)
            found.add(f"{label}{found.separator}{part}", data.shape, data.dtype[part], load)
    elif data.shape is not None:
        found.add(label, data.shape, data.dtype, partial(_dataset_values, data, ()), _unit(data))


def _datasets(file: Any) -> Iterator[tuple[str, Any]]:
    import h5py

    names: list[str] = []
    file.visit(names.append)
    for name in names:
        item = file[name]
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            yield name, item


def _unit(data: Any) -> str | None:
    for key in ("unit", "units", "Unit", "Units"):
        if key in data.attrs:
            value = data.attrs[key]
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return None


def _dataset_values(data: Any, part: Any) -> Array:
    """A dataset's values, or those of one field."""
    try:
        return data[part]
    except (ValueError, TypeError) as error:
        raise UnreadableFile(f"{data.name!r} is damaged: {str(error)[:200]}") from error


_SINCE_1904 = 2_082_844_800  # seconds from the format's zero, which stands for "not set", to 1970


def read_tdms(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a TDMS file; a row's line is its number, from 1.

    Parameters
    ----------
    path : Path
        The file.
    source : RecordSource
        With the table's layout; its ``group`` is the group of the channels, else columns are
        ``group/channel``.  Without ``time`` and ``rate`` the channels' own ``wf_increment`` and
        ``wf_start_time`` count; ``unit_string`` counts as the unit stated by the file.
    root : Path
        Folder of the machine's raw files; tables need nothing else from it.

    Raises
    ------
    UnreadableFile
        When npTDMS is not installed, or the file is no TDMS, is cut, or lacks a channel.
    ValueError
        When the layout is wrong.
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
    found = ArrayCollector(group=layout.group, separator="/")
    rates: set[float] = set()
    starts: set[str] = set()
    for group in file.groups():
        for channel in group.channels():
            facts = channel.properties
            values = channel[:]
            values = values.as_datetime64("ns") if hasattr(values, "as_datetime64") else values
            values = np.asarray(values)
            found.add(f"{group.name}/{channel.name}", values.shape, values.dtype,
                      values.view, facts.get("unit_string"))  # fmt: skip
            if layout.time is None and layout.group in (None, group.name):
                _sampling(facts, rates, starts)
    if layout.rate is None and len(rates) > 1:
        raise UnreadableFile(
            f"channels are sampled at {sorted(rates)} Hz: give the group of one rate in the layout"
        )
    raw = raw_table(
        found.found(),
        layout,
        rate=next(iter(rates), None),
        start=min(starts) if starts else None,
    )
    if not file.file_status.incomplete_final_segment:
        return raw
    reason = "the file ends inside its last segment: the samples from here on are lost"
    return replace(raw, rejected=[Rejection(line=len(raw.lines) + 1, reason=reason)])


def _sampling(facts: Any, rates: set[float], starts: set[str]) -> None:
    increment = facts.get("wf_increment")
    if isinstance(increment, float) and increment > 0:
        rates.add(float(f"{1 / increment:.12g}"))  # 1/0.0001 s is 10000 Hz, without float dust
    start = facts.get("wf_start_time")
    if start is not None and start.seconds > _SINCE_1904:
        # 2^-64 s are a fraction of a nanosecond: rounded once, together with the offset.
        nano = round(Fraction(start.second_fractions, 2**64) * 10**9)
        nano += round(Fraction(facts.get("wf_start_offset", 0.0)) * 10**9)
        instant = np.datetime64(start.seconds - _SINCE_1904, "s").astype("M8[ns]")
        starts.add(f"{instant + np.timedelta64(nano, 'ns')}Z")
