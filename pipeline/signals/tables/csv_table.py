"""Tables in text: CSV and its kin, of any header, delimiter, decimal mark and encoding.

Lines without an open quote go through Arrow's parser; a file with quoted line ends, or with short
rows that are to be filled, goes record by record with the same result.
"""

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from pipeline.schema.arrays import Ints
from pipeline.signals.formats import (
    EXCERPT,
    GZIP_MAGIC,
    RecordSource,
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
    foreign,
    gunzip,
)
from pipeline.signals.tables.table import (
    RawTable,
    assemble,
    columns_to_read,
    layout_of,
    missing_columns,
    named_columns,
)

_MARKS = (
    (b"\xff\xfe\x00\x00", "utf-32"),
    (b"\x00\x00\xfe\xff", "utf-32"),
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)
_HEAD = 4096  # bytes in which a text file holds no zero
_SAMPLE = 200  # lines that tell a delimiter when nothing else does
_CUT_SAMPLE = 1000  # rows that tell the decimals of each column


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """Place of the data of a text table, and names of its columns."""

    delimiter: str
    names: list[str]
    first: int
    units: dict[str, str] = field(default_factory=dict)


class Lines:
    """Lines of a text, by number from 0, without their ends."""

    def __init__(self, body: bytes) -> None:
        self.body = body
        ends = np.flatnonzero(np.frombuffer(body, np.uint8) == ord("\n")).astype(np.int64)
        if len(body) and not body.endswith(b"\n"):
            ends = np.append(ends, len(body))
        self.ends: Ints = ends
        self.starts: Ints = np.concatenate([[0], ends[:-1] + 1])[: len(ends)]

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, number: int) -> str:
        return self.body[self.starts[number] : self.ends[number]].decode()

    def __iter__(self) -> Iterator[str]:
        return (self[number] for number in range(len(self)))


def text_of(data: bytes, encoding: str) -> tuple[bytes, str]:
    r"""A file's bytes as UTF-8 text with ``\n`` line ends, and the damage of a gzip stream.

    The whole lines before the damage are kept.
    """
    damage: list[str] = []
    if data.startswith(GZIP_MAGIC):
        data = b"".join(gunzip(iter([data]), _BLOCK, damage.append))
    if kind := foreign(data):
        raise UnreadableFile(f"the file is {kind}")
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), encoding)
    try:
        text = data.decode(encoding, "ignore" if damage else "strict")
    except LookupError as error:
        raise ValueError(f"encoding {encoding!r} is not known: write it as in 'latin-1'") from error
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UnreadableFile(
            f"byte 0x{data[error.start]:02x} at line {line} is not {encoding}: "
            "name the file's encoding in the layout, for example 'latin-1'"
        ) from error
    if damage and not (text := text[: text.rfind("\n") + 1]):
        raise UnreadableFile(damage[0])
    if not text.strip():
        raise UnreadableFile("the file is empty")
    if "\0" in text[:_HEAD]:
        raise UnreadableFile("the file is binary, not text (or its encoding is 'utf-16-le')")
    body = text.removeprefix("\ufeff").encode("utf-8", "replace")
    return body.replace(b"\r\n", b"\n").replace(b"\r", b"\n"), "".join(damage)


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of one line, without the blanks around them."""
    if '"' in line:
        try:
            row = next(csv.reader([line], delimiter=delimiter), [])
        except csv.Error:
            return []
        return [cell.strip() for cell in row]
    return [cell.strip() for cell in line.split(delimiter)]


def unique(names: Sequence[str]) -> list[str]:
    """Names of columns, made unique: repeated ones as ``name#n``, empty ones as ``#place``."""
    count = Counter(names)
    seen: Counter[str] = Counter()
    result: dict[str, None] = {}
    for place, name in enumerate(names, 1):
        seen[name] += 1
        label = f"#{place}" if not name else name if count[name] == 1 else f"{name}#{seen[name]}"
        while label in result:
            label += "'"
        result[label] = None
    return list(result)


def dialect_of(lines: Lines, layout: TableLayout) -> Dialect:
    """Delimiter, column names, first line of data and units of a text table."""
    if layout.names:
        first = layout.header or 0
        return Dialect(
            delimiter=_delimiter_of(lines, first, layout, len(layout.names)),
            names=unique(layout.names),
            first=first,
        )
    number, delimiter = _header(lines, layout)
    names = unique(cells_of(lines[number], delimiter))
    missing = [name for name in named_columns(layout) if name not in names]
    if missing:
        raise missing_columns(missing, names)
    units: dict[str, str] = {}
    first = number + 1
    if layout.units_row and first < len(lines):
        units = dict(zip(names, cells_of(lines[first], delimiter), strict=False))
        first += 1
    names = _as_the_rows(names, lines, first, delimiter)
    return Dialect(delimiter=delimiter, names=names, first=first, units=units)


def _as_the_rows(names: list[str], lines: Lines, first: int, delimiter: str) -> list[str]:
    """Names for as many cells as the rows have, where a delimiter ends header or rows only."""
    row = next((lines[k] for k in range(first, len(lines)) if lines[k].strip()), "")
    cells = cells_of(row, delimiter)
    if len(cells) == len(names) + 1 and not cells[-1]:
        return unique([*names, ""])
    if len(cells) == len(names) - 1 and names[-1] == f"#{len(names)}":
        return names[:-1]
    return names


def _delimiters(layout: TableLayout) -> list[str]:
    if layout.delimiter != "auto":
        if len(layout.delimiter) != 1:
            raise ValueError(
                f"delimiter {layout.delimiter!r} of the table's layout is not one character: "
                "write it as in ';' or 'auto'"
            )
        return [layout.delimiter]
    return [mark for mark in ",;\t|" if mark != layout.decimal]


def _header(lines: Lines, layout: TableLayout) -> tuple[int, str]:
    named = named_columns(layout)
    if layout.header is not None and layout.header >= len(lines):
        raise UnreadableFile(
            f"the header is line {layout.header} by the layout, the file has {len(lines)}: "
            "correct the layout"
        )
    if not named:
        return _usual_header(lines, layout)
    only = None if layout.header is None else [layout.header]
    stems = [re.sub(r"#\d+$", "", name) for name in named]
    best = (0, 0, 0, _delimiters(layout)[0])
    for number in only or range(len(lines)):
        line = lines[number]
        if only is None and not any(stem in line for stem in stems):
            continue
        for delimiter in _delimiters(layout):
            names = unique(cells_of(line, delimiter))
            found = sum(name in names for name in named)
            if (found, len(names)) > best[:2] and (found or only):
                best = (found, len(names), number, delimiter)
        if best[0] == len(named):
            break
    if best[0] == 0 and only is None:
        number, delimiter = _usual_header(lines, layout)
        raise missing_columns(named, [n for n in cells_of(lines[number], delimiter) if n])
    return best[2], best[3]


def _usual_header(lines: Lines, layout: TableLayout) -> tuple[int, str]:
    """The first line with as many cells as most lines have, for a layout that names no column."""
    delimiter = _delimiter_of(lines, layout.header or 0, layout, 0)
    if layout.header is not None:
        return layout.header, delimiter
    counts = [len(cells_of(lines[k], delimiter)) for k in range(min(len(lines), 10 * _SAMPLE))]
    usual = Counter(counts).most_common(1)[0][0]
    return counts.index(usual), delimiter


def _delimiter_of(lines: Lines, first: int, layout: TableLayout, width: int) -> str:
    """The delimiter that gives most lines the wanted width, or the most cells."""
    sample = [lines[k] for k in range(first, min(len(lines), first + _SAMPLE))]

    def score(delimiter: str) -> tuple[int, int]:
        counts = [len(cells_of(line, delimiter)) for line in sample]
        return sum(count == width for count in counts), sum(counts)

    return max(_delimiters(layout), key=score)


_LONGEST_RECORD = 50  # lines; a quote that stays open longer is a stray one
_BLOCK = 1 << 26
_SHAPE = re.compile(r"([.,]\d*)?([eE][-+]?\d*)?\s*$")

CellRows = tuple[dict[str, pa.ChunkedArray], Ints, list[Rejection]]


def read(path: Path, source: RecordSource, root: Path) -> Trace:
    """Trace of a text table, packed with gzip or not."""
    layout = layout_of(source)
    body, damage = text_of(path.read_bytes(), layout.encoding)
    lines, dialect = _laid_out(body, layout)
    needed = columns_to_read(layout, dialect.names)
    columns, numbers, rejected = rows_of(lines, dialect, needed, layout)
    broken = _broken(lines, dialect, numbers, rejected, layout.decimal)
    if cut := _cut(lines, dialect):
        broken[len(lines)] = cut
    if damage:
        rejected = [*rejected, Rejection(line=len(lines) + 1, reason=damage)]
    if broken:
        keep = ~np.isin(numbers, list(broken))
        rejected = [*rejected, *(broken[int(number)] for number in numbers[~keep])]
        columns = {name: cells.filter(pa.array(keep)) for name, cells in columns.items()}
        numbers = numbers[keep]
    raw = RawTable(
        columns=dict(columns),
        lines=numbers,
        units=dialect.units,
        rejected=rejected,
        left_out=[name for name in dialect.names if name not in columns],
        notes={} if body.endswith(b"\n") else {"last_line_without_end": len(lines)},
        excerpt=lambda row: lines[int(numbers[row]) - 1],
    )
    return assemble(raw, layout)


def _laid_out(body: bytes, layout: TableLayout) -> tuple[Lines, Dialect]:
    """Lines and dialect of a table; columns in blanks, as Fortran writes them, become tabs."""
    if layout.delimiter == " ":
        return _in_blanks(body, layout)
    lines = Lines(body)
    try:
        dialect = dialect_of(lines, layout)
    except UnreadableFile:
        with suppress(UnreadableFile):
            if layout.delimiter == "auto":
                return _in_blanks(body, layout)
        raise
    if layout.delimiter == "auto" and len(dialect.names) == 1:
        with suppress(UnreadableFile):
            return _in_blanks(body, layout)
    return lines, dialect


def _in_blanks(body: bytes, layout: TableLayout) -> tuple[Lines, Dialect]:
    """Lines and dialect of a table whose columns stand in blanks; a name may hold single ones."""
    bare = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", body)
    for gap in (rb"[ \t]+", rb"[ \t]{2,}"):
        lines = Lines(re.sub(gap, b"\t", bare))
        with suppress(UnreadableFile):
            dialect = dialect_of(lines, replace(layout, delimiter="\t"))
            row = lines[dialect.first] if dialect.first < len(lines) else ""
            if len(dialect.names) == len(cells_of(row, "\t")) > 1:
                return lines, dialect
    raise UnreadableFile("no line of names has as many words as the rows: give the layout's names")


def rows_of(lines: Lines, dialect: Dialect, needed: list[str], layout: TableLayout) -> CellRows:
    """Cells of the needed columns as text, the line of each row (from 1), and rejected rows."""
    if dialect.first >= len(lines):
        empty = {name: pa.chunked_array([pa.array([], pa.string())]) for name in needed}
        return empty, np.empty(0, np.int64), []
    if layout.ragged == "fill" or _open_quotes(lines, dialect.first):
        return rows_by_record(lines, dialect, needed, fill=layout.ragged == "fill")
    return rows_by_arrow(lines, dialect, needed)


def rows_by_arrow(lines: Lines, dialect: Dialect, needed: list[str]) -> CellRows:
    """Rows as :func:`rows_of` gives them, for files whose records are one line each."""
    invalid: list[tuple[int, str, int]] = []

    def skip(row: pyarrow.csv.InvalidRow) -> str:
        invalid.append((row.number, row.text, row.actual_columns))
        return "skip"

    body = pa.py_buffer(lines.body).slice(int(lines.starts[dialect.first]))
    try:
        table = pyarrow.csv.read_csv(
            pa.BufferReader(body),
            read_options=pyarrow.csv.ReadOptions(
                column_names=dialect.names, use_threads=False, block_size=_BLOCK
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=dialect.delimiter, ignore_empty_lines=False, invalid_row_handler=skip
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(needed, pa.string()),
                include_columns=needed,
                strings_can_be_null=False,
            ),
        )
    except pa.ArrowInvalid as error:
        raise UnreadableFile(f"the table cannot be split into cells: {error}") from error
    count = len(lines) - dialect.first
    here = np.ones(count, bool)
    here[[number - 1 for number, _, _ in invalid]] = False
    numbers = dialect.first + 1 + np.flatnonzero(here)
    rejected = [
        _ragged(dialect.first + number, text, width, dialect)
        for number, text, width in invalid
        if text.strip()
    ]
    columns = {name: table.column(name) for name in needed}
    if len(dialect.names) == 1:
        return columns, numbers, rejected
    blank = lines.starts[numbers - 1] == lines.ends[numbers - 1]
    keep = pa.array(~blank)
    return {n: c.filter(keep) for n, c in columns.items()}, numbers[~blank], rejected


def rows_by_record(lines: Lines, dialect: Dialect, needed: list[str], fill: bool) -> CellRows:
    """Rows, one record after the other; a quoted cell may go over several lines."""
    places = [dialect.names.index(name) for name in needed]
    cells: list[list[str]] = [[] for _ in needed]
    numbers: list[int] = []
    rejected: list[Rejection] = []
    number = dialect.first
    while number < len(lines):
        line, width = lines[number], len(dialect.names)
        row, used = _record(lines, number, dialect.delimiter)
        number += used
        if row is None:
            reason = "a quote is not closed, or is followed by text"
            rejected.append(Rejection(line=number, reason=reason, excerpt=line[:EXCERPT]))
        elif not line.strip() and width > 1:
            continue
        elif len(row) > width or (len(row) < width and not fill):
            rejected.append(_ragged(number - used + 1, line, len(row), dialect))
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
    body = np.frombuffer(lines.body, np.uint8)
    quotes = np.flatnonzero(body == ord('"'))
    counts = np.searchsorted(quotes, lines.ends) - np.searchsorted(quotes, lines.starts)
    return bool((counts[first:] % 2).any())


def _ragged(line: int, text: str, width: int, dialect: Dialect) -> Rejection:
    reason = f"the row has {width} cells, the table has {len(dialect.names)} columns"
    if width < len(dialect.names):
        reason += ": set ragged: fill in the layout where the last cells may be missing"
    return Rejection(line=line, reason=reason, excerpt=text[:EXCERPT])


def _cut(lines: Lines, dialect: Dialect) -> Rejection | None:
    """The last line, when it has no end and its last number lacks digits that all others have."""
    last = len(lines) - 1
    others = range(max(dialect.first, last - 1000), last)
    if lines.body.endswith(b"\n") or len(others) < 2:
        return None
    shapes = {_shape(lines[k], dialect) for k in others if lines[k].strip()}
    if len(shapes) != 1 or _shape(lines[last], dialect) in shapes:
        return None
    reason = "the file ends inside this row: its last number is shorter than those above it"
    return Rejection(line=last + 1, reason=reason, excerpt=lines[last][:EXCERPT])


def _shape(line: str, dialect: Dialect) -> tuple[int, int]:
    """Numbers of characters of decimals and of an exponent at the end of a line."""
    match = _SHAPE.search(line.rsplit(dialect.delimiter, 1)[-1])
    return (len(match[1] or ""), len(match[2] or "")) if match else (0, 0)


_FIXED_CELLS = 60
"""Cells with one count of decimals that show a writer of fixed decimals; of one that leaves zeros
away each tenth cell is shorter."""
_DIGITS = re.compile(r"(?<![^\s,;|])[-+]?\d+([.,]\d*)?$")
_RARE = 0.01
"""Share of rows that may be broken; more are the writer's habit [1]."""


def _broken(
    lines: Lines, dialect: Dialect, numbers: Ints, rejected: Sequence[Rejection], mark: str
) -> dict[int, Rejection]:
    """Rows by line whose record was cut: a last number without its digits, or in two lines."""
    sample = [lines[int(k) - 1] for k in numbers[:: 1 + len(numbers) // _CUT_SAMPLE]]
    rows = [cells_of(line, dialect.delimiter) for line in sample]
    width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
    fixed = _fixed(rows, dialect)
    if not any(fixed):  # any number may be a whole one
        return {}
    short = _shortened(lines, dialect, numbers, fixed, width, mark)
    ragged = [r.line for r in rejected if r.line and _DIGITS.search(r.excerpt)]
    ends = [n for n in (*short, *ragged) if len(cells_of(lines[n - 1], dialect.delimiter)) < width]
    found = dict.fromkeys(short, "its last number is shorter than all others of its column")
    if len(ends) <= max(2, _RARE * len(numbers)):
        for number in ends:
            pair = [cells_of(lines[k], dialect.delimiter)
                    for k in range(number - 1, min(number + 1, len(lines)))]  # fmt: skip
            if sum(map(len, pair)) in (width, width + 1):
                found[number + 1] = f"its record began in line {number}"
    return {number: Rejection(line=number, reason=f"the row is broken: {why}",
                              excerpt=lines[number - 1][:EXCERPT])
            for number, why in found.items() if number <= len(lines)}  # fmt: skip


def _fixed(rows: list[list[str]], dialect: Dialect) -> list[tuple[int, int] | None]:
    """Form of the numbers of each column, None where they have no fixed decimals."""
    shapes = [Counter(_shape(row[k], dialect) for row in rows if k < len(row))
              for k in range(len(dialect.names))]  # fmt: skip
    usual = [of.most_common(1)[0] if of else ((0, 0), 0) for of in shapes]
    fixed = [shape if shape[0] > 1 and of.total() - n <= max(2, _RARE * of.total()) else None
             for (shape, n), of in zip(usual, shapes, strict=True)]  # fmt: skip
    cells = sum(n for (_, n), shape in zip(usual, fixed, strict=True) if shape)
    return fixed if cells >= _FIXED_CELLS else [None] * len(fixed)


def _shortened(
    lines: Lines, dialect: Dialect, numbers: Ints, fixed: Sequence[tuple[int, int] | None],
    width: int, mark: str,
) -> list[int]:  # fmt: skip
    """Lines of rows whose last number has fewer digits than a column of fixed decimals has."""
    form = fixed[width - 1] if width else None
    if not form:
        return []
    body = np.frombuffer(lines.body, np.uint8)
    place = np.clip(lines.ends[numbers - 1] - sum(form), 0, len(body) - 1)
    odd = numbers[body[place] != ord(mark)].tolist()
    if len(odd) > max(2, _RARE * len(numbers)):
        return []
    short = []
    for number in odd:
        row = cells_of(lines[number - 1], dialect.delimiter)
        own = fixed[len(row) - 1] if row else None
        if own and _DIGITS.match(row[-1]) and sum(_shape(row[-1], dialect)) < sum(own):
            short.append(number)
    return short
