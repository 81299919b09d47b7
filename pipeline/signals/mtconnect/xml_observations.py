"""Observations, assets, data items and errors from the elements of MTConnect XML, as they come."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from pipeline.signals.formats import Batch, RecordSource
from pipeline.signals.mtconnect.model import DeviceModel
from pipeline.signals.mtconnect.observations import (
    BLANK,
    SECTIONS,
    Entry,
    MalformedError,
    Naming,
    Shape,
    asset_shape,
    asset_time,
    sequence_of,
    shape_of,
)
from pipeline.signals.mtconnect.rows import Rows, SampleBatch
from pipeline.signals.mtconnect.xml_events import Content, End, XmlEvents, local, quoted

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
    """Fills ``rows`` with observations; ``place`` counts the records of the whole file."""

    def __init__(self, content: Content, selection: Selection) -> None:
        super().__init__(content)
        self.rows = Rows()
        self.place = 0
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
        batch = self.rows.batch()
        self.rows = Rows()
        return batch

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
        self.place += 1
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
        else:
            self.place += len(waiting)
        waiting.flat.clear()

    def _record(
        self, at: int, shape: Shape, timestamp: str | None, sequence: str | None, value: Any
    ) -> None:
        if isinstance(value, str):
            value = value.strip(BLANK)
        try:
            self.rows.record(shape, timestamp, sequence, self.instance, self.place + 1, value)
            self.place += 1
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


_ASIDE = re.compile(rb"<!--.*?-->|<\?.*?\?>", re.S)
_LINE = re.compile(rb"[^\n]+")
_TRANSPORT = re.compile(
    rb"\s*(?:--\S*|[A-Za-z][A-Za-z0-9-]*:.*|HTTP/\d\S* \d+.*|[0-9A-Fa-f]{1,16}|)\s*"
)

DOCUMENTS = {"MTConnectStreams": "streams", "MTConnectDevices": "devices",
             "MTConnectAssets": "assets", "MTConnectError": "error"}  # fmt: skip


def instance_of(header: dict[str, str]) -> int | None:
    """The agent's instanceId, None when it is no number."""
    try:
        return sequence_of(header["instanceId"])
    except (KeyError, MalformedError):
        return None


class Document(Streams):
    """Fills ``rows`` from one document of any kind."""

    def __init__(self, content: Content, selection: Selection) -> None:
        super().__init__(content, selection)
        self.root = ""
        self._form = ""
        self._markup = False
        self._created: str | None = None
        self._message: str | None = None

    def begin(self) -> None:
        """Forget the document before, keep the count of records."""
        self.forget_document()
        self.root = self._form = ""
        self._markup, self._created = False, None

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """An element that is no observation begins."""
        tag = local(name)
        if self.depth == 1:
            self._start_root(tag, attributes)
        if tag == "Header" and self.depth == 2:
            self._created, self.instance = attributes.get("creationTime"), instance_of(attributes)
        elif self._form == "streams":
            self.start_stream(tag, attributes)
        elif (self._form == "assets" and self.depth >= 3) or self._form == "asset":
            self._start_asset(name, tag, attributes)
        elif self._form == "devices" and tag == "DataItem":
            self._data_item(attributes)
        elif self._form == "error":
            self._start_error(tag, attributes)

    def end(self, name: str) -> None:
        """An element that is no observation ends."""
        if self._form in ("assets", "asset"):
            self._end_asset(name)
        elif self._form == "error":
            self._end_error(local(name))
        elif self._foreign == self.depth:
            self._foreign = None

    def characters(self, text: str) -> None:
        """Text of an asset or of an error."""
        if self._markup:
            text = escape(text)
        self._length += len(text)
        if self._length <= LONGEST:
            self._text.append(text)

    @property
    def known(self) -> bool:
        """Whether the root was one of a document, a device or an asset of MTConnect."""
        return bool(self._form)

    def _start_root(self, tag: str, attributes: dict[str, str]) -> None:
        self.root = tag
        self._form = DOCUMENTS.get(tag, "")
        if tag in ("Device", "fragment"):
            self._form = "devices"
        elif "assetId" in attributes:
            self._form = "asset"
        self._markup = self._form in ("assets", "asset")
        if self._form == "streams":
            # Texts are many; their lengths are looked at between chunks.
            self._parser.CharacterDataHandler = self._text.append

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        self._tag, self._attributes, self._began = tag, attributes, self.at
        self._text.clear()
        self._length = 0

    def cut(self, end: End) -> None:
        """Reject what is lost from where the document is not well formed to the next one."""
        if end.reason:
            self.reject(end.at, f"the document breaks off here ({end.reason})")

    def stray(self, at: int, to: int) -> None:
        """Reject what stands between two documents if it is of none."""
        begin = self._stray_at(at, to)
        if begin is not None:
            self.reject(begin, f"{to - begin} bytes between documents are of none")

    def _stray_at(self, at: int, to: int) -> int | None:
        """First place from ``at`` to ``to`` of something neither blank nor transport."""
        text = _ASIDE.sub(lambda aside: b" " * len(aside[0]), self.content.mapped[at:to])
        for line in _LINE.finditer(text):
            if not _TRANSPORT.fullmatch(line[0]):
                return at + line.start()
        return None

    def _start_asset(self, name: str, tag: str, attributes: dict[str, str]) -> None:
        if self.depth == (1 if self._form == "asset" else 3):
            self._begin(tag, attributes)
        markup = "".join(f" {k}={quoteattr(v)}" for k, v in attributes.items())
        self._text.append(f"<{name}{markup}>")

    def _end_asset(self, name: str) -> None:
        if self._form == "assets" and self.depth < 3:
            return
        self._text.append(f"</{name}>")
        if self.depth == (1 if self._form == "asset" else 3):
            self._keep_asset()

    def _keep_asset(self) -> None:
        attributes, naming = self._attributes, self.selection.naming
        shape = asset_shape(
            attributes.get("deviceUuid", ""), attributes.get("assetId"),
            {"xml": "".join(self._text)}, naming,
        )  # fmt: skip
        try:
            if not shape.key:
                raise MalformedError(f"the asset {quoted(self._tag)} has no assetId")
            if self._length > LONGEST:
                raise MalformedError(f"the asset has {self._length} characters")
            time = asset_time(attributes.get("timestamp") or self._created)
            self.rows.add(shape, time, self.place + 1, self.instance, self._tag)
            self.place += 1
        except MalformedError as malformed:
            self.reject(self._began, str(malformed))

    def _data_item(self, attributes: dict[str, str]) -> None:
        if attributes.get("id"):
            self.rows.read += 1
            self.place += 1
        else:
            self.reject(self.at, "the data item has no id")

    def _start_error(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "Error" or (self.depth == 3 and not self._tag):
            self._begin(tag, attributes)
            self._message = None
        elif tag == "ErrorMessage":
            self._text.clear()

    def _end_error(self, tag: str) -> None:
        text = "".join(self._text).strip(BLANK)
        if tag == "ErrorMessage":
            self._message = text
        elif tag == self._tag:
            code = self._attributes.get("errorCode") or self._tag
            self.reject(self._began, f"the agent answered {code}: {self._message or text}")
            self._tag = ""
