"""Fast path through an SHDR log: bytes are scanned, other lines go through the reference path."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import KINDS
from pipeline.signals.formats import Batch, Rejection
from pipeline.signals.shdr import scan
from pipeline.signals.shdr.lines import LONGEST, Segment
from pipeline.signals.shdr.record_forms import ItemPlan, Items
from pipeline.signals.shdr.reference import (
    Codes,
    LineReader,
    Row,
    Rows,
    merged,
    read_segment,
    rows_of,
)
from pipeline.signals.shdr.scan import scan as scan_lines

ROWS = 1 << 20
SLOW_LINES = 1 << 16
KEYS, KEY_BYTES = 1 << 16, 1 << 22
TEXT_BYTES = 1 << 24
HARD_BYTES = 1 << 24
ENOUGH = 1 << 18
"""Rows after which a batch is handed over."""

_FORM_CODES = {"any": scan.ANY, "sample": scan.SAMPLE, "event": scan.EVENT, "word": scan.WORD}


class Scanner:
    """Reads segments one after the other and hands over what has come together."""

    def __init__(self, items: Items) -> None:
        self.reader = LineReader(items)
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
            if segment.kind == "lines":
                yield from self._lines(segment)
            else:
                self._odd.append((int(self._state[scan.ROWS]), segment))
            if self._state[scan.ROWS] + len(self._odd) >= ENOUGH:
                yield self._batch()
        if self._state[scan.ROWS] or self._odd:
            yield self._batch()

    def _lines(self, segment: Segment) -> Iterator[Batch]:
        buffer = np.frombuffer(segment.data, np.uint8)
        self._state[scan.POSITION], self._state[scan.LINE] = 0, segment.line
        why = scan.FULL
        while why != scan.LINES:
            why = scan_lines(buffer, self._closed, LONGEST, self._state, self._rows,
                             self._slow, self._keys, self._plans, self._texts,
                             self._hard)  # fmt: skip
            self._take_slow(segment.data)
            if why == scan.NEW_KEY:
                self._learn(buffer)
            elif why == scan.FULL:
                yield self._batch()

    def _take_slow(self, data: bytes) -> None:
        for before, line, start, end in self._slow[: self._state[scan.SLOW]].tolist():
            self._odd.append((before, Segment("lines", data[start:end], line)))
        self._state[scan.SLOW] = 0

    @property
    def _closed(self) -> bool:
        n = len(self._known)
        return n == KEYS or int(self._keys[1][n]) > KEY_BYTES - scan.LONGEST_KEY

    def _learn(self, buffer: Any) -> None:
        """Take in the name at which the scanner stopped."""
        start, end = int(self._state[scan.KEY_START]), int(self._state[scan.KEY_END])
        plan = self.reader.items.plan(buffer[start:end].tobytes().decode("ascii"))
        code = len(self._known)
        _, slot = scan.find(buffer, start, end, *self._keys)
        scan.add(buffer, start, end, code, slot, *self._keys)
        shapes, factors, offsets = self._plans
        shapes[code] = _FORM_CODES.get(plan.shape, scan.OTHER)
        factors[code], offsets[code] = plan.factor, plan.offset
        self._known.append(plan)

    def _batch(self) -> Batch:
        """What has come together, in the order of the file."""
        n = int(self._state[scan.ROWS])
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
        table = self._table(n, sequence, rows, np.array(before, np.int64))
        self.records += n + done
        self._forget()
        kept = n + done - len(rejected)
        return Batch(observations=table, read=n + done, kept=kept, rejected=rejected)

    def _table(self, n: int, sequence: Any, odd: list[Row], before: Any) -> pa.Table:
        time, item, number, text, holds = (column[:n] for column in self._rows)
        self._convert_hard(number, item)
        names = Codes()
        name_of = np.array([names.code(p.name) for p in self._known] or [0], np.int32)
        kind_of = np.array([KINDS.index(p.kind) for p in self._known] or [0], np.int32)
        texts = _strings(int(self._state[scan.TEXTS]), *self._texts[1:])
        fast = Rows(
            time=time.copy(), item=name_of[item], number=number.copy(), holds=holds,
            text=text.copy(), sequence=sequence, kind=kind_of[item], key=None, attributes=None,
            items=names.array(), texts=texts, keys=pa.array([], pa.string()),
        )  # fmt: skip
        if not odd:
            return fast.table()
        return merged(fast, rows_of(odd, names, Codes(texts.to_pylist())), before).table()

    def _convert_hard(self, number: Any, item: Any) -> None:
        """Convert the numbers that the scanner copied out; Arrow rounds as Python does."""
        n = int(self._state[scan.HARD])
        if n:
            of_row, offsets, copies = self._hard
            values = pc.cast(_strings(n, offsets, copies), pa.float64()).to_numpy()
            at = of_row[:n]
            factor, offset = self._plans[1][item[at]], self._plans[2][item[at]]
            changed = (factor != 1.0) | (offset != 0.0)
            number[at] = np.where(changed, values * factor + offset, values)

    def _forget(self) -> None:
        self._odd = []
        self._texts[0][:] = 0
        self._state[scan.ROWS : scan.KEY_START] = 0


def _words(most: int, most_bytes: int) -> tuple[Any, Any, Any]:
    """An empty table of words: slots, offsets, bytes."""
    return np.zeros(2 * most, "i4"), np.zeros(most + 1, "i4"), np.empty(most_bytes, "u1")


def _strings(n: int, offsets: Any, data: Any) -> pa.Array:
    """The first ``n`` words of a table."""
    used = data[: offsets[n]].tobytes()
    return pa.StringArray.from_buffers(
        n, pa.py_buffer(offsets[: n + 1].tobytes()), pa.py_buffer(used)
    )
