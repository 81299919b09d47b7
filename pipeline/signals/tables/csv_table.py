"""Tables in text: CSV and its kin, of any header, delimiter, decimal mark and encoding.

Line numbers are the file's own, from 1.  Lines without a quote that stays open go through Arrow's
parser; a file with quoted line ends, or with short rows that are to be filled, goes record by
record.  Both give the same rows.
"""

import csv
import re
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from pipeline.signals.records import (
    EXCERPT,
    RecordSource,
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
)
from pipeline.signals.tables.csv_form import Form, Lines, form_of, text_of
from pipeline.signals.tables.table import RawTable, assemble, layout_of, wanted

_LONGEST_RECORD = 50  # lines; a quote that stays open longer is a stray one
_BLOCK = 1 << 26
_SHAPE = re.compile(r"([.,]\d*)?([eE][-+]?\d*)?\s*$")

Rows = tuple[dict[str, pa.ChunkedArray], NDArray[np.int64], list[Rejection]]


def read(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a text table.

    Parameters
    ----------
    path : Path
        The file; packed with gzip or not.
    source : RecordSource
        With the table's layout.
    root : Path
        Folder of the machine's raw files; tables need nothing else from it.

    Raises
    ------
    UnreadableFile
        When the file as a whole is no such table.
    ValueError
        When the layout is wrong.
    """
    layout = layout_of(source)
    body = text_of(path.read_bytes(), layout.encoding)
    lines = Lines(body)
    form = form_of(lines, layout)
    needed = wanted(layout, form.names)
    columns, numbers, rejected = rows_of(lines, form, needed, layout)
    cut = _cut(lines, form)
    if cut and len(numbers) and numbers[-1] == cut.line:
        columns = {name: cells.slice(0, len(numbers) - 1) for name, cells in columns.items()}
        numbers, rejected = numbers[:-1], [*rejected, cut]
    raw = RawTable(
        columns=dict(columns),
        lines=numbers,
        units=form.units,
        rejected=rejected,
        left_out=[name for name in form.names if name not in columns],
        notes={} if body.endswith(b"\n") else {"last_line_without_end": len(lines)},
        excerpt=lambda row: lines[int(numbers[row]) - 1],
    )
    return assemble(raw, layout)


def rows_of(lines: Lines, form: Form, needed: list[str], layout: TableLayout) -> Rows:
    """Cells of the needed columns as text, the line of each row (from 1), and rejected rows."""
    if form.first >= len(lines):
        empty = {name: pa.chunked_array([pa.array([], pa.string())]) for name in needed}
        return empty, np.empty(0, np.int64), []
    if layout.ragged == "fill" or _open_quotes(lines, form.first):
        return rows_by_record(lines, form, needed, fill=layout.ragged == "fill")
    return rows_by_arrow(lines, form, needed)


def rows_by_arrow(lines: Lines, form: Form, needed: list[str]) -> Rows:
    """As :func:`rows_of` for files whose records are one line each."""
    invalid: list[tuple[int, str, int]] = []

    def skip(row: pyarrow.csv.InvalidRow) -> str:
        invalid.append((row.number, row.text, row.actual_columns))
        return "skip"

    body = pa.py_buffer(lines.body).slice(int(lines.starts[form.first]))
    try:
        table = pyarrow.csv.read_csv(
            pa.BufferReader(body),
            read_options=pyarrow.csv.ReadOptions(
                column_names=form.names, use_threads=False, block_size=_BLOCK
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=form.delimiter, ignore_empty_lines=False, invalid_row_handler=skip
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(needed, pa.string()),
                include_columns=needed,
                strings_can_be_null=False,
            ),
        )
    except pa.ArrowInvalid as error:
        raise UnreadableFile(f"the table cannot be split into cells: {error}") from error
    count = len(lines) - form.first
    here = np.ones(count, bool)
    here[[number - 1 for number, _, _ in invalid]] = False
    numbers = form.first + 1 + np.flatnonzero(here)
    rejected = [
        _ragged(form.first + number, text, width, form)
        for number, text, width in invalid
        if text.strip()
    ]
    columns = {name: table.column(name) for name in needed}
    if len(form.names) == 1:
        return columns, numbers, rejected
    blank = lines.starts[numbers - 1] == lines.ends[numbers - 1]
    keep = pa.array(~blank)
    return {n: c.filter(keep) for n, c in columns.items()}, numbers[~blank], rejected


def rows_by_record(lines: Lines, form: Form, needed: list[str], fill: bool) -> Rows:
    """As :func:`rows_of`, one record after the other; a quoted cell may go over several lines."""
    places = [form.names.index(name) for name in needed]
    cells: list[list[str]] = [[] for _ in needed]
    numbers: list[int] = []
    rejected: list[Rejection] = []
    number = form.first
    while number < len(lines):
        line, width = lines[number], len(form.names)
        row, used = _record(lines, number, form.delimiter)
        number += used
        if row is None:
            reason = "a quote is not closed, or is followed by text"
            rejected.append(Rejection(line=number, reason=reason, excerpt=line[:EXCERPT]))
        elif not line.strip() and width > 1:
            continue
        elif len(row) > width or (len(row) < width and not fill):
            rejected.append(_ragged(number - used + 1, line, len(row), form))
        else:
            row += [""] * (width - len(row))
            numbers.append(number - used + 1)
            for column, place in zip(cells, places, strict=True):
                column.append(row[place])
    columns = {
        name: pa.chunked_array([pa.array(column, pa.string())])
        for name, column in zip(needed, cells, strict=True)
    }
    return columns, np.array(numbers, np.int64), rejected


def _record(lines: Lines, number: int, delimiter: str) -> tuple[list[str] | None, int]:
    """Cells of the record that begins at a line, None when it is malformed; and its lines."""
    line = lines[number]
    if '"' not in line:
        return line.split(delimiter), 1
    ahead = range(number, min(number + _LONGEST_RECORD, len(lines)))
    reader = csv.reader((lines[k] + "\n" for k in ahead), delimiter=delimiter, strict=True)
    try:
        row = next(islice(reader, 1), [])
    except csv.Error:
        return None, 1
    return row, max(reader.line_num, 1)


def _open_quotes(lines: Lines, first: int) -> bool:
    """Whether some line holds an odd number of quotes."""
    body = np.frombuffer(lines.body, np.uint8)
    quotes = np.flatnonzero(body == ord('"'))
    counts = np.searchsorted(quotes, lines.ends) - np.searchsorted(quotes, lines.starts)
    return bool((counts[first:] % 2).any())


def _ragged(line: int, text: str, width: int, form: Form) -> Rejection:
    reason = f"the row has {width} cells, the table has {len(form.names)} columns"
    return Rejection(line=line, reason=reason, excerpt=text[:EXCERPT])


def _cut(lines: Lines, form: Form) -> Rejection | None:
    """The last line, when it has no end and its last number lacks digits that all others have."""
    last = len(lines) - 1
    others = range(max(form.first, last - 1000), last)
    if lines.body.endswith(b"\n") or len(others) < 2:
        return None
    shapes = {_shape(lines[k], form) for k in others if lines[k].strip()}
    if len(shapes) != 1 or _shape(lines[last], form) in shapes:
        return None
    reason = "the file ends inside this row: its last number is shorter than those above it"
    return Rejection(line=last + 1, reason=reason, excerpt=lines[last][:EXCERPT])


def _shape(line: str, form: Form) -> tuple[int, int]:
    """How many characters of decimals and of an exponent end a line."""
    match = _SHAPE.search(line.rsplit(form.delimiter, 1)[-1])
    return (len(match[1] or ""), len(match[2] or "")) if match else (0, 0)
