"""Batches of rows from the observations that the fast path located."""

from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pipeline.schema.arrays import Floats, Ints
from pipeline.signals.columns import KINDS, OBSERVATIONS
from pipeline.signals.formats import Batch, encoded
from pipeline.signals.mtconnect import scan as scanning
from pipeline.signals.mtconnect import tokens
from pipeline.signals.mtconnect.model import number_of
from pipeline.signals.mtconnect.observations import (
    AXES,
    LEVELS,
    MalformedError,
    Shape,
    json_of,
    shape_of,
)
from pipeline.signals.mtconnect.reference import Document, device_name
from pipeline.signals.mtconnect.rows import RECORDS, Rows
from pipeline.signals.mtconnect.xml_events import attributes_of, local


def numbers(values: Floats) -> pa.Array:
    """Numbers; null where there is none."""
    return pa.array(values, mask=np.isnan(values))


_SECTIONS = ("SAMPLE", "EVENT", "CONDITION")
_LEVELS = [level for level in LEVELS.values() if level]
_MANNERS = {
    ("number", False): tokens.NUMBER,
    ("number", True): tokens.SPATIAL_NUMBER,
    ("value", False): tokens.VALUE,
    ("value", True): tokens.SPATIAL_VALUE,
    ("text", False): tokens.TEXT,
    ("text", True): tokens.TEXT,
    ("condition", False): tokens.CONDITION,
    ("condition", True): tokens.CONDITION,
}
_TEXT_SLOTS = 1 << 19
_DROPPED = 1 << 62
_REFUSED = Shape(data_item="", kind="UNKNOWN", manner="set")
_TAGS = (b"Samples", b"Events", b"Condition")
_CLOSING = b"></ComponentStream></DeviceStream></Streams></MTConnectStreams>"

ITEM, KIND, KEY, LEVEL, SECTION = range(5)
"""Columns of the codes of a shape."""


@dataclass(frozen=True)
class DeviceRun:
    """Elements of one device stream: from number ``first`` on, after ``place`` records."""

    prologue: bytes
    tag: bytes
    instance: int | None
    device: int
    first: int
    place: int


BrokenElement = tuple[DeviceRun, int, int, int]
"""DeviceRun, byte, section and place of an element at which a document is not well formed."""


class Assembly:
    """What is known about shapes, and the elements' runs since the last batch."""

    def __init__(self, document: Document, buffer: npt.NDArray[np.uint8], elements: Ints) -> None:
        self.buffer = buffer
        self.elements = elements
        self.notes: list[tuple[int, int, str]] = []
        self.runs: list[DeviceRun] = []
        self._document = document
        self._single = Document(document.content, document.selection)
        self._devices: dict[bytes, int] = {}
        self._names: list[str] = []
        self._rows = np.empty((3 * RECORDS, tokens.ROW_COLUMNS), np.int64)
        self._numbers = np.empty(3 * RECORDS)
        self._sequences = np.empty(3 * RECORDS, np.uint64)
        self._texts = np.empty((RECORDS, 2), np.int64)
        self._text_slots = np.empty(_TEXT_SLOTS, np.int32)
        self._slow = np.empty(RECORDS, np.int64)
        self._hard = np.empty((RECORDS, 3), np.int64)
        self._counts = np.zeros(4, np.int64)
        self._three = np.empty(3)
        self.forget()

    def forget(self) -> None:
        """Start anew with the table of shapes."""
        self._shapes: list[Shape] = []
        self._manners = np.zeros(scanning.SHAPES, np.int64)
        self._codes = np.full((scanning.SHAPES, 5), -1, np.int32)
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
        attributes: dict[str, str],
        instance: int | None,
        first: int,
        place: int,
    ) -> DeviceRun:
        """A device stream begins; ``first`` elements wait already."""
        device = self._devices.setdefault(tag, len(self._devices))
        if device == len(self._names):
            self._names.append(device_name(attributes))
        run = DeviceRun(prologue, tag, instance, device, first, place)
        self.runs.append(run)
        return run

    def restart(self, run: DeviceRun | None, place: int) -> None:
        """A batch was handed over in the middle of ``run``."""
        self.runs = [] if run is None else [replace(run, first=0, place=place)]
        self.notes.clear()

    def batch(self, n: int, shapes: Ints, n_shapes: int) -> tuple[Batch, BrokenElement | None]:
        """The first ``n`` elements as a batch, up to the first that is not well formed."""
        for s in range(self.known, n_shapes):
            self._learn(s, shapes[s])
        self._text_slots.fill(-1)
        tokens.values(
            self.buffer, self.elements, n, self._manners, self._rows, self._numbers,
            self._sequences, self._texts, self._text_slots, self._slow, self._hard, self._counts,
            self._three,
        )  # fmt: skip
        n_rows, n_texts, n_slow, n_hard = self._counts.tolist()
        slow = sorted(self._slow[:n_slow].tolist() + self._hard_numbers(n_hard))
        reference, places, broken = self._by_reference(slow)
        n = slow[broken] if broken is not None else n
        for first, at, reason in self.notes:
            if first <= n:
                content = self._document.content
                reference.reject(content.line(at), reason, content.excerpt(at))
        reference.rejected.sort(key=lambda rejection: rejection.line or 0)
        table = self._table(n_rows, n_texts, n, reference, places)
        read = n + sum(first <= n for first, _, _ in self.notes)
        kept = read - len(reference.rejected)
        batch = Batch(observations=table, read=read, kept=kept, rejected=reference.rejected)
        return batch, self._broken(n) if broken is not None else None

    def _broken(self, e: int) -> BrokenElement:
        run = self._run(e)
        start = int(self.elements[e, tokens.E_START])
        return run, start, self._section(e), run.place + e - run.first

    def _run(self, e: int) -> DeviceRun:
        return self.runs[bisect_right(self.runs, e, key=lambda run: run.first) - 1]

    def _section(self, e: int) -> int:
        s = int(self.elements[e, tokens.E_SHAPE])
        return -1 - s if s < 0 else int(self._codes[s, SECTION])

    # Shapes -------------------------------------------------------------------------------------

    def _learn(self, s: int, row: Ints) -> None:
        device, section = divmod(int(row[scanning.S_CONTEXT]), 4)
        self._codes[s, SECTION] = section
        shape = self._shape(row, self._names[device], _SECTIONS[section])
        self._shapes.append(shape)
        self._manners[s] = _MANNERS.get((shape.manner, shape.spatial), tokens.REFERENCE)
        self._codes[s, ITEM] = self._items.setdefault(shape.data_item, len(self._items))
        self._codes[s, KIND] = KINDS.index(shape.kind)
        if shape.key is not None:
            self._codes[s, KEY] = self._keys.setdefault(shape.key, len(self._keys))
        if shape.level is not None:
            self._codes[s, LEVEL] = _LEVELS.index(shape.level)

    def _shape(self, row: Ints, device: str, section: str) -> Shape:
        """The shape as the reference path sees it; one that it refuses is left to it."""
        start, length = int(row[scanning.S_START]), int(row[scanning.S_END])
        tag = self._document.content.mapped[start : start + length]
        name = tag[1 : 1 + int(row[scanning.S_NAME])]
        closed = tag if row[scanning.S_FLAGS] & scanning.F_EMPTY else tag + b"</" + name + b">"
        found = attributes_of(closed)
        if found is None:
            return _REFUSED
        attributes = found[name.decode()]
        del attributes["timestamp"], attributes["sequence"]
        try:
            naming = self._document.selection.naming
            return shape_of(section, local(name.decode()), attributes, device, naming)
        except MalformedError:
            return _REFUSED

    # Elements read by the reference path ----------------------------------------------------------

    def _hard_numbers(self, n: int) -> list[int]:
        """Put in the numbers that need all digits; elements whose number is none."""
        refused = []
        for r, a, b in self._hard[:n].tolist():
            value = number_of(self._document.content.mapped[a:b].decode())
            self._numbers[r] = np.nan if value is None else value
            if value is None:
                refused.append(int(self._rows[r, tokens.R_ELEMENT]))
                self._rows[r, tokens.R_ELEMENT] = _DROPPED
        return refused

    def _by_reference(self, slow: list[int]) -> tuple[Rows, list[int], int | None]:
        """Read elements one by one: rows, the element of each, which of ``slow`` is malformed."""
        single, rows = self._single, Rows()
        places: list[int] = []
        for i, e in enumerate(slow):
            run, section = self._run(e), _TAGS[self._section(e)]
            single.begin()
            single.rows, single.place = rows, run.place + e - run.first
            context = run.prologue + run.tag + b"<ComponentStream><" + section + b">"
            closing = b"</" + section + _CLOSING
            start = int(self.elements[e, tokens.E_START])
            stop = int(self.elements[e, tokens.E_CLOSE])
            if single.parse(start, context, stop, closing).reason:
                return rows, places, i
            places += [e] * (len(rows.rows) - len(places))
        return rows, places, None

    # Rows ---------------------------------------------------------------------------------------

    def _table(
        self, n_rows: int, n_texts: int, n: int, reference: Rows, places: list[int]
    ) -> pa.Table:
        """Rows of the elements before number ``n``, those of the reference path between them."""
        rows = self._rows[:n_rows]
        keep: slice | Ints = slice(None)
        if n_rows and int(rows[:, tokens.R_ELEMENT].max()) >= n:
            keep = np.flatnonzero(rows[:, tokens.R_ELEMENT] < n)
        rows = rows[keep]
        element = rows[:, tokens.R_ELEMENT]
        shape = self.elements[element, tokens.E_SHAPE]
        columns = [
            pa.array(rows[:, tokens.R_TIME].copy()).view(OBSERVATIONS.field("time").type),
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
        if not places:
            return table
        # In the order of the elements; rows of one element keep theirs.
        order = np.argsort(np.concatenate([element, np.array(places, np.int64)]), kind="stable")
        both = pa.concat_tables([table, reference.table()])
        return both.unify_dictionaries().combine_chunks().take(order)

    def _key(self, rows: Ints, shape: Ints) -> pa.Array:
        axis = rows[:, tokens.R_AXIS]
        return encoded(np.where(axis >= 0, axis, self._codes[shape, KEY]), list(self._keys))

    def _text_and_attributes(
        self, rows: Ints, shape: Ints, n_texts: int
    ) -> tuple[pa.Array, pa.Array]:
        mapped = self._document.content.mapped
        texts = [mapped[a : a + n].decode() for a, n in self._texts[:n_texts].tolist()]
        level, text = self._codes[shape, LEVEL], rows[:, tokens.R_TEXT]
        condition = self._codes[shape, KIND] == KINDS.index("CONDITION")
        code = np.where(text >= 0, text + len(_LEVELS), -1)
        code = np.where(condition, level, code)
        attributes = [s.attributes for s in self._shapes]
        which = shape.copy()
        # Each message that a condition comes with makes attributes of its own.
        with_message = np.flatnonzero(condition & (text >= 0))
        pairs = shape[with_message] * RECORDS + text[with_message]
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
