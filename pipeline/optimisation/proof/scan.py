"""F and S words of a line, found by the proof's own reading of its bytes.

It shares nothing with what writes words.  A line that it cannot read word by word, or in which F or
S may mean anything but a feed or a speed, is sealed: nothing in it may differ.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

BLANKS = rb" \t\v\f\x00\x7f"
SEALED_G = frozenset(
    (4, 10, 11, 25, 26, 31, 33, 33.1, 34, 35, 38.2, 38.3, 38.4, 38.5, 50, 63, 65, 66, 66.1, 67, 74,
     76, 84, 92, 92.1, 92.2, 92.3, 93, 96, 331, 332, 961, 962)
)  # fmt: skip
"""Dwell, data input, limits, probing, threads, tapping, calls, G93, G96 and their like."""
SEALED_M = frozenset((19, 29, 70, 71, 72, 73, 96, 97, 98, 99, 198))
"""Oriented stop, rigid tapping, saved states, calls."""
_COMMENT = re.compile(rb"\([^)]*\)|\(.*|;.*", re.DOTALL)
_BRACKETS = re.compile(rb"\[[^\[\]]*\]")
_VARIABLE = re.compile(rb"[#%b]*#[%b]*(?:[0-9]+|<[^>]*>|\x02+)" % (BLANKS, BLANKS))
_GAP = re.compile(rb"[%b\x01]+" % BLANKS)
_SKIP = re.compile(rb"/[%b]*[1-9]?" % BLANKS)
_NUMBER = rb"[+-]?[%b]*[0-9.][0-9.%b]*" % (BLANKS, BLANKS)
_WORD = re.compile(
    rb",?[%b]*([A-Za-z@^$])[%b]*(%b|[+\-%b]*\x02+)" % (BLANKS, BLANKS, _NUMBER, BLANKS)
)
_DECIMAL = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")


class Span(NamedTuple):
    """A word: its letter (``"F"``), and where its bytes lie in the line."""

    letter: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Scan:
    """A line word by word.

    Parameters
    ----------
    text : bytes
        Without its end.
    changeable : tuple of Span
        F and S words with a number, in order.
    last_other : int
        Where its last word ends that is no F or S, and no N; 0 where it has none.
    """

    text: bytes
    changeable: tuple[Span, ...]
    last_other: int

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
    found: list[Span] = []
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
            if any(span.letter == letter for span in found):
                return None
            if number is not None and word[0][:1] != b",":
                found.append(Span(letter, word.start(1), at))
        elif letter != "N":
            last_other = at
        numbers.append((letter, float(number[0]) if number is not None else -1.0))
    sealed = any(map(_seals, numbers))
    return None if sealed else Scan(text, tuple(found), last_other)


BLANKS_TO_STRIP = b" \t\v\f\x00\x7f"


def _seals(word: tuple[str, float]) -> bool:
    """Whether a word gives the F or S of its line another meaning, or names a program."""
    letter, value = word
    if letter == "G":
        return value < 0 or round(value, 3) in SEALED_G
    if letter == "M":
        return value < 0 or value in SEALED_M
    return letter in "O$"


def _masked(text: bytes) -> bytes:
    """The line with 1 for each byte of a comment and 2 for each of a value that is no number."""
    masked = _COMMENT.sub(lambda found: b"\x01" * len(found[0]), text)
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
    for comment in _COMMENT.finditer(text):
        pieces += [text[at : comment.start()].translate(None, BLANKS_TO_STRIP), comment[0]]
        at = comment.end()
    return b"".join([*pieces, text[at:].translate(None, BLANKS_TO_STRIP)])
