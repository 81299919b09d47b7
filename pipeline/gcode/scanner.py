"""Bytes to tokens, compiled: every byte belongs to one token."""

import numpy as np
import numpy.typing as npt

from pipeline.gcode.characters import (
    AT,
    CARET,
    CLOSE,
    COMMA,
    DOLLAR,
    EQUALS,
    HASH,
    LESS,
    LETTER_C,
    LETTER_O,
    LETTER_R,
    NEW_LINE,
    OPEN,
    OPEN_BRACKET,
    PERCENT_SIGN,
    RETURN,
    SEMICOLON,
    SLASH,
    Bytes,
    after_blanks,
    code_end,
    is_blank,
    is_digit,
    is_letter,
    is_line_end,
    line_end,
)
from pipeline.gcode.number_scanner import number
from pipeline.gcode.value_scanner import function_end, value_end
from pipeline.kernels import compiled

BLANK, WORD, VALUED, LONE, MACRO, COMMENT, REMARK, SKIP, PERCENT, LINE_END, OTHER = range(11)
"""Kinds of token; see :class:`pipeline.gcode.words.Kind`."""


@compiled
def scan(
    data: Bytes,
    kind: npt.NDArray[np.uint8],
    start: npt.NDArray[np.int32],
    value: npt.NDArray[np.float64],
    first_token: npt.NDArray[np.int32],
) -> tuple[int, int]:
    """Write the tokens of ``data``; their number and that of the lines.

    The arrays have room for a token each byte, and one more.
    """
    at, tokens, lines, n = 0, 0, 0, len(data)
    in_line, head = False, True
    while at < n:
        if not in_line:
            first_token[lines] = tokens
            lines += 1
            in_line = head = True
        kind[tokens], end, value[tokens] = token(data, at, head)
        start[tokens] = at
        in_line = kind[tokens] != LINE_END
        head = head and kind[tokens] == BLANK
        at = end
        tokens += 1
    first_token[lines] = tokens
    start[tokens] = n
    return tokens, lines


@compiled
def token(data: Bytes, at: int, head: bool) -> tuple[int, int, float]:
    """Kind, end and value of the token that begins at ``at``."""
    n, c = len(data), data[at]
    if is_blank(c):
        return BLANK, after_blanks(data, at), np.nan
    if is_letter(c) or c in (AT, CARET, DOLLAR):
        return word(data, at, at + 1)
    if is_line_end(c):
        pair = c == RETURN and at + 1 < n and data[at + 1] == NEW_LINE
        return LINE_END, at + 1 + pair, np.nan
    if c == OPEN:
        return comment(data, at)
    if c == SEMICOLON:
        return REMARK, line_end(data, at), np.nan
    if c == COMMA:
        letter = after_blanks(data, at + 1)
        if letter < n and data[letter] & 0xDF in (LETTER_C, LETTER_R):
            return word(data, at, letter + 1)
    if c in (HASH, OPEN_BRACKET, EQUALS):
        return MACRO, code_end(data, at), np.nan
    return rare(data, at, head)


@compiled
def rare(data: Bytes, at: int, head: bool) -> tuple[int, int, float]:
    """Head of a line, byte order mark, and what has no meaning."""
    n, c = len(data), data[at]
    if head and c == PERCENT_SIGN:
        return PERCENT, line_end(data, at), np.nan
    if head and c == SLASH:
        level = after_blanks(data, at + 1)
        if level < n and is_digit(data[level]) and data[level] != 48:
            return SKIP, level + 1, float(data[level] - 48)
        return SKIP, at + 1, 1.0
    if at == 0 and n >= 3 and c == 0xEF and data[1] == 0xBB and data[2] == 0xBF:
        return BLANK, 3, np.nan
    end = at + 1
    while end < n and not starts(data[end]):
        end += 1
    return OTHER, end, np.nan


@compiled
def starts(c: int) -> bool:
    """Whether a byte ends a run of bytes without meaning."""
    special = c in (OPEN, SEMICOLON, COMMA, HASH, OPEN_BRACKET)
    special = special or c in (EQUALS, AT, CARET, DOLLAR)
    return special or is_letter(c) or is_blank(c) or is_line_end(c)


@compiled
def comment(data: Bytes, at: int) -> tuple[int, int, float]:
    """``(…)``, or what follows an open ``(``."""
    end = at + 1
    while end < len(data) and not is_line_end(data[end]):
        end += 1
        if data[end - 1] == CLOSE:
            return COMMENT, end, np.nan
    return OTHER, end, np.nan


@compiled
def word(data: Bytes, at: int, behind: int) -> tuple[int, int, float]:
    """The word whose letter ends at ``behind``: with a number, with an expression, or lone."""
    begin = after_blanks(data, behind)
    if begin == len(data):
        return LONE, behind, np.nan
    end, value = number(data, begin)
    if end > begin:
        return WORD, end, value
    c = data[begin]
    if is_letter(c):
        return lettered(data, at, begin)
    if c == EQUALS or (c == LESS and data[at] & 0xDF == LETTER_O):
        return MACRO, code_end(data, at), np.nan
    end = value_end(data, begin)
    if end > begin:
        return VALUED, end, np.nan
    return LONE, behind, np.nan


@compiled
def lettered(data: Bytes, at: int, begin: int) -> tuple[int, int, float]:
    """Letters in a row: a function's value, or a name that makes the rest of the line macro."""
    end = function_end(data, begin)
    if end > begin:
        return VALUED, end, np.nan
    return MACRO, code_end(data, at), np.nan
