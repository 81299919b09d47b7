"""Raw tables from named arrays, as MATLAB, HDF5 and TDMS files hold them.

The longer axis of an array is time.  Arrays of one number are constants, not channels.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.signals.formats import TableLayout, UnreadableFile
from pipeline.signals.tables.table import RawTable, columns_to_read, named_columns

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class NamedArray:
    """An array in a file: ``load`` reads its values, of ``shape``; ``kind`` is NumPy's letter."""

    name: str
    shape: tuple[int, ...]
    kind: str
    load: Callable[[], Array]
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Column:
    block: NamedArray
    place: int | None
    length: int


def in_group(name: str, group: str | None, separator: str) -> str | None:
    """``name`` without the layout's group before it; None when it is not in the group."""
    if not group:
        return name
    prefix = group.strip(separator) + separator
    return name.removeprefix(prefix) if name.startswith(prefix) else None


def raw_table(
    named_arrays: Sequence[NamedArray],
    layout: TableLayout,
    rate: float | None = None,
    start: str | None = None,
) -> RawTable:
    """Raw table of the arrays of a file's group that belong together, or UnreadableFile.

    ``rate`` [Hz] and ``start``: sampling rate and first instant that the file itself states.
    """
    columns = {}
    for block in named_arrays:
        columns.update(_columns(block))
    length = _length(columns, named_columns(layout))
    fitting = [name for name, column in columns.items() if column.length == length]
    named = set(named_columns(layout))
    known = list(columns) if named - set(fitting) else fitting
    needed = columns_to_read(layout, known)
    loaded: dict[str, Array] = {}
    cells = {name: _cells(name, columns[name], loaded) for name in needed}
    constants = {
        block.name: float(np.ravel(block.load())[0].real)
        for block in named_arrays
        if _size(block.shape) == 1 and block.kind in "biuf"
    }
    return RawTable(
        columns=cells,
        lines=np.arange(1, length + 1),
        units={n: c.block.unit for n, c in columns.items() if c.block.unit is not None},
        left_out=[name for name in columns if name not in needed],
        notes={"constants": constants} if constants else {},
        rate=rate,
        start=start,
    )


def _size(shape: tuple[int, ...]) -> int:
    return int(np.prod(shape, dtype=object)) if shape else 1


def _columns(block: NamedArray) -> dict[str, _Column]:
    """A block's columns by name: itself, or ``name[0]``, ``name[1]`` of a matrix."""
    sides = [side for side in block.shape if side != 1]
    if block.kind not in "biufMmSUO" or len(sides) not in (1, 2):
        return {}
    if len(sides) == 1:
        return {block.name: _Column(block=block, place=None, length=sides[0])}
    return {
        f"{block.name}[{place}]": _Column(block=block, place=place, length=max(sides))
        for place in range(min(sides))
    }


def _length(columns: dict[str, _Column], named: list[str]) -> int:
    lengths = {name: columns[name].length for name in named if name in columns}
    if not lengths:
        return Counter(c.length for c in columns.values()).most_common(1)[0][0] if columns else 0
    first, *others = lengths
    for name in others:
        if lengths[name] != lengths[first]:
            raise UnreadableFile(
                f"{first!r} has {lengths[first]} samples and {name!r} has {lengths[name]}: "
                "read channels of different rates with one layout each"
            )
    return lengths[first]


def _cells(name: str, column: _Column, loaded: dict[str, Array]) -> pa.Array:
    block = column.block
    if block.name not in loaded:
        loaded[block.name] = np.squeeze(block.load())
    values = loaded[block.name]
    if column.place is not None:
        values = values[:, column.place] if len(values) == column.length else values[column.place]
    return _arrow(name, values)


def _arrow(name: str, values: Array) -> pa.Array:
    """An array for Arrow; text from bytes and from MATLAB's cells of text."""
    if values.dtype.kind in "SO":
        words = [_word(cell) for cell in values.tolist()]
        if any(word is None for word in words):
            raise UnreadableFile(f"{name!r} holds cells that are neither numbers nor text")
        return pa.array(words, pa.string())
    if values.dtype.kind == "U":
        return pa.array(values.tolist(), pa.string())
    if values.dtype.kind in "Mm":
        return pa.array(values.astype(f"{values.dtype.kind}8[ns]"))
    return pa.array(np.ascontiguousarray(values.astype(values.dtype.newbyteorder("="))))


def _word(cell: object) -> str | None:
    if isinstance(cell, np.ndarray):
        cell = cell.item() if cell.size == 1 else "" if cell.size == 0 else None
    if isinstance(cell, bytes):
        return cell.decode("utf-8", "replace")
    return str(cell) if isinstance(cell, str | int | float) else None


@dataclass
class ArrayCollector:
    """Blocks gathered while a file's tree is walked, under the layout's group."""

    group: str | None
    separator: str
    arrays: list[NamedArray] = field(default_factory=list)

    def add(self, name: str, shape: tuple[int, ...], dtype: Any, load: Callable[[], Array],
            unit: str | None = None) -> None:  # fmt: skip
        """Take an array when it is in the group."""
        short = in_group(name, self.group, self.separator)
        if short is not None:
            kind = np.dtype(dtype).kind
            self.arrays.append(NamedArray(name=short, shape=shape, kind=kind, load=load, unit=unit))

    def named_arrays(self) -> list[NamedArray]:
        """The arrays that were added; a group that holds none makes the file unreadable."""
        if not self.arrays:
            where = f"group {self.group!r}" if self.group else "the file"
            raise UnreadableFile(f"{where} holds no arrays: correct the group in the layout")
        return self.arrays
