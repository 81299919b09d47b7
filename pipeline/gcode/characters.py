"""Classes of bytes, as the compiled scanners see them."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.kernels import compiled

Bytes: TypeAlias = npt.NDArray[np.uint8]

NEW_LINE, RETURN, SPACE = 10, 13, 32
PERCENT_SIGN, HASH, SEMICOLON, SLASH, EQUALS = (ord(c) for c in "%#;/=")
OPEN, CLOSE, OPEN_BRACKET, CLOSE_BRACKET, LESS, GREATER = (ord(c) for c in "()[]<>")
PLUS, MINUS, STAR, POINT, COMMA = (ord(c) for c in "+-*.,")
ZERO, NINE, LETTER_A, LETTER_Z = (ord(c) for c in "09AZ")
LETTER_C, LETTER_O, LETTER_R = (ord(c) for c in "COR")
AT, CARET, DOLLAR = (ord(c) for c in "@^$")
BLANKS = b" \t\v\f\x00\x7f"
"""Do not count outside comments; NUL and DEL are the blank and the corrected rows of a tape."""


@compiled
def is_blank(c: int) -> bool:
    """Whether a byte is one of :data:`BLANKS`."""
    return c in (SPACE, 0, 9, 11, 12, 127)


@compiled
def is_line_end(c: int) -> bool:
    """Whether a byte ends a line."""
    return c in (NEW_LINE, RETURN)


@compiled
def is_letter(c: int) -> bool:
    """Whether a byte is an ASCII letter."""
    return LETTER_A <= (c & 0xDF) <= LETTER_Z


@compiled
def lower(c: int) -> int:
    """The small letter of an ASCII letter, any other byte as it is."""
    return c | 0x20 if is_letter(c) else c


@compiled
def is_digit(c: int) -> bool:
    """Whether a byte is an ASCII digit."""
    return ZERO <= c <= NINE


@compiled
def after_blanks(data: Bytes, at: int) -> int:
    """Where the next byte stands that is no blank."""
    while at < len(data) and is_blank(data[at]):
        at += 1
    return at


@compiled
def line_end(data: Bytes, at: int) -> int:
    """Where the line ends that ``at`` lies in, before its line end."""
    while at < len(data) and not is_line_end(data[at]):
        at += 1
    return at


@compiled
def code_end(data: Bytes, at: int) -> int:
    """Where the code ends that ``at`` lies in: at a comment or the line's end."""
    while at < len(data):
        c = data[at]
        if is_line_end(c) or c in (OPEN, SEMICOLON):
            break
        at += 1
    return at


@compiled
def holds(data: Bytes, at: int, end: int, sign: int) -> bool:
    """Whether ``sign`` stands in the bytes from ``at`` to before ``end``."""
    while at < end and data[at] != sign:
        at += 1
    return at < end
