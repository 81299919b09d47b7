"""Tables in Parquet."""

from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline.signals.records import RecordSource, Trace, UnreadableFile
from pipeline.signals.tables.table import RawTable, asked_for, assemble, layout_of, wanted


def read(path: Path, source: RecordSource, root: Path) -> Trace:
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
            needed = wanted(layout, schema.names if set(asked_for(layout)) - set(flat) else flat)
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
