"""Bytes of an SHDR log, in stretches that end at a line: gzip, UTF-16, long lines, blocks.

A block is a record over several lines: a line whose last field is ``--multiline--XXXX``, the lines
of the field, a line that is ``--multiline--XXXX``.  All sizes are bounded, so that a log of any
size is read in little memory.
"""

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.signals.packed import MAGIC, gunzip

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
class Stretch:
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

    ``damage`` says after the iteration why the file ended early, None when it did not.
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
            packed = file.read(2) == MAGIC
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


def stretches(source: LogBytes) -> Iterator[Stretch]:
    """Cut a log into stretches.

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
        for stretch in _cut(data[:whole], line, final=skipping):
            yield stretch
            used += len(stretch.data) + len(stretch.body)
            line += lines_in(stretch.data) + lines_in(stretch.body)
        rest = data[used:]
        if skipping:
            yield Stretch("refused", data[whole : whole + 200], line, reason=TOO_LONG)
            rest = b""
    yield from _last(rest, line, source.damage)


def lines_in(data: bytes) -> int:
    """Line feeds in ``data``; ten times as quick as ``bytes.count`` where lines are short."""
    return int(np.count_nonzero(np.frombuffer(data, np.uint8) == 10))


def _last(rest: bytes, line: int, damage: str | None) -> Iterator[Stretch]:
    cut = b""
    if damage:
        whole = rest.rfind(b"\n") + 1
        rest, cut = rest[:whole], rest[whole:]
    elif rest and not rest.endswith(b"\n"):
        rest += b"\n"
    for stretch in _cut(rest, line, final=True):
        yield stretch
        line += lines_in(stretch.data) + lines_in(stretch.body)
    if damage:
        yield Stretch("refused", cut[:200], line, reason=damage)


def _cut(data: bytes, line: int, *, final: bool) -> Iterator[Stretch]:
    """Stretches of whole lines; an open block at the end is left out unless ``final``."""
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
                yield Stretch("lines", data[begin:start], line)
            return
        if start > begin:
            yield Stretch("lines", data[begin:start], line)
            line += lines_in(data[begin:start])
        if close < 0:
            reason = f"the block {mark.decode('latin-1')!r} that begins here has no end"
            yield Stretch("refused", data[start:end], line, reason=reason)
            line += 1
            begin = end
            continue
        yield Stretch("block", data[start:end], line, body=data[end:close])
        line += 1 + lines_in(data[end:close])
        begin = at = close
    if len(data) > begin:
        yield Stretch("lines", data[begin:], line)


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
