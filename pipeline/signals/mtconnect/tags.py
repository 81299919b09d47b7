"""Compiled recognition of an observation by its shape: its tag without time and sequence.

Shapes repeat, mostly in the same order, so a tag is first compared with the shape that followed
the one before when it was last seen; only what does not fit is taken apart.
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.mtconnect.bytes import is_at, load8, name_char, same, value_end

SHAPES = 1 << 16
SLOTS = 1 << 18
GUESSES = 1 << 12

# Columns of the table of shapes.
S_START, S_CUT1, S_LEN1, S_CUT2, S_LEN2, S_END, S_NAME, S_FLAGS, S_NEXT, S_CONTEXT = range(10)
SHAPE_COLUMNS = 10
F_EMPTY, F_SEQUENCE_FIRST = 1, 2

N_SHAPES = 0
"""Place in the state of the number of shapes."""

ALONE, ODD_TAG, TOO_MANY = -1, -2, -3
"""In place of a shape: a tag to leave alone, one not as agents write it, no room for another."""

TIME, SEQUENCE = 1, 2
_TIMESTAMP = np.frombuffer(b"timestamp", np.uint8).copy()
_SEQUENCE = np.frombuffer(b"sequence", np.uint8).copy()


@compiled
def attribute(buf: Any, at: Any, end: Any, found: Any) -> Any:
    """The attribute that begins at ``at``: which of the two that vary it is, 0 for any other.

    ``found`` gets where its value begins and ends; -1 when it is not as agents write it.
    """
    i = at
    while i < end and name_char(buf[i]):
        i += 1
    if i == at or i + 1 >= end or buf[i] != 61 or buf[i + 1] != 34:
        return -1
    length = i - at
    found[0] = i + 2
    found[1] = value_end(buf, i + 2, end)
    if found[1] < 0:
        return -1
    if length == 9 and is_at(buf, at, end, _TIMESTAMP):
        return TIME
    if length == 8 and is_at(buf, at, end, _SEQUENCE):
        return SEQUENCE
    return 0


@compiled
def _name_end(buf: Any, at: Any, end: Any) -> Any:
    """Where the element's name that begins at ``at`` ends; -1 when it is none in ASCII."""
    i = at
    while i < end and name_char(buf[i]):
        i += 1
    if i == at or buf[at] == 45 or buf[at] == 46 or buf[at] == 58 or 48 <= buf[at] <= 57:
        return -1
    return i


@compiled
def tag_end(buf: Any, at: Any, end: Any, cuts: Any, found: Any) -> Any:
    """Take the start tag at ``at`` apart; ``cuts`` gets where the values that vary lie.

    Returns the place after ``>``, or -1 when the tag is not as agents write it.
    """
    i = _name_end(buf, at + 1, end)
    if i < 0:
        return -1
    cuts[S_START], cuts[S_NAME], cuts[S_FLAGS] = at, i - at - 1, 0
    cuts[S_CUT1] = cuts[S_CUT2] = -1
    first = 0
    while i < end and buf[i] == 32:
        i += 1
        if i < end and (buf[i] == 47 or buf[i] == 62):
            break  # a blank before the end of the tag
        which = attribute(buf, i, end, found)
        if which < 0 or (which > 0 and (which == first or cuts[S_CUT2] >= 0)):
            return -1
        if which > 0 and first == 0:
            first = which
            cuts[S_CUT1], cuts[S_LEN1] = found[0] - at, found[1] - found[0]
        elif which > 0:
            cuts[S_CUT2], cuts[S_LEN2] = found[0] - at, found[1] - found[0]
        i = found[1] + 1
    if first == SEQUENCE:
        cuts[S_FLAGS] |= F_SEQUENCE_FIRST
    if i + 1 < end and buf[i] == 47 and buf[i + 1] == 62:
        cuts[S_FLAGS] |= F_EMPTY
        i += 2
    elif i < end and buf[i] == 62:
        i += 1
    else:
        return -1
    cuts[S_END] = i - at
    return i


@compiled
def fits(buf: Any, at: Any, end: Any, shapes: Any, s: Any, where: Any) -> Any:
    """Whether the tag at ``at`` has shape ``s``; ``where`` gets its two values and its end."""
    start = shapes[s, S_START]
    n = shapes[s, S_CUT1]
    if at + shapes[s, S_END] + 64 > end:
        return False
    if not same(buf, at, start, n):
        return False
    first = at + n
    i = value_end(buf, first, end)
    if i < 0:
        return False
    rest = shapes[s, S_CUT1] + shapes[s, S_LEN1]
    n = shapes[s, S_CUT2] - rest
    if i + n + 64 > end or not same(buf, i, start + rest, n):
        return False
    second = i + n
    i = value_end(buf, second, end)
    if i < 0:
        return False
    rest = shapes[s, S_CUT2] + shapes[s, S_LEN2]
    n = shapes[s, S_END] - rest
    if i + n > end or not same(buf, i, start + rest, n):
        return False
    where[0] = first
    where[1] = second
    where[2] = i + n
    return True


@compiled
def _hash(buf: Any, at: Any, cuts: Any, context: Any) -> Any:
    h = np.uint64(14695981039346656037) ^ np.uint64(context)
    p = np.uint64(1099511628211)
    a = cuts[S_CUT1]
    b = a + cuts[S_LEN1]
    c = cuts[S_CUT2]
    d = c + cuts[S_LEN2]
    for i in range(0, a):
        h = (h ^ np.uint64(buf[at + i])) * p
    for i in range(b, c):
        h = (h ^ np.uint64(buf[at + i])) * p
    for i in range(d, cuts[S_END]):
        h = (h ^ np.uint64(buf[at + i])) * p
    return h


@compiled
def _lookup(
    buf: Any, at: Any, end: Any, shapes: Any, slots: Any, state: Any, cuts: Any, context: Any,
    where: Any,
) -> Any:  # fmt: skip
    """The shape of a tag that was taken apart, a new one if need be; -1 when there are too many."""
    slot = np.int64(_hash(buf, at, cuts, context) & np.uint64(SLOTS - 1))
    while slots[slot] >= 0:
        s = slots[slot]
        if shapes[s, S_CONTEXT] == context and fits(buf, at, end, shapes, s, where):
            return s
        slot = (slot + 1) & (SLOTS - 1)
    s = state[N_SHAPES]
    if s >= SHAPES:
        return -1
    slots[slot] = s
    state[N_SHAPES] = s + 1
    for k in range(SHAPE_COLUMNS):
        shapes[s, k] = cuts[k]
    shapes[s, S_NEXT] = s
    shapes[s, S_CONTEXT] = context
    where[0] = at + cuts[S_CUT1]
    where[1] = at + cuts[S_CUT2]
    where[2] = at + cuts[S_END]
    return s


@compiled
def _guess(buf: Any, at: Any, end: Any, context: Any) -> Any:
    """A slot for the tag at ``at`` by its name and its first attribute, mostly the item's id."""
    i = at + 8
    stop = min(end, at + 200)
    while i < stop and buf[i] != 34:
        i += 1
    i += 1
    while i < stop and buf[i] != 34:
        i += 1
    if i >= stop:
        return 0
    h = (load8(buf, at + 1) ^ np.uint64(context + (i - at) * 64)) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ load8(buf, i - 8) ^ (h >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return np.int64(h >> np.uint64(52))


@compiled
def shape_at(
    buf: Any, at: Any, end: Any, shapes: Any, slots: Any, guesses: Any, state: Any, cuts: Any,
    context: Any, where: Any, found: Any,
) -> Any:  # fmt: skip
    """The shape of the tag at ``at``, or :data:`ALONE`, :data:`ODD_TAG`, :data:`TOO_MANY`."""
    slot = _guess(buf, at, end, context)
    s = guesses[slot]
    if s >= 0 and shapes[s, S_CONTEXT] == context and fits(buf, at, end, shapes, s, where):
        return s
    i = tag_end(buf, at, end, cuts, found)
    if i < 0:
        return ODD_TAG
    where[2] = i
    if cuts[S_CUT2] < 0:
        return ALONE
    s = _lookup(buf, at, end, shapes, slots, state, cuts, context, where)
    if s < 0:
        return TOO_MANY
    guesses[slot] = s
    return s
