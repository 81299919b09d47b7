"""Observations from the elements of MTConnect XML as they come, and their rows in batches.

Plain samples are converted many at a time, all other observations one by one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import OBSERVATIONS, TIME
from pipeline.signals.formats import EXCERPT, Batch, RecordSource, Rejection, observations_of
from pipeline.signals.mtconnect.devices import DeviceModel
from pipeline.signals.mtconnect.observations import (
    BLANK,
    SECTIONS,
    Entry,
    MalformedError,
    Naming,
    Shape,
    json_of,
    nanoseconds,
    sequence_of,
    shape_of,
    values_of,
)
from pipeline.signals.mtconnect.xml_events import Content, XmlEvents, local, quoted


@dataclass
class SampleBatch:
    """Samples to be read together: timestamp, sequence, value, shape, place, and again.

    One flat list of plain values: with many objects alive, the garbage collector would take longer
    than the reading.
    """

    flat: list[Any] = field(default_factory=list)
    known: list[Shape] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.flat) // 5

    def each(self) -> Iterator[tuple[str, str, str, int, int]]:
        """Timestamp, sequence, value, number of the shape and place of each sample."""
        flat = self.flat
        return zip(flat[::5], flat[1::5], flat[2::5], flat[3::5], flat[4::5], strict=True)

    def table(self, instance: int | None) -> pa.Table | None:
        """The samples as rows; None when one of them is not as agents write it."""
        stamps, sequences, values = (pa.array(self.flat[i::5], pa.string()) for i in range(3))
        within = pc.min_max(stamps)
        if not (within["min"].as_py() >= "1678" and within["max"].as_py() < "2262"):
            return None
        known = pc.not_equal(values, "UNAVAILABLE")
        try:
            time = stamps.cast(TIME)
            number = pc.if_else(known, values, None).cast(pa.float64())
            sequence = sequences.cast(pa.uint64())
        except pa.ArrowInvalid:
            return None
        finite = pc.all(pc.is_finite(number), min_count=0).as_py()
        if not finite or not pc.all(pc.utf8_is_decimal(sequences)).as_py():
            return None
        n, code = len(time), pa.array(self.flat[3::5], pa.int32())
        columns = {
            "time": time,
            "data_item": _words([s.data_item for s in self.known]).dictionary_encode().take(code),
            "number": number,
            "text": pa.nulls(n, OBSERVATIONS.field("text").type),
            "sequence": sequence,
            "kind": _words([s.kind for s in self.known]).dictionary_encode().take(code),
            "key": _words([s.key for s in self.known]).dictionary_encode().take(code),
            "attributes": _words([s.attributes for s in self.known]).take(code),
            "instance": pa.array([instance], pa.uint64()).take(pa.nulls(n, pa.int8()).fill_null(0)),
        }
        return pa.table([columns[name] for name in OBSERVATIONS.names], schema=OBSERVATIONS)


def _words(words: list[str | None]) -> pa.Array:
    return pa.array(words, pa.string())


RECORDS = 200_000
"""Records after which a batch is handed over."""


Row = tuple[int, float | None, str | None, int, str | None, str | None, int | None, Shape]
"""Time, number, text, sequence, key, attributes, instance, shape."""


def _table(rows: list[Row]) -> pa.Table:
    time, number, text, sequence, key, attributes, instance, shapes = (
        zip(*rows, strict=True) if rows else ((),) * 8
    )
    columns = {
        "time": time, "number": number, "text": text, "sequence": sequence, "key": key,
        "attributes": attributes, "instance": instance,
        "data_item": [shape.data_item for shape in shapes], "kind": [s.kind for s in shapes],
    }  # fmt: skip
    return observations_of(columns, len(rows))


@dataclass
class Rows:
    """Rows that grow, and the count of what was read, kept and rejected."""

    rows: list[Row] = field(default_factory=list)
    tables: list[pa.Table] = field(default_factory=list)  # what stood before them
    read: int = 0
    rejected: list[Rejection] = field(default_factory=list)
    before: int = 0
    """Records of earlier batches."""

    @property
    def place(self) -> int:
        """Place in the file of the next record, from 1."""
        return self.before + self.read + 1

    def table(self) -> pa.Table:
        """Table of the rows so far."""
        if not self.rows and self.tables:
            return pa.concat_tables(self.tables)
        return pa.concat_tables([*self.tables, _table(self.rows)])

    def reject(self, line: int | None, reason: str, excerpt: str = "") -> None:
        """Count one record as read and not kept."""
        self.read += 1
        self.rejected.append(Rejection(line=line, reason=reason, excerpt=excerpt[:EXCERPT]))

    def add(
        self, shape: Shape, time: int, instance: int | None, value: Any, sequence: int | None = None
    ) -> None:
        """Keep one record: all its rows, or none where the value does not fit the shape.

        ``time`` is in nanoseconds since 1970, ``value`` the text or a list of the entries inside
        it; a record without ``sequence`` has its place.
        """
        sequence = self.place if sequence is None else sequence
        for at, (key, number, text, removed) in values_of(shape, time, value):
            attributes = shape.attributes
            if removed:
                attributes = json_of({**shape.rest, "removed": True})
            elif shape.manner == "condition" and value:
                attributes = json_of({**shape.rest, "message": value})
            self.rows.append((at, number, text, sequence, key, attributes, instance, shape))
        self.read += 1

    def record(
        self, shape: Shape, timestamp: str | None, sequence: str | None, instance: int | None,
        value: Any,
    ) -> None:  # fmt: skip
        """Keep one record whose time and sequence are still text."""
        if timestamp is None:
            raise MalformedError("the observation has no timestamp")
        number = None if sequence is None else sequence_of(sequence)
        self.add(shape, nanoseconds(timestamp), instance, value, number)

    def samples(self, waiting: SampleBatch, instance: int | None) -> bool:
        """Keep plain samples together, if each of them is one; else none of them.

        Many at once are read in a tenth of the time that one by one takes.
        """
        table = waiting.table(instance)
        if table is None:
            return False
        if self.rows:
            self.tables.append(_table(self.rows))
            self.rows = []
        self.tables.append(table)
        self.read += len(waiting)
        return True

    def batch(self) -> Batch:
        """Batch of all that was read since the last one."""
        batch = Batch(observations=self.table(), read=self.read, rejected=self.rejected)
        self.before += self.read
        self.rows, self.tables, self.read, self.rejected = [], [], 0, []
        return batch


TOGETHER = 32
"""Samples from which reading them together is faster."""

LONGEST = 1 << 24
"""Characters of one observation's text, or of one asset, above which it is rejected."""

MANY = 100_000
"""Shapes after which all are forgotten: where each tag differs, knowing them is no gain."""


_Latest = tuple[tuple[str, str], str, dict[str, str], int]
"""Section and device, element and attributes of an item's latest observation, its shape's place."""


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Selection of what is read from a file: naming of items, and the device (None for all)."""

    naming: Naming
    device: frozenset[str] | None

    def wants(self, attributes: dict[str, str]) -> bool:
        """Whether a device stream is one to keep."""
        device = self.device
        return (
            device is None or attributes.get("name") in device or attributes.get("uuid") in device
        )


def selection(
    source: RecordSource, model: DeviceModel | None, several_streams: Callable[[], bool]
) -> Selection:
    """Selection that ``source`` makes of a file whose streams may be of several devices."""
    if source.device is not None:
        names = {source.device}
        for device in model.devices if model else ():
            names |= {w for w in (device.name, device.uuid) if w}
        return Selection(naming=Naming(model=model, several=False), device=frozenset(names))
    several = (model is not None and model.several) or several_streams()
    return Selection(naming=Naming(model=model, several=several), device=None)


def foreign_reason(device: str) -> str:
    """Reason why a whole device stream is rejected, as one record."""
    return f"the stream of device {device!r} is not of the chosen one"


def device_name(attributes: dict[str, str]) -> str:
    """Name of the device of a device stream."""
    return attributes.get("name") or attributes.get("uuid") or "?"


class Streams(XmlEvents):
    """Fills ``rows`` with observations."""

    def __init__(self, content: Content, selection: Selection) -> None:
        super().__init__(content)
        self.rows = Rows()
        self.instance: int | None = None
        self.selection = selection
        self._device = ""
        self._section = ""
        self._foreign: int | None = None  # depth of a device stream that is not selected
        self._waiting = SampleBatch()
        self._codes: dict[Any, int] = {}  # places of the shapes in those of the waiting samples
        self._latest: dict[str | None, _Latest] = {}  # by item
        # The element that is being read:
        self._tag = ""
        self._attributes: dict[str, str] = {}
        self._began = 0
        self._text: list[str] = []
        self._length = 0  # of text that was not kept
        self._entries: list[Entry] | None = None
        self._entry: tuple[dict[str, str], list[tuple[str, str]]] | None = None
        self._cell = ""
        self._stranger: str | None = None  # an element inside an observation that is no entry

    def forget_document(self) -> None:
        """Forget the document before, keep the count of records."""
        self._settle()
        self._device = self._section = self._tag = ""
        self._foreign = self.instance = self._entries = self._stranger = None
        self._text.clear()

    def handed_over(self) -> Batch:
        """Observations since the last batch."""
        self._settle()
        return self.rows.batch()

    def between(self) -> None:
        """Read what waits, let go of a text that is too long to keep."""
        self._settle()
        if len(self._text) > 1:
            length = sum(map(len, self._text))
            if length > LONGEST:
                self._length += length
                self._text.clear()

    def reject(self, at: int, reason: str) -> None:
        """Reject the record that begins at byte ``at``."""
        self._settle()
        self._refuse(at, reason)

    def _refuse(self, at: int, reason: str) -> None:
        self.rows.reject(self.content.line(at), reason, self.content.excerpt(at))

    def start_stream(self, tag: str, attributes: dict[str, str]) -> None:
        """An element outside the sections begins."""
        if self._foreign:
            return
        if tag == "DeviceStream":
            self._device = device_name(attributes)
            if not self.selection.wants(attributes):
                self._foreign = self.depth
                self.reject(self.at, foreign_reason(self._device))
        elif tag in SECTIONS:
            self._read_section(SECTIONS[tag])
        elif "dataItemId" in attributes or "sequence" in attributes:
            reason = f"the element {quoted(tag)} stands outside Samples, Events and Condition"
            self.reject(self.at, reason)

    def _read_section(self, section: str) -> None:
        """Read elements as observations from here to the end of the section.

        Nearly all elements of a file are observations: the handlers look up nothing twice.
        """
        self._section = section
        parser, text, shift = self._parser, self._text, self._shift
        flat, known, latest = self._waiting.flat, self._waiting.known, self._latest
        context = section, self._device
        inside = began = 0
        attributes: dict[str, str] = {}

        def start(name: str, own: dict[str, str]) -> None:
            nonlocal inside, began, attributes
            inside += 1
            if inside > 1:
                self._start_inside(inside - 1, name, own)
                return
            attributes, began = own, parser.CurrentByteIndex
            self._length = 0
            text.clear()

        def end(name: str) -> None:
            nonlocal inside
            inside -= 1
            if inside > 0:
                self._end_inside(inside)
                return
            if inside < 0:
                self._section = ""
                parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
                self._end(name)
                return
            timestamp = attributes.pop("timestamp", None)
            sequence = attributes.pop("sequence", None)
            value = text[0] if len(text) == 1 else "".join(text)
            last = latest.get(attributes.get("dataItemId"))
            code = None
            if last and last[2] == attributes and last[1] == name and last[0] == context:
                code = last[3]
            plain = self._entries is None and not self._length and timestamp and sequence
            if code is not None and plain and known[code].manner == "number":
                flat.extend((timestamp, sequence, value, code, began + shift))
            else:
                times = timestamp, sequence
                self._observed(began + shift, context, name, attributes, times, value)

        parser.StartElementHandler, parser.EndElementHandler = start, end

    def _start_inside(self, inside: int, name: str, attributes: dict[str, str]) -> None:
        """An element begins ``inside`` levels below an observation."""
        if inside == 1:
            self._entries = [] if self._entries is None else self._entries
            self._entry = (attributes, [])
        elif inside == 2:
            self._cell = attributes.get("key", "")
        if local(name) != ("Entry" if inside == 1 else "Cell"):
            self._stranger = local(name)
        self._text.clear()

    def _end_inside(self, inside: int) -> None:
        if inside == 1 and self._entry is not None and self._entries is not None:
            attributes, cells = self._entry
            removed = attributes.get("removed", "").strip().lower() in ("true", "1")
            text = "".join(self._text).strip(BLANK)
            table = tuple(cells) if cells else None
            self._entries.append(Entry(attributes.get("key", ""), text, removed, table))
        elif inside == 2 and self._entry is not None:
            self._entry[1].append((self._cell, "".join(self._text).strip(BLANK)))
        self._text.clear()

    def _observed(
        self, at: int, context: tuple[str, str], tag: str, attributes: dict[str, str],
        times: tuple[str | None, str | None], value: str,
    ) -> None:  # fmt: skip
        self._settle()
        try:
            self._check(value)
            code = self._code(context, tag, attributes)
        except MalformedError as malformed:
            self._refuse(at, str(malformed))
        else:
            self._latest[attributes.get("dataItemId")] = context, tag, attributes, code
            inside = value if self._entries is None else self._entries
            self._record(at, self._waiting.known[code], *times, inside)
        self._entries = self._stranger = None

    def _settle(self) -> None:
        """Read the samples that wait, together or, if one of them is no plain one, one by one."""
        waiting = self._waiting
        if not waiting.flat:
            return
        if len(waiting) < TOGETHER or not self.rows.samples(waiting, self.instance):
            for timestamp, sequence, value, code, at in waiting.each():
                self._record(at, waiting.known[code], timestamp, sequence, value)
        waiting.flat.clear()

    def _record(
        self, at: int, shape: Shape, timestamp: str | None, sequence: str | None, value: Any
    ) -> None:
        if isinstance(value, str):
            value = value.strip(BLANK)
        try:
            self.rows.record(shape, timestamp, sequence, self.instance, value)
        except MalformedError as malformed:
            self._refuse(at, str(malformed))

    def _check(self, value: str) -> None:
        length = self._length + len(value.strip(BLANK))
        if self._length or length > LONGEST:
            raise MalformedError(f"the observation has {length} characters of text")
        if self._stranger is not None:
            stranger = quoted(self._stranger)
            raise MalformedError(f"the observation holds {stranger}, which is no entry")

    def _code(self, context: tuple[str, str], tag: str, attributes: dict[str, str]) -> int:
        key = context, tag, *attributes, *attributes.values()
        code = self._codes.get(key)
        if code is None:
            section, device = context
            shape = shape_of(section, local(tag), attributes, device, self.selection.naming)
            known = self._waiting.known
            if len(known) > MANY:
                known.clear()
                self._codes.clear()
                self._latest.clear()
            code = self._codes[key] = len(known)
            known.append(shape)
        return code


def instance_of(header: dict[str, str]) -> int | None:
    """The agent's instanceId, None when it is no number."""
    try:
        return sequence_of(header["instanceId"])
    except (KeyError, MalformedError):
        return None
