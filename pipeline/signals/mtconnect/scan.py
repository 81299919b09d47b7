"""Compiled scanning of MTConnectStreams as agents write them.

:func:`scan` locates the observations between the tags of a device stream.  An observation is
recognised by its shape, which is its tag without time and sequence.  Shapes repeat, mostly in the
same order, so a tag is first compared with the shape that followed the one before when it was last
seen; only what does not fit is taken apart.  The scan decides nothing that the reference path would
decide otherwise: an element in any other form is left to it, either alone or with all that follows.
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.mtconnect.tokens import (
    E_CLOSE,
    E_END,
    E_SEQUENCE,
    E_SHAPE,
    E_START,
    E_TEXT,
    E_TIME,
    element_end,
    is_at,
    is_space,
    load8,
    name_char,
    same,
    value_end,
)

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
"""In place of a shape: a tag to leave alone, one not as agents write it, a full table of shapes."""

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


LEFT_OVER = -1
"""In place of a shape: -1, -2 or -3 for an element of Samples, Events or Condition left alone."""

DEVICE_END, ODD, FULL, STOPPED = 0, 1, 2, 3
"""How :func:`scan` ended."""

LEVEL, SECTION, BEFORE, N_ELEMENTS, N_TAGS = range(N_SHAPES + 1, N_SHAPES + 6)
STATE_SIZE = N_SHAPES + 6
"""Places in the state that is carried from call to call."""

SCRATCH = SHAPE_COLUMNS
"""Numbers in each of the three arrays that the scanner writes to between two steps."""

_STREAM, _STREAM_END, _DEVICE_END = (
    np.frombuffer(tag, np.uint8).copy()
    for tag in (b"<ComponentStream ", b"</ComponentStream>", b"</DeviceStream>")
)
_SAMPLES, _EVENTS, _CONDITION = (
    np.frombuffer(tag, np.uint8).copy() for tag in (b"<Samples>", b"<Events>", b"<Condition>")
)
_SAMPLES_END, _EVENTS_END, _CONDITION_END = (
    np.frombuffer(tag, np.uint8).copy() for tag in (b"</Samples>", b"</Events>", b"</Condition>")
)


@compiled
def _section_begin(buf: Any, at: Any, end: Any, state: Any) -> Any:
    """A section, or the end of the component stream, begins at ``at``; the place after it or -1."""
    if is_at(buf, at, end, _SAMPLES):
        state[SECTION], state[LEVEL] = 0, 5
        return at + _SAMPLES.size
    if is_at(buf, at, end, _EVENTS):
        state[SECTION], state[LEVEL] = 1, 5
        return at + _EVENTS.size
    if is_at(buf, at, end, _CONDITION):
        state[SECTION], state[LEVEL] = 2, 5
        return at + _CONDITION.size
    if is_at(buf, at, end, _STREAM_END):
        state[LEVEL] = 3
        return at + _STREAM_END.size
    return -1


@compiled
def _section_end(buf: Any, at: Any, end: Any, state: Any) -> Any:
    """The section ends at ``at``: the place after its tag, -1 when that is another tag."""
    section = state[SECTION]
    state[LEVEL] = 4
    if section == 0 and is_at(buf, at, end, _SAMPLES_END):
        return at + _SAMPLES_END.size
    if section == 1 and is_at(buf, at, end, _EVENTS_END):
        return at + _EVENTS_END.size
    if section == 2 and is_at(buf, at, end, _CONDITION_END):
        return at + _CONDITION_END.size
    state[LEVEL] = 5
    return -1


@compiled
def _component(buf: Any, at: Any, end: Any, state: Any, tags: Any, cuts: Any, found: Any) -> Any:
    """A component stream begins at ``at``: the place after its tag, -1 when it is another tag."""
    if not is_at(buf, at, end, _STREAM):
        return -1
    after = tag_end(buf, at, end, cuts, found)
    if after < 0:
        return -1
    n = state[N_TAGS]
    tags[n, 0], tags[n, 1], tags[n, 2] = at, after, state[N_ELEMENTS]
    state[N_TAGS] = n + 1
    if not cuts[S_FLAGS] & F_EMPTY:
        state[LEVEL] = 4
    return after


@compiled
def _text_end(buf: Any, at: Any, end: Any, name_at: Any, name: Any, found: Any) -> Any:
    """The place after the end tag of the element whose text begins at ``at``, -1 for none.

    ``found`` gets the end of the text and whether it is all that is in the element, in plain form.
    """
    i = at
    plain = 1
    while i < end and buf[i] != 60:
        c = buf[i]
        if c < 32 or c == 38 or c == 62:
            plain = 0
        i += 1
    found[0], found[1] = i, plain
    close = i + name + 3
    if close > end:
        return -1
    if buf[i + 1] == 47 and buf[close - 1] == 62 and same(buf, i + 2, name_at, name):
        return close
    found[1] = 0
    return element_end(buf, i, end, name_at, name)


@compiled
def _observation(
    buf: Any, at: Any, end: Any, s: Any, state: Any, shapes: Any, elements: Any, cuts: Any,
    where: Any, found: Any,
) -> Any:  # fmt: skip
    """Note the element of shape ``s``; the place after it, -1 when it ends in another form."""
    name, flags = (
        (shapes[s, S_NAME], shapes[s, S_FLAGS]) if s >= 0 else (cuts[S_NAME], cuts[S_FLAGS])
    )
    text = where[2]
    close = found[0] = text
    found[1] = 1
    if not flags & F_EMPTY:
        close = _text_end(buf, text, end, at + 1, name, found)
        if close < 0:
            return -1
    e = state[N_ELEMENTS]
    elements[e, E_START] = at
    elements[e, E_SHAPE] = s if found[1] and s >= 0 else LEFT_OVER - state[SECTION]
    first = 1 if flags & F_SEQUENCE_FIRST else 0
    elements[e, E_TIME] = where[first]
    elements[e, E_SEQUENCE] = where[1 - first]
    elements[e, E_TEXT] = text
    elements[e, E_END] = found[0]
    elements[e, E_CLOSE] = close
    state[N_ELEMENTS] = e + 1
    return close


@compiled
def full(state: Any, elements: Any) -> Any:
    """Whether the table of elements is full."""
    return state[N_ELEMENTS] >= elements.shape[0]


@compiled
def _next_shape(
    buf: Any, at: Any, end: Any, shapes: Any, slots: Any, guesses: Any, state: Any, cuts: Any,
    context: Any, where: Any, found: Any,
) -> Any:  # fmt: skip
    """As :func:`shape_at`, trying first the shape that followed the one before."""
    before = state[BEFORE]
    s = shapes[before, S_NEXT] if before >= 0 else ALONE
    if s < 0 or shapes[s, S_CONTEXT] != context or not fits(buf, at, end, shapes, s, where):
        s = shape_at(buf, at, end, shapes, slots, guesses, state, cuts, context, where, found)
        if before >= 0 and s >= 0:
            shapes[before, S_NEXT] = s
    if s >= 0:
        state[BEFORE] = s
    return s


@compiled
def scan(
    buf: Any, at: Any, stop: Any, end: Any, device: Any, state: Any, shapes: Any, slots: Any,
    guesses: Any, elements: Any, tags: Any, cuts: Any, where: Any, found: Any,
) -> Any:  # fmt: skip
    """Find observations from ``at`` on until the device stream ends, ``stop`` is passed, or else.

    Parameters
    ----------
    buf : uint8[n]
        The file.
    at, stop, end : int
        Where to begin, from where on to begin no other element, and where to look no further.
    device : int
        Number of the device; shapes of two devices are never the same.
    state : int64[STATE_SIZE]
        Level of nesting (3 device stream, 4 component stream, 5 section) and counts.
    shapes, slots, guesses : int arrays
        The shapes seen so far, and two tables to look them up.
    elements : int64[:, ELEMENT_COLUMNS]
        Gets what is found.
    tags : int64[:, 3]
        Gets begin and end of the tags of component streams, and the elements before each.
    cuts, where, found : int64[SCRATCH]
        Scratch.

    Returns
    -------
    tuple of int
        Where it ended, and how: ``DEVICE_END``, ``ODD``, ``FULL`` or ``STOPPED``.
    """
    while True:
        while at < end and is_space(buf[at]):
            at += 1
        if stop <= at < end or state[N_TAGS] >= tags.shape[0] or full(state, elements):
            return at, STOPPED
        if at + 2 >= end or buf[at] != 60:
            return at, ODD
        level = state[LEVEL]
        if level == 5 and buf[at + 1] != 47:
            context = device * 4 + state[SECTION]
            s = _next_shape(
                buf, at, end, shapes, slots, guesses, state, cuts, context, where, found
            )
            if s == TOO_MANY or s == ODD_TAG:  # noqa: SIM109 - a tuple costs time here
                return at, (FULL if s == TOO_MANY else ODD)
            after = _observation(buf, at, end, s, state, shapes, elements, cuts, where, found)
        elif level == 5:
            after = _section_end(buf, at, end, state)
        elif level == 4:
            after = _section_begin(buf, at, end, state)
        elif is_at(buf, at, end, _DEVICE_END):
            return at + _DEVICE_END.size, DEVICE_END
        else:
            after = _component(buf, at, end, state, tags, cuts, found)
        if after < 0:
            return at, ODD
        at = after
