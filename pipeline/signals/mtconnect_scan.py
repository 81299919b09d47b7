"""Compiled scanning of MTConnectStreams as agents write them.

:func:`scan` finds the observations between the tags of a device stream, :func:`values` reads their
times, sequences and numbers.  Neither decides anything that the careful way would decide otherwise:
an element in any other form is left to it, either alone (``SLOW``) or with all that follows.

An observation is told by its *shape*: its tag without the values of ``timestamp`` and ``sequence``.
Shapes repeat, mostly in the same order, so a tag is first compared with the shape that followed
the one before when it was last seen; only what does not fit is taken apart.
"""

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

SHAPES = 1 << 16
SLOTS = 1 << 18
GUESSES = 1 << 12
SLOW = -1
"""In place of a shape: -1, -2 or -3 for an element of Samples, Events or Condition left alone."""

# How `scan` ended.
DEVICE_END, ODD, FULL, STOPPED = 0, 1, 2, 3

# Columns of the table of shapes.
S_START, S_CUT1, S_LEN1, S_CUT2, S_LEN2, S_END, S_NAME, S_FLAGS, S_NEXT, S_CONTEXT = range(10)
SHAPE_COLUMNS = 10
F_EMPTY, F_SEQUENCE_FIRST = 1, 2

# Columns of the table of elements.
E_START, E_SHAPE, E_TIME, E_SEQUENCE, E_TEXT, E_END, E_CLOSE = range(7)
ELEMENT_COLUMNS = 7

# State that is carried from call to call.
LEVEL, SECTION, BEFORE, N_SHAPES, N_ELEMENTS, N_TAGS = range(6)
STATE_SIZE = 6

_TAGS = tuple(
    np.frombuffer(t, np.uint8).copy()
    for t in (
        b"<ComponentStream ",
        b"</ComponentStream>",
        b"</DeviceStream>",
        b"<Samples>",
        b"<Events>",
        b"<Condition>",
        b"</Samples>",
        b"</Events>",
        b"</Condition>",
    )
)
_T0, _T1, _T2, _T3, _T4, _T5, _T6, _T7, _T8 = _TAGS
_DEVICE = np.frombuffer(b"DeviceStream ", np.uint8).copy()
# How far the search may go on when this byte stands where the last of `_DEVICE` would.
_SKIP = np.full(256, _DEVICE.size, np.int64)
_SKIP[_DEVICE] = _DEVICE.size - 1 - np.arange(_DEVICE.size)

_TIMESTAMP = np.frombuffer(b"timestamp", np.uint8).copy()
_SEQUENCE = np.frombuffer(b"sequence", np.uint8).copy()

_jit = nb.njit(cache=True, nogil=True)


@intrinsic
def load8(typing_context, buf, at):
    """Eight bytes of ``buf`` from ``at`` on as one number; they must lie within it."""

    def generate(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        pointer = builder.gep(array.data, [args[1]])
        wide = builder.bitcast(pointer, ir.IntType(64).as_pointer())
        word = builder.load(wide)
        word.align = 1
        return word

    return types.uint64(buf, types.int64), generate


@_jit
def _is(buf, at, end, word):
    n = word.size
    if at + n > end:
        return False
    for i in range(n):
        if buf[at + i] != word[i]:
            return False
    return True


@_jit
def _same(buf, a, b, n):
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


@_jit
def _space(c):
    return c == 32 or c == 10 or c == 13 or c == 9


@_jit
def _name_char(c):
    return (
        97 <= c <= 122 or 65 <= c <= 90 or 48 <= c <= 57 or c == 95 or c == 58 or c == 45 or c == 46
    )


@_jit
def _value_end(buf, at, end):
    """The quote that ends an attribute's value, -1 if something odd comes before."""
    while at < end:
        c = buf[at]
        if c == 34:
            return at
        if c < 32 or c == 60:
            return -1
        at += 1
    return -1


@_jit
def _tag(buf, at, end, cuts):
    """Take a start tag apart; ``cuts`` gets where its values lie.

    Returns the place after ``>``, or -1 when the tag is not as agents write it.
    """
    i = at + 1
    while i < end and _name_char(buf[i]):
        i += 1
    cuts[S_NAME] = i - at - 1
    if i == at + 1:
        return -1
    first = buf[at + 1]
    if not (97 <= first <= 122 or 65 <= first <= 90 or first == 95):
        return -1
    time_at = -1
    time_end = -1
    sequence_at = -1
    sequence_end = -1
    flags = 0
    while i < end:
        if buf[i] == 62:
            i += 1
            break
        if buf[i] == 47:
            if i + 1 >= end or buf[i + 1] != 62:
                return -1
            flags |= F_EMPTY
            i += 2
            break
        if buf[i] != 32:
            return -1
        i += 1
        name = i
        while i < end and _name_char(buf[i]):
            i += 1
        if i == name:
            # A blank before the end of the tag.
            if i < end and (buf[i] == 47 or buf[i] == 62):
                continue
            return -1
        if i + 1 >= end or buf[i] != 61 or buf[i + 1] != 34:
            return -1
        length = i - name
        value = i + 2
        i = _value_end(buf, value, end)
        if i < 0:
            return -1
        if length == 9 and _is(buf, name, end, _TIMESTAMP):
            if time_at >= 0:
                return -1
            time_at, time_end = value, i
        elif length == 8 and _is(buf, name, end, _SEQUENCE):
            if sequence_at >= 0:
                return -1
            sequence_at, sequence_end = value, i
        i += 1
    else:
        return -1
    if time_at < 0 or sequence_at < 0:
        # Left alone to the careful way.
        cuts[S_CUT1] = -1
        cuts[S_FLAGS] = flags
        cuts[S_END] = i - at
        return i
    cuts[S_START] = at
    if sequence_at < time_at:
        flags |= F_SEQUENCE_FIRST
        time_at, sequence_at = sequence_at, time_at
        time_end, sequence_end = sequence_end, time_end
    cuts[S_CUT1] = time_at - at
    cuts[S_LEN1] = time_end - time_at
    cuts[S_CUT2] = sequence_at - at
    cuts[S_LEN2] = sequence_end - sequence_at
    cuts[S_END] = i - at
    cuts[S_FLAGS] = flags
    return i


@_jit
def _fits(buf, at, end, shapes, s, where):
    """Whether the tag at ``at`` has shape ``s``; ``where`` gets its two values and its end."""
    start = shapes[s, S_START]
    n = shapes[s, S_CUT1]
    if at + shapes[s, S_END] + 64 > end:
        return False
    if not _same(buf, at, start, n):
        return False
    first = at + n
    i = _value_end(buf, first, end)
    if i < 0:
        return False
    rest = shapes[s, S_CUT1] + shapes[s, S_LEN1]
    n = shapes[s, S_CUT2] - rest
    if i + n + 64 > end or not _same(buf, i, start + rest, n):
        return False
    second = i + n
    i = _value_end(buf, second, end)
    if i < 0:
        return False
    rest = shapes[s, S_CUT2] + shapes[s, S_LEN2]
    n = shapes[s, S_END] - rest
    if i + n > end or not _same(buf, i, start + rest, n):
        return False
    where[0] = first
    where[1] = second
    where[2] = i + n
    return True


@_jit
def _hash(buf, at, cuts, context):
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


@_jit
def _lookup(buf, at, end, shapes, slots, state, cuts, context, where):
    """The shape of a tag that was taken apart, a new one if need be; -1 when there are too many."""
    slot = np.int64(_hash(buf, at, cuts, context) & np.uint64(SLOTS - 1))
    while slots[slot] >= 0:
        s = slots[slot]
        if shapes[s, S_CONTEXT] == context and _fits(buf, at, end, shapes, s, where):
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


@_jit
def _guess(buf, at, end, context):
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


@_jit
def _shape(buf, at, end, shapes, slots, guesses, state, cuts, context, where):
    """The shape of the tag at ``at``, which begins as one of its kind did when last seen, or not.

    -1 for a tag to leave alone, -2 for one not as agents write it, -3 when there are too many.
    """
    slot = _guess(buf, at, end, context)
    s = guesses[slot]
    if s >= 0 and shapes[s, S_CONTEXT] == context and _fits(buf, at, end, shapes, s, where):
        return s
    i = _tag(buf, at, end, cuts)
    if i < 0:
        return -2
    if cuts[S_CUT1] < 0:
        where[2] = i
        return -1
    s = _lookup(buf, at, end, shapes, slots, state, cuts, context, where)
    if s < 0:
        return -3
    guesses[slot] = s
    return s


@_jit
def _element_end(buf, at, end, name, length):
    """The place after ``</name>``; -1 where it is not found or a comment, CDATA, ... comes before."""
    while at + length + 3 <= end:
        if buf[at] == 60:
            c = buf[at + 1]
            if c == 33 or c == 63:
                return -1
            if c == 47 and _same(buf, at + 2, name, length):
                after = buf[at + 2 + length]
                if after == 62:
                    return at + length + 3
                if not _name_char(after):
                    return -1
        at += 1
    return -1


@_jit
def scan(buf, at, stop, end, device, state, shapes, slots, guesses, elements, tags):
    """Find observations from ``at`` on until the device stream ends, ``stop`` is passed, or else.

    Parameters
    ----------
    buf : uint8[n]
        The file.
    device : int
        Number of the device; shapes of two devices are never the same.
    state : int64[6]
        Level of nesting (3 device stream, 4 component stream, 5 section) and counts.
    tags : int64[:, 3]
        Gets begin and end of the tags of component streams, and the elements before each.

    Returns
    -------
    tuple of int
        Where it ended, and how: ``DEVICE_END``, ``ODD``, ``FULL`` or ``STOPPED``.
    """
    cuts = np.zeros(SHAPE_COLUMNS, np.int64)
    where = np.zeros(3, np.int64)
    before = state[BEFORE]
    room = elements.shape[0]
    while True:
        while at < end and _space(buf[at]):
            at += 1
        if at >= stop and at < end:
            state[BEFORE] = before
            return at, STOPPED
        if at + 2 >= end or buf[at] != 60:
            return at, ODD
        level = state[LEVEL]
        if level == 5 and buf[at + 1] != 47:
            if state[N_ELEMENTS] >= room:
                state[BEFORE] = before
                return at, STOPPED
            context = device * 4 + state[SECTION]
            s = shapes[before, S_NEXT] if before >= 0 else -1
            if s < 0 or shapes[s, S_CONTEXT] != context or not _fits(
                buf, at, end, shapes, s, where
            ):
                s = _shape(buf, at, end, shapes, slots, guesses, state, cuts, context, where)
                if s == -2:
                    return at, ODD
                if s == -3:
                    state[BEFORE] = -1
                    return at, FULL
                if s == -1:
                    s = SLOW - state[SECTION]
                elif before >= 0:
                    shapes[before, S_NEXT] = s
            e = state[N_ELEMENTS]
            text = where[2]
            i = text
            if s >= 0:
                name = shapes[s, S_NAME]
                empty = shapes[s, S_FLAGS] & F_EMPTY
                before = s
            else:
                name = cuts[S_NAME]
                empty = cuts[S_FLAGS] & F_EMPTY
            if not empty:
                plain = True
                while i < end and buf[i] != 60:
                    c = buf[i]
                    if c < 32 or c == 38 or c == 62:
                        plain = False
                    i += 1
                if i + name + 3 > end:
                    return at, ODD
                close = i + name + 3
                if not (
                    buf[i + 1] == 47
                    and buf[close - 1] == 62
                    and _same(buf, i + 2, at + 1, name)
                ):
                    plain = False
                    close = _element_end(buf, i, end, at + 1, name)
                    if close < 0:
                        return at, ODD
                if not plain:
                    s = SLOW - state[SECTION]
            else:
                close = i
            elements[e, E_START] = at
            elements[e, E_SHAPE] = s
            if s >= 0 and shapes[s, S_FLAGS] & F_SEQUENCE_FIRST:
                elements[e, E_SEQUENCE] = where[0]
                elements[e, E_TIME] = where[1]
            else:
                elements[e, E_TIME] = where[0]
                elements[e, E_SEQUENCE] = where[1]
            elements[e, E_TEXT] = text
            elements[e, E_END] = i
            elements[e, E_CLOSE] = close
            state[N_ELEMENTS] = e + 1
            at = close
        elif level == 5:
            section = state[SECTION]
            if section == 0 and _is(buf, at, end, _T6):
                at += _T6.size
            elif section == 1 and _is(buf, at, end, _T7):
                at += _T7.size
            elif section == 2 and _is(buf, at, end, _T8):
                at += _T8.size
            else:
                return at, ODD
            state[LEVEL] = 4
        elif level == 4:
            if _is(buf, at, end, _T3):
                state[SECTION] = 0
                state[LEVEL] = 5
                at += _T3.size
            elif _is(buf, at, end, _T4):
                state[SECTION] = 1
                state[LEVEL] = 5
                at += _T4.size
            elif _is(buf, at, end, _T5):
                state[SECTION] = 2
                state[LEVEL] = 5
                at += _T5.size
            elif _is(buf, at, end, _T1):
                state[LEVEL] = 3
                at += _T1.size
            else:
                return at, ODD
        elif _is(buf, at, end, _T0):
            if state[N_TAGS] >= tags.shape[0]:
                state[BEFORE] = before
                return at, STOPPED
            i = _tag(buf, at, end, cuts)
            if i < 0:
                return at, ODD
            tags[state[N_TAGS], 0] = at
            tags[state[N_TAGS], 1] = i
            tags[state[N_TAGS], 2] = state[N_ELEMENTS]
            state[N_TAGS] += 1
            if not cuts[S_FLAGS] & F_EMPTY:
                state[LEVEL] = 4
            at = i
        elif _is(buf, at, end, _T2):
            state[BEFORE] = before
            return at + _T2.size, DEVICE_END
        else:
            return at, ODD


@_jit
def find_tag(buf, at, end):
    """The next place of ``DeviceStream `` from ``at`` on, -1 when there is none."""
    n = _DEVICE.size
    i = at + n - 1
    while i < end:
        c = buf[i]
        skip = _SKIP[c]
        if skip == 0:
            if _is(buf, i - n + 1, end, _DEVICE):
                return i - n + 1
            skip = 1
        i += skip
    return -1
