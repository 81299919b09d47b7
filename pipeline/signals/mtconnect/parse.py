"""Compiled reading of the values of the observations that the scanner found."""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.mtconnect.bytes import is_at
from pipeline.signals.mtconnect.digits import (
    EXACT,
    HARD,
    NONE,
    number_at,
    sequence_at,
    three_at,
    time_at,
)
from pipeline.signals.mtconnect.scan import E_END, E_SEQUENCE, E_SHAPE, E_TEXT, E_TIME

CAREFUL, NUMBER, VALUE, TEXT, CONDITION, SPATIAL_NUMBER, SPATIAL_VALUE = range(7)
"""Manners, as in ``Shape.manner``; ``CAREFUL`` is left to the careful way."""

R_ELEMENT, R_TIME, R_TEXT, R_AXIS = range(4)
ROW_COLUMNS = 4
"""Columns of the table of rows."""

ROWS, TEXTS, SLOW, HARDS = range(4)
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
    """Rows of the first ``n`` elements; those that are left to the careful way go to ``slow``.

    ``counts`` gets the numbers of rows, of texts, of slow elements, and of numbers left to Python
    (``hard``: row, begin, end).  ``slots`` holds -1, ``date`` begins with -1; ``three`` is scratch.
    """
    counts[:] = 0
    for e in range(n):
        s = elements[e, E_SHAPE]
        manner = manners[s] if s >= 0 else CAREFUL
        time = 0
        sequence = np.uint64(0)
        # A time is at most 35 characters, which must lie within the file.
        ok = manner != CAREFUL and elements[e, E_TIME] + 64 <= buf.size
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
            slow[counts[SLOW]] = e
            counts[SLOW] += 1
        elif filled == 3:
            for k in range(3):
                rows[r + k, R_ELEMENT], rows[r + k, R_TIME] = e, time
                rows[r + k, R_TEXT], rows[r + k, R_AXIS] = -1, k
                sequences[r + k] = sequence
                numbers[r + k] = three[k]
        counts[ROWS] = r + filled
