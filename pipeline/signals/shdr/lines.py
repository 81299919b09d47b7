"""Lines of an SHDR log: its bytes in segments of whole lines or blocks, and the fields of a line.

SHDR (simple hierarchical data representation) is what adapters send and agents log:
``time|item|value|item|value``.  A block is a record over several lines: a line whose last field is
``--multiline--XXXX``, the lines of the field, a line that is ``--multiline--XXXX``.  All sizes are
bounded, so that a log of any size is read in little memory.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

import codecs
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.signals.formats import GZIP_MAGIC, gunzip

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
_KEY = re.compile(r"[^\s={}]+")
_BRACE = re.compile(r"\\.|[{}]", re.S)


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


def entries_of(text: str) -> list[tuple[str, str | None]]:
    """Entries ``key=value`` of a data set, value None where the entry is removed.

    A value with blanks stands in braces or quotes; one that is not closed, or has no key, is a
    ValueError.
    """
    entries: list[tuple[str, str | None]] = []
    at = 0
    while True:
        while at < len(text) and text[at].isspace():
            at += 1
        if at == len(text):
            return entries
        key = _KEY.match(text, at)
        if not key:
            raise ValueError(f"the data set has no key at character {at + 1}")
        at = key.end()
        value = None
        if text[at : at + 1] == "=":
            value, at = _entry_value(text, at + 1)
        entries.append((key[0], value or None))


def _entry_value(text: str, at: int) -> tuple[str, int]:
    opening = text[at : at + 1]
    if opening == "{":
        end = _closing_brace(text, at)
        return text[at + 1 : end], end + 1
    if opening and opening in "\"'":
        found = re.compile(rf"{opening}((?:[^{opening}\\]|\\.)*+){opening}", re.S).match(text, at)
        if not found:
            raise ValueError(f"the quote at character {at + 1} of the data set is not closed")
        return re.sub(r"\\(.)", r"\1", found[1], flags=re.S), found.end()
    end = at
    while end < len(text) and not text[end].isspace():
        end += 1
    return text[at:end], end


def _closing_brace(text: str, at: int) -> int:
    depth = 0
    for mark in _BRACE.finditer(text, at):
        depth += {"{": 1, "}": -1}.get(mark[0], 0)
        if depth == 0:
            return mark.start()
    raise ValueError(f"the brace at character {at + 1} of the data set is not closed")


def json_of(attributes: dict[str, object]) -> str | None:
    """JSON of attributes without those that are empty; None when none is left."""
    kept = {name: value for name, value in attributes.items() if value not in ("", None)}
    return json.dumps(kept, ensure_ascii=False, sort_keys=True) if kept else None
