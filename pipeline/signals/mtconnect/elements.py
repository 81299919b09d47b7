"""The careful way through an MTConnect document: element by element, whatever its form.

It reads Streams, Devices, Assets and Error documents, and lone devices and assets.  The quick way
(:mod:`pipeline.signals.mtconnect.quick`) hands over to it whatever it does not know.
"""

import re
from xml.sax.saxutils import escape, quoteattr

from pipeline.signals.mtconnect.streams import LONGEST, Asked, Streams
from pipeline.signals.mtconnect.text import Content, End, local, quoted
from pipeline.signals.mtconnect.words import (
    BLANK,
    MalformedError,
    Shape,
    json_of,
    nanoseconds,
    sequence_of,
)

_ASIDE = re.compile(rb"<!--.*?-->|<\?.*?\?>", re.S)
_LINE = re.compile(rb"[^\n]+")
_TRANSPORT = re.compile(
    rb"\s*(?:--\S*|[A-Za-z][A-Za-z0-9-]*:.*|HTTP/\d\S* \d+.*|[0-9A-Fa-f]{1,16}|)\s*"
)

DOCUMENTS = {"MTConnectStreams": "streams", "MTConnectDevices": "devices",
             "MTConnectAssets": "assets", "MTConnectError": "error"}  # fmt: skip


def stray_reason(length: int) -> str:
    """Why bytes between two documents are rejected."""
    return f"{length} bytes between documents are of none"


def instance_of(header: dict[str, str]) -> int | None:
    """The agent's instanceId, None when it is no number."""
    try:
        return sequence_of(header["instanceId"])
    except (KeyError, MalformedError):
        return None


class Document(Streams):
    """Fills ``rows`` from one document of any kind."""

    def __init__(self, content: Content, asked: Asked) -> None:
        super().__init__(content, asked)
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

    def start(self, name: str, said: dict[str, str]) -> None:
        """An element that is no observation begins."""
        if self.depth > self._observation > 0:
            self.start_inside(name, said)
            return
        tag = local(name)
        if self.depth == 1:
            self._start_root(tag, said)
        if tag == "Header" and self.depth == 2:
            self._created, self.instance = said.get("creationTime"), instance_of(said)
        elif self._form == "streams":
            self.start_stream(tag, said)
        elif (self._form == "assets" and self.depth >= 3) or self._form == "asset":
            self._start_asset(name, tag, said)
        elif self._form == "devices" and tag == "DataItem":
            self._data_item(said)
        elif self._form == "error":
            self._start_error(tag, said)

    def end(self, name: str) -> None:
        """An element that is no observation ends."""
        if self._section:
            self.end_in_section()
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
                raise MalformedError(f"the asset {quoted(self._tag)} has no assetId")
            if self._length > LONGEST:
                raise MalformedError(f"the asset has {self._length} characters")
            timestamp = said.get("timestamp") or self._created
            if timestamp is None:
                raise MalformedError("the asset has no timestamp and its document no creationTime")
            self.rows.add(shape, nanoseconds(timestamp), self.place + 1, self.instance, self._tag)
            self.place += 1
        except MalformedError as malformed:
            self.reject(self._began, str(malformed))

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
