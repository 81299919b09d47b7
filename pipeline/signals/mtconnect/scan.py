"""Compiled scanning of MTConnectStreams as agents write them.

:func:`scan` finds the observations between the tags of a device stream.  It decides nothing that
the careful way would decide otherwise: an element in any other form is left to it, either alone or
with all that follows.
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.mtconnect.bytes import element_end, is_at, is_space, same
from pipeline.signals.mtconnect.tags import (
    ALONE,
    F_EMPTY,
    F_SEQUENCE_FIRST,
    N_SHAPES,
    ODD_TAG,
    S_CONTEXT,
    S_FLAGS,
    S_NAME,
    S_NEXT,
    SHAPE_COLUMNS,
    TOO_MANY,
    fits,
    shape_at,
    tag_end,
)

SLOW = -1
"""In place of a shape: -1, -2 or -3 for an element of Samples, Events or Condition left alone."""

DEVICE_END, ODD, FULL, STOPPED = 0, 1, 2, 3
"""How :func:`scan` ended."""

E_START, E_SHAPE, E_TIME, E_SEQUENCE, E_TEXT, E_END, E_CLOSE = range(7)
ELEMENT_COLUMNS = 7
"""Columns of the table of elements; ``E_END`` is the end of the text, ``E_CLOSE`` of all."""

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
    elements[e, E_SHAPE] = s if found[1] and s >= 0 else SLOW - state[SECTION]
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
    """Whether no other element has room."""
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
        The shapes known so far, and two ways to find them.
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
