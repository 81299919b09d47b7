"""First difference of two texts in words: which word, which line, which line end."""

import re
from collections import Counter

from pipeline.optimisation.proof.text import (
    COMMENT,
    LINE_END,
    MORE,
    SEALED,
    Difference,
    WordChange,
    line_changes,
    same_but_words,
    seals,
    shown,
)

NOTHING = b""
FOLLOWING = 3
"""Lines after one that was deleted or put in that have to match."""
_ENDS = {b"\r\n": "CRLF", b"\n": "LF", b"\r": "CR", b"": "no line end"}
_WORD = re.compile(r"/[1-9]?|,?[A-Z@^$][^A-Z@^$/,]*|[^\s]", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_NAMES = {"O": "the program number ", "N": "its block number ", "/": "the block skip "}
_COMPUTES = re.compile(rb"[#\[\]=<>]")


def text_difference(
    before: list[bytes], after: list[bytes]
) -> tuple[Difference | None, tuple[WordChange, ...]]:
    """The first line that differs in more than F and S words, and what differs in those."""
    changes: list[WordChange] = []
    for at, (old, new) in enumerate(zip(before, after, strict=False)):
        if old == new:
            continue
        found = line_changes(at + 1, old, new)
        if isinstance(found, str):
            return _difference(before, after, at, found), tuple(changes)
        changes += found
    if len(before) != len(after):
        return _at_the_end(before, after), tuple(changes)
    return None, tuple(changes)


def _at_the_end(before: list[bytes], after: list[bytes]) -> Difference:
    at = min(len(before), len(after))
    old, new = (lines[at] if len(lines) > at else NOTHING for lines in (before, after))
    many = abs(len(before) - len(after))
    happened = "deleted" if len(before) > len(after) else "added"
    reason = f"{_counted(many)} {happened} at the end of the program"
    return Difference(at + 1, shown(old), shown(new), reason)


def _difference(before: list[bytes], after: list[bytes], at: int, said: str) -> Difference:
    """Difference of line ``at``, from 0; ``said``: as it is seen in that line alone."""
    old, new = before[at], after[at]
    if said == LINE_END:
        return Difference(at + 1, shown(old), shown(new), _line_ends(before, after, at))
    deleted, put_in = _shift(before, after, at), _shift(after, before, at)
    if deleted:
        return Difference(at + 1, shown(old), "", f"{_counted(deleted)} deleted")
    if put_in:
        return Difference(at + 1, "", shown(new), f"{_counted(put_in)} put in")
    reason = _words(old, new, said) if said in (MORE, SEALED) else said
    return Difference(at + 1, shown(old), shown(new), reason)


def _counted(lines: int) -> str:
    return "the line was" if lines == 1 else f"{lines} lines were"


def _line_ends(before: list[bytes], after: list[bytes], at: int) -> str:
    bodies = [[line.rstrip(b"\r\n") for line in lines] for lines in (before, after)]
    ends = [
        [line[len(body) :] for line, body in zip(lines, some, strict=True)]
        for lines, some in zip((before, after), bodies, strict=True)
    ]
    became = " became ".join(_ENDS.get(some[at], "another line end") for some in ends)
    if bodies[0] != bodies[1]:
        return f"its line end differs: {became}"
    many = sum(one != other for one, other in zip(*ends, strict=True))
    return f"only line ends differ: {became} in {many} of {len(before)} lines"


def _shift(longer: list[bytes], shorter: list[bytes], at: int) -> int:
    """Number of lines of one text, from ``at`` on, that the other lacks."""
    for many in range(1, len(longer) - len(shorter) + 1):
        rest, other = longer[at + many :], shorter[at : at + FOLLOWING]
        if other and len(rest) >= len(other) and all(map(same_but_words, rest, other)):
            return many
    return 0


def _words(old: bytes, new: bytes, said: str) -> str:
    body, other = old.rstrip(b"\r\n"), new.rstrip(b"\r\n")
    code, changed = (COMMENT.sub(b"", text) for text in (body, other))
    if code == changed:
        return _comments(body, other)
    if code.translate(None, b" \t") == changed.translate(None, b" \t"):
        return "only its blanks differ"
    if code.translate(None, b" \t").upper() == changed.translate(None, b" \t").upper():
        return "only its capital and small letters differ"
    if _COMPUTES.search(code) or _COMPUTES.search(changed):
        return "an expression in it differs" if said == MORE else said
    reason = _word_changes(_split(code), _split(changed))
    binding = next((word for word in _split(code) if _binds(word)), "")
    if said == SEALED and binding and re.search(r"\b[FS][0-9. +-]", reason):
        reason += f", and with {binding} in the line that is no plain feed or speed"
    return reason or said


def _comments(body: bytes, other: bytes) -> str:
    one, two = (b" ".join(COMMENT.findall(text)).decode("latin-1") for text in (body, other))
    if not one or not two:
        return f"the comment {one or two} {'was added' if two else 'is gone'}"
    return f"the comment {one} became {two}"


def _split(code: bytes) -> list[str]:
    text = code.translate(None, b" \t").decode("latin-1").upper()
    return [found[0] for found in _WORD.finditer(text)]


def _binds(word: str) -> bool:
    return bool(_NUMBER.fullmatch(word[1:])) and seals((word[0], float(word[1:])))


def _word_changes(old: list[str], new: list[str]) -> str:
    """``X10 became X11, M0 was added``; F and S words only where nothing else differs."""
    gone = list((Counter(old) - Counter(new)).elements())
    added = list((Counter(new) - Counter(old)).elements())
    if not gone and not added:
        return "its words stand in another order"
    other = [word for word in (*gone, *added) if word[0] not in "FS"]
    if other:
        gone = [word for word in gone if word in other]
        added = [word for word in added if word in other]
    said = []
    for word in gone:
        same = next((one for one in added if one[0] == word[0]), None)
        if same is None:
            said.append(f"{_named(word)} is gone")
        else:
            added.remove(same)
            said.append(f"{_named(word)} became {same}")
    return ", ".join([*said, *(f"{_named(word)} was added" for word in added)])


def _named(word: str) -> str:
    return _NAMES.get(word[0], "") + word
