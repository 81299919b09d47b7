"""Recordings in HDF5: datasets of a group, columns of a matrix or fields of a compound dataset."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.signals.records import RecordSource, Trace, UnreadableFile
from pipeline.signals.tables.arrays import Array, Block, Flat, raw_table
from pipeline.signals.tables.table import assemble, layout_of


def read(path: Path, source: RecordSource, root: Path) -> Trace:
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
            raw = raw_table(blocks(file, layout.group, "/"), layout)
    except (OSError, KeyError, RuntimeError) as error:
        raise UnreadableFile(f"the file is no whole HDF5 file: {str(error)[:200]}") from error
    return assemble(raw, layout)


def blocks(file: Any, group: str | None, separator: str) -> list[Block]:
    """All arrays of an open HDF5 file, their names joined with a separator."""
    found = Flat(group=group, separator=separator)
    try:
        for name, data in _datasets(file):
            _add(found, name.replace("/", separator), data)
    except (ValueError, TypeError) as error:  # a damaged type or shape
        raise UnreadableFile(f"the file is damaged: {str(error)[:200]}") from error
    return found.found()


def _add(found: Flat, label: str, data: Any) -> None:
    if data.dtype.names:
        for part in data.dtype.names:
            load = partial(_values, data, part)
            found.add(f"{label}{found.separator}{part}", data.shape, data.dtype[part], load)
    elif data.shape is not None:
        found.add(label, data.shape, data.dtype, partial(_values, data, ()), _unit(data))


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


def _values(data: Any, part: Any) -> Array:
    """A dataset's values, or those of one field."""
    try:
        return data[part]
    except (ValueError, TypeError) as error:
        raise UnreadableFile(f"{data.name!r} is damaged: {str(error)[:200]}") from error
