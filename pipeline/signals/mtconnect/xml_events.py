"""XML events of MTConnect documents without a tree, and the bytes of a file in UTF-8.

A document is not trusted: a document type declaration is refused, so that no entity is ever
declared, expanded or fetched.
"""

import codecs
import mmap
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NoReturn
from xml.parsers import expat

from pipeline.signals.formats import EXCERPT, GZIP_MAGIC, UnreadableFile, gunzip

CHUNK = 1 << 20
MOST_UNPACKED = 1 << 34
"""Bytes that a packed document may have; a small file can hold any number of zeros."""

FRAGMENT = b"<fragment>"
"""Root element read first where elements stand side by side without one."""

_NO_END = expat.ErrorString(expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS])
BEGIN = re.compile(rb"<\?xml\s|<!DOCTYPE|<(?:[\w.-]+:)?MTConnect(?:Streams|Devices|Assets|Error)\b")
"""Head of a document."""

_DECLARED = re.compile(rb"""^\s*<\?xml[^>]{0,200}?\bencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_BOMS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"),
         (codecs.BOM_UTF16_BE, "utf-16"), (b"<\0", "utf-16-le"), (b"\0<", "utf-16-be"),
         (b"{\0", "utf-16-le"), (b"\0{", "utf-16-be"))  # fmt: skip


class Content:
    """The bytes of a file as UTF-8, mapped, not loaded; positions in them as lines."""

    def __init__(self, mapped: mmap.mmap, start: int) -> None:
        self.mapped = mapped
        self.start = start
        self.size = len(mapped)
        self._counted = (0, 1)

    def everything(self) -> bytes:
        """Content as a whole."""
        return self.mapped[self.start :]

    def head(self, n: int) -> bytes:
        """First ``n`` bytes of the content."""
        return self.mapped[self.start : self.start + n]

    def line(self, at: int) -> int:
        """Line of the byte ``at``, counting from 1."""
        import numpy as np

        offset, line = self._counted if self._counted[0] <= at else (0, 1)
        while offset < at:
            to = min(at, offset + (1 << 24))
            part = np.frombuffer(self.mapped, np.uint8, to - offset, offset)
            line += int(np.count_nonzero(part == 10))
            offset = to
        self._counted = (offset, line)
        return line

    def excerpt(self, at: int) -> str:
        """The beginning of what stands at byte ``at``, to the end of its line."""
        raw = self.mapped[at : at + 4 * EXCERPT].split(b"\n", 1)[0]
        return raw.decode("utf-8", "replace").rstrip("\r")[:EXCERPT]


def content(path: Path) -> Content:
    """The file at ``path`` as UTF-8, whatever it is encoded in."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise UnreadableFile(f"the file cannot be opened: {error.strerror}") from None
    with file:
        packed = file.read(2) == GZIP_MAGIC
        file.seek(0)
        if not packed:
            return _decoded(file)
        with tempfile.TemporaryFile() as unpacked:
            _unpack(file, unpacked)
            unpacked.seek(0)
            return _decoded(unpacked)


def _unpack(packed: IO[bytes], out: IO[bytes]) -> None:
    """Unpack gzip; what stands before a cut is the file, and ends as a cut document does."""
    reasons: list[str] = []
    for part in gunzip(iter(lambda: packed.read(CHUNK), b""), CHUNK, reasons.append):
        out.write(part)
        if out.tell() > MOST_UNPACKED:
            raise UnreadableFile(f"unpacked it has over {MOST_UNPACKED} bytes: unpack it by hand")
    if reasons and not out.tell():
        raise UnreadableFile(reasons[0])


def _decoded(file: IO[bytes]) -> Content:
    head = file.read(1024)
    if not head:
        raise UnreadableFile("the file is empty")
    encoding = _encoding(head)
    if encoding in ("utf-8", "utf-8-sig", "ascii"):
        file.flush()
        skip = 3 if encoding == "utf-8-sig" else 0
        return Content(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), skip)
    file.seek(0)
    return _transcoded(file, encoding)


def _encoding(head: bytes) -> str:
    for mark, encoding in _BOMS:
        if head.startswith(mark):
            return encoding
    declared = _DECLARED.match(head)
    if not declared:
        return "utf-8"
    name = declared[1].decode("ascii")
    try:
        known = codecs.lookup(name).name
        b" ".decode(known)  # refuses codecs that are no text encodings
    except (LookupError, UnicodeError):
        reason = f"the document declares the encoding {name!r}, which is unknown"
        raise UnreadableFile(reason) from None
    # A declaration in single bytes cannot be UTF-16 whatever it declares.
    return "utf-8" if known.startswith("utf-16") or known.startswith("utf-32") else known


def _transcoded(file: IO[bytes], encoding: str) -> Content:
    decoder = codecs.getincrementaldecoder(encoding)()
    with tempfile.TemporaryFile() as out:
        try:
            while part := file.read(CHUNK):
                out.write(decoder.decode(part).encode())
            out.write(decoder.decode(b"", final=True).encode())
        except UnicodeError as error:
            raise UnreadableFile(f"the file is not in its encoding {encoding}: {error}") from None
        out.flush()
        if not out.tell():
            raise UnreadableFile("the file is empty")
        return Content(mmap.mmap(out.fileno(), 0, access=mmap.ACCESS_READ), 0)


@dataclass(frozen=True)
class End:
    """End of one document's reading, and the reason if it is not the document's."""

    at: int
    reason: str | None


def local(name: str) -> str:
    """A name without its namespace prefix."""
    return name.rpartition(":")[2]


def quoted(name: str) -> str:
    """An element's name as it is shown in a message, at most 60 characters of it."""
    return f"<{name[:60]}>"


class XmlEvents:
    """Feeds one document of ``content`` to ``start``, ``characters`` and ``end``."""

    def __init__(self, content: Content) -> None:
        self.content = content
        self.depth = 0
        self.closed = False
        self.finished = End(content.start, None)
        self._parser = self._new_parser()
        self._shift = 0
        self._root_end = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """An element begins."""

    def characters(self, text: str) -> None:
        """Text inside an element, all that stands between two tags at once unless it is long."""

    def end(self, name: str) -> None:
        """An element ends."""

    def between(self) -> None:
        """Called after each chunk of the document."""

    def _new_parser(self) -> expat.XMLParserType:
        parser = expat.ParserCreate("utf-8")
        parser.buffer_text = True
        parser.buffer_size = 1 << 16
        parser.StartDoctypeDeclHandler = _refuse_doctype
        return parser

    @property
    def at(self) -> int:
        """Byte of the file that the current event begins at."""
        return self._parser.CurrentByteIndex + self._shift

    def parse(self, at: int, context: bytes = b"") -> End:
        """Read the document that begins (or, after ``context``, goes on) at byte ``at``."""
        for _ in self.steps(at, context):
            pass
        return self.finished

    def steps(self, at: int, context: bytes = b"") -> Iterator[None]:
        """The same as :meth:`parse`, pausing after each chunk; ``finished`` is how it ended."""
        parser = self._parser = self._new_parser()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self.characters
        self.depth, self.closed = 0, False
        self._shift = at - len(context)
        end = self.content.size
        try:
            parser.Parse(context, False)
            while at < end:
                to = min(at + CHUNK, end)
                parser.Parse(self.content.mapped[at:to], False)
                at = to
                self.between()
                yield
            parser.Parse(b"", True)
        except expat.ExpatError as error:
            # After the root anything that is not XML belongs to the next document.
            broken = min(parser.ErrorByteIndex + self._shift, end)
            self.finished = End(broken, expat.ErrorString(error.code))
        else:
            self.finished = End(end, None)
        if self.closed:
            self.finished = End(self._root_end, None)

    def parse_fragment(self) -> End:
        """Read the whole file as one document, or as elements side by side without a root."""
        begin = self.content.start
        head = self.content.head(4096).lstrip()
        if head.startswith(b"<?xml") or b"<MTConnect" in head:
            skipped = len(self.content.head(4096)) - len(head)
            return self.parse(begin + skipped)
        return self.without_root(self.parse(begin, FRAGMENT))

    def without_root(self, end: End) -> End:
        """End of elements side by side, read after :data:`FRAGMENT`."""
        whole = self.depth == 1 and end.at >= self.content.size and end.reason == _NO_END
        return End(end.at, None) if whole else end

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        self.start(name, attributes)

    def _end(self, name: str) -> None:
        self.end(name)
        self.depth -= 1
        if not self.depth:
            self.closed = True
            self._root_end = self.content.mapped.find(b">", max(self.at, 0)) + 1


def _refuse_doctype(*_: object) -> NoReturn:
    raise UnreadableFile(
        "the document has a document type declaration, which can hide entities that never end; "
        "remove it"
    )
