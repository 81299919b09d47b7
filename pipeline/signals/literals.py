"""Compiled readers of times and decimal numbers in ASCII, for the scanners of logs and documents.

A number is computed here only where one rounding gives the nearest float64 (at most 2^53 times or
over a power of ten up to 10^22: W. D. Clinger, "How to read floating point numbers accurately",
1990); other numbers are left to be converted exactly.
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled, compiled_with

# as pipeline.kernels.compiled, but woven into what calls it
inlined = compiled_with(nogil=True, _nrt=False, inline="always")

NONE, EXACT, COPIED, AWAY = 0, 1, 2, 3
"""Results of :func:`number_at`: no number, one, one to convert exactly, one out of its range."""

NO_DAY = -(1 << 31)

_TENS = 10.0 ** np.arange(23)
_WHOLE_TENS = 10 ** np.arange(10)
_MOST = np.uint64(1 << 53)


@compiled
def _days(year: Any, month: Any, day: Any) -> Any:
    """Days since 1970 in the Gregorian calendar, :data:`NO_DAY` for a day that is none."""
    if year < 1678 or year > 2261 or month < 1 or month > 12 or day < 1:
        return NO_DAY
    leap = year % 4 == 0 and (year % 100 != 0 or year % 400 == 0)
    length = 30 + ((month + (month > 7)) & 1)
    if month == 2:
        length = 29 if leap else 28
    if day > length:
        return NO_DAY
    from_march = year - (month <= 2)
    era = from_march // 400
    of_era = from_march - era * 400
    of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146097 + of_era * 365 + of_era // 4 - of_era // 100 + of_year - 719468


@inlined
def _digits(buf: Any, at: Any, n: Any) -> Any:
    """Number written by ``n`` digits, negative when one is none."""
    value: Any = 0
    worst: Any = 0
    for i in range(at, at + n):
        d = np.int64(buf[i]) - 48
        worst |= d | (9 - d)
        value = value * 10 + d
    return value if worst >= 0 else -1


@inlined
def _fraction(buf: Any, at: Any) -> Any:
    """Nanoseconds of the fraction at ``at``, and the place after it, -1 when it has no digit."""
    if buf[at] != 46:
        return 0, at
    first = at + 1
    at = first
    value: Any = 0
    while 48 <= buf[at] <= 57:
        if at - first < 9:
            value = value * 10 + np.int64(buf[at]) - 48
        at += 1
    if at == first:
        return 0, -1
    return value * _WHOLE_TENS[9 - min(at - first, 9)], at


@compiled
def _zone(buf: Any, at: Any, end: Any, mark: Any) -> Any:
    """Seconds east of UTC, and the place after the zone, -1 when it is not ordinary."""
    if buf[at] == 90:
        return 0, at + 1
    if buf[at] == mark:
        return 0, at
    if (buf[at] != 43 and buf[at] != 45) or at + 6 > end or buf[at + 3] != 58:
        return 0, -1
    hour, minute = _digits(buf, at + 1, 2), _digits(buf, at + 4, 2)
    if hour < 0 or hour > 23 or minute < 0 or minute > 59:
        return 0, -1
    east = hour * 3600 + minute * 60
    return (east if buf[at] == 43 else -east), at + 6


@inlined
def time_at(buf: Any, at: Any, end: Any, mark: Any, date: Any, days: Any) -> Any:
    """Nanoseconds since 1970, the place after the ISO time and its ``mark``, date and its days.

    The place is -1 when the time is not ordinary.  ``date`` and ``days`` come from the time before.
    """
    if at + 21 > end or buf[at + 4] != 45 or buf[at + 7] != 45 or buf[at + 10] != 84:
        return 0, -1, date, days
    year, month, day = _digits(buf, at, 4), _digits(buf, at + 5, 2), _digits(buf, at + 8, 2)
    if (year * 100 + month) * 100 + day != date:
        date, days = (year * 100 + month) * 100 + day, _days(year, month, day)
    hour, minute = _digits(buf, at + 11, 2), _digits(buf, at + 14, 2)
    second = _digits(buf, at + 17, 2)
    ordinary = buf[at + 13] == 58 and buf[at + 16] == 58 and days != NO_DAY
    ordinary &= 0 <= hour <= 23 and 0 <= minute <= 59 and 0 <= second <= 60
    if not ordinary:
        return 0, -1, -1, 0
    fraction, at = _fraction(buf, at + 19)
    if at < 0:
        return 0, -1, date, days
    east, at = _zone(buf, at, end, mark)
    if at < 0 or buf[at] != mark:
        return 0, -1, date, days
    seconds = days * 86400 + hour * 3600 + minute * 60 + second - east
    return seconds * 1_000_000_000 + fraction, at + 1, date, days


@inlined
def _exponent(buf: Any, at: Any) -> Any:
    """Exponent written at ``at`` (0 without one), and the place after it, -1 when it is broken."""
    if buf[at] != 101 and buf[at] != 69:
        return 0, at
    at += 1
    less = buf[at] == 45
    at += less or buf[at] == 43
    first = at
    exponent: Any = 0
    while 48 <= buf[at] <= 57:
        exponent = min(exponent * 10 + np.int64(buf[at]) - 48, 10_000)
        at += 1
    return (-exponent if less else exponent), (at if at > first else -1)


@compiled
def number_at(buf: Any, at: Any) -> Any:
    """Whether a number stands at ``at``, the number, and the place after it."""
    negative = buf[at] == 45
    at += negative or buf[at] == 43
    mantissa: Any = np.uint64(0)
    taken, power = 0, 0
    any_digit = cut = after_point = False
    while True:
        c = buf[at]
        if 48 <= c <= 57:
            any_digit = True
            cut |= taken >= 19
            if taken < 19:
                mantissa = mantissa * np.uint64(10) + np.uint64(c - 48)
                taken += mantissa > 0
                power -= after_point
            else:
                power += not after_point
        elif c == 46 and not after_point:
            after_point = True
        else:
            break
        at += 1
    exponent, at = _exponent(buf, at)
    if not any_digit or at < 0:
        return NONE, 0.0, at
    power += exponent
    if mantissa == 0:
        return EXACT, -0.0 if negative else 0.0, at
    if cut or mantissa > _MOST or power < -22 or power > 22:
        return (COPIED if -290 < power < 280 else AWAY), 0.0, at
    value = float(mantissa)
    value = value / _TENS[-power] if power < 0 else value * _TENS[power]
    return EXACT, -value if negative else value, at
