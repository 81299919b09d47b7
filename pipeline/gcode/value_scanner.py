"""How far the value of a word reaches that is no plain number."""

from pipeline.gcode.characters import (
    CLOSE_BRACKET,
    GREATER,
    HASH,
    LESS,
    MINUS,
    OPEN,
    OPEN_BRACKET,
    PLUS,
    POINT,
    SEMICOLON,
    SLASH,
    Bytes,
    after_blanks,
    is_digit,
    is_letter,
    is_line_end,
)
from pipeline.gcode.number_scanner import number
from pipeline.kernels import compiled

LONGEST_NAME = 6


def packed(name: str) -> int:
    """A name of up to six letters as one integer."""
    code = 0
    for letter in name:
        code = code * 32 + (ord(letter) & 31)
    return code


ATAN = packed("ATAN")
FUNCTIONS = tuple(
    packed(name)
    for name in (
        "ABS", "ACOS", "ASIN", "ATAN", "BCD", "BIN", "COS", "EXISTS", "EXP", "FIX", "FUP", "LN",
        "POW", "RND", "ROUND", "SIN", "SQR", "SQRT", "TAN",
    )
)  # fmt: skip


@compiled
def value_end(data: Bytes, at: int) -> int:
    """Where the value ends that begins at ``at``; ``at`` itself where there is none.

    Signs, then a number, ``#…``, ``[…]`` or a function of ``[…]``.
    """
    start, n = at, len(data)
    while at < n and (data[at] in (PLUS, MINUS)):
        at = after_blanks(data, at + 1)
    hashes = at
    while at < n and data[at] == HASH:
        at = after_blanks(data, at + 1)
    if at == n:
        return start
    c = data[at]
    if c == OPEN_BRACKET:
        end = closed(data, at, OPEN_BRACKET, CLOSE_BRACKET)
    elif c == LESS and at > hashes:
        end = closed(data, at, LESS, GREATER)
    elif is_digit(c) or c == POINT:
        end, _ = number(data, at)
    elif is_letter(c) and at == hashes:
        end = function_end(data, at)
    else:
        return start
    return end if end > at else start


@compiled
def function_end(data: Bytes, at: int) -> int:
    """Where the call of a function ends, ``at`` itself where there is none."""
    start, n = at, len(data)
    code, letters = 0, 0
    while at < n and is_letter(data[at]) and letters <= LONGEST_NAME:
        code = code * 32 + (data[at] & 31)
        letters += 1
        at = after_blanks(data, at + 1)
    if code not in FUNCTIONS or at == n or data[at] != OPEN_BRACKET:
        return start
    end = closed(data, at, OPEN_BRACKET, CLOSE_BRACKET)
    if end == at:
        return start
    if code == ATAN:
        slash = after_blanks(data, end)
        if slash < n and data[slash] == SLASH:
            bracket = after_blanks(data, slash + 1)
            if bracket < n and data[bracket] == OPEN_BRACKET:
                end = max(end, closed(data, bracket, OPEN_BRACKET, CLOSE_BRACKET))
    return end


@compiled
def closed(data: Bytes, at: int, opening: int, closing: int) -> int:
    """Behind the partner of the bracket at ``at``, ``at`` itself where it has none."""
    start, depth = at, 0
    while at < len(data):
        c = data[at]
        if is_line_end(c) or c in (OPEN, SEMICOLON):
            break
        depth += (c == opening) - (c == closing)
        at += 1
        if depth == 0:
            return at
    return start
