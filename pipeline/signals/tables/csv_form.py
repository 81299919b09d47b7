"""The form of a text table: its bytes as UTF-8 lines, its delimiter, header and units."""

import csv
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.signals.records import TableLayout, UnreadableFile
from pipeline.signals.tables.table import asked_for, missing_columns

_MARKS = (
    (b"\xff\xfe\x00\x00", "utf-32"),
    (b"\x00\x00\xfe\xff", "utf-32"),
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)
_HEAD = 4096  # bytes in which a text file holds no zero
_SAMPLE = 200  # lines that tell a delimiter when nothing else does


@dataclass(frozen=True, kw_only=True)
class Form:
    """Where the data of a text table stand and what its columns are called."""

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
        self.ends: NDArray[np.int64] = ends
        self.starts: NDArray[np.int64] = np.concatenate([[0], ends[:-1] + 1])[: len(ends)]

    def __len__(self) -> int:
        """Number of lines."""
        return len(self.ends)

    def __getitem__(self, number: int) -> str:
        """One line."""
        return self.body[self.starts[number] : self.ends[number]].decode()

    def __iter__(self) -> Iterator[str]:
        """All lines."""
        return (self[number] for number in range(len(self)))


def text_of(data: bytes, encoding: str) -> bytes:
    r"""A file's bytes as UTF-8 text with ``\n`` line ends; gzip is unpacked.

    Raises
    ------
    UnreadableFile
        For an empty, binary or cut file, or one in another encoding.
    ValueError
        When ``encoding`` is not the name of an encoding.
    """
    if data.startswith(b"\x1f\x8b"):
        data = _unpacked(data)
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), encoding)
    try:
        text = data.decode(encoding)
    except LookupError as error:
        raise ValueError(f"encoding {encoding!r} is not known: write it as in 'latin-1'") from error
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise UnreadableFile(
            f"byte 0x{data[error.start]:02x} at line {line} is not {encoding}: "
            "name the file's encoding in the layout, for example 'latin-1'"
        ) from error
    if not text.strip():
        raise UnreadableFile("the file is empty")
    if "\0" in text[:_HEAD]:
        raise UnreadableFile("the file is binary, not text (or its encoding is 'utf-16-le')")
    body = text.removeprefix("\ufeff").encode("utf-8", "replace")
    return body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _unpacked(data: bytes) -> bytes:
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(data)
        while unpacker.eof and unpacker.unused_data.startswith(b"\x1f\x8b"):
            rest, unpacker = unpacker.unused_data, zlib.decompressobj(wbits=31)
            text += unpacker.decompress(rest)
    except zlib.error as error:
        raise UnreadableFile(
            f"the gzip stream is damaged ({error}): copy the file again"
        ) from error
    if not unpacker.eof:
        raise UnreadableFile("the gzip stream ends early: copy the file again")
    return text


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
    """Names of columns, told apart: repeated ones as ``name#n``, empty ones as ``#place``."""
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


def form_of(lines: Lines, layout: TableLayout) -> Form:
    """Delimiter, column names, first line of data and units of a text table.

    Raises
    ------
    UnreadableFile
        When no line names the columns that the layout asks for.
    """
    if layout.names:
        first = layout.header or 0
        return Form(
            delimiter=_delimiter_of(lines, first, layout, len(layout.names)),
            names=unique(layout.names),
            first=first,
        )
    number, delimiter = _header(lines, layout)
    names = unique(cells_of(lines[number], delimiter))
    missing = [name for name in asked_for(layout) if name not in names]
    if missing:
        raise missing_columns(missing, names)
    units: dict[str, str] = {}
    first = number + 1
    if layout.units_row and first < len(lines):
        units = dict(zip(names, cells_of(lines[first], delimiter), strict=False))
        first += 1
    names = _as_the_rows(names, lines, first, delimiter)
    return Form(delimiter=delimiter, names=names, first=first, units=units)


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
    """Number of the line with the column names, and the delimiter."""
    asked = asked_for(layout)
    if layout.header is not None and layout.header >= len(lines):
        raise UnreadableFile(
            f"the header is line {layout.header} by the layout, the file has {len(lines)}: "
            "correct the layout"
        )
    if not asked:
        return _plainest(lines, layout)
    only = None if layout.header is None else [layout.header]
    stems = [re.sub(r"#\d+$", "", name) for name in asked]
    best = (0, 0, 0, _delimiters(layout)[0])
    for number in only or range(len(lines)):
        line = lines[number]
        if only is None and not any(stem in line for stem in stems):
            continue
        for delimiter in _delimiters(layout):
            names = unique(cells_of(line, delimiter))
            found = sum(name in names for name in asked)
            if (found, len(names)) > best[:2] and (found or only):
                best = (found, len(names), number, delimiter)
        if best[0] == len(asked):
            break
    if best[0] == 0 and only is None:
        number, delimiter = _plainest(lines, layout)
        raise missing_columns(asked, [n for n in cells_of(lines[number], delimiter) if n])
    return best[2], best[3]


def _plainest(lines: Lines, layout: TableLayout) -> tuple[int, str]:
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
