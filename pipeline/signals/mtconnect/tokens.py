"""Compiled reading of tokens: names, times, sequences, and the values of observations.

These functions allocate nothing, as :func:`pipeline.kernels.compiled` requires.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from pipeline.kernels import compiled
from pipeline.signals.literals import COPIED, EXACT, NONE, number_at, time_at


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


MOST_DIGITS = 19
_TEN = np.uint64(10)


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
def _number(buf: Any, at: Any, end: Any) -> Any:
    """The number that fills ``at`` to ``end``: ``EXACT``, ``COPIED`` (for Python) or ``NONE``."""
    found, value, stop = number_at(buf, at)
    if found == NONE or stop != end:
        return 0.0, NONE
    return value, (EXACT if found == EXACT else COPIED)


@compiled
def three_at(buf: Any, at: Any, end: Any, numbers: Any) -> Any:
    """Three numbers parted by single blanks: ``EXACT``, ``COPIED`` or ``NONE``."""
    i = at
    j = at
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
    return EXACT if j == end else COPIED


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
    numbers[r], found = _number(buf, a, b)
    if found == EXACT:
        return 1
    numbers[r] = np.nan
    if found == COPIED and b - a < LONGEST_HARD:
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
    texts: Any, slots: Any, slow: Any, hard: Any, counts: Any, three: Any,
) -> Any:  # fmt: skip
    """Rows of the first ``n`` elements; those that are left to the reference path go to ``slow``.

    ``counts`` gets the numbers of rows, of texts, of slow elements, and of numbers left to Python
    (``hard``: row, begin, end).  ``slots`` holds -1; ``three`` is scratch.
    """
    counts[:] = 0
    date, days = -1, 0
    for e in range(n):
        s = elements[e, E_SHAPE]
        manner = manners[s] if s >= 0 else REFERENCE
        time = 0
        sequence = np.uint64(0)
        # A time is at most 35 characters, which must lie within the file.
        ok = manner != REFERENCE and elements[e, E_TIME] + 64 <= buf.size
        if ok:
            at = elements[e, E_TIME]
            time, after, date, days = time_at(buf, at, buf.size, 34, date, days)
            ok = after >= 0
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
