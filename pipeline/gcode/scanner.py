"""Compiled scanner of part programs: bytes to tokens, every byte in exactly one token.

A number of at most 2⁵³ with up to 22 decimals is the quotient of two exact float64, so that one
division rounds it correctly (Clinger 1990, the fast path); others are left to Python, marked NaN.
"""

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
BLANKS = b" \t\v\f\x00\x11\x12\x13\x14\x1a\x7f"
"""Bytes ignored outside comments.

NUL and DEL are the blank and the corrected rows of a tape, DC1 to DC4 start and stop its reader
and punch, SUB ends a file of old systems.
"""


@compiled
def is_blank(c: int) -> bool:
    """Whether a byte is one of :data:`BLANKS`."""
    return c in (SPACE, 0, 9, 11, 12, 17, 18, 19, 20, 26, 127)


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
    """Place of the next byte that is no blank."""
    while at < len(data) and is_blank(data[at]):
        at += 1
    return at


@compiled
def line_end(data: Bytes, at: int) -> int:
    """End of the line that ``at`` lies in, before its line end."""
    while at < len(data) and not is_line_end(data[at]):
        at += 1
    return at


@compiled
def code_end(data: Bytes, at: int) -> int:
    """End of the code that ``at`` lies in: at a comment or the line's end."""
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


MACRO_INITIALS = tuple(ord(c) for c in "DEGIW")
"""First letters of DO, END, GOTO, IF and WHILE."""


@compiled
def remarks_block(data: Bytes, at: int) -> bool:
    """Whether code may follow the ``;`` at ``at``: on a Fanuc it ends a block."""
    at = after_blanks(data, at)
    while at < len(data) and data[at] in (SEMICOLON, SLASH):
        at = after_blanks(data, at + 1)
    if at == len(data) or is_line_end(data[at]):
        return False
    if not is_letter(data[at]):
        return data[at] in (OPEN, HASH)
    first, at = data[at] & 0xDF, after_blanks(data, at + 1)
    if at == len(data) or is_line_end(data[at]):
        return False
    return not is_letter(data[at]) or first in MACRO_INITIALS


EXACT = 2**53
MOST_DECIMALS = 22
POWERS: npt.NDArray[np.float64] = np.array([float(10**n) for n in range(MOST_DECIMALS + 1)])


@compiled
def number(data: Bytes, at: int) -> tuple[int, float]:
    """End of the number at ``at`` (``at`` itself if there is none) and its value."""
    n = len(data)
    start = at
    negative = data[at] == MINUS
    if negative or data[at] == PLUS:
        at = after_blanks(data, at + 1)
    mantissa, decimals, digits, end = 0, 0, 0, start
    exact, pointed = True, False
    while at < n:
        c = data[at]
        if is_digit(c):
            digits += 1
            decimals += pointed
            exact = exact and mantissa <= EXACT // 10 - 1
            mantissa = mantissa * 10 + (c - ZERO) if exact else 0
        elif c == POINT and not pointed:
            pointed = True
        elif not is_blank(c):
            break
        at += 1
        if not is_blank(c):
            end = at
    if digits == 0:
        return start, np.nan
    if not exact or decimals > MOST_DECIMALS:
        return end, np.nan
    value = mantissa / POWERS[decimals]
    return end, -value if negative else value


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
    """End of the value that begins at ``at``; ``at`` itself where there is none.

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
    """End of the call of a function, ``at`` itself where there is none."""
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


BLANK, WORD, VALUED, LONE, MACRO, COMMENT, REMARK, SKIP, PERCENT, LINE_END, OTHER = range(11)
"""Kinds of token; see :class:`pipeline.gcode.program.TokenKind`."""


@compiled
def scan(
    data: Bytes, kind: npt.NDArray[np.uint8], start: npt.NDArray[np.int32],
    first_token: npt.NDArray[np.int32],
) -> tuple[int, int]:  # fmt: skip
    """Write the tokens of ``data``; their number and that of the lines.

    The arrays hold one element for each byte, and one more.
    """
    # literals would have all that follows compiled a second time
    at, tokens, lines, n = np.int64(0), 0, 0, len(data)
    in_line, head = False, at == 0
    while at < n:
        if not in_line:
            first_token[lines] = tokens
            lines += 1
            in_line = head = True
        kind[tokens], end = token(data, at, head)
        start[tokens] = at
        in_line = kind[tokens] != LINE_END
        head = head and kind[tokens] == BLANK
        at = end
        tokens += 1
    first_token[lines] = tokens
    start[tokens] = n
    return tokens, lines


@compiled
def token(data: Bytes, at: int, head: bool) -> tuple[int, int]:
    """Kind and end of the token that begins at ``at``."""
    n, c = len(data), data[at]
    if is_blank(c):
        return BLANK, after_blanks(data, at)
    if is_letter(c) or c in (AT, CARET, DOLLAR):
        return word(data, at, at + 1)
    if is_line_end(c):
        pair = c == RETURN and at + 1 < n and data[at + 1] == NEW_LINE
        return LINE_END, at + 1 + pair
    if c == OPEN:
        return comment(data, at)
    if c == SEMICOLON:
        return REMARK, line_end(data, at)
    if c == COMMA:
        letter = after_blanks(data, at + 1)
        if letter < n and data[letter] & 0xDF in (LETTER_C, LETTER_R):
            return word(data, at, letter + 1)
    if c in (HASH, OPEN_BRACKET, EQUALS):
        return MACRO, code_end(data, at)
    return rare(data, at, head)


@compiled
def rare(data: Bytes, at: int, head: bool) -> tuple[int, int]:
    """Head of a line, byte order mark, and what has no meaning."""
    n, c = len(data), data[at]
    if head and c == PERCENT_SIGN:
        return PERCENT, line_end(data, at)
    if head and c == SLASH:
        level = after_blanks(data, at + 1)
        numbered = level < n and is_digit(data[level]) and data[level] != ZERO
        return SKIP, level + 1 if numbered else at + 1
    if at == 0 and n >= 3 and c == 0xEF and data[1] == 0xBB and data[2] == 0xBF:
        return BLANK, 3
    end = at + 1
    while end < n and not starts(data[end]):
        end += 1
    return OTHER, end


@compiled
def starts(c: int) -> bool:
    """Whether a byte ends a run of bytes without meaning."""
    special = c in (OPEN, SEMICOLON, COMMA, HASH, OPEN_BRACKET)
    special = special or c in (EQUALS, AT, CARET, DOLLAR)
    return special or is_letter(c) or is_blank(c) or is_line_end(c)


@compiled
def comment(data: Bytes, at: int) -> tuple[int, int]:
    """``(…)``, or what follows an open ``(``."""
    end = at + 1
    while end < len(data) and not is_line_end(data[end]):
        end += 1
        if data[end - 1] == CLOSE:
            return COMMENT, end
    return OTHER, end


@compiled
def word(data: Bytes, at: int, behind: int) -> tuple[int, int]:
    """The word whose letter ends at ``behind``: with a number, with an expression, or lone."""
    begin = after_blanks(data, behind)
    if begin == len(data):
        return LONE, behind
    end, _ = number(data, begin)
    if end > begin:
        return WORD, end
    c = data[begin]
    if is_letter(c):  # a function's value, or a name that makes the rest of the line macro
        end = function_end(data, begin)
        return (VALUED, end) if end > begin else (MACRO, code_end(data, at))
    if c == EQUALS or (c == LESS and data[at] & 0xDF == LETTER_O):
        return MACRO, code_end(data, at)
    end = value_end(data, begin)
    if end > begin:
        return VALUED, end
    return LONE, behind


@compiled
def number_of(data: Bytes, at: int) -> float:
    """Number of the WORD at ``at``; NaN where it has more digits than are rounded here."""
    letter = after_blanks(data, at + 1) if data[at] == COMMA else at
    _, value = number(data, after_blanks(data, letter + 1))
    return value


@compiled
def read_numbers(data: Bytes, at: npt.NDArray[np.int32], numbers: npt.NDArray[np.float64]) -> None:
    """Write the numbers of the WORDs at ``at`` (n,) to ``numbers`` (n,), as :func:`number_of`."""
    for index in range(len(at)):
        numbers[index] = number_of(data, at[index])
