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
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import KINDS, OBSERVATIONS, TIME
from pipeline.signals.formats import (
    Batch,
    RecordSource,
    Rejection,
    UnreadableFile,
    encoded,
    looks_like,
)
from pipeline.signals.shdr import lines
from pipeline.signals.shdr.lines import (
    CHUNK,
    LONGEST,
    LineReader,
    LogBytes,
    Row,
    Segment,
    read_segment,
    segments,
    single_lines,
)
from pipeline.signals.shdr.record_forms import ItemPlan, Items

ROWS = 1 << 20
SLOW_LINES = 1 << 16
KEYS, KEY_BYTES = 1 << 16, 1 << 22
TEXT_BYTES = 1 << 24
HARD_BYTES = 1 << 24
ENOUGH = 1 << 18
"""Rows after which a batch is handed over."""

_FORM_CODES = {"any": lines.ANY, "sample": lines.SAMPLE, "event": lines.EVENT, "word": lines.WORD}


class Scanner:
    """Reads segments one after the other and hands over what has come together."""

    def __init__(self, items: Items, *, plain: bool) -> None:
        self.reader = LineReader(items)
        self._plain = plain  # no line is scanned
        self.records = 0  # of the batches that were handed over
        self._state = np.zeros(10, np.int64)
        self._rows = tuple(np.empty(ROWS, t) for t in ("i8", "i4", "f8", "i4", "u1"))
        self._slow = np.empty((SLOW_LINES, 4), np.int64)
        self._keys = _words(KEYS, KEY_BYTES)
        self._plans = (np.zeros(KEYS, "u1"), np.ones(KEYS), np.zeros(KEYS))
        self._known: list[ItemPlan] = []
        self._texts = _words(ROWS, TEXT_BYTES)
        self._hard = (np.empty(ROWS, "i4"), np.zeros(ROWS + 1, "i4"), np.empty(HARD_BYTES, "u1"))
        self._odd: list[tuple[int, Segment]] = []  # with the rows before each

    def batches(self, segments: Iterator[Segment]) -> Iterator[Batch]:
        """Batches of the whole log."""
        for segment in segments:
            if segment.kind == "lines" and not self._plain:
                yield from self._lines(segment)
            else:
                self._odd += [(int(self._state[lines.ROWS]), one) for one in single_lines(segment)]
            if self._state[lines.ROWS] + len(self._odd) >= ENOUGH:
                yield self._batch()
        if self._state[lines.ROWS] or self._odd:
            yield self._batch()

    def _lines(self, segment: Segment) -> Iterator[Batch]:
        from pipeline.signals.shdr.scan import scan  # which loads the compiler

        buffer = np.frombuffer(segment.data, np.uint8)
        self._state[lines.POSITION], self._state[lines.LINE] = 0, segment.line
        why = lines.FULL
        while why != lines.LINES:
            why = scan(buffer, self._closed, LONGEST, self._state, self._rows,
                             self._slow, self._keys, self._plans, self._texts,
                             self._hard)  # fmt: skip
            for before, line, start, end in self._slow[: self._state[lines.SLOW]].tolist():
                self._odd.append((before, Segment("lines", segment.data[start:end], line)))
            self._state[lines.SLOW] = 0
            if why == lines.NEW_KEY:
                self._learn(buffer)
            elif why == lines.FULL:
                yield self._batch()

    @property
    def _closed(self) -> bool:
        n = len(self._known)
        return n == KEYS or int(self._keys[1][n]) > KEY_BYTES - lines.LONGEST_KEY

    def _learn(self, buffer: Any) -> None:
        """Take in the name at which the scanner stopped."""
        start, end = int(self._state[lines.KEY_START]), int(self._state[lines.KEY_END])
        plan = self.reader.items.plan(buffer[start:end].tobytes().decode("ascii"))
        code = len(self._known)
        from pipeline.signals.shdr.scan import add, find

        _, slot = find(buffer, start, end, *self._keys)
        add(buffer, start, end, code, slot, *self._keys)
        shapes, factors, offsets = self._plans
        shapes[code] = _FORM_CODES.get(plan.shape, lines.OTHER)
        factors[code], offsets[code] = plan.factor, plan.offset
        self._known.append(plan)

    def _batch(self) -> Batch:
        n = int(self._state[lines.ROWS])
        rows: list[Row] = []
        before: list[int] = []
        rejected: list[Rejection] = []
        odd_records = np.zeros(n + 1, np.int64)
        last = done = 0
        for place, segment in self._odd:
            if place > last:
                self.reader.previous = int(self._rows[0][place - 1])
            read = read_segment(self.reader, segment, self.records + place + done + 1)
            rows += read.rows
            before += [place] * len(read.rows)
            rejected += read.rejected
            odd_records[place] += read.records
            done += read.records
            last = place
        if n > last:
            self.reader.previous = int(self._rows[0][n - 1])
        self.reader.formed |= n > 0
        sequence = self.records + 1 + np.arange(n) + np.cumsum(odd_records)[:n]
        table = self._table(n, sequence, rows, before)
        self.records += n + done
        self._odd = []
        self._texts[0][:] = 0
        self._state[lines.ROWS : lines.KEY_START] = 0
        return Batch(observations=table, read=n + done, rejected=rejected)

    def _table(self, n: int, sequence: Any, odd: list[Row], before: list[int]) -> pa.Table:
        """Rows of the scanner, each of ``odd`` after as many of them as ``before`` says."""
        time, item, number, text, holds = (column[:n] for column in self._rows)
        self._convert_hard(number, item)
        names: dict[str, int] = {}
        name_of = np.array([_code(names, p.name) for p in self._known] or [0], np.int32)
        kind_of = np.array([KINDS.index(p.kind) for p in self._known] or [0], np.int32)
        texts = _strings(int(self._state[lines.TEXTS]), *self._texts[1:])
        keys: dict[str, int] = {}
        columns = [time.copy(), name_of[item], number.copy(), holds == lines.NUMBER, text.copy(),
                   sequence, kind_of[item], np.full(n, -1)]  # fmt: skip
        attributes = pa.nulls(n + len(odd), pa.string())
        if odd:
            words = {word: code for code, word in enumerate(texts.to_pylist())}
            rows = [
                (r.time, _code(names, r.data_item), 0.0 if r.number is None else r.number,
                 r.number is not None, _code(words, r.text), r.sequence, KINDS.index(r.kind),
                 _code(keys, r.key))
                for r in odd
            ]  # fmt: skip
            columns = [
                np.insert(column, before, values)
                for column, values in zip(columns, zip(*rows, strict=True), strict=True)
            ]
            texts = pa.array(words, pa.string())
            which = np.insert(np.full(n, -1), before, range(len(odd)))
            indices = pa.array(which, mask=which < 0)
            attributes = pa.array([r.attributes for r in odd], pa.string()).take(indices)
        time, item, number, known, text, sequence, kind, key = columns
        arrays = [
            pa.array(time).cast(TIME), encoded(item, list(names)), pa.array(number, mask=~known),
            encoded(text, texts), pa.array(sequence.astype(np.uint64)), encoded(kind, KINDS),
            encoded(key, list(keys)), attributes, pa.nulls(len(time), pa.uint64()),
        ]  # fmt: skip
        return pa.Table.from_arrays(arrays, schema=OBSERVATIONS)

    def _convert_hard(self, number: Any, item: Any) -> None:
        """Convert the numbers that the scanner copied out; Arrow rounds as Python does."""
        n = int(self._state[lines.HARD])
        if n:
            of_row, offsets, copies = self._hard
            values = pc.cast(_strings(n, offsets, copies), pa.float64()).to_numpy()
            at = of_row[:n]
            factor, offset = self._plans[1][item[at]], self._plans[2][item[at]]
            changed = (factor != 1.0) | (offset != 0.0)
            number[at] = np.where(changed, values * factor + offset, values)


def _code(codes: dict[str, int], word: str | None) -> int:
    """The number of a word in the order in which they come, -1 for None."""
    return -1 if word is None else codes.setdefault(word, len(codes))


def _words(most: int, most_bytes: int) -> tuple[Any, Any, Any]:
    return np.zeros(2 * most, "i4"), np.zeros(most + 1, "i4"), np.empty(most_bytes, "u1")


def _strings(n: int, offsets: Any, data: Any) -> pa.Array:
    used = data[: offsets[n]].tobytes()
    return pa.StringArray.from_buffers(
        n, pa.py_buffer(offsets[: n + 1].tobytes()), pa.py_buffer(used)
    )


HEAD = 1 << 13
"""Bytes by which a file that is no log is recognised."""

PATIENCE = 100_000
"""Records that may be rejected before the first that has the form of a log."""


SMALL = 1 << 20
"""Bytes of a log below which its lines are read in plain Python: compilation takes far longer."""


def read(
    path: Path, source: RecordSource, root: Path, chunk: int = CHUNK, small: float = SMALL
) -> Iterator[Batch]:
    """Read a log, plain or gzip, in batches of about a quarter of a million records.

    ``devices``, ``device`` and ``values`` of ``source`` declare its items.  A file that is empty,
    or no line of which has the form of a log, is an :class:`UnreadableFile`.
    """
    begins = map(len, islice(LogBytes(path, SMALL), 2))
    scanner = Scanner(Items(source, root), plain=sum(begins) < small)
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
