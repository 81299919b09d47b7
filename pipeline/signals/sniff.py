"""Which reader a file wants, from its first bytes and, for text, its name."""

import codecs
import zlib
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from pipeline.signals.records import Format, RecordSource, UnreadableFile

MAGIC: tuple[tuple[bytes, Format], ...] = (
    (b"PAR1", "parquet"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0", "matlab"),
    (b"MATLAB 7.3", "matlab"),
    (b"TDSm", "tdms"),
)

PLAIN = {"shdr", "csv"}
"""Formats whose bytes look alike."""

TELLING = {"shdr", "mtconnect_xml", "mtconnect_json"}
"""Formats that say themselves what stands where."""

HEAD = 1 << 16
"""Bytes of a file that are looked at."""


def sniff(path: Path) -> Format:
    """The format of the file ``path``.

    Logs and text tables cannot be told apart by their bytes: a name that ends in ``.csv`` or
    ``.tsv`` is a table, all other text a log.

    Raises
    ------
    UnreadableFile
        When the file cannot be opened.
    """
    try:
        with path.open("rb") as file:
            head = _unpacked(file.read(HEAD))
    except OSError as error:
        raise UnreadableFile(f"it cannot be opened: {error.strerror or error}") from error
    for magic, form in MAGIC:
        if head.startswith(magic):
            return form
    text = _ascii(head).lstrip()
    if text.startswith(b"<") or b"<MTConnect" in text or (text.startswith(b"--") and b"<" in text):
        return "mtconnect_xml"
    if text.startswith((b"{", b"[")):
        return "mtconnect_json"
    name = path.name.removesuffix(".gz").lower()
    return "csv" if name.endswith((".csv", ".tsv")) else "shdr"


def source_of(path: Path, sources: Sequence[RecordSource]) -> RecordSource | None:
    """How to read ``path``: as the machine's source of its format, best the one that names it.

    What its bytes say counts; a log and a text table look alike, and there the machine's names for
    its files count.  None for a table of which the machine's file gives no layout, and for a file
    that cannot be opened.
    """
    try:
        form = sniff(path)
    except UnreadableFile:
        return None
    alike = [s for s in sources if s.format == form or {s.format, form} <= PLAIN]
    whole, same = path.resolve(), [s for s in alike if s.format == form]
    placed = [s for s in alike if whole.match(s.files)]
    named = [s for s in alike if fnmatch(path.name, s.files.rpartition("/")[2])]
    for found in (*placed, *named, *same):
        return found
    return RecordSource(format=form, files=path.name) if form in TELLING else None


def _unpacked(head: bytes) -> bytes:
    """The beginning of what is packed with gzip; it may break off, or be broken."""
    if not head.startswith(b"\x1f\x8b"):
        return head
    try:
        return zlib.decompressobj(wbits=31).decompress(head, HEAD)
    except zlib.error:
        return b""


def _ascii(head: bytes) -> bytes:
    """Text without its byte order mark, one byte a character where that is enough to see a tag."""
    for mark, encoding in ((codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be")):
        if head.startswith(mark):
            return head[2:].decode(encoding, "replace").encode()
    return head.removeprefix(codecs.BOM_UTF8)
