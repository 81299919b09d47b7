"""Layouts of tables, and what a trace holds, for all tests of tables."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.signals.formats import ColumnSource, Format, RecordSource, TableLayout, Trace

Columns = Mapping[str, tuple[str, str | None]]
"""Signal -> its column in the file and its unit."""


def layout(columns: Columns, **options: Any) -> TableLayout:
    sources = {name: ColumnSource(column=c, unit=u) for name, (c, u) in columns.items()}
    return TableLayout(columns=sources, **options)


def trace_of(read: Callable[..., Trace], path: Path, form: TableLayout, kind: Format) -> Trace:
    """Trace of a file in a layout; what was read is what was kept and what was rejected."""
    return read(path, RecordSource(format=kind, files="*", table=form), path.parent)


def values(result: Trace, name: str) -> list[Any]:
    return result.table.column(name).to_pylist()


def nanoseconds(result: Trace) -> list[int]:
    return result.table.column("time").cast(pa.int64()).to_pylist()


def notes(result: Trace) -> dict[str, Any]:
    return json.loads(result.table.schema.metadata[b"notes"])
