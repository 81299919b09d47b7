"""Compiled reading of times, sequences and numbers as agents write them.

A number is computed here only where one rounding gives the nearest float64 (at most 2^53 over a
power of ten up to 10^22: W. D. Clinger, "How to read floating point numbers accurately", 1990).
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.mtconnect.bytes import load8

EXACT, HARD, NONE = 0, 1, 2
"""What a number turned out to be: computed, left to Python, or none."""

NO_DAY = -1_000_000_000
MOST_DIGITS = 19

_TENS = 10.0 ** np.arange(23)
_MONTH = np.array([0, 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])
_EXACT_LIMIT = np.uint64(1 << 53)
_TEN = np.uint64(10)


@compiled
def _two(buf: Any, at: Any) -> Any:
    a = np.int64(buf[at]) - 48
    b = np.int64(buf[at + 1]) - 48
    return a * 10 + b if 0 <= a <= 9 and 0 <= b <= 9 else -1


@compiled
def _days(buf: Any, at: Any) -> Any:
    """Days from 1970 to the date at ``at``; ``NO_DAY`` when it is none of 1900 to 2199."""
    century, year = _two(buf, at), _two(buf, at + 2)
    month, day = _two(buf, at + 5), _two(buf, at + 8)
    if century < 19 or century > 21 or year < 0 or month < 1 or month > 12 or day < 1:
        return NO_DAY
    if buf[at + 4] != 45 or buf[at + 7] != 45:
        return NO_DAY
    y = century * 100 + year
    leap = y % 4 == 0 and (y % 100 != 0 or y % 400 == 0)
    if day > _MONTH[month] + (1 if leap and month == 2 else 0):
        return NO_DAY
    # Gregorian calendar with years that begin in March, eras of 400 years.
    from_march = y - 1 if month <= 2 else y
    era = from_march // 400
    of_era = from_march - era * 400
    of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146097 + of_era * 365 + of_era // 4 - of_era // 100 + of_year - 719468


@compiled
def _day(buf: Any, at: Any, date: Any) -> Any:
    """As :func:`_days`; ``date`` keeps place and days of the last, as days rarely change."""
    known = date[0]
    if (
        known < 0
        or load8(buf, at) != load8(buf, known)
        or buf[at + 8] != buf[known + 8]
        or buf[at + 9] != buf[known + 9]
    ):
        days = _days(buf, at)
        if days == NO_DAY:
            return NO_DAY
        date[0], date[1] = at, days
    return date[1]


@compiled
def time_at(buf: Any, at: Any, date: Any) -> Any:
    """Nanoseconds since 1970, and whether the time at ``at`` is as agents write it."""
    days = _day(buf, at, date)
    hour, minute, second = _two(buf, at + 11), _two(buf, at + 14), _two(buf, at + 17)
    if days == NO_DAY or buf[at + 10] != 84 or buf[at + 13] != 58 or buf[at + 16] != 58:
        return 0, False
    if not (0 <= hour <= 23 and 0 <= minute <= 59 and 0 <= second <= 59):
        return 0, False
    i = at + 19
    ns: Any = 0
    if buf[i] == 46:
        i += 1
        n = 0
        while 48 <= buf[i] <= 57:
            if n < 9:
                ns = ns * 10 + (np.int64(buf[i]) - 48)
            n += 1
            i += 1
        if n == 0:
            return 0, False
        while n < 9:
            ns *= 10
            n += 1
    if buf[i] == 90:
        i += 1
    return (days * 86400 + hour * 3600 + minute * 60 + second) * 1000000000 + ns, buf[i] == 34


@compiled
def sequence_at(buf: Any, at: Any) -> Any:
    """The sequence at ``at``, and whether it is a number of at most 19 digits."""
    value = np.uint64(0)
    i = at
    while 48 <= buf[i] <= 57:
        value = value * _TEN + np.uint64(buf[i] - 48)
        i += 1
    return value, buf[i] == 34 and 0 < i - at <= MOST_DIGITS


@compiled
def number_at(buf: Any, at: Any, end: Any) -> Any:
    """The decimal number that fills ``at`` to ``end``, and whether it is exact, hard or none."""
    i = at
    negative = i < end and buf[i] == 45
    if negative or (i < end and buf[i] == 43):
        i += 1
    m = np.uint64(0)
    digits = scale = significant = zeros = 0
    point = False
    while i < end:
        c = buf[i]
        if c == 46 and not point:
            point = True
        elif c == 48 and point:
            # Zeros at the end of a fraction add nothing; they count if more digits follow.
            zeros += 1
            digits += 1
        elif 48 <= c <= 57:
            for _ in range(zeros + 1):
                m *= _TEN
            m += np.uint64(c - 48)
            significant += (zeros + 1) if m > np.uint64(0) else 0
            scale += (zeros + 1) if point else 0
            zeros = 0
            digits += 1
        else:
            break
        i += 1
    if digits == 0 or (i != end and buf[i] != 101 and buf[i] != 69):
        return 0.0, NONE
    if i != end or significant > MOST_DIGITS or m > _EXACT_LIMIT or scale > 22:
        return 0.0, HARD
    value = np.float64(m) / _TENS[scale]
    return (-value if negative else value), EXACT


@compiled
def three_at(buf: Any, at: Any, end: Any, numbers: Any) -> Any:
    """Three numbers parted by single blanks: ``EXACT``, ``HARD`` or ``NONE``."""
    i = at
    j = at
    for k in range(3):
        j = i
        while j < end and buf[j] != 32:
            j += 1
        value, found = number_at(buf, i, j)
        if found != EXACT:
            return found
        numbers[k] = value
        if k < 2 and j >= end:
            return NONE
        i = j + 1
    return EXACT if j == end else HARD
