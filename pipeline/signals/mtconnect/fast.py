"""Fast path through MTConnectStreams documents: bytes are scanned in compiled code.

Documents as agents write them are read here; whatever is in another form is left to the reference
path, element by element or from there on.  Both give the same rows.
"""

import re
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from pipeline.signals.formats import Batch
from pipeline.signals.mtconnect import scan as scanning
from pipeline.signals.mtconnect import tokens
from pipeline.signals.mtconnect.assemble import Assembly, DeviceRun
from pipeline.signals.mtconnect.reference import (
    Document,
    device_name,
    foreign_reason,
    instance_of,
    stray_reason,
)
from pipeline.signals.mtconnect.rows import RECORDS
from pipeline.signals.mtconnect.xml_events import BEGIN, attributes_of

WINDOW = 1 << 24
MARGIN = 1 << 18
"""Bytes after a window that an element begun in it may reach; a longer one is left to the reference
path."""

MANY_SHAPES = 0.25
"""New shapes for each element above which every tag differs and comparing them is no gain."""

_PROLOGUE = re.compile(
    rb"(?:<\?xml\s[^<>]*\?>)?\s*(?:<\?xml-stylesheet\s[^<>]*\?>\s*)*"
    rb"<MTConnectStreams(?:\s[^<>]*)?>\s*<Header\s[^<>]*/>\s*<Streams>"
)
_DEVICE = re.compile(rb"\s*(<DeviceStream(?:\s[^<>]*)?>)")
_END = re.compile(rb"\s*</Streams>\s*</MTConnectStreams>")
_CLOSERS = b"</Streams></MTConnectStreams>"
_SECTIONS = (b"<Samples>", b"<Events>", b"<Condition>")


@dataclass(frozen=True)
class Resume:
    """Where the reference path goes on (None: nothing is left) and what it reads first."""

    at: int | None
    context: bytes = b""


class FastPath:
    """Tables of the fast path; ``document`` is the reference path, which also keeps the counts."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.content = document.content
        self.buffer = np.frombuffer(self.content.mapped, np.uint8)
        self.state = np.zeros(scanning.STATE_SIZE, np.int64)
        self.tags = np.empty((4096, 3), np.int64)
        self.scratch = np.zeros((3, scanning.SCRATCH), np.int64)
        self.elements = np.empty((RECORDS, tokens.ELEMENT_COLUMNS), np.int64)
        self.assembly = Assembly(document, self.buffer, self.elements)
        self._sound: dict[bytes, dict[str, str] | None] = {}
        self._worn = False
        self._place = self._after = self._checked = 0
        self._reset()

    def _reset(self) -> None:
        self.shapes = np.empty((scanning.SHAPES, scanning.SHAPE_COLUMNS), np.int64)
        self.slots = np.full(scanning.SLOTS, -1, np.int32)
        self.guesses = np.full(scanning.GUESSES, -1, np.int32)
        self.state[scanning.N_SHAPES] = 0
        self.state[scanning.BEFORE] = -1
        self.assembly.forget()

    def run(self, begin: int) -> Generator[Batch, None, Resume]:
        """Read documents from ``begin`` on, in batches of :data:`RECORDS` records."""
        self._place = self.document.place
        at: int | None = begin
        resume: Resume | None = None
        while at is not None and resume is None:
            resume = yield from self._document(at)
            if resume is None:
                at = self._between(self._after)
        earlier = yield from self._flush()
        if earlier is None:
            self.document.place = self._place
        return earlier or resume or Resume(None)

    def _between(self, at: int) -> int | None:
        """Where the next document begins; what stands before it is noted when it is of none."""
        following = BEGIN.search(self.content.mapped, at)
        to = following.start() if following else self.content.size
        stray = self.document.stray_at(at, to)
        if stray is not None:
            self._note(stray, stray_reason(to - stray))
        return following.start() if following else None

    def _n(self) -> int:
        return int(self.state[scanning.N_ELEMENTS])

    def _note(self, at: int, reason: str) -> None:
        self.assembly.notes.append((self._n(), at, reason))
        self._place += 1

    def _document(self, begin: int) -> Generator[Batch, None, Resume | None]:
        mapped = self.content.mapped
        prologue = _PROLOGUE.match(mapped, begin)
        header = attributes_of(prologue[0] + _CLOSERS) if prologue else None
        if prologue is None or header is None:
            return Resume(begin)
        instance = instance_of(header["Header"])
        at = prologue.end()
        while not (end := _END.match(mapped, at)):
            device = _DEVICE.match(mapped, at)
            attributes = self._sound_tag(device[1]) if device else None
            if device is None or attributes is None:
                return Resume(at, prologue[0])
            begin, at = device.start(1), device.end()
            wanted = self.document.selection.wants(attributes)
            if not device[1].endswith(b"/>"):
                run = self.assembly.begin(
                    prologue[0], device[1], attributes, instance, self._n(), self._place
                )
                resume = yield from self._stream(run, at, wanted)
                if resume is not None:
                    earlier = resume.at is not None and resume.at < begin
                    return resume if wanted or earlier else Resume(begin, prologue[0])
                at = self._after
            if not wanted:
                self._note(begin, foreign_reason(device_name(attributes)))
        self._after = end.end()
        return None

    def _stream(
        self, run: DeviceRun, at: int, wanted: bool
    ) -> Generator[Batch, None, Resume | None]:
        """Scan one device stream, dropping what is not wanted; ``_after`` is where it ended."""
        state = self.state
        state[scanning.LEVEL] = 3
        how = scanning.STOPPED
        while how != scanning.DEVICE_END:
            before = self._n()
            state[scanning.N_TAGS] = 0
            stop, end = self._window(at)
            if stop < at:
                return Resume(at, self._context(run))
            at, how = scanning.scan(
                self.buffer, at, stop, end, run.device, state, self.shapes, self.slots,
                self.guesses, self.elements, self.tags, *self.scratch,
            )  # fmt: skip
            unsound = self._unsound_component()
            if unsound is not None:
                at, state[scanning.N_ELEMENTS] = unsound
                state[scanning.LEVEL], how = 3, scanning.ODD
            if wanted:
                self._place += self._n() - before
            else:
                state[scanning.N_ELEMENTS] = before
            if how == scanning.ODD:
                return Resume(at, self._context(run))
            if self._n() >= RECORDS or how == scanning.FULL:
                resume = yield from self._flush(run)
                if resume is not None or self._worn:
                    return resume or Resume(at, self._context(run))
            if how == scanning.FULL:
                self._reset()
        self._after = int(at)
        return None

    def _window(self, at: int) -> tuple[int, int]:
        """Where to stop and where to look no further; -1 when what lies before is no UTF-8."""
        size = self.content.size
        if at + MARGIN >= self._checked < size:
            end = min(at + WINDOW + MARGIN, size)
            if not _is_utf8(self.content.mapped[at:end]):
                return -1, -1
            self._checked = end
        return (size if self._checked == size else self._checked - MARGIN), self._checked

    def _flush(self, run: DeviceRun | None = None) -> Generator[Batch, None, Resume | None]:
        """Hand over what was located; where the reference path goes on, if one is malformed."""
        n = self._n()
        new = int(self.state[scanning.N_SHAPES]) - self.assembly.known
        self._worn = new > MANY_SHAPES * max(n, 1000)
        batch, broken = self.assembly.batch(n, self.shapes, int(self.state[scanning.N_SHAPES]))
        self.state[scanning.N_ELEMENTS] = 0
        if batch.read:
            yield batch
        self.assembly.restart(None if broken else run, self._place)
        if broken is not None:
            of, at, section, place = broken
            self.document.place = place
            return Resume(at, self._opened(of, 5, section))
        return None

    def _context(self, run: DeviceRun) -> bytes:
        level, section = int(self.state[scanning.LEVEL]), int(self.state[scanning.SECTION])
        return self._opened(run, level, section)

    @staticmethod
    def _opened(run: DeviceRun, level: int, section: int) -> bytes:
        component = b"<ComponentStream>" if level > 3 else b""
        return run.prologue + run.tag + component + (_SECTIONS[section] if level > 4 else b"")

    def _unsound_component(self) -> tuple[int, int] | None:
        """The first component stream whose tag is not well formed, and the elements before it."""
        for begin, end, n in self.tags[: self.state[scanning.N_TAGS]].tolist():
            if self._sound_tag(self.content.mapped[begin:end]) is None:
                return begin, n
        return None

    def _sound_tag(self, tag: bytes) -> dict[str, str] | None:
        """Attributes of a start tag, None when it is not well formed."""
        if tag not in self._sound:
            if len(self._sound) > 10_000:
                self._sound.clear()
            name = tag[1:].split(None, 1)[0].rstrip(b"/>")
            closed = tag if tag.endswith(b"/>") else tag + b"</" + name + b">"
            found = attributes_of(closed)
            self._sound[tag] = found[name.decode()] if found else None
        return self._sound[tag]


def _is_utf8(text: bytes) -> bool:
    """Whether bytes, which may end within a character, are UTF-8 that XML allows."""
    if text.isascii():
        return True
    try:
        text.decode()
    except UnicodeDecodeError as error:
        if error.start < len(text) - 3:
            return False
    return b"\xef\xbf\xbe" not in text and b"\xef\xbf\xbf" not in text
