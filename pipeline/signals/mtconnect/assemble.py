"""From the observations that the compiled way found to a batch of rows."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pipeline.signals.columns import KINDS, OBSERVATIONS
from pipeline.signals.mtconnect import parse as parsing
from pipeline.signals.mtconnect import scan as scanning
from pipeline.signals.mtconnect import tags as tagging
from pipeline.signals.mtconnect.arrays import encoded, merged, numbers
from pipeline.signals.mtconnect.elements import Document
from pipeline.signals.mtconnect.rows import RECORDS, Rows
from pipeline.signals.mtconnect.streams import device_name
from pipeline.signals.mtconnect.text import attributes_of, local
from pipeline.signals.mtconnect.words import (
    AXES,
    LEVELS,
    MalformedError,
    Shape,
    json_of,
    number_of,
    shape_of,
)
from pipeline.signals.records import Batch

Ints = npt.NDArray[np.int64]

_SECTIONS = ("SAMPLE", "EVENT", "CONDITION")
_LEVELS = [level for level in LEVELS.values() if level]
_MANNERS = {
    ("number", False): parsing.NUMBER,
    ("number", True): parsing.SPATIAL_NUMBER,
    ("value", False): parsing.VALUE,
    ("value", True): parsing.SPATIAL_VALUE,
    ("text", False): parsing.TEXT,
    ("text", True): parsing.TEXT,
    ("condition", False): parsing.CONDITION,
    ("condition", True): parsing.CONDITION,
}
_TEXT_SLOTS = 1 << 19
_DROPPED = 1 << 62
_REFUSED = Shape(data_item="", kind="UNKNOWN", manner="set")
_TAGS = (b"Samples", b"Events", b"Condition")
_CLOSING = b"></ComponentStream></DeviceStream></Streams></MTConnectStreams>"

ITEM, KIND, KEY, LEVEL, SECTION = range(5)
"""Columns of the table of what a shape says."""


@dataclass(frozen=True)
class Run:
    """Elements of one device stream: from number ``first`` on, after ``place`` records."""

    prologue: bytes
    tag: bytes
    said: dict[str, str]
    instance: int | None
    device: int
    first: int
    place: int


Broken = tuple[Run, int, int, int]
"""Run, byte, section and place of an element at which a document is not well formed."""


class Assembly:
    """What is known about shapes, and the elements' runs since the last batch."""

    def __init__(self, document: Document, buffer: npt.NDArray[np.uint8], elements: Ints) -> None:
        self.buffer = buffer
        self.elements = elements
        self.notes: list[tuple[int, int, str]] = []
        self.runs: list[Run] = []
        self._document = document
        self._single = Document(document.content, document.asked)
        self._devices: dict[bytes, int] = {}
        self._names: list[str] = []
        self._rows = np.empty((3 * RECORDS, parsing.ROW_COLUMNS), np.int64)
        self._numbers = np.empty(3 * RECORDS)
        self._sequences = np.empty(3 * RECORDS, np.uint64)
        self._texts = np.empty((RECORDS, 2), np.int64)
        self._text_slots = np.empty(_TEXT_SLOTS, np.int32)
        self._slow = np.empty(RECORDS, np.int64)
        self._hard = np.empty((RECORDS, 3), np.int64)
        self._counts, self._date = np.zeros(4, np.int64), np.zeros(2, np.int64)
        self._three = np.empty(3)
        self.forget()

    def forget(self) -> None:
        """Start anew with the table of shapes."""
        self._shapes: list[Shape] = []
        self._manners = np.zeros(tagging.SHAPES, np.int64)
        self._codes = np.full((tagging.SHAPES, 5), -1, np.int32)
        self._items: dict[str, int] = {}
        self._keys: dict[str, int] = {axis: i for i, axis in enumerate(AXES)}

    @property
    def known(self) -> int:
        """How many shapes are known already."""
        return len(self._shapes)

    def begin(
        self,
        prologue: bytes,
        tag: bytes,
        said: dict[str, str],
        instance: int | None,
        first: int,
        place: int,
    ) -> Run:
        """A device stream begins; ``first`` elements wait already."""
        device = self._devices.setdefault(tag, len(self._devices))
        if device == len(self._names):
            self._names.append(device_name(said))
        run = Run(prologue, tag, said, instance, device, first, place)
        self.runs.append(run)
        return run

    def restart(self, run: Run | None, place: int) -> None:
        """A batch was handed over in the middle of ``run``."""
        self.runs.clear()
        self.notes.clear()
        if run is not None:
            self.begin(run.prologue, run.tag, run.said, run.instance, 0, place)

    def batch(self, n: int, shapes: Ints, n_shapes: int) -> tuple[Batch, Broken | None]:
        """The first ``n`` elements as a batch, up to the first that is not well formed."""
        for s in range(self.known, n_shapes):
            self._learn(s, shapes[s])
        self._text_slots.fill(-1)
        self._date[0] = -1
        parsing.values(
            self.buffer, self.elements, n, self._manners, self._rows, self._numbers,
            self._sequences, self._texts, self._text_slots, self._slow, self._hard, self._counts,
            self._date, self._three,
        )  # fmt: skip
        n_rows, n_texts, n_slow, n_hard = self._counts.tolist()
        slow = sorted(self._slow[:n_slow].tolist() + self._hard_numbers(n_hard))
        careful, places, broken = self._careful(slow)
        n = slow[broken] if broken is not None else n
        for first, at, reason in self.notes:
            if first <= n:
                content = self._document.content
                careful.reject(content.line(at), reason, content.excerpt(at))
        careful.rejected.sort(key=lambda rejection: rejection.line or 0)
        table = self._table(n_rows, n_texts, n, careful, places)
        read = n + sum(first <= n for first, _, _ in self.notes)
        kept = read - len(careful.rejected)
        batch = Batch(observations=table, read=read, kept=kept, rejected=careful.rejected)
        return batch, self._broken(n) if broken is not None else None

    def _broken(self, e: int) -> Broken:
        run = self._run(e)
        start = int(self.elements[e, scanning.E_START])
        return run, start, self._section(e), run.place + e - run.first

    def _run(self, e: int) -> Run:
        return self.runs[bisect_right(self.runs, e, key=lambda run: run.first) - 1]

    def _section(self, e: int) -> int:
        s = int(self.elements[e, scanning.E_SHAPE])
        return -1 - s if s < 0 else int(self._codes[s, SECTION])

    # Shapes -------------------------------------------------------------------------------------

    def _learn(self, s: int, row: Ints) -> None:
        device, section = divmod(int(row[tagging.S_CONTEXT]), 4)
        self._codes[s, SECTION] = section
        shape = self._shape(row, self._names[device], _SECTIONS[section])
        self._shapes.append(shape)
        self._manners[s] = _MANNERS.get((shape.manner, shape.spatial), parsing.CAREFUL)
        self._codes[s, ITEM] = self._items.setdefault(shape.data_item, len(self._items))
        self._codes[s, KIND] = KINDS.index(shape.kind)
        if shape.key is not None:
            self._codes[s, KEY] = self._keys.setdefault(shape.key, len(self._keys))
        if shape.level is not None:
            self._codes[s, LEVEL] = _LEVELS.index(shape.level)

    def _shape(self, row: Ints, device: str, section: str) -> Shape:
        """The shape as the careful way sees it; one that it refuses is left to it."""
        start, length = int(row[tagging.S_START]), int(row[tagging.S_END])
        tag = self._document.content.mapped[start : start + length]
        name = tag[1 : 1 + int(row[tagging.S_NAME])]
        closed = tag if row[tagging.S_FLAGS] & tagging.F_EMPTY else tag + b"</" + name + b">"
        found = attributes_of(closed)
        if found is None:
            return _REFUSED
        said = found[name.decode()]
        del said["timestamp"], said["sequence"]
        try:
            naming = self._document.asked.naming
            return shape_of(section, local(name.decode()), said, device, naming)
        except MalformedError:
            return _REFUSED

    # Elements that are read carefully -----------------------------------------------------------

    def _hard_numbers(self, n: int) -> list[int]:
        """Put in the numbers that need all digits; elements whose number is none."""
        refused = []
        for r, a, b in self._hard[:n].tolist():
            value = number_of(self._document.content.mapped[a:b].decode())
            self._numbers[r] = np.nan if value is None else value
            if value is None:
                refused.append(int(self._rows[r, parsing.R_ELEMENT]))
                self._rows[r, parsing.R_ELEMENT] = _DROPPED
        return refused

    def _careful(self, slow: list[int]) -> tuple[Rows, list[int], int | None]:
        """Read elements one by one: rows, the element of each, which of ``slow`` is malformed."""
        single, rows = self._single, Rows()
        places: list[int] = []
        for i, e in enumerate(slow):
            run, section = self._run(e), _TAGS[self._section(e)]
            single.begin()
            single.rows, single.place = rows, run.place + e - run.first
            context = run.prologue + run.tag + b"<ComponentStream><" + section + b">"
            closing = b"</" + section + _CLOSING
            start = int(self.elements[e, scanning.E_START])
            stop = int(self.elements[e, scanning.E_CLOSE])
            if single.parse(start, context, stop, closing).reason:
                return rows, places, i
            places += [e] * (len(rows.rows) - len(places))
        return rows, places, None

    # Rows ---------------------------------------------------------------------------------------

    def _table(
        self, n_rows: int, n_texts: int, n: int, careful: Rows, places: list[int]
    ) -> pa.Table:
        """Rows of the elements before the one numbered ``n``, with those read carefully between."""
        rows = self._rows[:n_rows]
        keep: slice | Ints = slice(None)
        if n_rows and int(rows[:, parsing.R_ELEMENT].max()) >= n:
            keep = np.flatnonzero(rows[:, parsing.R_ELEMENT] < n)
        rows = rows[keep]
        element = rows[:, parsing.R_ELEMENT]
        shape = self.elements[element, scanning.E_SHAPE]
        columns = [
            pa.array(rows[:, parsing.R_TIME].copy()).view(OBSERVATIONS.field("time").type),
            encoded(self._codes[shape, ITEM], list(self._items)),
            numbers(self._numbers[:n_rows][keep].copy()),
            *self._text_and_attributes(rows, shape, n_texts),
            pa.array(self._sequences[:n_rows][keep].copy()),
            encoded(self._codes[shape, KIND], list(KINDS)),
            self._key(rows, shape),
            self._instance(element),
        ]
        columns.insert(7, columns.pop(4))
        table = pa.table(columns, schema=OBSERVATIONS)
        return merged(table, element, careful.table(), places) if places else table

    def _key(self, rows: Ints, shape: Ints) -> pa.Array:
        axis = rows[:, parsing.R_AXIS]
        return encoded(np.where(axis >= 0, axis, self._codes[shape, KEY]), list(self._keys))

    def _text_and_attributes(
        self, rows: Ints, shape: Ints, n_texts: int
    ) -> tuple[pa.Array, pa.Array]:
        mapped = self._document.content.mapped
        texts = [mapped[a : a + n].decode() for a, n in self._texts[:n_texts].tolist()]
        level, said = self._codes[shape, LEVEL], rows[:, parsing.R_TEXT]
        condition = self._codes[shape, KIND] == KINDS.index("CONDITION")
        code = np.where(said >= 0, said + len(_LEVELS), -1)
        code = np.where(condition, level, code)
        attributes = [s.attributes for s in self._shapes]
        which = shape.copy()
        # Each message that a condition comes with makes attributes of its own.
        with_message = np.flatnonzero(condition & (said >= 0))
        pairs = shape[with_message] * RECORDS + said[with_message]
        unique, place = np.unique(pairs, return_inverse=True)
        which[with_message] = len(attributes) + place
        for pair in unique.tolist():
            s, t = divmod(pair, RECORDS)
            attributes.append(json_of({**self._shapes[s].rest, "message": texts[t]}))
        taken = pa.array(attributes, pa.string()).take(pa.array(which))
        return encoded(code, _LEVELS + texts), taken

    def _instance(self, element: Ints) -> pa.Array:
        first = np.array([run.first for run in self.runs], np.int64)
        known = np.array([run.instance or 0 for run in self.runs], np.uint64)
        missing = np.array([run.instance is None for run in self.runs], bool)
        run = np.searchsorted(first, element, "right") - 1
        mask = missing[run] if missing.any() else None
        return pa.array(known[run], mask=mask)
