"""Compiled reading of times, sequences and numbers of the observations that were found."""

import numba as nb
import numpy as np

from pipeline.signals.mtconnect_scan import (
    E_END,
    E_SEQUENCE,
    E_SHAPE,
    E_TEXT,
    E_TIME,
    load8,
)

# Manners, as in Shape.manner; 0 is left to the careful way.
CAREFUL, NUMBER, VALUE, TEXT, CONDITION, SPATIAL_NUMBER, SPATIAL_VALUE = range(7)

# Columns of the table of rows.
R_ELEMENT, R_TIME, R_TEXT, R_AXIS = range(4)
ROW_COLUMNS = 4

# What a number turned out to be.
EXACT, HARD, NONE = 0, 1, 2

_UNAVAILABLE = np.frombuffer(b"UNAVAILABLE", np.uint8).copy()
_TENS = 10.0 ** np.arange(23)
_MONTH = np.array([0, 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])
_EXACT_LIMIT = np.uint64(1 << 53)

_jit = nb.njit(cache=True, nogil=True)


@_jit
def _two(buf, at):
    a = np.int64(buf[at]) - 48
    b = np.int64(buf[at + 1]) - 48
    if a < 0 or a > 9 or b < 0 or b > 9:
        return -1
    return a * 10 + b


@_jit
def _days(buf, at):
    """Days from 1970 to the date at ``at``; -1e9 when it is none of 1900 to 2199."""
    century = _two(buf, at)
    year = _two(buf, at + 2)
    month = _two(buf, at + 5)
    day = _two(buf, at + 8)
    if century < 19 or century > 21 or year < 0 or month < 1 or month > 12 or day < 1:
        return -1000000000
    if buf[at + 4] != 45 or buf[at + 7] != 45:
        return -1000000000
    y = century * 100 + year
    leap = (y % 4 == 0 and y % 100 != 0) or y % 400 == 0
    if day > _MONTH[month] + (1 if leap and month == 2 else 0):
        return -1000000000
    # Days from civil, counting years from March.
    if month <= 2:
        y -= 1
    era = y // 400
    yoe = y - era * 400
    doy = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146097 + yoe * 365 + yoe // 4 - yoe // 100 + doy - 719468


@_jit
def _time(buf, at, date):
    """Nanoseconds since 1970 and whether the time at ``at`` is as agents write it.

    ``date`` keeps the last date's place and days, as times of one day follow each other.
    """
    days = date[1]
    known = date[0]
    if (
        known < 0
        or load8(buf, at) != load8(buf, known)
        or buf[at + 8] != buf[known + 8]
        or buf[at + 9] != buf[known + 9]
    ):
        days = _days(buf, at)
        if days == -1000000000:
            return 0, False
        date[0] = at
        date[1] = days
    hour = _two(buf, at + 11)
    minute = _two(buf, at + 14)
    second = _two(buf, at + 17)
    if hour < 0 or hour > 23 or minute < 0 or minute > 59 or second < 0 or second > 59:
        return 0, False
    if buf[at + 10] != 84 or buf[at + 13] != 58 or buf[at + 16] != 58:
        return 0, False
    i = at + 19
    ns = 0
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
    if buf[i] != 34:
        return 0, False
    return (days * 86400 + hour * 3600 + minute * 60 + second) * 1000000000 + ns, True


@_jit
def _sequence(buf, at):
    value = np.uint64(0)
    i = at
    while 48 <= buf[i] <= 57:
        value = value * np.uint64(10) + np.uint64(buf[i] - 48)
        i += 1
    # 19 digits always fit 64 bits.
    return value, buf[i] == 34 and 0 < i - at <= 19


@_jit
def _number(buf, at, end):
    """A decimal number: its value, and whether it is exact, hard (left to Python) or none."""
    i = at
    negative = False
    if i < end and (buf[i] == 45 or buf[i] == 43):
        negative = buf[i] == 45
        i += 1
    m = np.uint64(0)
    digits = 0
    scale = 0
    significant = 0
    seen_point = False
    zeros = 0
    while i < end:
        c = buf[i]
        if 48 <= c <= 57:
            digits += 1
            if c == 48 and seen_point:
                # Zeros at the end of a fraction add nothing; they count if more digits follow.
                zeros += 1
            else:
                while zeros > 0:
                    m *= np.uint64(10)
                    significant += 1
                    scale += 1
                    zeros -= 1
                m = m * np.uint64(10) + np.uint64(c - 48)
                if m > np.uint64(0):
                    significant += 1
                if seen_point:
                    scale += 1
        elif c == 46 and not seen_point:
            seen_point = True
        else:
            break
        i += 1
    if digits == 0:
        return 0.0, NONE
    if i < end and (buf[i] == 101 or buf[i] == 69):
        return 0.0, HARD
    if i != end:
        return 0.0, NONE
    if significant > 19 or m > _EXACT_LIMIT or scale > 22:
        return 0.0, HARD
    value = np.float64(m) / _TENS[scale]
    return (-value if negative else value), EXACT


@_jit
def _three(buf, at, end, numbers):
    """Three numbers parted by single blanks: EXACT, HARD or NONE."""
    i = at
    for k in range(3):
        j = i
        while j < end and buf[j] != 32:
            j += 1
        value, found = _number(buf, i, j)
        if found != EXACT:
            return found
        numbers[k] = value
        if k < 2 and j >= end:
            return NONE
        i = j + 1
    return EXACT if j == end else HARD


@_jit
def _intern(buf, at, n, texts, slots, count):
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
            same = True
            for i in range(n):
                if buf[texts[t, 0] + i] != buf[at + i]:
                    same = False
                    break
            if same:
                return t
        slot = (slot + 1) & mask
    t = count[0]
    slots[slot] = t
    texts[t, 0] = at
    texts[t, 1] = n
    count[0] = t + 1
    return t


@_jit
def values(buf, elements, n, manners, rows, numbers, sequences, texts, slots, slow, hard):
    """Rows of the elements; those that are left to the careful way go to ``slow``.

    Returns
    -------
    tuple of int
        Counts of rows, of texts, of slow elements and of numbers left to Python (``hard``).
    """
    date = np.full(2, -1, np.int64)
    three = np.zeros(3)
    count = np.zeros(1, np.int64)
    r = 0
    n_slow = 0
    n_hard = 0
    for e in range(n):
        s = elements[e, E_SHAPE]
        manner = manners[s] if s >= 0 else CAREFUL
        time, ok = 0, False
        # A time is at most 35 characters, which must lie within the file.
        if manner != CAREFUL and elements[e, E_TIME] + 64 <= buf.size:
            time, ok = _time(buf, elements[e, E_TIME], date)
        sequence = np.uint64(0)
        if ok:
            sequence, ok = _sequence(buf, elements[e, E_SEQUENCE])
        if not ok:
            slow[n_slow] = e
            n_slow += 1
            continue
        a = elements[e, E_TEXT]
        b = elements[e, E_END]
        while a < b and buf[a] == 32:
            a += 1
        while b > a and buf[b - 1] == 32:
            b -= 1
        rows[r, R_ELEMENT] = e
        rows[r, R_TIME] = time
        rows[r, R_TEXT] = -1
        rows[r, R_AXIS] = -1
        sequences[r] = sequence
        numbers[r] = np.nan
        if manner == CONDITION:
            if b > a:
                rows[r, R_TEXT] = _intern(buf, a, b - a, texts, slots, count)
            r += 1
            continue
        if b - a == 11 and buf[a] == 85:
            gone = True
            for i in range(11):
                if buf[a + i] != _UNAVAILABLE[i]:
                    gone = False
            if gone:
                r += 1
                continue
        if manner == TEXT:
            rows[r, R_TEXT] = _intern(buf, a, b - a, texts, slots, count)
            r += 1
            continue
        value, found = _number(buf, a, b)
        if found == EXACT:
            numbers[r] = value
            r += 1
            continue
        if found == NONE and (manner == SPATIAL_NUMBER or manner == SPATIAL_VALUE):
            found = _three(buf, a, b, three)
            if found == EXACT:
                for k in range(3):
                    rows[r, R_ELEMENT] = e
                    rows[r, R_TIME] = time
                    rows[r, R_TEXT] = -1
                    rows[r, R_AXIS] = k
                    sequences[r] = sequence
                    numbers[r] = three[k]
                    r += 1
                continue
        if found == HARD and b - a < 300 and manner != SPATIAL_VALUE and _number(buf, a, b)[1] == HARD:
            hard[n_hard, 0], hard[n_hard, 1], hard[n_hard, 2] = r, a, b
            n_hard += 1
            r += 1
            continue
        if found == HARD or manner != VALUE:
            slow[n_slow] = e
            n_slow += 1
            continue
        rows[r, R_TEXT] = _intern(buf, a, b - a, texts, slots, count)
        r += 1
    return r, count[0], n_slow, n_hard
