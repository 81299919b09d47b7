"""Raw tables from named arrays: HDF5, and MATLAB's MAT files of level 4, 5 and 7.3.

The longer axis of an array is time.  Arrays of one number are constants, not channels.  HDF5 gives
datasets of a group, columns of a matrix or fields of a compound dataset; version 7.3 of MAT is
HDF5.  SciPy reads level 4.  Level 5 (versions 5, 6 and 7; The MathWorks) has a reader of its own
for vectors, matrices, text, cells and structs, because SciPy's ends the process when a file is
damaged.  Sparse arrays, functions and objects (tables, datetimes) are left out.
"""

import io
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.signals.formats import RecordSource, TableLayout, Trace, UnreadableFile
from pipeline.signals.tables.table import (
    RawTable,
    assemble,
    columns_to_read,
    layout_of,
    named_columns,
)

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
        if prod(block.shape) == 1 and block.kind in "biuf"
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


_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
          13: "u8", 16: "u1", 17: "u2", 18: "u4"}  # fmt: skip
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8",
            15: "u8"}  # fmt: skip
_CODINGS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR = 1, 2, 4
_COMPLEX = 0x0800
_DEEPEST = 20


@dataclass(frozen=True)
class _Element:
    kind: int
    data: memoryview


def level_5_arrays(data: bytes) -> Iterator[tuple[str, Array]]:
    """Arrays of a workspace by name, structs taken apart (``run.axes.t``)."""
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise _damaged("it has no header of a MAT file")
    order = "<" if data[126:128] == b"IM" else ">"
    for element in _elements(memoryview(data)[128:], order):
        if element.kind == _COMPRESSED:
            inner = list(_elements(memoryview(_inflated(element.data)), order))
            if len(inner) != 1:
                raise _damaged("a compressed variable is not one array")
            element = inner[0]
        if element.kind == _MATRIX:
            yield from _matrix(element.data, order, "", 0)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    position = 0
    while position < len(data):
        element, position = _element(data, position, order)
        yield element


def _element(data: memoryview, position: int, order: str) -> tuple[_Element, int]:
    """The element at a position, and the position after it and its padding."""
    if position + 8 > len(data):
        raise _damaged("it ends inside a variable")
    first, size = (int(word) for word in np.frombuffer(data[position : position + 8], f"{order}u4"))
    if first >> 16:  # small: type and size share a word, the value is in the next
        kind, size, start, end = first & 0xFFFF, first >> 16, position + 4, position + 8
        if size > 4:
            raise _damaged(f"a small value claims {size} bytes")
    else:
        kind, start = first, position + 8
        end = start + size + (0 if kind == _COMPRESSED else -size % 8)
        if start + size > len(data):
            raise _damaged(f"it ends inside a variable of {size} bytes")
    return _Element(kind, data[start : start + size]), end


def _inflated(data: memoryview) -> bytes:
    try:
        return zlib.decompress(data)
    except zlib.error as error:
        raise _damaged(str(error)) from error


def _matrix(data: memoryview, order: str, prefix: str, depth: int) -> Iterator[tuple[str, Array]]:
    """Arrays in an array: itself, or what a struct holds."""
    if not len(data):
        return
    parts = _elements(data, order)
    flags = _numbers(next(parts, None), order)
    sides = [int(side) for side in _numbers(next(parts, None), order)]
    label = bytes(_numbers(next(parts, None), order).astype(np.uint8)).decode("latin-1")
    name = f"{prefix}.{label}" if prefix and label else prefix or label
    if not len(flags) or len(sides) < 2 or min(sides) < 0 or depth > _DEEPEST:
        raise _damaged("an array has no class or no sides")
    kind, count = int(flags[0]) & 0xFF, 1
    for side in sides:
        count *= side
    if kind in _CLASSES:
        yield name, _numeric(parts, order, sides, count, kind, bool(int(flags[0]) & _COMPLEX))
    elif kind == _CHAR:
        yield name, np.array([_text(next(parts, None), order)])
    elif kind == _CELL:
        words = _cell(parts, order, count, depth)
        if words is not None:
            yield name, np.array(words, dtype=str).reshape(sides, order="F")
    elif kind == _STRUCT and count == 1:
        yield from _struct(parts, order, name, depth)


def _numeric(
    parts: Iterator[_Element], order: str, sides: list[int], count: int, kind: int, two: bool
) -> Array:
    values = []
    for _ in range(1 + two):
        found = _numbers(next(parts, None), order)
        if len(found) != count:
            raise _damaged(f"an array of {count} numbers holds {len(found)}")
        with np.errstate(over="ignore"):  # becomes infinite, which a table rejects
            values.append(found.astype(_CLASSES[kind]))
    flat = values[0] + 1j * values[1] if two else values[0]
    return flat.reshape(sides, order="F")


def _cell(parts: Iterator[_Element], order: str, count: int, depth: int) -> list[str] | None:
    """Words of a cell array; None when it holds anything else."""
    words = []
    for part in parts:
        inner = [value for _, value in _matrix(part.data, order, "", depth + 1)]
        if len(inner) == 1 and inner[0].dtype.kind == "U" and inner[0].size == 1:
            words.append(str(inner[0].reshape(-1)[0]))
    return words if len(words) == count else None


def _struct(
    parts: Iterator[_Element], order: str, name: str, depth: int
) -> Iterator[tuple[str, Array]]:
    width = _numbers(next(parts, None), order)
    text = bytes(_numbers(next(parts, None), order).astype(np.uint8))
    if len(width) != 1 or width[0] < 1 or len(text) % int(width[0]):
        raise _damaged("a struct has no names of fields")
    step = int(width[0])
    for start in range(0, len(text), step):
        field = text[start : start + step].split(b"\0")[0].decode("latin-1")
        part = next(parts, None)
        if part is None or part.kind != _MATRIX:
            raise _damaged(f"the field {field!r} of a struct is missing")
        yield from _matrix(part.data, order, f"{name}.{field}", depth + 1)


def _numbers(element: _Element | None, order: str) -> Array:
    if element is None or element.kind not in _TYPES:
        raise _damaged("an array lacks a part, or has one of an unknown type")
    dtype = np.dtype(order + _TYPES[element.kind])
    if len(element.data) % dtype.itemsize:
        raise _damaged(f"a part of {len(element.data)} bytes is no row of {dtype.itemsize} bytes")
    return np.frombuffer(element.data, dtype)


def _text(element: _Element | None, order: str) -> str:
    if element is not None and element.kind in _CODINGS:
        coding = _CODINGS[element.kind]
        ending = "" if coding == "utf-8" else "-le" if order == "<" else "-be"
        return bytes(element.data).decode(coding + ending, "replace")
    codes = _numbers(element, order)
    return "".join(chr(int(code)) if 0 <= code < 0x110000 else "\ufffd" for code in codes)


def _damaged(why: str) -> UnreadableFile:
    return UnreadableFile(f"the file is no whole MAT file: {why}; save or copy it again")


def read_hdf5(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of an HDF5 file; a row's line is its number, from 1.

    The layout's ``group`` is a group or a compound dataset, columns are paths below it.
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
    collector = ArrayCollector(group=group, separator=separator)
    try:
        for name, data in _datasets(file):
            _add(collector, name.replace("/", separator), data)
    except (ValueError, TypeError) as error:  # a damaged type or shape
        raise UnreadableFile(f"the file is damaged: {str(error)[:200]}") from error
    return collector.named_arrays()


def _add(collector: ArrayCollector, label: str, data: Any) -> None:
    if data.dtype.names:
        for part in data.dtype.names:
            load = partial(_dataset_values, data, part)
            collector.add(f"{label}{collector.separator}{part}", data.shape, data.dtype[part], load)
    elif data.shape is not None:
        collector.add(
            label, data.shape, data.dtype, partial(_dataset_values, data, ()), _unit(data)
        )


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


_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_mat(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a MAT file; a row's line is its number, from 1.

    The layout's ``group`` is a struct, or one in another (``run.axes``); single numbers are notes.
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

    try:
        with h5py.File(path, "r") as file:
            return raw_table(named_arrays(file, layout.group, "."), layout)
    except (OSError, KeyError, RuntimeError) as error:
        raise UnreadableFile(f"the file is no whole MAT file: {str(error)[:200]}") from error


def _classic(path: Path, layout: TableLayout) -> RawTable:
    data = path.read_bytes()
    level_5 = data[126:128] in (b"IM", b"MI")
    collector = ArrayCollector(group=layout.group, separator=".")
    for name, values in level_5_arrays(data) if level_5 else _level_4(data):
        collector.add(name, values.shape, values.dtype, values.view)
    if not collector.arrays and collector.group is None:
        raise UnreadableFile(
            "the file holds no arrays: save tables and objects of MATLAB as a struct of vectors"
        )
    return raw_table(collector.named_arrays(), layout)


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
