"""Formats of records: their declaration in a machine's file, reader types, and their detection.

Formats are recognised by the first bytes of a file; gzip is unpacked up to where it is damaged.
"""

import codecs
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.signals.columns import KINDS, OBSERVATIONS

Format = Literal[
    "shdr", "mtconnect_xml", "mtconnect_json", "csv", "parquet", "matlab", "hdf5", "tdms", "wav",
    "program",
]  # fmt: skip

EXCERPT = 200
"""Characters of a rejected record that are kept."""


class UnreadableFile(ValueError):  # noqa: N818 - a state of the file, not a fault of ours
    """A whole file that cannot be read; the message says why in one sentence, without the path."""


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """One record that was not kept: ``line`` counts from 1, None for the whole file."""

    line: int | None
    reason: str
    excerpt: str = ""


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Observations of one part of a file, by ``read`` records.

    One record (a ``key|value`` pair, an element, a row) may give several rows.
    """

    observations: pa.Table
    read: int
    rejected: list[Rejection] = field(default_factory=list)

    @property
    def kept(self) -> int:
        """Records that were kept."""
        return self.read - len(self.rejected)


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Recording in wide form: ``table`` has ``time`` [ns UTC] or ``t`` [s] and channels.

    Each channel's field carries its unit as metadata.
    """

    table: pa.Table
    rejected: list[Rejection] = field(default_factory=list)

    @property
    def kept(self) -> int:
        """Rows that were kept."""
        return int(self.table.num_rows)


@dataclass(frozen=True, kw_only=True)
class ColumnSource:
    """Column of a signal in a file, its unit, and ``full_scale`` of a WAV (negative: reversed)."""

    column: str
    unit: str | None = None
    full_scale: float | None = None


@dataclass(frozen=True, kw_only=True)
class TableLayout:
    """Layout of a table."""

    columns: dict[str, ColumnSource] = field(default_factory=dict)
    """Signal -> the column it is found in.  A signal of ``columns.COLUMNS``, or any other name with
    a unit (``""`` for none), which becomes a channel of its own; a name that ends with a known
    signal (``turret_spindle_speed``, ``x_position_ref``) takes that signal's unit. Of columns with
    one name the n-th is called ``name#n``; a column without a name ``#n``; of a matrix of MATLAB or
    HDF5 the columns are ``name[0]``, ``name[1]``; the channels of a WAV file are ``#1``, ``#2``."""
    text: tuple[str, ...] = ()
    """Names among the signals, not in ``columns.COLUMNS``, that hold words."""
    rest: bool = False
    """Whether columns that are not named above are kept too, under the file's own names."""
    time: str | None = None
    """Name of the time column; None with ``rate`` for tables that have none."""
    date: str | None = None
    """Column of the date when ``time`` holds the time of day alone."""
    time_format: str | None = None
    """Form of ``"iso"`` times that are written otherwise, as in ``strptime`` (``"%m/%d/%Y
    %H:%M:%S:%f"``; ``%f`` down to nanoseconds)."""
    time_unit: str = "s"
    """``"iso"`` for date and time in words, else a unit of time since the start (``"s"``, ``"ms"``,
    ``"us"``, ``"ns"``, ``"min"``, ``"h"``) or since 1970 (``"unix_s"``, ``"unix_ms"``,
    ``"unix_us"``, ``"unix_ns"``).  Columns of type timestamp need none."""
    time_zone: str = "UTC"
    """Zone of ISO times that name none."""
    start: str | None = None
    """ISO date and time of the first sample when ``time`` counts from the start."""
    rate: float | None = None
    """Sampling rate [Hz] of a table without a time column."""
    delimiter: str = "auto"
    decimal: str = "."
    encoding: str = "utf-8"
    """Form of text tables; delimiter ``"auto"`` finds it."""
    header: int | None = None
    """Line of the column names, counting from 0; None finds it."""
    names: tuple[str, ...] = ()
    """Column names of a table without a header line; ``header`` is then its first line of data."""
    ragged: Literal["reject", "fill"] = "reject"
    """Rows with fewer cells than columns: rejected, or the missing cells are null."""
    units_row: bool = False
    """Whether the line after the names holds units."""
    group: str | None = None
    """Group or variable in which an HDF5, TDMS or MATLAB file holds the channels."""


@dataclass(frozen=True, kw_only=True)
class RecordSource:
    """One kind of record of a machine, as named in its file in ``conf/machine/``."""

    format: Format
    """Format, and so the reader; part programs (``program``) are read where they are used."""
    files: str
    """Glob under ``data/raw/<machine>/``."""
    devices: str | None = None
    """The agent's Devices document under ``data/raw/<machine>/``, for kinds and units."""
    device: str | None = None
    """Device of that document (name, uuid or id); None when it has only one."""
    values: Literal["units", "native"] = "units"
    """Whether the numbers of a log are in the document's ``units`` (written by an agent) or
    ``nativeUnits`` (written by an adapter)."""
    table: TableLayout | None = None
    """Layout of tables."""


def observations_of(columns: Mapping[str, Sequence[Any]], rows: int) -> pa.Table:
    """Table of observations from values column by column; what is left out is null."""
    arrays = []
    for one in OBSERVATIONS:
        values = columns.get(one.name, [None] * rows)
        if one.name == "kind":
            arrays.append(encoded(np.array([KINDS.index(v) for v in values], np.int32), KINDS))
        elif pa.types.is_dictionary(one.type):
            arrays.append(pa.array(values, pa.string()).dictionary_encode())
        else:
            arrays.append(pa.array(values, one.type))
    return pa.table(arrays, schema=OBSERVATIONS)


def encoded(codes: NDArray[np.integer], words: Sequence[str] | pa.Array) -> pa.DictionaryArray:
    """Words by their number; null where it is negative."""
    codes = codes.astype(np.int32, copy=False)
    absent = codes < 0
    indices = pa.array(codes, mask=absent) if absent.any() else pa.array(codes)
    return pa.DictionaryArray.from_arrays(indices, pa.array(words, pa.string()))


GZIP_MAGIC = b"\x1f\x8b"
"""The first bytes of a gzip stream."""
GZIP_ENDS = "the gzip stream is"
"""Beginning of the reason why a packed file ends early."""


def gunzip(raw: Iterator[bytes], chunk: int, damaged: Callable[[str], None]) -> Iterator[bytes]:
    """Unpack a gzip stream in pieces of ``chunk`` bytes; ``damaged`` gets the reason of an end."""
    unpack, inside = zlib.decompressobj(31), False
    for packed in raw:
        while packed := packed if inside else packed.lstrip(b"\0"):
            inside = True
            try:
                data = unpack.decompress(packed, chunk)
            except zlib.error as error:
                damaged(f"{GZIP_ENDS} damaged from here on ({error}): copy the file again")
                return
            if data:
                yield data
            packed = unpack.unconsumed_tail
            if unpack.eof:  # another member, or nothing, follows
                packed, inside = unpack.unused_data, False
                unpack = zlib.decompressobj(31)
    if inside:
        yield unpack.flush()
        if not unpack.eof:
            damaged(f"{GZIP_ENDS} cut off here: copy the file again")


_MAGIC_BYTES: tuple[tuple[bytes, Format], ...] = (
    (b"PAR1", "parquet"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0", "matlab"),
    (b"MATLAB 7.3", "matlab"),
    (b"TDSm", "tdms"),
    (b"RIFF", "wav"),
)

_ALIKE = {"shdr", "csv"}
"""Formats whose bytes look alike."""

_SELF_DESCRIBING = {"shdr", "mtconnect_xml", "mtconnect_json"}
"""Formats that say themselves what stands where."""

_HEAD = 1 << 16
"""Bytes of a file that are looked at."""


def format_of(path: Path) -> Format:
    """Format of a file by its bytes; text is a table if named ``.csv`` or ``.tsv``, else a log."""
    try:
        with path.open("rb") as file:
            head = _unpacked(file.read(_HEAD))
    except OSError as error:
        raise UnreadableFile(f"it cannot be opened: {error.strerror or error}") from error
    for magic, form in _MAGIC_BYTES:
        if head.startswith(magic):
            return form
    text = _ascii(head).lstrip()
    if _is_xml(text):
        return "mtconnect_xml"
    if _JSON.match(text) and not _LOGGED.search(text):
        return "mtconnect_json"
    name = path.name.removesuffix(".gz").lower()
    return "csv" if name.endswith((".csv", ".tsv")) else "shdr"


_LOGGED = re.compile(rb"^[ \t]*(?:\d{4}-\d\d-\d\dT[^|<\n]*|\d+(?:\.\d*)?)\|", re.MULTILINE)
"""The beginning of a line of a log: its time and a bar."""

_JSON = re.compile(rb"[{\[]\s*(?:[{\[\]}\"]|$)")
"""The beginning of an object or of a list of objects."""


def _is_xml(text: bytes) -> bool:
    """Whether a text is a document; a log may begin with the rest of one."""
    if text.startswith((b"<MTConnect", b"<?xml")):
        return True
    before, document, _ = text.partition(b"<MTConnect")
    if document or text.startswith(b"<"):
        return not _LOGGED.search(before)
    return text.startswith(b"--") and b"<" in text


_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"BZh", "packed with bzip2: unpack it"),
    (b"\xfd7zXZ\0", "packed with xz: unpack it"),
    (b"\x28\xb5\x2f\xfd", "packed with zstd: unpack it"),
    (b"PK\x03\x04", "a zip archive or a spreadsheet: unpack it, or save it as CSV"),
    (b"%PDF", "a PDF: save its table as CSV"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet or document of old Office: save it as CSV"),
    (b"7z\xbc\xaf", "packed with 7z: unpack it"),
    (b"Rar!", "packed with RAR: unpack it"),
    (b"SQLite format 3", "a database of SQLite: write its table as CSV"),
    (
        b"RIFF",
        "a WAV recording: name it in a source of format wav, with the unit and full_scale of its "
        "channels",
    ),
    (b"\x89PNG", "a picture"),
)
_HEX = re.compile(rb"(?:[0-9a-fA-F]{4,8}:?\s+)(?:[0-9a-fA-F]{2,4}\s+){4,}")
_BLOCK = re.compile(
    rb"(?:%|O\d{4}|[(;]|(?:N\d+\s*)?[GMXYZFSTIJKR][-+]?[\d.]+(?![0-9A-Za-z_|:])"
    rb"|N\d+\s*[GMXYZFST(])"
)


def foreign(head: bytes) -> str:
    """Kind of a file that no reader reads, by its first bytes; ``""`` where they do not show it."""
    return next((kind for magic, kind in _OTHERS if head.startswith(magic)), "")


def looks_like(head: bytes) -> str:
    """Kind of a file that is no log, by its first bytes; ``""`` where nothing shows it."""
    if kind := foreign(head):
        return kind
    lines = [one.strip() for one in head.splitlines()[:50] if one.strip()]
    if lines and sum(bool(_HEX.match(one)) for one in lines) > len(lines) / 2:
        return "a hex dump: read the file that it was made of"
    if lines and sum(bool(_BLOCK.match(one)) for one in lines) > len(lines) / 2:
        return "a part program: name it in a source of format program"
    for mark in (b",", b";", b"\t"):
        counts = {one.count(mark) for one in lines[:-1]}
        if len(lines) > 2 and len(counts) == 1 and counts != {0}:
            return "a table of text: name it in a source of format csv"
    return ""


def source_of(path: Path, sources: Sequence[RecordSource]) -> RecordSource | None:
    """Source of the machine for a file by its bytes, then its name; None without a layout."""
    try:
        form = format_of(path)
    except UnreadableFile:
        return None
    alike = [s for s in sources if s.format == form or {s.format, form} <= _ALIKE]
    whole, same = path.resolve(), [s for s in alike if s.format == form]
    placed = [s for s in alike if whole.match(s.files)]
    named = [s for s in alike if fnmatch(path.name, s.files.rpartition("/")[2])]
    for found in (*placed, *named, *same):
        return found
    return RecordSource(format=form, files=path.name) if form in _SELF_DESCRIBING else None


def _unpacked(head: bytes) -> bytes:
    """The beginning of what is packed with gzip; it may break off, or be broken."""
    if not head.startswith(GZIP_MAGIC):
        return head
    try:
        return zlib.decompressobj(wbits=31).decompress(head, _HEAD)
    except zlib.error:
        return b""


def _ascii(head: bytes) -> bytes:
    """Text without its byte order mark, one byte a character where that is enough to see a tag."""
    for mark, encoding in ((codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be")):
        if head.startswith(mark):
            return head[2:].decode(encoding, "replace").encode()
    return head.removeprefix(codecs.BOM_UTF8)
