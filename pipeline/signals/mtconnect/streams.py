"""The careful way through the observations of an MTConnectStreams document."""

from dataclasses import dataclass
from typing import Any

from pipeline.signals.mtconnect.rows import Rows
from pipeline.signals.mtconnect.text import Content, XmlEvents, local, quoted
from pipeline.signals.mtconnect.values import Entry
from pipeline.signals.mtconnect.waiting import Waiting
from pipeline.signals.mtconnect.words import (
    BLANK,
    SECTIONS,
    MalformedError,
    Naming,
    Shape,
    shape_of,
)
from pipeline.signals.records import Batch

MODEST = 100
"""Characters of a sample's value that can wait to be read with others."""

TOGETHER = 32
"""Samples from which reading them together is faster."""

LONGEST = 1 << 24
"""Characters of one observation's text, or of one asset, above which it is rejected."""

MANY = 100_000
"""Shapes after which all are forgotten: where each tag differs, knowing them is no gain."""


_Last = tuple[tuple[str, str], str, dict[str, str], int]
"""Context, element and attributes of an item's last sample, and the number of their shape."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What was asked of a file: how items are named, and which device (None for all)."""

    naming: Naming
    device: frozenset[str] | None

    def wants(self, said: dict[str, str]) -> bool:
        """Whether a device stream is one to keep."""
        device = self.device
        return device is None or said.get("name") in device or said.get("uuid") in device


def foreign_reason(device: str) -> str:
    """Why a whole device stream is rejected, as one record."""
    return f"the stream of device {device!r} is not of the chosen one"


def device_name(said: dict[str, str]) -> str:
    """What the device of a device stream is called."""
    return said.get("name") or said.get("uuid") or "?"


class Streams(XmlEvents):
    """Fills ``rows`` with observations; ``place`` counts the records of the whole file."""

    def __init__(self, content: Content, asked: Asked) -> None:
        super().__init__(content)
        self.rows = Rows()
        self.place = 0
        self.instance: int | None = None
        self.asked = asked
        self._device = ""
        self._section = ""
        self._context = ("", "")
        self._observation = 0  # depth of observations, 0 outside sections
        self._foreign: int | None = None  # depth of a device stream that was not asked for
        self._shapes: dict[Any, Shape] = {}
        self._waiting = Waiting()
        self._flat = self._waiting.flat
        self._codes: dict[Any, int] = {}  # of shapes of samples
        self._last: dict[str | None, _Last] = {}  # by item
        # The element that is being read:
        self._tag = ""
        self._said: dict[str, str] = {}
        self._began = 0
        self._text: list[str] = []
        self._length = 0  # of text that was not kept
        self._entries: list[Entry] | None = None
        self._entry: tuple[dict[str, str], list[tuple[str, str]]] | None = None
        self._cell = ""
        self._stranger: str | None = None  # an element inside an observation that is no entry

    def forget_document(self) -> None:
        """Forget the document before, keep the count of records."""
        if self._waiting.flat:
            self._settle()
        self._device = self._section = self._tag = ""
        self._observation, self._foreign, self.instance = 0, None, None
        self._text.clear()

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
        if self.depth != self._observation:
            super()._end(name)
            return
        self.depth -= 1
        said, text = self._said, self._text
        timestamp, sequence = said.pop("timestamp", None), said.pop("sequence", None)
        value = (text[0] if len(text) == 1 else "".join(text)).strip(BLANK)
        # Most say what the one before of their item said: that is faster than to look it up.
        code: int | None
        last = self._last.get(said.get("dataItemId"))
        if last and last[2] == said and last[1] == name and last[0] == self._context:
            code = last[3]
        else:
            code = self._code()
        plain = self._entries is None and len(value) <= MODEST and not self._length
        if code is not None and timestamp and sequence and plain:
            self._flat += (timestamp, sequence, value, code, self._began)
        else:
            self._observed(timestamp, sequence, value)

    def _known(self) -> tuple[Any, ...]:
        """What tells apart the shape of the element that is being read."""
        return self._context, self._tag, *self._said, *self._said.values()

    def _code(self) -> int | None:
        """The number of a sample's shape; None when it is new or that of no sample."""
        code = self._codes.get(self._known())
        if code is not None:
            item_id = self._said.get("dataItemId")
            self._last[item_id] = (self._context, self._tag, self._said, code)
        return code

    def handed_over(self) -> Batch:
        """What was read since the last batch."""
        if self._waiting.flat:
            self._settle()
        batch = self.rows.batch()
        self.rows = Rows()
        return batch

    def between(self) -> None:
        """Read what waits, let go of a text that is too long to keep."""
        if self._waiting.flat:
            self._settle()
        if len(self._text) > 1:
            length = sum(map(len, self._text))
            if length > LONGEST:
                self._length += length
                self._text.clear()

    def reject(self, at: int, reason: str) -> None:
        """Reject the record that begins at byte ``at``."""
        if self._waiting.flat:
            self._settle()
        self._refuse(at - self._shift, reason)

    def _refuse(self, began: int, reason: str) -> None:
        at = began + self._shift
        self.place += 1
        self.rows.reject(self.content.line(at), reason, self.content.excerpt(at))

    def start_stream(self, tag: str, said: dict[str, str]) -> None:
        """An element outside the sections begins."""
        if self._foreign:
            return
        if tag == "DeviceStream":
            self._device = device_name(said)
            if not self.asked.wants(said):
                self._foreign = self.depth
                self.reject(self.at, foreign_reason(self._device))
        elif tag in SECTIONS:
            self._section, self._observation = SECTIONS[tag], self.depth + 1
            self._context = (self._section, self._device)
        elif "dataItemId" in said or "sequence" in said:
            reason = f"the element {quoted(tag)} stands outside Samples, Events and Condition"
            self.reject(self.at, reason)

    def start_inside(self, name: str, said: dict[str, str]) -> None:
        """An element inside an observation begins."""
        inside = self.depth - self._observation
        if inside == 1:
            self._entries = [] if self._entries is None else self._entries
            self._entry = (said, [])
        elif inside == 2:
            self._cell = said.get("key", "")
        if local(name) != ("Entry" if inside == 1 else "Cell"):
            self._stranger = local(name)
        self._text.clear()

    def end_in_section(self) -> None:
        """An element inside an observation, or the section, ends."""
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

    def _observed(self, timestamp: str | None, sequence: str | None, value: str) -> None:
        if self._waiting.flat:
            self._settle()
        try:
            self._check(value)
            known = self._known()
            shape = self._shapes.get(known) or self._new_shape(known)
        except MalformedError as malformed:
            self._refuse(self._began, str(malformed))
        else:
            inside: Any = value if self._entries is None else self._entries
            self._record(self._began, shape, timestamp, sequence, inside)

    def _settle(self) -> None:
        """Read the samples that wait, together or, if one of them is no plain one, one by one."""
        waiting = self._waiting
        if len(waiting) < TOGETHER or not self.rows.samples(waiting, self.instance):
            for timestamp, sequence, value, code, began in waiting.each():
                self._record(began, waiting.known[code], timestamp, sequence, value)
        else:
            self.place += len(waiting)
        waiting.flat.clear()

    def _record(
        self, began: int, shape: Shape, timestamp: str | None, sequence: str | None, value: Any
    ) -> None:
        try:
            self.rows.record(shape, timestamp, sequence, self.instance, self.place + 1, value)
            self.place += 1
        except MalformedError as malformed:
            self._refuse(began, str(malformed))

    def _check(self, value: str) -> None:
        if self._length or len(value) > LONGEST:
            length = self._length + len(value)
            raise MalformedError(f"the observation has {length} characters of text")
        if self._stranger is not None:
            stranger = quoted(self._stranger)
            raise MalformedError(f"the observation holds {stranger}, which is no entry")

    def _new_shape(self, known: Any) -> Shape:
        if len(self._shapes) > MANY:
            self._shapes.clear()
            self._codes.clear()
            self._last.clear()
            self._waiting.known.clear()
        naming = self.asked.naming
        shape = shape_of(self._section, local(self._tag), self._said, self._device, naming)
        self._shapes[known] = shape
        if shape.manner == "number":
            self._codes[known] = len(self._waiting.known)
            self._waiting.known.append(shape)
        return shape
