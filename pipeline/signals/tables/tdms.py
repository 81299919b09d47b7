"""Recordings in TDMS, the format of NI's data loggers; needs the extra ``tdms``."""

import struct
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.signals.records import (
    RecordSource,
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
)
from pipeline.signals.tables.arrays import Array, Flat, raw_table
from pipeline.signals.tables.table import RawTable, assemble, layout_of

_SINCE_1904 = 2_082_844_800  # seconds from the format's zero, which stands for "not set", to 1970


def read(path: Path, source: RecordSource, root: Path) -> Trace:
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
        raise UnreadableFile("TDMS needs the package npTDMS: pip install kerf[tdms]") from error
    if not path.stat().st_size:
        raise UnreadableFile("the file is empty")
    try:
        file = TdmsFile.read(path, raw_timestamps=True)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OSError, EOFError,
            OverflowError, MemoryError, NotImplementedError, struct.error) as error:  # fmt: skip
        raise UnreadableFile(f"the file is no whole TDMS file: {str(error)[:200]}") from error
    return assemble(_raw(file, layout), layout)


def _raw(file: Any, layout: TableLayout) -> RawTable:
    found = Flat(group=layout.group, separator="/")
    rates: set[float] = set()
    starts: set[str] = set()
    for group in file.groups():
        for channel in group.channels():
            facts = channel.properties
            values = channel[:]
            values = values.as_datetime64("ns") if hasattr(values, "as_datetime64") else values
            values = np.asarray(values)
            found.add(f"{group.name}/{channel.name}", values.shape, values.dtype,
                      partial(_values, values), facts.get("unit_string"))  # fmt: skip
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


def _values(values: Array) -> Array:
    return values
