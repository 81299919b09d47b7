"""Parts of a recorded table by the values of some columns, as recordings of their own.

A part is called ``<file>#<column>=<value>,…`` in section ``roles`` of the machine's file, and has
the hash of its own samples.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Floats

PART = "#"
"""Separator of the name of a raw file and that of a part of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TablePart:
    """Rows of a table in which some columns hold the same values."""

    values: Mapping[str, str]
    """Column -> its value, as a word."""
    rows: Bools
    """Rows of the table; shape (T,)."""

    def name(self, file: str) -> str:
        """Name of the part of the raw file ``file``."""
        named = ",".join(f"{key}={value}" for key, value in self.values.items())
        return f"{file}{PART}{named}"


def selection(name: str) -> tuple[str, dict[str, str]]:
    """Raw file of a recording or of a part of one, and the column values that select the part.

    >>> selection("cuts.csv#tool=T3,cut=1 (part 2)")
    ('cuts.csv', {'tool': 'T3', 'cut': '1'})
    >>> selection("trace #1.csv")
    ('trace #1.csv', {})
    """
    file, _, part = name.partition(PART)
    words = [one.partition("=") for one in part.partition(" (part ")[0].split(",")]
    values = {column: value for column, sign, value in words if sign}
    return (file, values) if values else (name, {})


def share_rows(one: str, other: str) -> bool:
    """Whether two recordings, or parts of them, may hold the same rows of one file."""
    (file, values), (another, others) = selection(one), selection(other)
    same = all(others[column] == value for column, value in values.items() if column in others)
    return file == another and same


def parts_of(path: Path, columns: Sequence[str], section: str) -> list[TablePart]:
    """Parts of an ingested table by the values of ``columns``, in the order of their first rows."""
    names = pq.read_schema(path).names
    for name in columns:
        if name not in names:
            raise ValueError(f"it has no column {name!r}, which {section} names: correct it")
    table = pq.read_table(path, columns=list(columns))
    words = [as_words(table[name]) for name in columns]
    joined = np.array(["\x1f".join(row) for row in zip(*words, strict=True)])
    kinds, first = np.unique(joined, return_index=True)
    return [
        TablePart(
            values=dict(zip(columns, kinds[k].split("\x1f"), strict=True)), rows=joined == kinds[k]
        )
        for k in np.argsort(first).tolist()
    ]


def as_words(column: pa.ChunkedArray) -> list[str]:
    """Values of a column as words; whole numbers without a fraction, ``""`` for none."""
    return [
        "" if value is None
        else f"{value:g}" if isinstance(value, float) and abs(value) < 1e6
        else f"{value:.0f}" if isinstance(value, float) and value == int(value)
        else str(value)
        for value in column.to_pylist()
    ]  # fmt: skip


def samples_sha256(named: Iterable[tuple[str, Floats]]) -> str:
    """SHA-256 of named channels: a copy has the same, whatever its file is called."""
    digest = sha256()
    for name, values in named:
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    return digest.hexdigest()
