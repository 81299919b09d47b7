"""The careful way through an MTConnect document: element by element, whatever its form.

It reads Streams, Devices, Assets and Error documents, and lone devices and assets.  The quick way
(:mod:`pipeline.signals.mtconnect_quick`) hands over to it whatever it does not know.
"""

import re
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from pipeline.signals.mtconnect_rows import Entry, Rows
from pipeline.signals.mtconnect_text import Content, End, XmlEvents, local, quoted
from pipeline.signals.mtconnect_words import (
    BLANK,
    SECTIONS,
    Malformed,
    Naming,
    Shape,
    json_of,
    nanoseconds,
    sequence_of,
    shape_of,
)
from pipeline.signals.records import Batch

LONGEST = 1 << 24
"""Characters of one observation's text, or of one asset, above which it is rejected."""

_ASIDE = re.compile(rb"<!--.*?-->|<\?.*?\?>", re.S)
_LINE = re.compile(rb"[^\n]+")
_TRANSPORT = re.compile(
    rb"\s*(?:--\S*|[A-Za-z][A-Za-z0-9-]*:.*|HTTP/\d\S* \d+.*|[0-9A-Fa-f]{1,16}|)\s*"
)

DOCUMENTS = {"MTConnectStreams": "streams", "MTConnectDevices": "devices",
             "MTConnectAssets": "assets", "MTConnectError": "error"}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What was asked of a file: how items are named, and which device (None for all)."""

    naming: Naming
    device: frozenset[str] | None

    def wants(self, said: dict[str, str]) -> bool:
        """Whether a device stream is one to keep."""
        device = self.device
        return device is None or said.get("name") in device or said.get("uuid") in device


def stray_reason(length: int) -> str:
    """Why bytes between two documents are rejected."""
    return f"{length} bytes between documents are of none"


def foreign_reason(device: str) -> str:
    """Why a whole device stream is rejected, as one record."""
    return f"the stream of device {device!r} is not of the chosen one"


def instance_of(header: dict[str, str]) -> int | None:
    """The agent's instanceId, None when it is no number."""
    try:
        return sequence_of(header["instanceId"])
    except (KeyError, Malformed):
        return None


def device_name(said: dict[str, str]) -> str:
    """What the device of a device stream is called."""
    return said.get("name") or said.get("uuid") or "?"


class Document(XmlEvents):
    """Fills ``rows`` from one document; ``place`` counts the records of the whole file."""

    def __init__(self, content: Content, asked: Asked) -> None:
        super().__init__(content)
        self.rows = Rows()
        self.place = 0
        self.root = ""
        self.instance: int | None = None
        self.asked = asked
        self._created: str | None = None
        self._form = ""
        self._markup = False
        self._device = ""
        self._section = ""
        self._observation = 0  # depth of observations
        self._foreign: int | None = None  # depth of a device stream that was not asked for
        self._shapes: dict[Any, Shape] = {}
        self._said: dict[str, str] = {}
        self._tag = ""
        self._began = 0
        self._text: list[str] = []
        self._length = 0
        self._entries: list[Entry] | None = None
        self._entry: tuple[dict[str, str], list[tuple[str, str]]] | None = None
        self._cell = ""
        self._stranger: str | None = None  # an element inside an observation that is no entry
        self._message: str | None = None

    # Every document -----------------------------------------------------------------------------

    def begin(self) -> None:
        """Forget the document before, keep the count of records."""
        self.root, self._form, self._device, self._section, self._tag = "", "", "", "", ""
        self._markup = False
        self._text.clear()
        self.instance, self._created, self._foreign = None, None, None
        self._observation = 0

    def _start(self, name: str, said: dict[str, str]) -> None:
        # Nearly all elements are observations: no detour for them.
        self.depth += 1
        if self.depth != self._observation:
            self.start(name, said)
            return
        self._tag, self._said, self._began = name, said, self._parser.CurrentByteIndex
        self._entries = self._stranger = None
        self._length = 0
        self._text.clear()

    def _end(self, name: str) -> None:
        if self.depth == self._observation:
            self._end_observation()
            self.depth -= 1
        else:
            super()._end(name)

    def start(self, name: str, said: dict[str, str]) -> None:
        """An element that is no observation begins."""
        if self.depth > self._observation > 0:
            self._start_inside(name, said)
            return
        tag = local(name)
        if self.depth == 1:
            self._start_root(tag, said)
        if tag == "Header" and self.depth == 2:
            self._header(said)
        elif self._form == "streams":
            self._start_stream(tag, said)
        elif (self._form == "assets" and self.depth >= 3) or self._form == "asset":
            self._start_asset(name, tag, said)
        elif self._form == "devices" and tag == "DataItem":
            self._data_item(said)
        elif self._form == "error":
            self._start_error(tag, said)

    def end(self, name: str) -> None:
        """An element that is no observation ends."""
        if self._section:
            self._end_in_section()
        elif self._form in ("assets", "asset"):
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

    def handed_over(self) -> Batch:
        """What was read since the last batch."""
        batch = self.rows.batch()
        self.rows = Rows()
        return batch

    def between(self) -> None:
        """Let go of a text that is too long to keep."""
        if len(self._text) > 1:
            length = sum(map(len, self._text))
            if length > LONGEST:
                self._length += length
                self._text.clear()

    @property
    def known(self) -> bool:
        """Whether the root was one of a document, a device or an asset of MTConnect."""
        return bool(self._form)

    def _start_root(self, tag: str, said: dict[str, str]) -> None:
        self.root = tag
        self._form = DOCUMENTS.get(tag, "")
        if tag in ("Device", "fragment"):
            self._form = "devices"
        elif "assetId" in said:
            self._form = "asset"
        self._markup = self._form in ("assets", "asset")
        if self._form == "streams":
            # Texts are many; their lengths are looked at between stretches.
            self._parser.CharacterDataHandler = self._text.append

    def _header(self, said: dict[str, str]) -> None:
        self._created = said.get("creationTime")
        self.instance = instance_of(said)

    def _begin(self, tag: str, said: dict[str, str]) -> None:
        self._tag, self._said, self._began = tag, said, self.at
        self._text.clear()
        self._length = 0

    def cut(self, end: End) -> None:
        """Reject what is lost from where the document is not well formed to the next one."""
        if end.reason:
            self.reject(end.at, f"the document breaks off here ({end.reason})")

    def stray(self, at: int, to: int) -> None:
        """Reject what stands between two documents if it is of none."""
        begin = self.stray_at(at, to)
        if begin is not None:
            self.reject(begin, stray_reason(to - begin))

    def stray_at(self, at: int, to: int) -> int | None:
        """Where, from ``at`` to ``to``, something begins that is neither blank nor transport."""
        text = _ASIDE.sub(lambda aside: b" " * len(aside[0]), self.content.mapped[at:to])
        for line in _LINE.finditer(text):
            if not _TRANSPORT.fullmatch(line[0]):
                return at + line.start()
        return None

    def reject(self, at: int, reason: str) -> None:
        """Reject the record that begins at byte ``at``."""
        self.place += 1
        self.rows.reject(self.content.line(at), reason, self.content.excerpt(at))

    # Streams ------------------------------------------------------------------------------------

    def _start_stream(self, tag: str, said: dict[str, str]) -> None:
        if self._foreign:
            return
        if tag == "DeviceStream":
            self._device = device_name(said)
            if not self.asked.wants(said):
                self._foreign = self.depth
                self.reject(self.at, foreign_reason(self._device))
        elif tag in SECTIONS:
            self._section, self._observation = SECTIONS[tag], self.depth + 1
        elif "dataItemId" in said or "sequence" in said:
            reason = f"the element {quoted(tag)} stands outside Samples, Events and Condition"
            self.reject(self.at, reason)

    def _start_inside(self, name: str, said: dict[str, str]) -> None:
        inside = self.depth - self._observation
        if inside == 1:
            self._entries = [] if self._entries is None else self._entries
            self._entry = (said, [])
        elif inside == 2:
            self._cell = said.get("key", "")
        if local(name) != ("Entry" if inside == 1 else "Cell"):
            self._stranger = local(name)
        self._text.clear()

    def _end_in_section(self) -> None:
        inside = self.depth - self._observation
        if inside == 1 and self._entry is not None and self._entries is not None:
            said, cells = self._entry
            removed = said.get("removed", "").strip().lower() in ("true", "1")
            text = "".join(self._text).strip(BLANK)
            table = tuple(cells) if cells else None
            self._entries.append(Entry(said.get("key", ""), text, removed, table))
        elif inside == 2 and self._entry is not None:
            self._entry[1].append((self._cell, "".join(self._text).strip(BLANK)))
        elif inside == -1:
            self._section, self._observation = "", 0
        self._text.clear()

    def _end_observation(self) -> None:
        said = self._said
        timestamp = said.pop("timestamp", None)
        sequence = said.pop("sequence", None)
        text = self._text
        value: Any = (text[0] if len(text) == 1 else "".join(text)).strip(BLANK)
        known = (self._section, self._device, self._tag, *said, *said.values())
        try:
            self._check(value)
            shape = self._shapes.get(known) or self._new_shape(known)
            if self._entries is not None:
                value = self._entries
            self.rows.record(shape, timestamp, sequence, self.instance, self.place + 1, value)
            self.place += 1
        except Malformed as malformed:
            self.reject(self._began + self._shift, str(malformed))

    def _check(self, value: str) -> None:
        if self._length or len(value) > LONGEST:
            raise Malformed(f"the observation has {self._length + len(value)} characters of text")
        if self._stranger is not None:
            raise Malformed(f"the observation holds {quoted(self._stranger)}, which is no entry")

    def _new_shape(self, known: Any) -> Shape:
        if len(self._shapes) > 100_000:
            self._shapes.clear()
        naming = self.asked.naming
        shape = shape_of(self._section, local(self._tag), self._said, self._device, naming)
        self._shapes[known] = shape
        return shape

    # Assets -------------------------------------------------------------------------------------

    def _start_asset(self, name: str, tag: str, said: dict[str, str]) -> None:
        if self.depth == (1 if self._form == "asset" else 3):
            self._begin(tag, said)
        markup = "".join(f" {k}={quoteattr(v)}" for k, v in said.items())
        self._text.append(f"<{name}{markup}>")

    def _end_asset(self, name: str) -> None:
        if self._form == "assets" and self.depth < 3:
            return
        self._text.append(f"</{name}>")
        if self.depth == (1 if self._form == "asset" else 3):
            self._keep_asset()

    def _keep_asset(self) -> None:
        said = self._said
        shape = Shape(
            data_item=self.asked.naming.label(said.get("deviceUuid", ""), None, "asset"),
            kind="ASSET",
            manner="text",
            key=said.get("assetId"),
            attributes=json_of({"xml": "".join(self._text)}),
        )
        try:
            if not shape.key:
                raise Malformed(f"the asset {quoted(self._tag)} has no assetId")
            if self._length > LONGEST:
                raise Malformed(f"the asset has {self._length} characters")
            timestamp = said.get("timestamp") or self._created
            if timestamp is None:
                raise Malformed("the asset has no timestamp and its document no creationTime")
            self.rows.add(shape, nanoseconds(timestamp), self.place + 1, self.instance, self._tag)
            self.place += 1
        except Malformed as malformed:
            self.reject(self._began, str(malformed))

    # Devices and errors -------------------------------------------------------------------------

    def _data_item(self, said: dict[str, str]) -> None:
        if said.get("id"):
            self.rows.read += 1
            self.place += 1
        else:
            self.reject(self.at, "the data item has no id")

    def _start_error(self, tag: str, said: dict[str, str]) -> None:
        if tag == "Error" or (self.depth == 3 and not self._tag):
            self._begin(tag, said)
            self._message = None
        elif tag == "ErrorMessage":
            self._text.clear()

    def _end_error(self, tag: str) -> None:
        text = "".join(self._text).strip(BLANK)
        if tag == "ErrorMessage":
            self._message = text
        elif tag == self._tag:
            code = self._said.get("errorCode") or self._tag
            self.reject(self._began, f"the agent answered {code}: {self._message or text}")
            self._tag = ""
