"""Reader of MTConnect XML: Streams, Devices, Assets and Error documents, one or many in a file."""

import re
from collections.abc import Iterator
from pathlib import Path

from pipeline.signals.formats import Batch, RecordSource, UnreadableFile
from pipeline.signals.mtconnect.devices import device_model
from pipeline.signals.mtconnect.xml_events import BEGIN, FRAGMENT, Content, content, quoted
from pipeline.signals.mtconnect.xml_observations import Document, selection

FIRST_WITHIN = 1 << 16
"""Bytes within which a file's first document must begin."""

_ROOT = re.compile(rb"\s*(?:<!--.*?-->\s*)*<([\w:.-]+)", re.S)
_NAME = re.compile(rb"""\b(name|uuid)\s*=\s*["']([^"'<]*)""")


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
