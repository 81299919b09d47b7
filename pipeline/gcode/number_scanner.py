"""Numbers of words, rounded as Python's ``float`` rounds them.

A number of at most 2⁵³ with up to 22 decimals is the quotient of two exact float64, so that one
division rounds it correctly (Clinger 1990, the fast path); others are left to Python, marked NaN.
"""

import numpy as np
import numpy.typing as npt

from pipeline.gcode.characters import (
    MINUS,
    PLUS,
    POINT,
    ZERO,
    Bytes,
    after_blanks,
    is_blank,
    is_digit,
)
from pipeline.kernels import compiled

EXACT = 2**53
MOST_DECIMALS = 22
POWERS: npt.NDArray[np.float64] = np.array([float(10**n) for n in range(MOST_DECIMALS + 1)])


@compiled
def number(data: Bytes, at: int) -> tuple[int, float]:
    """Where the number at ``at`` ends (``at`` itself: there is none) and its value.

    One sign, digits with at most one point, blanks between them.
    """
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
