"""Compiled reading of tokens: names, times, sequences, numbers, and the values of observations.

A number is computed here only where one rounding gives the nearest float64 (at most 2^53 over a
power of ten up to 10^22: W. D. Clinger, "How to read floating point numbers accurately", 1990).
These functions allocate nothing, as :func:`pipeline.kernels.compiled` requires.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from pipeline.kernels import compiled

_DEVICE = np.frombuffer(b"DeviceStream ", np.uint8).copy()
# How far the search may go on when this byte stands where the last of `_DEVICE` would.
_SKIP = np.full(256, _DEVICE.size, np.int64)
_SKIP[_DEVICE] = _DEVICE.size - 1 - np.arange(_DEVICE.size)


@intrinsic
def load8(typing_context: Any, buf: Any, at: Any) -> Any:
    """Eight bytes of ``buf`` from ``at`` on as one number; they must lie within it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, args[0])
        pointer = builder.gep(array.data, [args[1]])
        wide = builder.bitcast(pointer, ir.IntType(64).as_pointer())
        word = builder.load(wide)
        word.align = 1
        return word

    return types.uint64(buf, types.int64), generate


@compiled
def is_at(buf: Any, at: Any, end: Any, word: Any) -> Any:
    """Whether ``word`` stands at ``at``, before ``end``."""
    n = word.size
    i = 0
    while i < n and at + i < end and buf[at + i] == word[i]:
        i += 1
    return i == n


@compiled
def same(buf: Any, a: Any, b: Any, n: Any) -> Any:
    """Whether the ``n`` bytes from ``a`` and from ``b`` on are the same."""
    i = 0
    while i + 8 <= n:
        if load8(buf, a + i) != load8(buf, b + i):
            return False
        i += 8
    while i < n:
        if buf[a + i] != buf[b + i]:
            return False
        i += 1
    return True


@compiled
def is_space(c: Any) -> Any:
    """Whether a byte is white space of XML."""
    return c == 32 or c == 10 or c == 13 or c == 9


@compiled
def name_char(c: Any) -> Any:
    """Whether a byte may stand in a name, as far as ASCII goes."""
    return (
        97 <= c <= 122 or 65 <= c <= 90 or 48 <= c <= 57 or c == 95 or c == 58 or c == 45 or c == 46
    )


@compiled
def value_end(buf: Any, at: Any, end: Any) -> Any:
    """The quote that ends an attribute's value, -1 if something odd comes before."""
    while at < end:
        c = buf[at]
        if c == 34:
            return at
        if c < 32 or c == 60:
            return -1
        at += 1
    return -1


@compiled
def element_end(buf: Any, at: Any, end: Any, name: Any, length: Any) -> Any:
    """The place after ``</name>``; -1 where there is none or a comment, CDATA, ... before it."""
    while at + length + 3 <= end:
        if buf[at] == 60:
            c = buf[at + 1]
            if c == 33 or c == 63:
                return -1
            if c == 47 and same(buf, at + 2, name, length):
                after = buf[at + 2 + length]
                if after == 62:
                    return at + length + 3
                if not name_char(after):
                    return -1
        at += 1
    return -1


@compiled
def device_tag(buf: Any, at: Any, end: Any) -> Any:
    """The next place of ``DeviceStream `` from ``at`` on, -1 when there is none."""
    n = _DEVICE.size
    i = at + n - 1
    while i < end:
        c = buf[i]
        skip = _SKIP[c]
        if skip == 0:
            if is_at(buf, i - n + 1, end, _DEVICE):
                return i - n + 1
            skip = 1
        i += skip
    return -1


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


REFERENCE, NUMBER, VALUE, TEXT, CONDITION, SPATIAL_NUMBER, SPATIAL_VALUE = range(7)
"""Manners, as in ``Shape.manner``; ``REFERENCE`` is left to the reference path."""

E_START, E_SHAPE, E_TIME, E_SEQUENCE, E_TEXT, E_END, E_CLOSE = range(7)
ELEMENT_COLUMNS = 7
"""Columns of the table of elements; ``E_END`` is the end of the text, ``E_CLOSE`` of all."""

R_ELEMENT, R_TIME, R_TEXT, R_AXIS = range(4)
ROW_COLUMNS = 4
"""Columns of the table of rows."""

ROWS, TEXTS, LEFT_OVER, HARDS = range(4)
"""Places in ``counts``."""

LONGEST_HARD = 300
"""Bytes of a number that is left to Python as such; a longer one is read with its element."""

_UNAVAILABLE = np.frombuffer(b"UNAVAILABLE", np.uint8).copy()


@compiled
def _intern(buf: Any, at: Any, n: Any, texts: Any, slots: Any, counts: Any) -> Any:
    """The number of a text among those seen in this batch."""
    h = np.uint64(14695981039346656037)
    for i in range(n):
        h = (h ^ np.uint64(buf[at + i])) * np.uint64(1099511628211)
    h ^= h >> np.uint64(32)
    mask = slots.size - 1
    slot = np.int64(h & np.uint64(mask))
    while slots[slot] >= 0:
        t = slots[slot]
        if texts[t, 1] == n:
            i = 0
            while i < n and buf[texts[t, 0] + i] == buf[at + i]:
                i += 1
            if i == n:
                return t
        slot = (slot + 1) & mask
    t = counts[TEXTS]
    slots[slot] = t
    texts[t, 0], texts[t, 1] = at, n
    counts[TEXTS] = t + 1
    return t


@compiled
def _trimmed(buf: Any, a: Any, b: Any) -> Any:
    while a < b and buf[a] == 32:
        a += 1
    while b > a and buf[b - 1] == 32:
        b -= 1
    return a, b


@compiled
def _value(
    buf: Any, a: Any, b: Any, manner: Any, row: Any, numbers: Any, texts: Any, slots: Any,
    hard: Any, counts: Any, three: Any,
) -> Any:  # fmt: skip
    """Read the text from ``a`` to ``b`` into the next row; how many rows it fills, 0 for none."""
    r = counts[ROWS]
    if manner == CONDITION:
        if b > a:
            row[R_TEXT] = _intern(buf, a, b - a, texts, slots, counts)
        return 1
    if b - a == _UNAVAILABLE.size and is_at(buf, a, b, _UNAVAILABLE):
        return 1
    if manner == TEXT:
        row[R_TEXT] = _intern(buf, a, b - a, texts, slots, counts)
        return 1
    numbers[r], found = number_at(buf, a, b)
    if found == EXACT:
        return 1
    numbers[r] = np.nan
    if found == HARD and b - a < LONGEST_HARD:
        h = counts[HARDS]
        hard[h, 0], hard[h, 1], hard[h, 2] = r, a, b
        counts[HARDS] = h + 1
        return 1
    spatial = manner in (SPATIAL_NUMBER, SPATIAL_VALUE)
    if found == NONE and spatial and three_at(buf, a, b, three) == EXACT:
        return 3
    if manner == VALUE and found == NONE:
        row[R_TEXT] = _intern(buf, a, b - a, texts, slots, counts)
        return 1
    return 0


@compiled
def values(
    buf: Any, elements: Any, n: Any, manners: Any, rows: Any, numbers: Any, sequences: Any,
    texts: Any, slots: Any, slow: Any, hard: Any, counts: Any, date: Any, three: Any,
) -> Any:  # fmt: skip
    """Rows of the first ``n`` elements; those that are left to the reference path go to ``slow``.

    ``counts`` gets the numbers of rows, of texts, of slow elements, and of numbers left to Python
    (``hard``: row, begin, end).  ``slots`` holds -1, ``date`` begins with -1; ``three`` is scratch.
    """
    counts[:] = 0
    for e in range(n):
        s = elements[e, E_SHAPE]
        manner = manners[s] if s >= 0 else REFERENCE
        time = 0
        sequence = np.uint64(0)
        # A time is at most 35 characters, which must lie within the file.
        ok = manner != REFERENCE and elements[e, E_TIME] + 64 <= buf.size
        if ok:
            time, ok = time_at(buf, elements[e, E_TIME], date)
        if ok:
            sequence, ok = sequence_at(buf, elements[e, E_SEQUENCE])
        filled = 0
        r = counts[ROWS]
        if ok:
            a, b = _trimmed(buf, elements[e, E_TEXT], elements[e, E_END])
            rows[r, R_ELEMENT], rows[r, R_TIME] = e, time
            rows[r, R_TEXT] = rows[r, R_AXIS] = -1
            sequences[r] = sequence
            numbers[r] = np.nan
            filled = _value(buf, a, b, manner, rows[r], numbers, texts, slots, hard, counts, three)
        if filled == 0:
            slow[counts[LEFT_OVER]] = e
            counts[LEFT_OVER] += 1
        elif filled == 3:
            for k in range(3):
                rows[r + k, R_ELEMENT], rows[r + k, R_TIME] = e, time
                rows[r + k, R_TEXT], rows[r + k, R_AXIS] = -1, k
                sequences[r + k] = sequence
                numbers[r + k] = three[k]
        counts[ROWS] = r + filled
