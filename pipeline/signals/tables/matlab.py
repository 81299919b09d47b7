"""Recordings in MATLAB's MAT files: level 4 by SciPy, 5 to 7 by our own, 7.3 (HDF5) by h5py."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.signals.records import RecordSource, TableLayout, Trace, UnreadableFile
from pipeline.signals.tables import mat5
from pipeline.signals.tables.arrays import Array, Flat, raw_table
from pipeline.signals.tables.table import RawTable, assemble, layout_of

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a MAT file; a row's line is its number, from 1.

    Parameters
    ----------
    path : Path
        The file.
    source : RecordSource
        With the table's layout; its ``group`` is the name of a struct, or of one in another
        (``run.axes``).  Variables of one number become ``constants`` in the trace's notes.
    root : Path
        Folder of the machine's raw files; tables need nothing else from it.

    Raises
    ------
    UnreadableFile
        When the file is no MAT file, is cut, or lacks a variable.
    ValueError
        When the layout is wrong.
    """
    layout = layout_of(source)
    with path.open("rb") as file:
        head = file.read(1024)
    if not head:
        raise UnreadableFile("the file is empty")
    modern = head[512:520] == _HDF5 or head[:8] == _HDF5
    return assemble(_modern(path, layout) if modern else _classic(path, layout), layout)


def _modern(path: Path, layout: TableLayout) -> RawTable:
    import h5py

    from pipeline.signals.tables import hdf5

    try:
        with h5py.File(path, "r") as file:
            return raw_table(hdf5.blocks(file, layout.group, "."), layout)
    except (OSError, KeyError, RuntimeError) as error:
        raise UnreadableFile(f"the file is no whole MAT file: {str(error)[:200]}") from error


def _classic(path: Path, layout: TableLayout) -> RawTable:
    data = path.read_bytes()
    level_5 = data[126:128] in (b"IM", b"MI")
    found = Flat(group=layout.group, separator=".")
    for name, values in mat5.arrays(data) if level_5 else _level_4(data):
        found.add(name, values.shape, values.dtype, values.view)
    if not found.blocks and found.group is None:
        raise UnreadableFile(
            "the file holds no arrays: save tables and objects of MATLAB as a struct of vectors"
        )
    return raw_table(found.found(), layout)


def _level_4(data: bytes) -> Iterator[tuple[str, Array]]:
    """Arrays of MATLAB before 1996, which is how Simulink's loggers still write."""
    import scipy.io
    from scipy.io.matlab import MatReadError

    try:
        loaded = scipy.io.loadmat(io.BytesIO(data))  # type: ignore[arg-type]
    except (MatReadError, ValueError, TypeError, KeyError, IndexError, OSError, EOFError,
            NotImplementedError, MemoryError, OverflowError) as error:  # fmt: skip
        raise UnreadableFile(f"the file is no whole MAT file: {str(error)[:200]}") from error
    return ((name, value) for name, value in loaded.items() if isinstance(value, np.ndarray))
