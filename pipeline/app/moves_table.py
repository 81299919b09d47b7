"""Moves of a program as a table, and as CSV of any length."""

import lzma
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from pipeline.app.programs import PACKED
from pipeline.gcode.errors import NO_BLOCK
from pipeline.gcode.moves import AXES, Kind, Moves
from pipeline.schema.files import replacing

ROWS_AT_ONCE = 50_000
"""Rows that are held in memory as a table: a program of 50 MB has two million."""
G_CODES = [f"G{number}" for number in range(100)]


def moves_table(moves: Moves) -> pa.Table:
    """One row a move, in mm and degree, in the machine's frame; what is not known is null."""
    table: dict[str, Any] = {
        "block": moves.line,
        "type": _named([kind.name.lower() for kind in Kind], moves.kind),
    }
    for i, axis in enumerate(AXES):
        table[f"{axis.lower()}_{'mm' if i < 3 else 'deg'}"] = moves.end[:, i]
    for i, axis in enumerate("xyz"):
        table[f"centre_{axis}_mm"] = moves.centre[:, i]
    table |= {
        "angle_deg": np.degrees(moves.angle),
        "plane": _named(G_CODES, moves.plane),
        "feed": moves.feed,
        "feed_mode": _named(G_CODES, moves.feed_mode),
        "speed": moves.speed * np.where(moves.direction == 0, 0, 1),
        "tool": moves.tool,
        "length_mm": moves.length,
        "dwell_s": _dwell(moves),
        "frame": _named([frame.name for frame in moves.frames], moves.frame),
        "file": _named([Path(file).name for file in moves.files], moves.file),
    }
    return pa.table(
        {
            name: column if isinstance(column, pa.Array) else _column(column)
            for name, column in table.items()
        }
    )


def _dwell(moves: Moves) -> NDArray[np.float64]:
    """Time that each row waits [s]; NaN where none does, or the spindle that counts it stands."""
    waits = moves.kind == Kind.DWELL
    in_turns = waits & (moves.code == 1)
    speed = np.where(moves.speed > 0, moves.speed, np.nan)
    seconds = np.where(in_turns, moves.value * 60 / speed, moves.value)
    return np.where(waits, seconds, np.nan)


def _named(names: Sequence[str], numbers: NDArray[np.integer]) -> pa.Array:
    words = [name.encode() for name in names]
    ends = np.cumsum([0, *map(len, words)], dtype=np.int32)
    table = pa.StringArray.from_buffers(
        len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(words))
    )
    numbered = pa.DictionaryArray.from_arrays(_column(numbers.astype(np.int32)), table)
    return numbered.dictionary_decode()


def _column(values: NDArray[np.generic]) -> pa.Array:
    """An array with null for NaN, from its bytes: ``pa.array`` of an array imports pandas."""
    values, known = np.ascontiguousarray(values), None
    if values.dtype.kind == "f":
        known = pa.py_buffer(np.packbits(~np.isnan(values), bitorder="little"))
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [known, pa.py_buffer(values)])


def write_moves(parts: Iterable[Moves], out: Path) -> tuple[int, float, tuple[str, ...]]:
    """Write moves as CSV, a row a move, packed by the ending (``.gz``).

    ``parts`` are consecutive moves of one program; each is written before the next one is made.
    Returned are the number of moves, the length of their path [mm], and notices to the user.
    """
    count, length = 0, 0.0
    notices: tuple[str, ...] = ()
    with replacing(out) as part, _opened(part, PACKED.get(out.suffix)) as file:
        for moves in parts:
            for first in range(0, max(len(moves), 1), ROWS_AT_ONCE):
                part_of = moves.part(first, first + ROWS_AT_ONCE)
                options = csv.WriteOptions(include_header=count == 0, quoting_style="needed")
                csv.write_csv(moves_table(part_of), file, options)
                count += len(part_of)
                length += float(part_of.length.sum())
            notices = moves.notices
        if count == 0:
            raise ValueError(NO_BLOCK.format(", ".join(moves.files)))
    return count, length, notices


def _opened(part: Path, packing: str | None) -> Any:
    if packing == "xz":
        return lzma.open(part, "wb")
    return pa.output_stream(part, compression=packing)
