"""Reader of MTConnect XML: Streams, Devices, Assets and Error documents, one or many in a file."""

import re
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from pipeline.signals.formats import Batch, RecordSource, UnreadableFile
from pipeline.signals.mtconnect.devices import device_model
from pipeline.signals.mtconnect.observations import BLANK, MalformedError, asset_shape, asset_time
from pipeline.signals.mtconnect.xml_events import (
    BEGIN,
    FRAGMENT,
    Content,
    End,
    content,
    local,
    quoted,
)
from pipeline.signals.mtconnect.xml_observations import (
    LONGEST,
    Selection,
    Streams,
    instance_of,
    selection,
)

FIRST_WITHIN = 1 << 16
"""Bytes within which a file's first document must begin."""

_ROOT = re.compile(rb"\s*(?:<!--.*?-->\s*)*<([\w:.-]+)", re.S)
_NAME = re.compile(rb"""\b(name|uuid)\s*=\s*["']([^"'<]*)""")


_ASIDE = re.compile(rb"<!--.*?-->|<\?.*?\?>", re.S)
_LINE = re.compile(rb"[^\n]+")
_TRANSPORT = re.compile(
    rb"\s*(?:--\S*|[A-Za-z][A-Za-z0-9-]*:.*|HTTP/\d\S* \d+.*|[0-9A-Fa-f]{1,16}|)\s*"
)

DOCUMENTS = {"MTConnectStreams": "streams", "MTConnectDevices": "devices",
             "MTConnectAssets": "assets", "MTConnectError": "error"}  # fmt: skip


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
            if attributes.get("id"):
                self.rows.read += 1
            else:
                self.reject(self.at, "the data item has no id")
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
            self.rows.add(shape, time, self.instance, self._tag)
        except MalformedError as malformed:
            self.reject(self._began, str(malformed))

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


def read(path: Path, source: RecordSource, root: Path) -> Iterator[Batch]:
    """Batches of about 200 000 records of the documents in an XML file.

    A record is an observation, an asset, a data item, an error, or bytes that cannot be read.
    Times of a time series are spread backwards from its timestamp.  A document type declaration is
    refused.
    """
    whole = content(path)
    chosen = selection(source, device_model(source, root), lambda: _several_devices(whole))
    return _documents(whole, Document(whole, chosen))


def _several_devices(whole: Content) -> bool:
    mapped, at = whole.mapped, -1
    seen: set[bytes] = set()
    while len(seen) < 2 and (at := mapped.find(b"DeviceStream ", at + 1)) >= 0:
        attributes = dict(_NAME.findall(mapped[at : at + 1024].split(b">", 1)[0]))
        seen.add(attributes.get(b"name") or attributes.get(b"uuid") or b"?")
    return len(seen) > 1


def _documents(whole: Content, document: Document) -> Iterator[Batch]:
    at: int = whole.start
    begin: int | None = _first(whole)
    known = False
    while begin is not None:
        document.stray(at, begin)
        context = FRAGMENT if not known and _is_fragment(whole, begin) else b""
        document.begin()
        for _ in document.steps(begin, context):
            # Rows are objects: few at a time, or the garbage collector walks them again and again.
            yield document.handed_over()
        end = document.finished
        document.cut(document.without_root(end) if context else end)
        yield document.handed_over()
        if not document.known:
            _refuse(document, begin, known)
        known = True
        at = end.at if context else max(end.at, begin + 1)
        following = BEGIN.search(whole.mapped, at)
        begin = following.start() if following else None
        if end.reason and not context:
            at = begin or whole.size  # what lies between is lost with the document
    document.stray(at, whole.size)
    yield document.handed_over()


def _first(whole: Content) -> int:
    head = whole.head(FIRST_WITHIN)
    skipped = len(head) - len(head.lstrip())
    if head[skipped : skipped + 1] == b"<":
        return whole.start + skipped
    found = BEGIN.search(head)
    if not found:
        begins = head[skipped : skipped + 40].decode("utf-8", "replace")
        raise UnreadableFile(f"the file is no XML document: it begins with {begins!r}")
    return whole.start + found.start()


def _is_fragment(whole: Content, begin: int) -> bool:
    root = _ROOT.match(whole.mapped[begin : begin + 4096])
    return root is not None and root[1].rpartition(b":")[2] in (b"Device", b"DataItem")


def _refuse(document: Document, begin: int, known: bool) -> None:
    """Reject a document that is none of MTConnect; the whole file when it is the first."""
    end = document.finished
    reason = f"the XML document is {quoted(document.root)}, which is not of MTConnect"
    if known and not end.reason:
        document.reject(begin, reason)
    elif not known:
        broken = f"the file is no XML document: {end.reason}"
        raise UnreadableFile(broken if end.reason and not document.root else reason)
