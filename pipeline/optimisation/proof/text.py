"""Comparison of two texts: the same, byte by byte, but for F and S words.

It shares nothing with the code that writes words.  A line that it cannot read word by word, or in
which F or S may mean anything but a feed or a speed, is sealed: nothing in it may differ.
"""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

BLANKS = rb" \t\v\f\x00\x7f"
BLANKS_TO_STRIP = b" \t\v\f\x00\x7f"
SEALED_G = frozenset(
    (4, 10, 11, 25, 26, 31, 33, 33.1, 34, 35, 38.2, 38.3, 38.4, 38.5, 50, 63, 65, 66, 66.1, 67, 74,
     76, 84, 92, 92.1, 92.2, 92.3, 93, 96, 331, 332, 961, 962)
)  # fmt: skip
"""Dwell, data input, limits, probing, threads, tapping, calls, G93, G96 and their like."""
SEALED_M = frozenset((19, 29, 70, 71, 72, 73, 96, 97, 98, 99, 198))
"""Oriented stop, rigid tapping, saved states, calls."""
COMMENT = re.compile(rb"\([^)]*\)|\(.*|;.*", re.DOTALL)
_BRACKETS = re.compile(rb"\[[^\[\]]*\]")
_VARIABLE = re.compile(rb"[#%b]*#[%b]*(?:[0-9]+|<[^>]*>|\x02+)" % (BLANKS, BLANKS))
_GAP = re.compile(rb"[%b\x01]+" % BLANKS)
_SKIP = re.compile(rb"/[%b]*[1-9]?" % BLANKS)
_NUMBER = rb"[+-]?[%b]*[0-9.][0-9.%b]*" % (BLANKS, BLANKS)
_WORD = re.compile(
    rb",?[%b]*([A-Za-z@^$])[%b]*(%b|[+\-%b]*\x02+)" % (BLANKS, BLANKS, _NUMBER, BLANKS)
)
_DECIMAL = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_PLAIN = re.compile(rb"(?i)[FS][ \t\v\f\x00\x7f]*(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
"""A word as it may be written anew: no sign, no blank between digits."""
LINE_END = "its line end differs"
SEALED = "it differs, and F or S may mean something else in it"
MORE = "it differs in more than its F and S words"
_PROOF_COMMENT = re.compile(
    rb"(?:\(KERF PROOF SHA256 ([0-9A-F]{64})\)|; KERF PROOF SHA256 ([0-9A-F]{64}))"
)


@dataclass(frozen=True, slots=True)
class WordChange:
    """One F or S word."""

    line: int
    """Line number, from 1."""
    letter: str
    """Letter, ``"F"`` or ``"S"``."""
    before: str | None
    """Word as written; None where it was added."""
    after: str
    """Word as written in the second program."""


class Span(NamedTuple):
    """A word: its letter (``"F"``), and where its bytes lie in the line."""

    letter: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Scan:
    """A line word by word."""

    text: bytes
    """Text of the line without its end."""
    changeable: tuple[Span, ...]
    """F and S words with a number, in order."""
    last_other: int
    """End of its last word that is no F or S, and no N; 0 where it has none."""

    @property
    def bare(self) -> bytes:
        """The line without its changeable words, and without blanks outside of comments."""
        pieces, at = [], 0
        for span in self.changeable:
            pieces.append(self.text[at : span.start])
            at = span.end
        pieces.append(self.text[at:])
        return _without_blanks(b"".join(pieces))


def scanned(text: bytes) -> Scan | None:
    """A line read; None where it is sealed."""
    masked = _masked(text)
    spans: list[Span] = []
    last_other, at = 0, 0
    numbers: list[tuple[str, float]] = []
    while at < len(masked):
        gap = _GAP.match(masked, at) or (None if numbers else _SKIP.match(masked, at))
        if gap is not None:
            at = gap.end()
            continue
        word = _WORD.match(masked, at)
        if word is None:
            return None
        letter = word[1].decode("ascii").upper()
        at = word.start(2) + len(word[2].rstrip(BLANKS_TO_STRIP))
        number = _DECIMAL.fullmatch(word[2].translate(None, BLANKS_TO_STRIP))
        if number is None and word[2][-1:] != b"\x02":
            return None
        if letter in "FS":
            if any(span.letter == letter for span in spans):
                return None
            if number is not None and word[0][:1] != b",":
                spans.append(Span(letter, word.start(1), at))
        elif letter != "N":
            last_other = at
        numbers.append((letter, float(number[0]) if number is not None else -1.0))
    sealed = any(map(seals, numbers))
    return None if sealed else Scan(text, tuple(spans), last_other)


def seals(word: tuple[str, float]) -> bool:
    """Whether a word gives the F or S of its line another meaning, or names a program."""
    letter, value = word
    if letter == "G":
        return value < 0 or round(value, 3) in SEALED_G
    if letter == "M":
        return value < 0 or value in SEALED_M
    return letter in "O$"


def _masked(text: bytes) -> bytes:
    """The line with 1 for each byte of a comment and 2 for each of a value that is no number."""
    masked = COMMENT.sub(lambda found: b"\x01" * len(found[0]), text)
    if b"\x01" in text or b"\x02" in text:
        return b"\x03"  # no word begins so: sealed
    if b"[" not in masked and b"#" not in masked:
        return masked
    count = 1
    while count:
        masked, count = _BRACKETS.subn(lambda found: b"\x02" * len(found[0]), masked)
    return _VARIABLE.sub(lambda found: b"\x02" * len(found[0]), masked)


def _without_blanks(text: bytes) -> bytes:
    pieces, at = [], 0
    for comment in COMMENT.finditer(text):
        pieces += [text[at : comment.start()].translate(None, BLANKS_TO_STRIP), comment[0]]
        at = comment.end()
    return b"".join([*pieces, text[at:].translate(None, BLANKS_TO_STRIP)])


@dataclass(frozen=True, slots=True)
class Difference:
    """The first block that is not the same, and why."""

    line: int
    """Line number in the program before, from 1 (0 where it is none of its lines)."""
    before: str
    after: str
    """The block in each text."""
    reason: str
    """Difference in words."""

    def __str__(self) -> str:
        return f"line {self.line}: {self.reason}: {self.before!r} became {self.after!r}"


def same_but_words(old: bytes, new: bytes) -> bool:
    """Whether two lines, with their ends, differ in nothing but F and S words."""
    return old == new or not isinstance(line_changes(0, old, new), str)


def text_digest(lines: list[bytes]) -> bytes:
    """Hash of lines without F and S words (and the blanks between words)."""
    digest = hashlib.sha256()
    for line in lines:
        body = line.rstrip(b"\r\n")
        scan = scanned(body)
        digest.update(body if scan is None else scan.bare)
        digest.update(line[len(body) :] or b"\n")
    return digest.digest()


def shown(text: bytes) -> str:
    """Bytes as text for people."""
    return text.rstrip(b"\r\n").decode("latin-1")


def line_changes(number: int, old: bytes, new: bytes) -> list[WordChange] | str:
    """F and S words of a line that differ, or the reason why it is not the same."""
    body, other = old.rstrip(b"\r\n"), new.rstrip(b"\r\n")
    if old[len(body) :] != new[len(other) :]:
        return LINE_END
    before, after = scanned(body), scanned(other)
    if before is None or after is None:
        return SEALED
    given = {span.letter: span for span in before.changeable}
    kept = [span for span in after.changeable if span.letter in given]
    added = [span for span in after.changeable if span.letter not in given]
    if len(kept) != len(given):
        gone = next(span for span in given.values() if span.letter not in [k.letter for k in kept])
        return f"its {gone.letter} word is gone"
    if added and not (after.last_other and added[0].start >= after.last_other):
        return f"{added[0].letter} was added in a place that is not the end of its words"
    if added and any(span.start > added[0].start for span in kept):
        return f"{added[0].letter} was added in a place that is not the end of its words"
    frame = _frame(body, [given[span.letter] for span in kept])
    order = [span.letter for span in before.changeable] == [span.letter for span in kept]
    if not order or frame not in _frames_without(after, kept, added):
        return MORE
    return _words(number, body, other, given, kept, added)


def _frame(text: bytes, spans: list[Span]) -> list[bytes]:
    """Text around some words: their letters stay, their numbers go."""
    pieces, at = [], 0
    for span in spans:
        pieces.append(text[at : span.start + 1])
        at = span.end
    return [*pieces, text[at:]]


def _frames_without(scan: Scan, kept: list[Span], added: list[Span]) -> Iterator[list[bytes]]:
    """A line without the words that were added, each with or without one blank before it."""
    for blanks in product((0, 1), repeat=len(added)):
        text = scan.text
        for span, blank in sorted(zip(added, blanks, strict=True), reverse=True):
            start = span.start - blank
            if blank and text[start : span.start] not in (b" ", b"\t"):
                break
            text = text[:start] + text[span.end :]
        else:
            yield _frame(text, kept)


def _words(
    number: int, old: bytes, new: bytes, given: dict[str, Span], kept: list[Span], added: list[Span]
) -> list[WordChange] | str:
    changes = []
    for span in sorted([*kept, *added]):
        word = new[span.start : span.end]
        before = given.get(span.letter)
        written = None if before is None else old[before.start : before.end]
        if word == written:
            continue
        if _PLAIN.fullmatch(word) is None or not float(word[1:].strip(BLANKS_TO_STRIP)) > 0:
            return f"{shown(word)} is no plain positive number"
        shown_before = None if written is None else shown(written)
        changes.append(WordChange(number, span.letter, shown_before, shown(word)))
    return changes


def proof_line(sha256: str, dialect: str) -> bytes:
    """The comment, without a line end."""
    said = f"KERF PROOF SHA256 {sha256.upper()}"
    return (f"; {said}" if dialect == "siemens" else f"({said})").encode("ascii")


def without_comment(lines: list[bytes]) -> tuple[list[bytes], str | None, int]:
    """Lines without the proof's comment at the end, the hash that it holds, and its place."""
    for at in range(len(lines) - 1, -1, -1):
        comment = _PROOF_COMMENT.fullmatch(lines[at].rstrip(b"\r\n"))
        if comment is not None:
            rest = lines[:at] + lines[at + 1 :]
            if lines[at] == comment[0] and at:  # the text had no line end before
                rest[-1] = rest[-1].rstrip(b"\r\n")
            return rest, (comment[1] or comment[2]).decode("ascii").lower(), at
        if lines[at].strip() and not lines[at].lstrip().startswith(b"%"):
            break
    return lines, None, len(lines)


def with_comment(lines: list[bytes], comment: bytes) -> list[bytes]:
    """Lines with the comment at the end, before a closing ``%``, in place of an older one."""
    lines, _, _ = without_comment(lines)
    end = next((line[len(line.rstrip(b"\r\n")) :] for line in lines if line[-1:] in b"\r\n"), b"\n")
    last = len(lines)
    while last and not lines[last - 1].strip():
        last -= 1
    if last > 1 and lines[last - 1].lstrip().startswith(b"%"):
        return [*lines[: last - 1], comment + end, *lines[last - 1 :]]
    if lines and lines[-1][-1:] not in b"\r\n":
        return [*lines[:-1], lines[-1] + end, comment]
    return [*lines, comment + end]
