"""Whether two texts are the same but for F and S words: line by line, byte by byte."""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from pipeline.optimisation.proof.scan import BLANKS_TO_STRIP, Scan, Span, scanned
from pipeline.optimisation.text.word_changes import WordChange

_PLAIN = re.compile(rb"(?i)[FS][ \t\v\f\x00\x7f]*(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
"""A word as it may be written anew: no sign, no blank between digits."""
NOTHING = b""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first block that is not the same, and why.

    Parameters
    ----------
    line : int
        Counting from 1, in the program before (0 where it is none of its lines).
    before, after : str
        The block in each text.
    reason : str
        What is not the same.
    """

    line: int
    before: str
    after: str
    reason: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.reason}: {self.before!r} became {self.after!r}"


def text_difference(
    before: list[bytes], after: list[bytes]
) -> tuple[Difference | None, tuple[WordChange, ...]]:
    """The first line that differs in more than F and S words, and what differs in those.

    Parameters
    ----------
    before, after : list of bytes
        Lines with their ends.
    """
    changes: list[WordChange] = []
    for number, (old, new) in enumerate(zip(before, after, strict=False), 1):
        if old == new:
            continue
        found = _line_changes(number, old, new)
        if isinstance(found, str):
            return Difference(number, shown(old), shown(new), found), tuple(changes)
        changes += found
    if len(before) != len(after):
        number = min(len(before), len(after))
        old, new = (lines[number] if len(lines) > number else NOTHING for lines in (before, after))
        reason = f"one text has {len(before)} lines and the other {len(after)}"
        return Difference(number + 1, shown(old), shown(new), reason), tuple(changes)
    return None, tuple(changes)


def same_but_words(old: bytes, new: bytes) -> bool:
    """Whether two lines, with their ends, differ in nothing but F and S words."""
    return old == new or not isinstance(_line_changes(0, old, new), str)


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
    """Bytes for a person to read."""
    return text.rstrip(b"\r\n").decode("latin-1")


def _line_changes(number: int, old: bytes, new: bytes) -> list[WordChange] | str:
    """What differs in the F and S words of a line, or why it is not the same."""
    body, other = old.rstrip(b"\r\n"), new.rstrip(b"\r\n")
    if old[len(body) :] != new[len(other) :]:
        return "its line end differs"
    before, after = scanned(body), scanned(other)
    if before is None or after is None:
        return "it differs, and F or S may mean something else in it"
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
        return "it differs in more than its F and S words"
    return _words(number, body, other, given, kept, added)


def _frame(text: bytes, spans: list[Span]) -> list[bytes]:
    """What stands around some words: their letters stay, their numbers go."""
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
    number: int,
    old: bytes,
    new: bytes,
    given: dict[str, Span],
    kept: list[Span],
    added: list[Span],
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
