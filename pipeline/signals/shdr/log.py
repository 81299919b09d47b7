"""Reader of MTConnect logs (SHDR): ``time|item|value``, streamed in little memory.

A record is one ``item|value`` pair, condition, message, asset or adapter command; ``sequence`` is
its place in the file from 1.  Commands (``* key: value``) are kept without rows.

- Times: ISO 8601 to the nanosecond, UTC where they name no zone; ``time@duration`` gives
  ``duration`` in ``attributes``.  A number that is a date from 1990 to 2099 in s, ms, us or ns
  since 1970 is that date, with ``{"time": "unix_s"}`` and so on; a smaller one is milliseconds of
  the adapter's own counter, kept as time since 1970 with ``{"time": "milliseconds"}``; an empty
  time is that of the line before, with ``{"time": "of the line before"}``.  Old times are kept.
- Values: UNAVAILABLE is null in both columns; an item that the Devices document declares a SAMPLE
  must be a number; events are numbers where they look so unless their type is a name (PROGRAM);
  without a document see :mod:`pipeline.signals.shdr.record_forms`.
- Conditions: ``text`` is the level in capitals, ``key`` the conditionId or else the code,
  ``attributes`` has severity, qualifier, message (and nativeCode) where they are not empty.
- Assets: item ``asset``, ``key`` the id, ``text`` the type, ``attributes`` has the document as
  ``xml``; removed ones are unavailable.
- Time series: ``key`` is the place from 1; the record's time is that of the last value.
- Data sets: a row for each entry (``row/column`` for tables), removed entries unavailable.
- Bytes: gzip and UTF-16 are unpacked; bytes that are not UTF-8 are read as Latin-1 and the rows say
  so; lines and blocks are at most 4 MiB.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

from collections.abc import Iterator
from pathlib import Path

from pipeline.signals.formats import Batch, RecordSource, UnreadableFile, looks_like
from pipeline.signals.shdr.lines import CHUNK, LogBytes, segments
from pipeline.signals.shdr.record_forms import Items
from pipeline.signals.shdr.reference import LineReader

HEAD = 1 << 13
"""Bytes by which a file that is no log is recognised."""

PATIENCE = 100_000
"""Records that may be rejected before the first that has the form of a log."""


def read(path: Path, source: RecordSource, root: Path, chunk: int = CHUNK) -> Iterator[Batch]:
    """Read a log, plain or gzip, in batches of about a quarter of a million records.

    ``devices``, ``device`` and ``values`` of ``source`` declare its items.  A file that is empty,
    or no line of which has the form of a log, is an :class:`UnreadableFile`.
    """
    # Compiled code is slow to load, and most who import this module only ask what it reads.
    from pipeline.signals.shdr.fast import Scanner

    scanner = Scanner(Items(source, root))
    yield from _recognised(path, scanner.batches(segments(LogBytes(path, chunk))), scanner.reader)


def _recognised(path: Path, batches: Iterator[Batch], reader: LineReader) -> Iterator[Batch]:
    """Pass batches on as soon as the file is known to be a log."""
    held: list[Batch] = []
    for batch in (b for b in batches if b.read):
        held.append(batch)
        waiting = not reader.formed
        if waiting and sum(len(b.rejected) for b in held) > PATIENCE:
            raise _no_log(path, held)
        if not waiting:
            yield from held
            held = []
    if not held:
        if not reader.formed:
            raise UnreadableFile("the file holds no record")
        return
    if any(b.rejected for b in held):
        raise _no_log(path, held)
    yield from held  # adapter commands only


def _no_log(path: Path, held: list[Batch]) -> UnreadableFile:
    with path.open("rb") as file:
        kind = looks_like(file.read(HEAD))
    first = next(b.rejected[0] for b in held if b.rejected)
    read = sum(b.read for b in held)
    return UnreadableFile(
        f"none of the first {read} lines has the form of a log (time|item|value): "
        f"{first.reason} in line {first.line}" + (f"; it looks like {kind}" if kind else "")
    )
