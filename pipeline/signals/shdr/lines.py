"""Lines of an SHDR log: segments of its bytes, the fields of a line, and their records.

SHDR (simple hierarchical data representation) is what adapters send and agents log:
``time|item|value|item|value``.  A block is a record over several lines: a line whose last field is
``--multiline--XXXX``, the lines of the field, a line that is ``--multiline--XXXX``.  All sizes are
bounded, so that a log of any size is read in little memory.

Plain Python, for the lines that the compiled scanner leaves over.  Bytes that are not UTF-8 are
read as Latin-1, which the rows say (``encoding``).  NUL bytes around a line are left out and
counted (``nulBytes``); within a line they make it unreadable.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

import codecs
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from pipeline.signals.formats import EXCERPT, GZIP_MAGIC, Rejection, gunzip
from pipeline.signals.mtconnect.devices import number_of
from pipeline.signals.mtconnect.observations import iso_ns
from pipeline.signals.shdr.record_forms import (
    FORMS,
    Items,
    RecordForm,
    RefusedError,
    asset,
    undeclared,
)

NOTHING, NUMBER, TEXT = 0, 1, 2
"""Content of a row."""
LINES, NEW_KEY, FULL = 0, 1, 2
"""Results of the scanner: all lines are read, a name is met first, a table is full."""
ANY, SAMPLE, EVENT, WORD, OTHER = 0, 1, 2, 3, 4
"""Forms of an item's value; a line with an OTHER is for the reference path."""
POSITION, LINE, ROWS, SLOW, TEXTS, TEXT_BYTES, HARD, HARD_BYTES = range(8)
KEY_START, KEY_END = range(8, 10)
"""Places in the scanner's state."""
LONGEST_KEY = 256
"""Bytes of the longest item's name that is scanned."""
CHUNK = 8 << 20
"""Bytes read at a time."""

PACKED = 256 << 10
"""Bytes of a gzip stream unpacked at a time."""

LONGEST = 4 << 20
"""Bytes of the longest line or block that is read."""

TOO_LONG = f"the line is longer than {LONGEST} bytes"
OPEN, BROKEN = -1, -2
_MARK = b"--multiline--"
_OPENING = re.compile(rb"\|[ \t]*(--multiline--[^\s|]*)[ \t\r]*\n?\Z")


@dataclass(frozen=True)
class Segment:
    """Part of a log: whole lines, one block, or something refused with the reason.

    ``line`` is the number of its first line, from 1.  ``body`` holds the lines of a block
    after the first, which is ``data``, to its closing mark.
    """

    kind: Literal["lines", "block", "refused"]
    data: bytes
    line: int
    body: bytes = b""
    reason: str = ""


class LogBytes:
    """The bytes of a file, unpacked when it is gzip, as UTF-8 when it is UTF-16.

    ``damage`` is after the iteration the reason why the file ended early, None when it did not.
    """

    def __init__(self, path: Path, chunk: int = CHUNK) -> None:
        self.path = path
        self.chunk = chunk
        self.damage: str | None = None

    def __iter__(self) -> Iterator[bytes]:
        """Chunks without the byte order mark."""
        first = True
        decoder: codecs.IncrementalDecoder | None = None
        for data in self._unpacked():
            if first:
                first = False
                if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
                    decoder = codecs.getincrementaldecoder("utf-16")(errors="replace")
                data = data.removeprefix(codecs.BOM_UTF8)
            yield data if decoder is None else decoder.decode(data).encode()
        if decoder:
            yield decoder.decode(b"", final=True).encode()

    def _unpacked(self) -> Iterator[bytes]:
        with self.path.open("rb") as file:
            packed = file.read(2) == GZIP_MAGIC
            file.seek(0)
            if packed:
                raw = iter(lambda: file.read(PACKED), b"")
                yield from _gathered(gunzip(raw, self.chunk, self._damaged), self.chunk)
            else:
                yield from iter(lambda: file.read(self.chunk), b"")

    def _damaged(self, reason: str) -> None:
        self.damage = reason


def _gathered(pieces: Iterator[bytes], size: int) -> Iterator[bytes]:
    held: list[bytes] = []
    for piece in pieces:
        held.append(piece)
        if sum(map(len, held)) >= size:
            yield b"".join(held)
            held = []
    yield b"".join(held)


def segments(source: LogBytes) -> Iterator[Segment]:
    """Cut a log into segments.

    A block ends with its mark.  Where a line that opens another block, the end of the file or
    :data:`LONGEST` bytes come first, the opening line is refused and the lines after it are read
    as lines.  After damage the line that it cut is refused with the reason.
    """
    rest, line, skipping = b"", 1, False
    for block in source:
        if skipping:
            end = block.find(b"\n") + 1
            if not end:
                continue
            block, line, skipping = block[end:], line + 1, False
        data = rest + block
        whole = data.rfind(b"\n") + 1
        skipping = len(data) - whole > LONGEST
        used = 0
        for segment in _cut(data[:whole], line, final=skipping):
            yield segment
            used += len(segment.data) + len(segment.body)
            line += lines_in(segment.data) + lines_in(segment.body)
        rest = data[used:]
        if skipping:
            yield Segment("refused", data[whole : whole + 200], line, reason=TOO_LONG)
            rest = b""
    yield from _last(rest, line, source.damage)


def lines_in(data: bytes) -> int:
    """Line feeds in ``data``; ten times as fast as ``bytes.count`` where lines are short."""
    return int(np.count_nonzero(np.frombuffer(data, np.uint8) == 10))


def _last(rest: bytes, line: int, damage: str | None) -> Iterator[Segment]:
    cut = b""
    if damage:
        whole = rest.rfind(b"\n") + 1
        rest, cut = rest[:whole], rest[whole:]
    elif rest and not rest.endswith(b"\n"):
        rest += b"\n"
    for segment in _cut(rest, line, final=True):
        yield segment
        line += lines_in(segment.data) + lines_in(segment.body)
    if damage:
        yield Segment("refused", cut[:200], line, reason=damage)


def _cut(data: bytes, line: int, *, final: bool) -> Iterator[Segment]:
    """Segments of whole lines; an open block at the end is left out unless ``final``."""
    begin = at = 0
    while (at := data.find(_MARK, at)) >= 0:
        start = data.rfind(b"\n", 0, at) + 1
        end = data.index(b"\n", at) + 1
        opening = _OPENING.search(data, start, end)
        at = end
        if not opening:
            continue
        mark = opening[1]
        close = _block_end(data, end, mark, start + LONGEST)
        if close == OPEN and not final and len(data) - start <= LONGEST:
            if start > begin:
                yield Segment("lines", data[begin:start], line)
            return
        if start > begin:
            yield Segment("lines", data[begin:start], line)
            line += lines_in(data[begin:start])
        if close < 0:
            reason = f"the block {mark.decode('latin-1')!r} that begins here has no end"
            yield Segment("refused", data[start:end], line, reason=reason)
            line += 1
            begin = end
            continue
        yield Segment("block", data[start:end], line, body=data[end:close])
        line += 1 + lines_in(data[end:close])
        begin = at = close
    if len(data) > begin:
        yield Segment("lines", data[begin:], line)


def _block_end(data: bytes, at: int, mark: bytes, limit: int) -> int:
    """Offset after the closing line, OPEN when the data end before, BROKEN when it has none."""
    while (at := data.find(_MARK, at)) >= 0:
        start = data.rfind(b"\n", 0, at) + 1
        end = data.index(b"\n", at) + 1
        if data[start:end].strip() == mark:
            return end if end <= limit else BROKEN
        if _OPENING.search(data, start, end):
            return BROKEN
        at = end
    return OPEN


BLANK = " \t\r"
"""Characters around a field that are not part of it."""

_QUOTED = re.compile(r'[ \t]*"((?:[^"\\|]|\\.|\\$|"(?![ \t\r]*(?:\||$)))*+)"[ \t\r]*(?=\||$)', re.S)
_PLAIN = re.compile(r"(?:[^|\\]|\\\||\\(?!\|))*+", re.S)
_COUNT = re.compile(r"[+-]?\d{1,19}(?:\.\d{0,9})?", re.ASCII)
_UNITS = {"unix_s": 10**9, "unix_ms": 10**6, "unix_us": 10**3, "unix_ns": 1}
_DATED = (631_152_000 * 10**9, 4_102_444_800 * 10**9)
"""Nanoseconds since 1970 between which a count is a date: the years 1990 to 2099."""


def fields_of(line: str) -> list[str]:
    r"""Fields of a line, blanks around them removed.

    A field in double quotes ends at the quote before ``|`` or the end, and ``\`` in it takes the
    next character as it is.  Outside quotes only ``\|`` is special: a pipe that does not separate.
    """
    if '"' not in line and "\\|" not in line:
        return [field.strip(BLANK) for field in line.split("|")]
    fields = []
    at = 0
    while at <= len(line):
        quoted = _QUOTED.match(line, at)
        if quoted:
            fields.append(re.sub(r"\\(.)", r"\1", quoted[1], flags=re.S))
            at = quoted.end() + 1
            continue
        plain = _PLAIN.match(line, at)
        end = plain.end() if plain else at
        fields.append(line[at:end].replace("\\|", "|").strip(BLANK))
        at = end + 1
    return fields


def counted_ns(text: str) -> tuple[int | None, str]:
    """Nanoseconds of a time that is a number, and its unit; None when it is no time.

    A number that is a date from 1990 to 2099 in seconds, milliseconds, microseconds or nanoseconds
    since 1970 is that date; at most one of the units makes it one.  A smaller number is
    ``milliseconds`` of the adapter's own counter.
    """
    if not _COUNT.fullmatch(text):
        return None, ""
    count = Decimal(text)
    for unit, factor in _UNITS.items():
        if _DATED[0] <= (ns := int(count * factor)) < _DATED[1]:
            return ns, unit
    ns = int(count * 10**6)
    return (ns, "milliseconds") if abs(ns) < _DATED[0] // 1000 else (None, "")


def json_of(attributes: dict[str, object]) -> str | None:
    """JSON of attributes without those that are empty; None when none is left."""
    kept = {name: value for name, value in attributes.items() if value not in ("", None)}
    return json.dumps(kept, ensure_ascii=False, sort_keys=True) if kept else None


ASSET = "asset"
"""Item under which assets stand."""
EARLIEST = -(2**63) + 1
MOST_FIELDS = 6
"""Fields that a record of a data item looks at: five of a condition, and whether more follow."""


_GLUED = re.compile(r"\S\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[^|\s]*$", re.ASCII)
"""A field that has lost its end and is followed by the time of another line."""


class Row(NamedTuple):
    """One row of observations; ``attributes`` is JSON."""

    time: int
    data_item: str
    number: float | None
    text: str | None
    sequence: int
    kind: str
    key: str | None
    attributes: str | None


class LineResult(NamedTuple):
    """Result of one line."""

    rows: list[Row]
    records: int
    rejected: list[Rejection]


class LineReader:
    """Reader of the lines of one log in their order.

    ``previous`` is the time of the last line that had one [ns since 1970], ``formed`` whether any
    line so far had the form of a log.
    """

    def __init__(self, items: Items) -> None:
        self.items = items
        self.previous: int | None = None
        self.formed = False

    def line(self, number: int, raw: bytes, sequence: int, body: bytes | None = None) -> LineResult:
        """Read line ``number`` of the file, whose first record is its record ``sequence``.

        ``raw`` is the line without its end, ``body`` the rest of a block.
        """
        if len(raw) > LONGEST:
            return refused(number, TOO_LONG, raw)
        bare = raw.strip(b" \t\r\0")
        nul_bytes = raw.count(b"\0")
        if not bare:
            return (
                refused(number, "the line is NUL bytes", b"")
                if nul_bytes
                else LineResult([], 0, [])
            )
        if b"\0" in bare:
            return refused(number, "NUL bytes stand in the middle of the line", raw)
        attributes: dict[str, object] = {"nulBytes": nul_bytes or None}
        text = decoded(bare, attributes)
        text = text.removeprefix("\ufeff")
        if text.startswith("*"):
            return LineResult([], 1, [])
        stamp, *fields = fields_of(text)
        time, reason = self._time(stamp, attributes)
        if time is None or not fields or fields == [""]:
            reason = reason if time is None else "no item follows the time"
            return refused(number, reason, bare)
        if any(map(_GLUED.search, fields[:-1])):
            return refused(
                number, "the line breaks off, and the next one follows without a break", bare
            )
        self.previous, self.formed = time, True
        if body is not None:
            fields[-1] = decoded(body.rstrip().rpartition(b"\n")[0].strip(), attributes)
        return self._records(number, time, fields, attributes, sequence)

    def _time(self, stamp: str, attributes: dict[str, object]) -> tuple[int | None, str]:
        """Time of a line [ns] or why it has none; its oddities are added to ``attributes``."""
        stamp, at, duration = stamp.partition("@")
        if at:
            attributes["duration"] = number_of(duration)
            if attributes["duration"] is None:
                return None, f"the duration {duration[:40]!r} is no number"
        if not stamp:
            attributes["time"] = "of the line before"
            return self.previous, "the line has no time and none stands before it"
        time = iso_ns(stamp)
        if time is None:
            time, attributes["time"] = counted_ns(stamp)
        return time, (
            f"{stamp[:40]!r} is no time: ISO 8601 from 1678 to 2261, or s, ms, us or ns since 1970"
        )

    def _records(
        self, line: int, time: int, fields: list[str], attributes: dict[str, object], sequence: int
    ) -> LineResult:
        rows: list[Row] = []
        rejected: list[Rejection] = []
        at = records = 0
        # A lone empty field at the end is a pipe too many.
        while at < len(fields) - (at > 0 and not fields[-1]):
            key = fields[at]
            rest = fields[at + 1 : None if key.startswith("@") else at + 1 + MOST_FIELDS]
            try:
                name, form = self._record(key, rest, alone=at == 0)
                used = form.used
                if time - form.values[0].before < EARLIEST:
                    raise RefusedError("the time series begins before 1678", used)
            except RefusedError as why:
                used = why.used
                excerpt = "|".join((key, *rest[:used]))[:EXCERPT]
                rejected.append(Rejection(line=line, reason=str(why), excerpt=excerpt))
            else:
                place = sequence + records
                rows += _rows(form, time, name, place, attributes)
            at += 1 + used
            records += 1
        return LineResult(rows, records, rejected)

    def _record(self, key: str, rest: list[str], *, alone: bool) -> tuple[str, RecordForm]:
        if not key:
            raise RefusedError("a value stands without an item's name", min(1, len(rest)))
        if key.startswith("@"):
            return ASSET, asset(key, rest)
        if not rest:
            raise RefusedError(f"item {key[:40]!r} has no value", 0)
        plan = self.items.plan(key)
        if plan.shape == "refused":
            raise RefusedError(plan.why, undeclared(rest, alone=alone).used)
        if plan.shape != "any":
            return plan.name, FORMS[plan.shape](plan, rest)
        return plan.name, undeclared(rest, alone=alone)


def _rows(
    form: RecordForm, time: int, name: str, place: int, attributes: dict[str, object]
) -> list[Row]:
    rows = []
    last: dict[str, object] | None = None
    words: str | None = None
    for v in form.values:
        if v.attributes is not last:  # the thousands of values of a series share one
            last, words = v.attributes, json_of(attributes | v.attributes)
        rows.append(Row(time - v.before, name, v.number, v.text, place, form.kind, v.key, words))
    return rows


def decoded(raw: bytes, attributes: dict[str, object]) -> str:
    """Text of UTF-8, else of Latin-1, which is added to the attributes of the rows."""
    try:
        return raw.decode()
    except UnicodeDecodeError:
        attributes["encoding"] = "latin-1"
        return raw.decode("latin-1")


def single_lines(segment: Segment) -> Iterator[Segment]:
    """Each line of a segment of lines; a block, or what was refused, as it is."""
    if segment.kind != "lines":
        yield segment
        return
    for number, raw in enumerate(segment.data.removesuffix(b"\n").split(b"\n"), segment.line):
        yield Segment("lines", raw, number)


def read_segment(reader: LineReader, segment: Segment, sequence: int) -> LineResult:
    """Read one line, one block, or what was refused before."""
    if segment.kind == "refused":
        return refused(segment.line, segment.reason, segment.data)
    body = segment.body if segment.kind == "block" else None
    return reader.line(segment.line, segment.data.removesuffix(b"\n"), sequence, body)


def refused(line: int, reason: str, raw: bytes) -> LineResult:
    """A line that is rejected as one record."""
    excerpt = raw[: 4 * EXCERPT].decode("utf-8", "replace")[:EXCERPT]
    return LineResult([], 1, [Rejection(line=line, reason=reason, excerpt=excerpt)])
